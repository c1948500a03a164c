// Signatures: what every unknown of a robot changes in the estimate now. docs/estimation.md.
#pragma once

#include <span>
#include <vector>

#include "population.hpp"

namespace cdrj {

/// The robots that show what an unknown changes.
struct Ends {
    Index more;   // at plus one unit
    Index less;   // at minus one unit
    Index only;   // cable that it changes, as the others of these robots show other unknowns; or
                  // axis, counted after the cables; -1 where it changes several cables
};

/// The signatures of all unknowns of a robot,
///
///     s = (robot at plus one unit - robot at minus one unit) / 2,                              (B2)
///
/// of all quantities of the estimate that have a standard deviation.
///
/// The robots are stepped along with the estimate. A wide difference in place of a derivative shows
/// what an unknown does where it makes cables slack, as in the unscented transform.
class Signatures {
public:
    /// `constants` and `shift`: of all robots by rows, and their angles less those that are read;
    /// `slipping`: whether their cables slip on the drums.
    Signatures(
        const Topology& topology, std::vector<double> constants, std::vector<double> shift,
        std::vector<bool> slipping, std::vector<Ends> unknowns);

    /// Discard the histories of all robots.
    void reset() { std::ranges::fill(robots_.states, 0.0); }

    /// Step all robots to the angles that are read, `dt` after the last ones [s], 0 if unknown; write
    /// the change of every quantity per unit of every unknown, by rows.
    void follow(
        std::span<const double> motor_angle, std::span<const double> joint_angle, double dt,
        std::span<double> slopes);

    Index unknowns() const { return std::ssize(unknowns_); }
    Index quantities() const { return efforts_at_ + sizes_.axes(); }

private:
    void step(
        Index robot, std::span<const double> motor_angle, std::span<const double> joint_angle, double dt);
    void compare(const Ends& ends, Index first, Index count, std::span<double> slopes) const;
    void compare_cable(const Ends& ends, std::span<double> slopes) const;
    double effort(Index robot, Index cable, Index axis) const;

    const Topology& topology_;
    const Sizes& sizes_;
    const Index tensions_at_, forces_at_, efforts_at_;  // the first quantities of these kinds
    Population robots_;
    const std::vector<double> shift_;
    const std::vector<bool> slipping_;
    const std::vector<Ends> unknowns_;
    std::vector<double> angle_;    // of the robot in progress
    std::vector<double> out_;      // of `Robot::advance`
    std::vector<double> values_;   // quantities of all robots, by rows
    std::vector<double> efforts_;  // of every cable on every axis, by rows, robot after robot
};

}  // namespace cdrj

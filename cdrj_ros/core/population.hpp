// Populations of robots: those of signatures (B2), and the members of an ensemble.
#pragma once

#include <span>
#include <vector>

#include "robot.hpp"

namespace cdrj {

/// Robots of one topology, each with constants and a history of its own.
class Population {
public:
    /// `constants`: of all robots, see `cdrj_ros.model.packing`, stored by rows.
    Population(const Topology& topology, std::size_t robots, std::vector<double> constants);

    // robots view arrays of this object
    Population(const Population&) = delete;
    Population& operator=(const Population&) = delete;

    Index size() const { return static_cast<Index>(robots_.size()); }
    const Robot& operator[](Index k) const { return robots_[k]; }

    /// State of robot `k`; zeros before its first sample.
    std::span<double> state(Index k) {
        const std::size_t size = states.size() / robots_.size();
        return std::span(states).subspan(static_cast<std::size_t>(k) * size, size);
    }

    /// One sample of robot `k`, whose state becomes the new one; `dt` and `out` as of
    /// `Robot::advance`. False: not solved.
    bool advance(
        Index k, std::span<const double> motor_angle, std::span<const double> joint_angle, double dt,
        double* out);

    std::vector<double> constants;  // Python holds views of both: they are never moved
    std::vector<double> states;

private:
    std::vector<Robot> robots_;
};

}  // namespace cdrj

// Which errors of clocks, and which ages of values, the mean tensions leave possible.
//
// Friction moves tension along a cable but leaves its mean, so the mean shows what an error of an angle
// is worth: by how much it swings, and by what follows the velocity. (U13) and (U18) of
// docs/estimation.md.
#pragma once

#include <span>
#include <vector>

#include "blocks.hpp"
#include "lag_fit.hpp"
#include "records.hpp"

namespace cdrj {

/// Lags of one robot's axes, as its mean tensions bound them.
class Lags {
public:
    /// gains: change of every cable's mean tension by every axis [N/rad], by rows.
    Lags(std::size_t axes, std::vector<double> gains);

    /// Takes the standard deviations of lasting errors, as `Sample::offset`.
    void take_offset(std::span<const double> offset);

    /// These, as last taken.
    std::span<const double> offset() const { return std::span(numbers).first(2 * axes_); }

    /// Computes all shares anew, after changes of `numbers` by others.
    void renew();

    /// Takes the angles of a sample and the mean tensions of the cables; whether greatest speeds have
    /// changed.
    ///
    /// unread: what the mean tensions may be off by because axes had not been read. Where that is not
    /// zero, they show it, not a lag.
    bool take(
        Nanoseconds stamp_ns, std::span<const double> angles, std::span<const double> tensions,
        std::span<const double> unread);

    /// Share of the variance due to lags, (C10), that is possible in a cable, (U13) and (U18).
    double late_share(std::size_t cable) const { return cables_[cable].late_share; }

    /// By how much a cable's mean tension has just changed, beyond how it changed before [N].
    double sudden(std::size_t cable) const { return cables_[cable].sudden; }

    /// Greatest speed of an axis so far [rad/s].
    double fastest(std::size_t axis) const { return numbers[2 * axes_ + axis]; }

    /// Mean and standard deviation of how far an axis lags behind the first one of its cables [s].
    LagFit::Lag lag(std::size_t axis) const;

    std::vector<double> numbers;  // all that is remembered; Python holds a view of it

private:
    /// A cable: its axes, and where its part of `numbers` begins. That part holds the lowest and the highest
    /// mean tension, the same of the velocities of its axes, then `blocks` of both, then `fit`.
    struct Cable {
        std::vector<std::size_t> axes;
        std::vector<double> gains;  // of these [N/rad]
        std::size_t begin;
        Blocks blocks;
        LagFit fit;
        double late_share = 1.0;
        double sudden = 0.0;
    };

    std::span<double> blocks_of(const Cable& cable);
    std::span<double> fit_of(const Cable& cable);
    std::span<const double> fit_of(const Cable& cable) const;
    bool note_speeds(double now, std::span<const double> angles);
    double change(const Cable& cable, double now, double tension);
    void take_cable(Cable& cable, double now, std::span<const double> angles, double tension);
    void fit_to(const Cable& cable);
    void bound(Cable& cable);

    std::size_t axes_;
    Blocks motion_;  // of the angles of all axes, read or not
    std::vector<Cable> cables_;
    std::vector<double> values_;  // of a cable that is being taken
    std::vector<double> velocity_, acceleration_, angle_;  // of the stretch in progress
};

}  // namespace cdrj

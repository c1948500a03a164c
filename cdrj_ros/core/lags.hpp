// Which errors of clocks, and which ages of values, the mean tensions leave possible.
//
// Friction moves tension along a cable but leaves its mean, so the mean shows what an error of an angle
// is worth: by how much it swings, and by what follows the velocity. (U13) and (U18) of
// docs/estimation.md.
#pragma once

#include <span>
#include <vector>

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

    /// Takes the angles of a sample and the mean tensions of the cables; whether greatest speeds may
    /// have changed.
    bool take(
        Nanoseconds stamp_ns, std::span<const double> angles, std::span<const double> tensions);

    /// Share of the variance due to lags, (C10), that is possible in a cable, (U13) and (U18).
    double late_share(std::size_t cable) const { return late_share_[cable]; }

    /// Greatest speed of an axis so far [rad/s].
    double fastest(std::size_t axis) const;

    /// Mean and standard deviation of how far an axis lags behind the first one of its cables [s].
    LagFit::Lag lag(std::size_t axis) const;

    std::vector<double> numbers;  // all that is remembered; Python holds a view of it

private:
    /// Means over a few samples.
    struct Block {
        std::span<double> numbers;  // count, begin, time since then, mean tensions, angles

        double& count() const { return numbers[0]; }
        double time() const { return numbers[1] + numbers[2]; }  // [s]
    };

    Block block(std::size_t k);
    std::span<double> swing(std::size_t cable) { return std::span(numbers).subspan(2 * (axes_ + cable), 2); }
    std::span<double> range(std::size_t axis) {
        return std::span(numbers).subspan(2 * (axes_ + cables_ + axis), 2);
    }
    std::span<double> memory_of(std::size_t cable);
    std::span<const double> memory_of(std::size_t cable) const;
    bool is_faster(double now, std::span<const double> angles);
    void close();
    void bound(std::size_t cable);

    std::size_t axes_, cables_;
    std::vector<double> gains_;
    std::vector<LagFit> fits_;
    std::vector<std::size_t> begin_;  // of every fit's memory
    std::vector<double> late_share_;
    std::vector<double> velocity_, acceleration_, angle_;  // of the stretch in progress
};

}  // namespace cdrj

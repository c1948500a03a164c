// Lags of the axes of a cable behind each other, as its mean tension shows them.
//
// A value that is older than its stamp gives the angle of an earlier time. That changes the mean tension
// of a cable in proportion to the velocity of the axis, whereas a load changes it with the pose and the
// acceleration, and friction with the direction alone. A recursive regression separates these; its
// result is a mean and a standard deviation of every lag, (U18) of docs/estimation.md.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace cdrj {

/// A short stretch of a motion around its middle, in which means are taken.
struct Stretch {
    double length;                         // [s]
    std::span<const double> velocity;      // of all axes [rad/s]
    std::span<const double> angle;         // of all axes [rad]
    std::span<const double> acceleration;  // of all axes [rad/s^2]
    double mean_tension;                   // of the cable [N]
};

/// What one cable shows of the lags of its axes behind the first one.
class LagFit {
public:
    /// gains: change of the mean tension by every axis [N/rad]; axes with 0 do not act on the cable.
    explicit LagFit(std::span<const double> gains);

    /// Numbers that it remembers.
    std::size_t size() const;

    /// Takes a stretch.
    ///
    /// memory: `size()` numbers, 0 at first.
    /// lag_stddev: standard deviations of the lags of all axes if nothing excludes them [s].
    void take(
        std::span<double> memory, const Stretch& stretch, std::span<const double> lag_stddev) const;

    /// Mean square of what lags add to the mean tension in the fastest motion so far, by what it would be if
    /// the stretches showed nothing; above 1 where they show greater lags.
    double share(std::span<const double> memory, std::span<const double> lag_stddev) const;

    /// Mean and standard deviation of an axis's lag behind the first one [s]; the standard deviation
    /// is infinite where the cable shows nothing of it.
    struct Lag {
        double mean, stddev;
    };
    Lag lag(std::span<const double> memory, std::size_t axis) const;

private:
    /// The parts of the memory.
    template <typename Number>
    struct Parts;

    double prior(std::span<const double> lag_stddev, std::size_t k) const;
    void solve(std::span<double> memory, std::span<const double> lag_stddev) const;

    std::vector<std::size_t> axes_;  // that act on the cable; the others lag behind the first one
    std::vector<double> gains_;      // of these [N/rad]
    std::size_t lags_;               // unknown lags
    std::size_t terms_;              // these, and what load and friction do
};

}  // namespace cdrj

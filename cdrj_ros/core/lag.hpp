// How far the readings of an axis lag those of the others, by their stamps when they arrive.
//
// The least lag of many readings is that of a topic that is always late, or of a clock that is behind.
// Nothing in the stamps tells which, so it is in the standard deviations, (C10) of
// docs/conditioning.md.
#pragma once

#include "records.hpp"

namespace cdrj {

/// The newest stamp of all axes.
struct Newest {
    Nanoseconds stamp_ns = -1;   // -1 before the first reading
    std::int64_t count = 0;      // how often it has grown
    Nanoseconds passed_ns = 0;   // in all, by 5 ms at most at a time
    std::size_t there = 0;       // axes with a reading of this stamp
    Nanoseconds common_ns = -1;  // the last stamp that readings of all axes had

    void take(Nanoseconds of_ns, std::size_t axes);
};

/// The least lag within the last window of one axis, and how it grows.
struct Lag {
    Nanoseconds lag_ns = 0;  // in the last complete window, or less since; in the first one so far
    double growth = 0.0;     // of the lag since the first window, per time

    /// Takes the stamp of a reading, and the newest one when it arrives.
    void take(Nanoseconds stamp_ns, const Newest& newest);

    /// The greatest error of the axis's clock that it leaves possible, (C10).
    Nanoseconds most_ns() const { return lag_ns + step_ns_; }

private:
    void measure_step(const Newest& newest);

    Nanoseconds step_ns_ = 0;         // by which newest stamps differ on average, in the last window;
                                      // 0 if all axes shared a stamp in it, as those of one clock do
    Newest before_;                   // at the begin of the window in progress
    Nanoseconds begin_ns_ = -1;       // of the window in progress
    Nanoseconds least_ns_ = EVER_NS;  // in it
    int count_ = 0;                   // readings in it
    Nanoseconds first_ns_ = -1;       // end of the first window; -1 before it
    Nanoseconds first_lag_ns_ = 0;    // in that window
};

}  // namespace cdrj

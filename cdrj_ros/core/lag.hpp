// How far the readings of an axis lag those of the others, by their stamps when they arrive.
//
// The least lag of many readings is that of a topic that is always late, or of a clock that is behind.
// Nothing in the stamps tells which. It has no effect on samples. See docs/conditioning.md.
#pragma once

#include "records.hpp"

namespace cdrj {

/// The least lag within the last window of one axis, and how it grows.
struct Lag {
    Nanoseconds lag_ns = 0;  // in the last complete window, or less since; 0 before it
    double growth = 0.0;     // of the lag since the first window, per time

    /// Takes the stamp of a reading, and the newest one when it arrives.
    void take(Nanoseconds stamp_ns, Nanoseconds newest_ns);

private:
    Nanoseconds begin_ns_ = -1;       // of the window in progress
    Nanoseconds least_ns_ = EVER_NS;  // in it
    int count_ = 0;                   // readings in it
    Nanoseconds first_ns_ = -1;       // end of the first window; -1 before it
    Nanoseconds first_lag_ns_ = 0;    // in that window
};

}  // namespace cdrj

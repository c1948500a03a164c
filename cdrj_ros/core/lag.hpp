// How far the readings of an axis lag those of the others, by their stamps when they arrive.
//
// The least lag of many readings is that of a topic that is always late, or of a clock that is behind.
// Nothing in the stamps tells which. A reading has arrived before the next one of another axis, which
// bounds by how much the clock can be behind; this is in the standard deviations, (C10) of
// docs/conditioning.md.
#pragma once

#include <cstddef>
#include <vector>

#include "records.hpp"

namespace cdrj {

/// The least lag within the last window of one axis, and how it grows.
struct Lag {
    Nanoseconds lag_ns = 0;  // in the last complete window, or less since; in the first one so far
    double growth = 0.0;     // of the lag since the first window, per time
    Nanoseconds most_ns = 0;  // by how much the axis's clock may be behind others, D of (C10)

    /// Takes the stamp of a reading of another axis.
    void meet(std::size_t axis, Nanoseconds stamp_ns);

    /// Takes the stamp of a reading of this axis.
    void take(Nanoseconds stamp_ns);

private:
    /// Another axis.
    struct Other {
        Nanoseconds newest_ns = -1;       // its newest stamp
        // In the window in progress:
        Nanoseconds least_ns = EVER_NS;  // from a stamp of this axis to its next one
        int shared = 0;                  // readings of this axis that have its newest stamp
    };

    std::vector<Other> others_;
    Nanoseconds last_ns_ = -1;        // the last stamp of this axis
    Nanoseconds begin_ns_ = -1;       // of the window in progress
    Nanoseconds least_ns_ = EVER_NS;  // lag in it
    int count_ = 0;                   // readings of this axis in it
    Nanoseconds first_ns_ = -1;       // end of the first window; -1 before it
    Nanoseconds first_lag_ns_ = 0;    // in that window
};

}  // namespace cdrj

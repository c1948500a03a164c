// An angle between the counts of its sensor: a tracking filter that stays within what was read.
//
// A sensor of low resolution says the same for many samples and then jumps by a count, while the
// angle moves on. A critically damped third-order tracking filter (g-h-k, fading memory; E.
// Brookner, Tracking and Kalman Filtering Made Easy, 1998, ch. 1; N. Morrison, 1969, ch. 13) follows
// constant acceleration without lag, and is kept within half a count and three standard deviations
// of every reading: however badly it suits the motion, it errs by no more than twice the sensor's
// errors.
//
// On request its bandwidth rises with the motion, (C6) of docs/conditioning.md: the lag grows with
// the jerk, the counts' error with the bandwidth, and the bandwidth at which their sum is smallest
// follows from the speed and the acceleration of the last seconds.
#pragma once

#include "records.hpp"

namespace cdrj {

/// Filter of one axis.
class TrackingFilter {
public:
    /// The angle at a reading, (C1), within `band` of it.
    ///
    /// `since_ns` is the time since the reading before, ignored at the first one. After a silence
    /// of a whole period of the bandwidth the filter starts anew.
    ///
    /// bandwidth: of the filter [Hz], positive.
    /// band: greatest difference of angle and reading.
    /// adaptive: whether the bandwidth rises with the motion.
    double track(
        Nanoseconds since_ns, double reading, double bandwidth, double band, bool adaptive);

    /// Whether a chord shows that the axis moves; only an adaptive filter looks.
    bool moves() const { return moves_; }

private:
    double adapted(double dt, double reading, double bandwidth, double band);

    double readings_ = 0.0;      // their number since the filter started; 0 before the first
    double angle_ = 0.0;
    double speed_ = 0.0;         // [rad/s]
    double acceleration_ = 0.0;  // [rad/s^2]

    double begun_ = 0.0;    // reading at the beginning of the chord that is being taken
    double since_ = 0.0;    // its length so far [s]
    double chord_ = 0.0;    // mean velocity over the last chord [rad/s]
    double length_ = 0.0;   // length of the last chord [s]; 0 before the first
    double fastest_ = 0.0;  // V of (C6) [rad/s]
    double hardest_ = 0.0;  // A of (C6) [rad/s^2]
    bool moves_ = false;
};

}  // namespace cdrj

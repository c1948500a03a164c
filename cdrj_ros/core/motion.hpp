// The motion of an axis from its readings: its speed and acceleration, what they allow between two readings, and
// its angle between the counts of its sensor. Equations (C1) to (C4) and (C6) of docs/estimation.md.
#pragma once

#include <algorithm>

#include "records.hpp"

namespace cdrj {

/// Speeds are averaged over at least this time.
inline constexpr Nanoseconds WINDOW_NS = 100'000'000;

/// How fast an axis moves at least.
struct LeastMotion {
    double speed = 0.0;         // [rad/s]
    double acceleration = 0.0;  // [rad/s^2]; 0 if nothing is known
};

/// Running estimates of an axis's speed and acceleration.
struct Motion {
    double band = 0.0;            // greatest error of a reading
    double negligible = 0.0;      // standard deviations up to this are not reported, positive
    Nanoseconds begin_ns = -1;    // first reading of the current window; -1 before the first one
    double begin = 0.0;           // angle there
    Nanoseconds part_ns = -1;     // first reading of the part in progress
    double part = 0.0;            // angle there
    double part_span = 0.0;       // length of the part before it [s]; 0 if there is none
    double part_velocity = 0.0;   // mean over that part [rad/s]
    double span = 0.0;            // length of the last window [s]
    double velocity = 0.0;        // mean over the last window [rad/s]
    double speed = 0.0;           // V of (C2): rises at once and decays [rad/s]
    double acceleration = 0.0;    // A of (C2) [rad/s^2]
    double fastest = 0.0;         // greatest speed so far over a part (20 ms or more) or a window [rad/s]
    double travelled = 0.0;       // sum of the displacements of all windows
    double windows = 0.0;         // their number
    double lowest = INFINITE, highest = -INFINITE;  // velocities over windows so far [rad/s]
    double bend = 0.0;            // B of (C4), the acceleration that extrapolations missed [rad/s^2]
    Nanoseconds seen_ns = EVER_NS;  // between readings no further apart, deviations are negligible

    /// Takes the next reading of the axis, (C2).
    void take(Nanoseconds stamp_ns, double angle);

    /// What stays valid when the clock of the readings changes: all but the current window.
    Motion without_window() const;

    /// Greatest error of a reading; where the file states none, what counts for nothing.
    double error() const { return band > 0.0 ? band : negligible; }

    /// Whether the motion so far tells what may happen between readings so far apart.
    bool knows(Nanoseconds span_ns) const;

    /// Curvature of (C3) between two readings, 4 s / T^2 [rad/ns^2].
    ///
    /// The standard deviation of the angle is this times the times to both readings. 0 where it is
    /// negligible everywhere between them, infinite where it is unknown.
    ///
    /// least: what the other axes show of its motion.
    double curvature(Nanoseconds span_ns, const LeastMotion& least = {}) const;

    /// Whether it turns within a time that its readings, `usual_ns` apart, resolve.
    bool turns_within(Nanoseconds span_ns, Nanoseconds usual_ns) const;

    /// Takes the error of an angle that was extrapolated with the velocity over a window, (C4).
    void miss(Nanoseconds horizon_ns, Nanoseconds window_ns, double error);

    /// Standard deviation of an angle extrapolated with the velocity over a window, (C4).
    double ahead(Nanoseconds horizon_ns, Nanoseconds window_ns) const;

    /// By how much the velocity has differed so far [rad/s].
    double range() const { return std::max(highest - lowest, 0.0); }

    /// Greatest displacement within a time [s] at up to twice the greatest speed so far.
    double reach(double span) const;

private:
    void close(double span, double moved);
    void close_part(double length, double moved);
    Nanoseconds seen() const;
};

/// An angle between the counts of its sensor: a tracking filter that stays within what was read.
///
/// A sensor of low resolution says the same for many samples and then jumps by a count, while the
/// angle moves on. A critically damped third-order tracking filter (g-h-k, fading memory; E.
/// Brookner, Tracking and Kalman Filtering Made Easy, 1998, ch. 1; N. Morrison, 1969, ch. 13) follows
/// constant acceleration without lag, and is kept within half a count and three standard deviations
/// of every reading: however badly it suits the motion, it errs by no more than twice the sensor's
/// errors.
///
/// On request its bandwidth rises with the motion, (C6) of docs/estimation.md: the lag grows with
/// the jerk, the counts' error with the bandwidth, and the bandwidth at which their sum is smallest
/// follows from the speed and the acceleration of the last seconds.
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
    bool moves_ = false;     // whether a chord shows that the axis moves; only an adaptive filter looks
};

}  // namespace cdrj

// Speed and acceleration of an axis, and the motion that they allow between two readings.
//
// Equations (C2) to (C4) of docs/conditioning.md.
#pragma once

#include <algorithm>

#include "records.hpp"

namespace cdrj {

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
    Motion elsewhen() const;

    /// Whether the motion so far tells what may happen between readings so far apart.
    bool knows(Nanoseconds span_ns) const;

    /// Curvature of (C3) between two readings, 4 s / T^2 [rad/ns^2].
    ///
    /// The standard deviation of the angle is this times the times to both readings. 0 where it is
    /// negligible everywhere between them, infinite where it is unknown.
    double curvature(Nanoseconds span_ns) const;

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

}  // namespace cdrj

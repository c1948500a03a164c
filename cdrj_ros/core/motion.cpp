#include "motion.hpp"

#include <algorithm>
#include <cmath>

namespace cdrj {
namespace {

constexpr Nanoseconds WINDOW_NS = 100'000'000;  // speeds are averaged over at least this time
constexpr Nanoseconds PART_NS = 20'000'000;     // the greatest speed, over at least this one
constexpr double SLOW = 2e-9 * WINDOW_NS;       // windows longer than this are chords [s]
constexpr double CHORDS = 1.5;       // factor for accelerations from chords of a third of a period
constexpr double MEMORY = 10.0;      // time constant with which V and A decay [s]
constexpr double WINDOWS = 3.0;      // windows of a slow channel after which its motion is known
constexpr Nanoseconds FAR_NS = 1'000'000'000;  // beyond it, a moving axis may have been anywhere
constexpr double NOISE = 0.8165;     // of two readings with errors up to 1, sqrt(2 / 3)
constexpr double STILL = 0.01;       // an axis that moves by no more between two readings is at rest

/// Weighted root mean square of the old and the new value.
double faded(double before, double now, double keep) {
    return std::sqrt(before * before * keep + now * now * (1.0 - keep));
}

}  // namespace

void Motion::take(Nanoseconds stamp_ns, double angle) {
    if (begin_ns >= 0 && stamp_ns >= begin_ns) {  // else the clock went back during a restart
        if (stamp_ns - part_ns >= PART_NS) {
            close_part((stamp_ns - part_ns) * 1e-9, angle - part);
            part_ns = stamp_ns;
            part = angle;
        }
        if (stamp_ns - begin_ns < WINDOW_NS) return;
        close((stamp_ns - begin_ns) * 1e-9, angle - begin);
    }
    if (part_ns != stamp_ns) part_span = 0.0;
    begin_ns = part_ns = stamp_ns;
    begin = part = angle;
}

/// Ends a part of `length` [s] in which the axis has moved by `moved`.
void Motion::close_part(double length, double moved) {
    const double mean = moved / length;
    fastest = std::max(fastest, (std::abs(moved) - 2.0 * band) / length);
    if (part_span > 0.0) {
        const double noise = 2.0 * band * (1.0 / length + 1.0 / part_span);
        const double change = std::abs(mean - part_velocity) - noise;
        acceleration = std::max(acceleration, change / (0.5 * (length + part_span)));
        seen_ns = seen();
    }
    part_span = length;
    part_velocity = mean;
}

/// Ends a window of `length` [s] in which the axis has moved by `moved`.
void Motion::close(double length, double moved) {
    const double mean = moved / length;
    const double certain = std::max(std::abs(moved) - 2.0 * band, 0.0);
    const double now = certain / length;
    fastest = std::max(fastest, now);
    double change = 0.0;
    if (span > 0.0) {
        change = std::max(std::abs(mean - velocity) - 2.0 * band / length, 0.0);
        change /= 0.5 * (length + span);
    } else if (length > SLOW) {  // the first window of a slow channel gives no better estimate
        change = now / length;
    }
    if (length > SLOW) change *= CHORDS;
    const double keep = std::exp(-length / MEMORY);
    speed = std::max(now, faded(speed, now, keep));
    acceleration = std::max(change, faded(acceleration, change, keep));
    lowest = std::min(lowest, std::copysign(now, moved));
    highest = std::max(highest, std::copysign(now, moved));
    travelled += certain;
    windows += 1.0;
    span = length;
    velocity = mean;
    seen_ns = seen();
}

/// `seen_ns` by the speed and the acceleration so far.
Nanoseconds Motion::seen() const {
    if (!(speed > 0.0 && acceleration > 0.0)) return EVER_NS;
    const double slow = 3.0 * negligible / speed;
    const double smooth = std::sqrt(8.0 * negligible / acceleration);
    const bool resolved = acceleration * smooth <= speed;
    const double seconds = std::min(resolved ? std::max(slow, smooth) : slow, 1e9);
    return static_cast<Nanoseconds>(seconds * 1e9);
}

Motion Motion::elsewhen() const {
    Motion later = *this;
    later.begin_ns = -1;
    later.begin = later.span = later.velocity = later.part_span = 0.0;
    later.seen_ns = seen();
    return later;
}

bool Motion::knows(Nanoseconds span_ns) const {
    if (span_ns <= WINDOW_NS) return true;
    const bool still = speed * span_ns * 1e-9 <= STILL;
    return windows > WINDOWS && (span_ns <= FAR_NS || still);
}

double Motion::curvature(Nanoseconds span_ns) const {
    if (!knows(span_ns)) return INFINITE;
    if (span_ns <= seen_ns) return 0.0;
    const double length = span_ns * 1e-9, bend = acceleration * length;
    const double unresolved = speed > 0.0 ? std::max(bend / speed, 1.0) : 1.0;
    const double sagitta =
        std::min(bend * length / 8.0 * unresolved * unresolved, std::max(speed, bend) * length / 3.0);
    return 4.0 * sagitta / (static_cast<double>(span_ns) * static_cast<double>(span_ns));
}

void Motion::miss(Nanoseconds horizon_ns, Nanoseconds window_ns, double error) {
    const double horizon = horizon_ns * 1e-9, window = window_ns * 1e-9;
    const double certain = std::max(std::abs(error) - 2.0 * band * (1.0 + horizon / window), 0.0);
    const double now = certain / (0.5 * horizon * (horizon + window));
    bend = std::max(now, faded(bend, now, std::exp(-horizon / MEMORY)));
}

double Motion::ahead(Nanoseconds horizon_ns, Nanoseconds window_ns) const {
    const double horizon = horizon_ns * 1e-9, window = window_ns * 1e-9;
    const double arc = 0.5 * horizon * (horizon + window);
    const bool turned = 2.0 * std::max(std::min(highest, -lowest), 0.0) >= speed;
    const double known = turned ? acceleration : std::max(acceleration, speed * 1e9 / WINDOW_NS);
    const double drift = std::max(std::min(known * arc, 2.0 * speed * horizon), bend * arc);
    const double noise = NOISE * band * horizon / window;
    return std::sqrt(drift * drift + noise * noise);
}

double Motion::reach(double length) const {
    return std::max(2.0 * band, 2.0 * fastest * length);
}

}  // namespace cdrj

#include "motion.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace cdrj {
namespace {

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

Motion Motion::without_window() const {
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

double Motion::curvature(Nanoseconds span_ns, const LeastMotion& least) const {
    if (!knows(span_ns)) return INFINITE;
    if (span_ns <= seen_ns && least.acceleration == 0.0) return 0.0;
    const double fast = std::max(speed, least.speed);
    const double length = span_ns * 1e-9;
    const double bend = std::max(acceleration, least.acceleration) * length;
    const double unresolved = fast > 0.0 ? std::max(bend / fast, 1.0) : 1.0;
    const double sagitta =
        std::min(bend * length / 8.0 * unresolved * unresolved, std::max(fast, bend) * length / 3.0);
    return 4.0 * sagitta / (static_cast<double>(span_ns) * static_cast<double>(span_ns));
}

bool Motion::turns_within(Nanoseconds span_ns, Nanoseconds usual_ns) const {
    return acceleration * (span_ns * 1e-9) > speed && acceleration * (usual_ns * 1e-9) <= speed;
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

// -------------------------------------------------------------------------------------------------
// The angle between counts

namespace {

constexpr double FAR = 1e15;          // the filter starts anew where its prediction exceeds this
constexpr double CHORD = 0.03;        // shortest time over which a mean velocity is taken [s]
constexpr double FORGET = 2.0;        // time constant with which V and A are forgotten [s]
constexpr double LAG = 6.0 / 2.0625;  // factor of J^2 / (sigma^2 dt) in (C6)
constexpr double WHOLE_ERROR = 0.077;  // bandwidth times dt at which the filter passes it all
constexpr double MANY = 1e6;          // readings beyond this number weigh nothing more

}  // namespace

double TrackingFilter::track(
    Nanoseconds since_ns, double reading, double bandwidth, double band, bool adaptive) {
    const double dt = since_ns * 1e-9;
    double angle = angle_ + speed_ * dt + 0.5 * acceleration_ * dt * dt;
    if (readings_ == 0.0 || dt * bandwidth > 1.0 || !(std::abs(angle) < FAR)) {
        readings_ = 1.0;
        angle_ = begun_ = reading;
        speed_ = acceleration_ = since_ = length_ = 0.0;
        return reading;
    }
    if (adaptive && band > 0.0) bandwidth = adapted(dt, reading, bandwidth, band);

    const double n = readings_ + 1.0;
    readings_ = std::min(n, MANY);
    const double theta = std::exp(-2.0 * std::numbers::pi * bandwidth * dt), fresh = 1.0 - theta;
    // at first all readings count alike (growing memory), later the recent ones more
    const double many = n * (n + 1.0) * (n + 2.0);
    const double g =
        std::max(1.0 - theta * theta * theta, 3.0 * (3.0 * n * n - 3.0 * n + 2.0) / many);
    double h = std::max(1.5 * (fresh * fresh) * (1.0 + theta), 18.0 * (2.0 * n - 1.0) / many);
    double k = std::max(fresh * fresh * fresh, 60.0 / many);
    if (n < 3.0) {  // a line through two readings, no parabola yet
        h = 1.0;
        k = 0.0;
    }
    const double off = reading - angle;
    angle += std::min(g, 1.0) * off;
    speed_ = speed_ + acceleration_ * dt + h * off / dt;
    acceleration_ = acceleration_ + k * off / (dt * dt);
    angle_ = std::min(std::max(angle, reading - band), reading + band);
    return angle_;
}

/// Bandwidth at a reading [Hz], (C6); not below `bandwidth`.
double TrackingFilter::adapted(double dt, double reading, double bandwidth, double band) {
    since_ += dt;
    const double turned = reading - begun_;
    const double moved = std::max(std::abs(turned) - 2.0 * band, 0.0);
    if (moved > 0.0) moves_ = true;
    if (since_ >= CHORD) {
        const double kept = std::exp(-since_ / FORGET), chord = turned / since_;
        if (length_ > 0.0) {
            const double change = std::max(std::abs(chord - chord_) - 4.0 * band / since_, 0.0);
            hardest_ = std::max(2.0 * change / (since_ + length_), hardest_ * kept);
        }
        fastest_ = std::max(moved / since_, fastest_ * kept);
        moves_ = moved > 0.0;
        chord_ = chord;
        length_ = since_;
        begun_ = reading;
        since_ = 0.0;
    }
    if (!moves_ || fastest_ == 0.0) return bandwidth;
    const double jerk = hardest_ * hardest_ / fastest_;
    const double best =
        std::pow(LAG * (jerk * jerk) / (band * band / 3.0 * dt), 1.0 / 7.0) /
        (2.0 * std::numbers::pi);
    return std::max(bandwidth, std::min(best, WHOLE_ERROR / dt));
}

}  // namespace cdrj

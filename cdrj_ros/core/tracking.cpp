#include "tracking.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace cdrj {
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

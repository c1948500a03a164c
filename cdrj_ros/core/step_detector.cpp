#include "step_detector.hpp"

#include <algorithm>
#include <cmath>

namespace cdrj {
namespace {

constexpr Nanoseconds DENSE_NS = 30'000'000;    // in shorter ones no axis moves to and fro
constexpr double TRAVEL = 1.0;     // an axis that has travelled this far has shown its motion
constexpr double BEYOND = 2.5;     // a step exceeds what was unexplained so far by this factor,
constexpr double NOISE = 4.0;      // and the sensor's greatest error by this one
constexpr double PLAIN = 10.0;     // deviation that no noise causes, by the sensor's greatest error
constexpr double OFF_GRID = 0.05;  // deviation from whole counts by rounding [counts]
constexpr double LATELY = 1.0 / 64.0;  // weight of a reading in the share of alternating ones
constexpr double OFTEN = 0.1;      // from this share on two motions alternate,
constexpr double SELDOM = 0.02;    // down to this one
constexpr double MISSED = 1.5;     // readings repeat if the axis would have moved so many times as far
constexpr double MISSED_COUNTS = 10.0;  // as it last did, and by more counts than at a crest (8),
constexpr double STEADY = 0.7;     // at a velocity that had not fallen below this share of that before;
constexpr std::size_t LONGEST = 32;   // within so many readings,
constexpr double LONGEST_S = 0.1;      // or this time [s], if that is longer,
constexpr std::size_t MOST = 100;      // but no more readings

double seconds(Point from, Point to) {
    return (to.stamp_ns - from.stamp_ns) * 1e-9;
}

double velocity(Point from, Point to) {
    return (to.angle - from.angle) / seconds(from, to);
}

/// What of a displacement exceeds any motion between the ones of the intervals before and after, (C5),
/// with its sign, by the noise that it may contain.
double jump(double before, double moved, double after, double noise) {
    const double by = moved - 0.5 * (before + after);
    return std::copysign(std::max(std::abs(by) - 0.5 * std::abs(after - before), 0.0) * noise, by);
}

/// The part of a displacement that neither of two lines explains, from what each leaves.
double unexplained(double one, double other) {
    if (one * other <= 0.0) return 0.0;
    return std::abs(one) < std::abs(other) ? one : other;
}

}  // namespace

/// Whether there are two readings before it, none of them too long ago.
bool StepDetector::is_judged(Point next) const {
    return count_ >= 2 && next.stamp_ns - points_[2].stamp_ns <= WITHIN_NS &&
           points_[2].stamp_ns - points_[1].stamp_ns <= WITHIN_NS;
}

/// Whether neither noise nor a motion to and fro causes a deviation.
bool StepDetector::is_plain(const Motion& motion, Point next, double deviation) const {
    return next.stamp_ns - points_[2].stamp_ns <= DENSE_NS &&
           std::abs(deviation) > PLAIN * motion.error();
}

/// Whether a deviation is that of counts, worth little, which the file does not state: it is no larger than
/// one, and the last readings differ by whole ones, at least two.
bool StepDetector::is_count(const Motion& motion, double worth, double deviation) const {
    if (motion.band > 0.0 || count_size_ >= worth) return false;
    if (std::abs(deviation) > (1.0 + OFF_GRID) * count_size_) return false;
    double least = 0.0, most = 0.0;
    for (std::size_t i = latest_.size() - std::min(latest_.size(), LONGEST); i < latest_.size(); ++i) {
        const double counts = (latest_[i].angle - latest_.back().angle) / count_size_;
        if (std::abs(counts - std::nearbyint(counts)) > OFF_GRID) return false;
        least = std::min(least, counts);
        most = std::max(most, counts);
    }
    return most - least > 2.0 - OFF_GRID;
}

/// Deviation from the line through the last two readings, by the noise that it may contain.
///
/// Stamps may be less even than readings, or readings than stamps, so the line is drawn over the
/// stamps and over the order of readings; what either explains is no deviation.
double StepDetector::bend(Point next) const {
    const double before = points_[2].angle - points_[1].angle, after = next.angle - points_[2].angle;
    const double longer = seconds(points_[2], next) / seconds(points_[1], points_[2]);
    return unexplained((after - before * longer) / (1.0 + longer), 0.5 * (after - before));
}

bool StepDetector::is_off(const Motion& motion, Point next) const {
    if (!is_judged(next)) return false;
    const double deviation = bend(next);
    if (motion.travelled >= TRAVEL) {
        return std::abs(deviation) > std::max(2.0 * motion.band, BEYOND * memory.bend);
    }
    return motion.band > 0.0 && is_plain(motion, next, deviation);
}

double StepDetector::expected(Nanoseconds stamp_ns) const {
    const double rate = count_ >= 2 ? velocity(points_[1], points_[2]) : 0.0;
    return points_[2].angle + rate * seconds(points_[2], {stamp_ns, 0.0});
}

bool StepDetector::returns(Point off, Point next) const {
    const double rate = velocity(points_[1], points_[2]);
    const double first = off.angle - points_[2].angle - rate * seconds(points_[2], off);
    const double second = next.angle - points_[2].angle - rate * seconds(points_[2], next);
    return std::abs(second) < 0.5 * std::abs(first);
}

void StepDetector::restart() {
    count_ = 0;
    latest_.clear();
    equal_ = 0;
    compared_ = repeats_ = false;
}

bool StepDetector::take(const Motion& motion, double worth, Point next, bool off) {
    if (count_ > 0 && next.stamp_ns - points_[2].stamp_ns > WITHIN_NS) restart();
    follow(motion, next);
    const bool found = count_ == 3 && !alternates_ && is_step(motion, worth, next);
    double side = 0.0;
    if (is_judged(next)) {
        const double deviation = bend(next);
        if (!off && !found) memory.bend = std::max(memory.bend, std::abs(deviation));
        const bool plain = is_plain(motion, next, deviation) && next.angle != points_[2].angle;
        if (plain && !is_count(motion, worth, deviation)) side = deviation;
    }
    alternate(side * side_ < 0.0);
    side_ = side;
    if (motion.windows > 0.0) {
        sudden_ = 0.0;
    } else if (count_ > 0) {
        const double sudden = count_ == 1 ? next.angle - points_[2].angle : bend(next);
        sudden_ = std::max(sudden_, std::abs(sudden));
    }
    points_ = {points_[1], points_[2], next};
    count_ = std::min(count_ + 1, 3);
    return found;
}

/// Whether the displacement between the last two readings was a step, (C7); otherwise what it has of
/// unexplained is noted.
bool StepDetector::is_step(const Motion& motion, double worth, Point next) {
    const double before = points_[1].angle - points_[0].angle;
    const double moved = points_[2].angle - points_[1].angle;
    const double after = next.angle - points_[2].angle;
    const double length = seconds(points_[1], points_[2]);
    const double to_before = length / seconds(points_[0], points_[1]);
    const double to_after = length / seconds(points_[2], next);
    const double size = unexplained(
        jump(before * to_before, moved, after * to_after, NOISE / (2.0 + to_before + to_after)),
        jump(before, moved, after, 1.0));
    const double least = std::max(NOISE * motion.band, BEYOND * memory.unexplained);
    const auto beyond = [moved](double earlier, double later) {
        const double by = moved - 0.5 * (earlier + later);
        return std::abs(by) > std::max(std::abs(earlier), std::abs(later)) ? by : 0.0;
    };
    const double by = unexplained(beyond(before * to_before, after * to_after), beyond(before, after));
    if (motion.travelled >= TRAVEL && std::abs(size) > least && by != 0.0) {
        step_by(by, worth);
        return true;
    }
    memory.unexplained = std::max(memory.unexplained, std::abs(size));
    return false;
}

bool StepDetector::differs(const Motion& motion, double one, double other) {
    return std::abs(one - other) > std::max(2.0 * motion.band, motion.negligible);
}

bool StepDetector::contradicts(const Motion& motion, Point earlier) const {
    for (std::size_t i = latest_.size(); i-- > 0;) {
        const Point& before = latest_[i];
        if (before.stamp_ns > earlier.stamp_ns) continue;
        if (before.stamp_ns == earlier.stamp_ns) {
            return differs(motion, earlier.angle, before.angle);
        }
        if (i + 1 == latest_.size() || latest_[i + 1].stamp_ns - before.stamp_ns > WITHIN_NS) break;
        const double line =
            before.angle + velocity(before, latest_[i + 1]) * seconds(before, earlier);
        return differs(motion, earlier.angle, line) &&
               std::abs(earlier.angle - line) > BEYOND * memory.bend;
    }
    return false;
}

void StepDetector::note_contradiction() {
    share_ = std::max(share_, OFTEN);
    alternates_ = true;
}

/// Compares the readings that are alike with as many before them, and those with as many before, (C12).
void StepDetector::follow(const Motion& motion, Point next) {
    const double change = latest_.empty() ? 0.0 : std::abs(next.angle - latest_.back().angle);
    if (change > 0.0) count_size_ = std::min(count_size_, change);
    if (!latest_.empty() && stays(motion, next.angle)) {
        ++equal_;
    } else {
        equal_ = 0;
        compared_ = repeats_ = false;
        still_ = next.angle;
        still_since_ns_ = next.stamp_ns;
    }
    latest_.push_back(next);
    if (latest_.size() > 3 * MOST + 1) latest_.pop_front();
    if (compared_ || equal_ == 0 || equal_ > MOST || latest_.size() <= 3 * equal_) return;
    const auto ago = [&](std::size_t count) { return latest_[latest_.size() - 1 - count]; };
    const Point still = ago(equal_), before = ago(2 * equal_);
    if (equal_ > LONGEST && seconds(still, next) > LONGEST_S) return;
    const double rate = velocity(before, still), earlier = velocity(ago(3 * equal_), before);
    const double missed = std::abs(rate) * seconds(still, next);
    const double last = std::abs(still.angle - ago(equal_ + 1).angle);
    compared_ =
        missed > std::max({PLAIN * motion.error(), MISSED_COUNTS * count_size_, MISSED * last});
    const double late = velocity(ago(equal_ + (equal_ + 1) / 2), still);
    const bool slows_down = STEADY * std::max(earlier * rate, rate * rate) >
                            std::min(rate * rate, late * rate);
    repeats_ = compared_ && !slows_down;
    if (repeats_) repeated_since_ns_ = still.stamp_ns;
}

void StepDetector::alternate(bool does) {
    share_ += LATELY * ((does ? 1.0 : 0.0) - share_);
    if (share_ > OFTEN) alternates_ = true;
    if (share_ < SELDOM) alternates_ = false;
}

void StepDetector::step_by(double by, double worth) {
    memory.displaced += by;
    memory.stepped = std::abs(memory.displaced) > worth;
}

double StepDetector::offset(const Motion& motion) const {
    const double hidden = DEVIATION * std::max({memory.unexplained, sudden_, 2.0 * motion.band});
    return std::hypot(hidden, memory.displaced);
}

}  // namespace cdrj

#include "channel.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace cdrj {
namespace {

constexpr Nanoseconds LATE_INTERVALS = 3;  // a gap is longer than so many usual intervals
constexpr Nanoseconds AWAITED_NS = 250'000'000;  // half of a node's default timeout, so that none is STALE for it
constexpr Nanoseconds REGULAR = 2;         // regular intervals differ by less than this factor
constexpr Nanoseconds SPEED_WINDOW_NS = 20'000'000;     // the velocity is averaged over this time
constexpr Nanoseconds SHORTEST_WINDOW_NS = 10'000'000;  // and not over less where readings are lost
constexpr std::size_t RECENT = 1000;       // readings kept for it at most
constexpr int STRAGGLERS = 100;            // that a channel may deliver after a jump back
constexpr Nanoseconds LAG_WINDOW_NS = 500'000'000;     // shortest window over which a lag is taken
constexpr int LAG_READINGS = 8;            // fewest readings in one
constexpr double ARRIVAL = 1e-3;           // standard deviation of even times of arrival [s]
constexpr Nanoseconds EVEN_NS = 1'000'000;  // and what tells no speed
constexpr double UNEVEN_FADES = 10.0;      // time constant [s], that of (C2)
constexpr Nanoseconds OLDEST_NS = 45'000'000;  // a value may be so much older, unless that is stated
constexpr double DEGREES = 180.0 / std::numbers::pi;  // in a radian
constexpr double BETWEEN = 0.1;            // a change is no multiple if it is so far from the nearest one
constexpr double FINER = 0.22;             // logarithm of 1.25

/// The nearest whole number, the even one of two; the current rounding mode is the default.
std::int64_t nearest(double number) {
    return static_cast<std::int64_t>(std::nearbyint(number));
}

bool is_in_range(const Axis& axis, double angle) {
    return axis.lower - RANGE_MARGIN <= angle && angle <= axis.upper + RANGE_MARGIN;
}

/// Linear interpolation between the points of a correction, constant beyond its ends.
double correction_at(const Axis& axis, double angle) {
    const std::vector<double>& at = axis.corrected_at;
    const std::vector<double>& value = axis.correction;
    if (angle <= at.front()) return value.front();
    if (angle >= at.back()) return value.back();
    const auto after = std::upper_bound(at.begin(), at.end(), angle) - at.begin();
    const auto before = after - 1;
    const double slope = (value[after] - value[before]) / (at[after] - at[before]);
    return slope * (angle - at[before]) + value[before];
}

/// The next of few values, each a quarter above the one before, so that changes are few.
double level(double value) {
    if (!(value > 0.0)) return 0.0;
    return std::exp(FINER * std::ceil(std::log(value) / FINER));
}

}  // namespace

void Lag::meet(std::size_t axis, Nanoseconds stamp_ns) {
    if (others_.size() <= axis) others_.resize(axis + 1);
    Other& other = others_[axis];
    if (std::exchange(other.since, heard_) != heard_) other.heard_ns = other.newest_ns;
    const Nanoseconds passed_ns = stamp_ns - other.newest_ns;
    if (passed_ns > MAX_GAP_NS) other.heard_ns += passed_ns;  // a gap, another time, or the first reading
    silent_ns = std::max(silent_ns, stamp_ns - other.heard_ns);
    other.newest_ns = stamp_ns;
    other.is_new = true;
    if (last_ns_ < 0) return;
    if (stamp_ns == last_ns_) ++other.shared;
    other.least_ns = std::min(other.least_ns, std::max<Nanoseconds>(stamp_ns - last_ns_, 0));
}

void Lag::take(Nanoseconds stamp_ns) {
    last_ns_ = stamp_ns;
    ++count_;
    Nanoseconds newest_ns = -1, most = 0;
    bool differs = false;
    for (Other& other : others_) {
        if (other.newest_ns < 0) continue;  // this axis, or a silent one
        newest_ns = std::max(newest_ns, other.newest_ns);
        if (std::exchange(other.is_new, false) && other.newest_ns == stamp_ns) ++other.shared;
        const bool one_clock = 2 * other.shared >= count_;
        const bool met = other.least_ns != EVER_NS;
        differs = differs || !one_clock;
        most = std::max(most, one_clock ? 0 : met ? other.least_ns : most_ns);
    }
    if (newest_ns < 0) return;
    const Nanoseconds behind_ns = std::max<Nanoseconds>(newest_ns - stamp_ns, 0);
    if (begin_ns_ < 0) begin_ns_ = stamp_ns;
    least_ns_ = std::min(least_ns_, behind_ns);
    lag_ns = first_ns_ < 0 ? least_ns_ : std::min(lag_ns, behind_ns);
    if (first_ns_ < 0) {
        most_ns = most;
        apart = differs;
    }
    if (count_ < LAG_READINGS || stamp_ns - begin_ns_ < LAG_WINDOW_NS) return;
    lag_ns = least_ns_;
    most_ns = most;
    apart = differs;
    if (first_ns_ < 0) {
        first_ns_ = stamp_ns;
        first_lag_ns_ = lag_ns;
    } else {
        growth = static_cast<double>(lag_ns - first_lag_ns_) /
                 static_cast<double>(stamp_ns - first_ns_);
    }
    begin_ns_ = stamp_ns;
    least_ns_ = EVER_NS;
    for (Other& other : others_) other = {other.newest_ns, other.heard_ns, other.since};
    count_ = 0;
}

void Arrivals::take(Nanoseconds arrival_ns) {
    const Nanoseconds interval_ns = last_ns_ < 0 ? -1 : arrival_ns - last_ns_;
    last_ns_ = arrival_ns;
    if (interval_ns < 0 || interval_ns > MAX_GAP_NS) return;
    const Nanoseconds before_ns = std::exchange(interval_ns_, interval_ns);
    if (before_ns < 0) return;
    const double difference = std::abs(interval_ns - before_ns) * 1e-9;
    uneven_ = std::max(difference, uneven_ * std::exp(-interval_ns * 1e-9 / UNEVEN_FADES));
}

double Arrivals::stddev() const {
    return last_ns_ < 0 ? 0.0 : std::hypot(ARRIVAL, DEVIATION * uneven_);
}

Channel::Channel(const Axis& axis) {
    motion.band = axis.band;
    motion.negligible = axis.negligible;
}

void Channel::take_over(const Channel& earlier) {
    motion = earlier.motion.without_window();
    steps.memory = earlier.steps.memory;
    left_behind_ns = earlier.last_ns;
}

void Channel::keep_turns(const Channel& earlier) {
    turns = earlier.turns;
    motion = earlier.motion.without_window();
    steps.memory.bend = earlier.steps.memory.bend;
    steps.memory.unexplained = earlier.steps.memory.unexplained;
}

void Channel::keep_turns_for_a_while(const Channel& earlier) {
    before_ = earlier.turns;
    before_.stamp_ns = earlier.last_ns;
}

void Channel::go_on_turning(Nanoseconds stamp_ns) {
    const Turns before = before_;
    before_ = {};
    if (before.stamp_ns < 0) return;
    const Nanoseconds since_ns = stamp_ns - before.stamp_ns;
    if (0 < since_ns && since_ns <= MAX_GAP_NS) turns = before;
}

/// Number of periods to add to a first reading: angle in range, and nearest to the expected one.
std::int64_t Channel::first_turn(const Axis& axis, double reading) const {
    const double wanted = near.value_or(axis.start);
    const double exact = ((wanted - axis.offset) / axis.scale - reading) / axis.period;
    if (!(std::abs(exact) < LARGEST)) return 0;
    const std::int64_t turn = nearest(exact);
    for (const std::int64_t candidate : {turn, turn - 1, turn + 1}) {
        const double unwrapped = reading + axis.period * candidate;
        if (is_in_range(axis, axis.scale * unwrapped + axis.offset)) return candidate;
    }
    return turn;
}

Unwrapped Channel::unwrap(const Axis& axis, double reading) const {
    Unwrapped found{0, reading};
    if (axis.period != INFINITE) {
        found.turns = turns.last ? turns.count + nearest((*turns.last - reading) / axis.period)
                                 : first_turn(axis, reading);
        found.angle = reading + axis.period * found.turns;
    }
    if (axis.scale != 1.0 || axis.offset != 0.0) {
        found.angle = axis.scale * found.angle + axis.offset;
    }
    if (!axis.corrected_at.empty()) found.angle += correction_at(axis, found.angle);
    return found;
}

Cause Channel::complaint(const Axis& axis, Raw raw) const {
    if (!(std::abs(raw.reading) <= LARGEST)) {
        return axis.upper == INFINITE ? Cause::implausible : Cause::out_of_range;
    }
    const double angle = unwrap(axis, raw.reading).angle;
    if (!is_in_range(axis, angle)) return Cause::out_of_range;
    if (last_ns >= 0) {
        const Nanoseconds known_ns = steps.repeats() ? steps.repeated_since_ns() : last_ns;
        const Nanoseconds ahead_ns = raw.stamp_ns - known_ns;
        const double most = axis.max_speed * (std::max({ahead_ns, mean_ns, EVEN_NS}) * 1e-9);
        if (ahead_ns > 0 && std::abs(angle - last) > most) return Cause::implausible;
    }
    return Cause::none;
}

Nanoseconds Channel::restart_ns() const {
    return usual_ns > 0 ? std::max(WITHIN_NS, LATE_INTERVALS * usual_ns) : MAX_GAP_NS;
}

bool Channel::speaks() const {
    return lag.silent_ns <= (usual_ns > 0 ? std::max(AWAITED_NS, LATE_INTERVALS * usual_ns) : MAX_GAP_NS);
}

Nanoseconds Channel::patience_ns() const {
    return std::max(MAX_GAP_NS, restart_ns());
}

bool Channel::follows(Nanoseconds stamp_ns) const {
    const Raw& newest = held.back();
    const Nanoseconds before_ns = held.size() > 1 ? held[held.size() - 2].stamp_ns : last_ns;
    const Nanoseconds interval_ns = newest.stamp_ns - before_ns;
    const Nanoseconds longest_ns =
        interval_ns > 0 ? std::max(MAX_GAP_NS, REGULAR * interval_ns) : MAX_GAP_NS;
    const Nanoseconds since_ns = stamp_ns - newest.stamp_ns;
    return 0 < since_ns && since_ns <= longest_ns;
}

bool Channel::is_regular() const {
    if (usual_ns != 0 || held.size() < 2) return false;
    Nanoseconds before_ns = last_ns, longest_ns = -EVER_NS, shortest_ns = EVER_NS;
    for (const Raw& raw : held) {
        longest_ns = std::max(longest_ns, raw.stamp_ns - before_ns);
        shortest_ns = std::min(shortest_ns, raw.stamp_ns - before_ns);
        before_ns = raw.stamp_ns;
    }
    return 0 < longest_ns && longest_ns < REGULAR * shortest_ns;
}

Timing Channel::timing(const Axis& axis, Raw raw, std::span<const Channel> channels) {
    const Nanoseconds stamp_ns = raw.stamp_ns;
    if (last_ns < 0) return straggles(stamp_ns, channels) ? Timing::late : Timing::usable;
    const Nanoseconds ahead_ns = stamp_ns - last_ns;
    if (ahead_ns > (off ? off->stamp_ns - last_ns : 0) && ahead_ns <= patience_ns()) {
        return Timing::usable;
    }
    if (ahead_ns > patience_ns() || ahead_ns < -MAX_GAP_NS || (ahead_ns < 0 && !held.empty())) {
        return Timing::another_time;
    }
    const bool with_off = off && stamp_ns == off->stamp_ns;
    if (std::abs(raw.reading) <= LARGEST) {  // else it is no angle
        const double angle = unwrap(axis, raw.reading).angle;
        if (with_off ? steps.differs(motion, angle, unwrap(axis, off->reading).angle)
                     : steps.contradicts(motion, {stamp_ns, angle})) {
            return Timing::contradictory;
        }
    }
    return ahead_ns == 0 || with_off ? Timing::repeated : Timing::late;
}

/// Whether the first reading after the clock went back has a stamp from before the jump.
///
/// The last messages of one topic may arrive after the first messages of another topic that carry
/// the new time.
bool Channel::straggles(Nanoseconds stamp_ns, std::span<const Channel> channels) {
    if (left_behind_ns < 0 || std::abs(stamp_ns - left_behind_ns) > MAX_GAP_NS) return false;
    Nanoseconds newest_ns = -1;
    for (const Channel& channel : channels) newest_ns = std::max(newest_ns, channel.last_ns);
    if (stragglers_ >= STRAGGLERS || stamp_ns - newest_ns <= MAX_GAP_NS) return false;
    ++stragglers_;
    return true;
}

void Channel::resume(const Axis& axis, double angle) {
    lost_way = axis.worth > 0.0 && std::abs(angle - last) > axis.worth;
    steps.restart();
    motion = motion.without_window();
}

void Channel::note_implausible(const Axis& axis, Raw raw) {
    if (!(std::abs(raw.reading) <= LARGEST)) {
        agreeing_ = 0;
        return;
    }
    const double angle = unwrap(axis, raw.reading).angle;
    const double since = (raw.stamp_ns - refused_.stamp_ns) * 1e-9;
    const bool near_it = std::abs(angle - refused_.reading) <= axis.max_speed * since;
    if (near_it && refused_.stamp_ns >= 0 && refused_.stamp_ns < last_ns) steps.note_outlier();
    if (agreeing_ == 0 || !near_it) {
        agreeing_ = 0;
        step_ = last_ns >= 0 ? angle - steps.expected(raw.stamp_ns) : 0.0;
    }
    ++agreeing_;
    refused_ = {raw.stamp_ns, angle};
}

bool Channel::note_plausible(const Axis& axis, Point next, bool off) {
    bool stepped = false;
    if (agreeing_ > 0 && last_ns >= 0) {
        const bool beyond = std::abs(next.angle - refused_.reading) < std::abs(next.angle - last);
        const double least = motion.reach((next.stamp_ns - last_ns) * 1e-9);
        const bool lasted = agreeing_ >= CONFIRMATIONS || std::abs(step_) > least;
        stepped = beyond && lasted;
    }
    agreeing_ = 0;
    if (stepped) {
        steps.step_by(step_, axis.worth);
        steps.restart();
    }
    return steps.take(motion, axis.worth, next, off) || stepped;
}

void Channel::look_at_counts(const Axis& axis, double reading) {
    if (counted) return;
    if (axis.count == 0.0) {
        counted = true;
    } else if (turns.last && reading != *turns.last) {
        const double counts = std::abs(reading - *turns.last) / (DEGREES * axis.count);
        counted = std::abs(counts - std::max(std::nearbyint(counts), 1.0)) > BETWEEN;
    }
}

Offset Channel::offset(const Axis& axis) {
    const bool stated = axis.clock_stddev > 0.0;
    const double oldest = (stated ? lag.most_ns : std::max(lag.most_ns, OLDEST_NS)) * 1e-9;
    const double stamps = std::hypot(DEVIATION * oldest, axis.clock_stddev);
    const double clock = lag.apart ? std::hypot(stamps, arrivals.stddev()) : stamps;
    const double slipped = std::hypot(steps.offset(motion), unit_error(axis));
    const Offset now{slipped, clock};
    if (now != exact_) {
        exact_ = now;
        rounded_ = {level(now.slipped), level(now.lag)};
    }
    return rounded_;
}

double Channel::between_counts(const Axis& axis, Nanoseconds stamp_ns, double angle) {
    const double tracked =
        filter.track(stamp_ns - last_ns, angle, axis.bandwidth, axis.band, axis.adaptive);
    return std::min(std::max(tracked, axis.lower), axis.upper);
}

void Channel::extrapolate_from(Nanoseconds stamp_ns, double angle, Nanoseconds horizon_ns) {
    recent.push_back({stamp_ns, angle});
    if (recent.size() > RECENT) recent.pop_front();
    while (stamp_ns - recent.front().stamp_ns > SPEED_WINDOW_NS && recent.size() > 2 &&
           stamp_ns - recent[1].stamp_ns >= SHORTEST_WINDOW_NS) {
        recent.pop_front();
    }
    while (!tested_.empty() && 2 * (stamp_ns - tested_.front().stamp_ns) >= horizon_ns) {
        const auto [from_ns, window_ns, from, speed] = tested_.front();
        const Nanoseconds since_ns = stamp_ns - from_ns;
        motion.miss(since_ns, window_ns, angle - from - speed * (since_ns * 1e-9));
        tested_.pop_front();
    }
    if (recent_ns() > 0) tested_.push_back({stamp_ns, recent_ns(), angle, velocity()});
}

std::array<double*, Channel::REMEMBERED> Channel::remembered() {
    StepMemory& step = steps.memory;
    return {
        &motion.speed, &motion.acceleration, &motion.fastest, &motion.travelled, &motion.windows,
        &step.bend, &step.unexplained, &step.displaced,
    };
}

double Channel::velocity() const {
    const Nanoseconds span_ns = recent_ns();
    if (span_ns <= 0) return 0.0;
    return (recent.back().reading - recent.front().reading) / span_ns * 1e9;
}

}  // namespace cdrj

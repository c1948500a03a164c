#include "conditioner.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace cdrj {
Conditioner::Conditioner(
    std::vector<Axis> axes, std::size_t motors, std::vector<std::vector<std::size_t>> cables,
    bool predict, Nanoseconds horizon_ns)
    : axes_(std::move(axes)), motors_(motors), time_line_(std::move(cables), predict, horizon_ns) {
    for (std::size_t k = 0; k < axes_.size(); ++k) index_.emplace(axes_[k].name, k);
    take_refused();
    begin();
}

void Conditioner::begin() {
    channels_ = std::vector<Channel>(axes_.begin(), axes_.end());
    time_line_.begin();
}

Conditioner::Target Conditioner::find(Topic topic, std::string_view name) const {
    const auto found = index_.find(name);
    if (found == index_.end()) return UNKNOWN;
    const bool is_motor = found->second < motors_;
    const bool belongs = topic == Topic::both || is_motor == (topic == Topic::motors);
    return belongs ? static_cast<Target>(found->second) : ELSEWHERE;
}

std::vector<Sample> Conditioner::take(
    Nanoseconds stamp_ns, std::span<const Target> targets, std::span<const double> positions,
    Arrival arrival) {
    if (targets.size() != positions.size()) {
        refuse(Cause::malformed);
        return {};
    }
    if (targets.empty()) {
        refuse(Cause::empty);
        return {};
    }
    if (stamp_ns <= 0) {
        refuse(Cause::unstamped);
        return {};
    }
    stamp_ns = std::min(stamp_ns, 2 * END_OF_TIME_NS);  // an offset can be added to that
    bool news = false;
    for (std::size_t i = 0; i < targets.size(); ++i) {
        if (targets[i] == ELSEWHERE) {
            ++elsewhere;
        } else if (targets[i] == UNKNOWN) {
            refuse(Cause::unknown_name);
        } else if (admit(static_cast<std::size_t>(targets[i]), stamp_ns, positions[i], arrival)) {
            news = true;
        }
    }
    if (!news) return {};
    return time_line_.samples(axes_, channels_);
}

std::vector<Sample> Conditioner::take(Topic topic, const JointState& message) {
    if (message.positions.empty() && !message.names.empty()) return {};
    targets_.clear();
    for (const std::string& name : message.names) targets_.push_back(find(topic, name));
    return take(message.stamp_ns, targets_, message.positions, message.arrival);
}

/// Applies the gate; true if the reading, or a held one before it, joined the channel.
bool Conditioner::admit(std::size_t k, Nanoseconds stamp_ns, double reading, Arrival arrival) {
    const Axis& axis = axes_[k];
    Channel& channel = channels_[k];
    const Raw raw{stamp_ns + axis.clock_offset_ns, reading};
    if (arrival.at_ns >= 0) channel.ahead_ns = raw.stamp_ns - arrival.at_ns;
    Cause cause = Cause::none;
    if (!std::isfinite(reading)) {
        cause = Cause::not_finite;
    } else if (raw.stamp_ns <= 0) {
        cause = Cause::late;
    } else if (raw.stamp_ns >= END_OF_TIME_NS) {
        cause = Cause::future;
    } else {
        channel.go_on_turning(raw.stamp_ns);
        cause = channel.complaint(axis, raw);
        if (cause != Cause::out_of_range) {
            switch (channel.timing(axis, raw, channels_)) {
                case Timing::another_time: return hold(k, raw);
                case Timing::repeated: cause = Cause::repeated; break;
                case Timing::contradictory: cause = Cause::contradictory; break;
                case Timing::late: cause = Cause::late; break;
                case Timing::usable: break;
            }
        }
    }
    if (cause != Cause::none) {
        refuse(k, cause, raw);
        if (cause == Cause::implausible) channel.note_implausible(axis, raw);
        if (cause == Cause::contradictory) note_contradiction(k, raw.stamp_ns);
        if (cause == Cause::out_of_range) channel.steps.note_outlier();
        return false;
    }
    drop_held(k);
    for (Channel& other : channels_) {
        if (&other != &channel) other.lag.meet(k, raw.stamp_ns);
    }
    channel.lag.take(raw.stamp_ns);
    if (arrival.is_stamp) channel.arrivals.take(raw.stamp_ns);
    return judge(k, raw);
}

/// Adds a reading to its channel, unless it is off: then the next one decides, and adds both or
/// has it refused.
bool Conditioner::judge(std::size_t k, Raw raw) {
    const Axis& axis = axes_[k];
    Channel& channel = channels_[k];
    const Point next{raw.stamp_ns, channel.unwrap(axis, raw.reading).angle};
    if (channel.steps.resumes(channel.motion, next.angle)) channel.resume(axis, next.angle);
    if (channel.off) {
        const Raw off = *std::exchange(channel.off, std::nullopt);
        if (!channel.steps.returns({off.stamp_ns, channel.unwrap(axis, off.reading).angle}, next)) {
            const Nanoseconds before_ns = channel.last_ns;
            append(k, off, before_ns, true);
            append(k, raw, before_ns, false);
            std::deque<Reading>& readings = channel.readings;
            readings[readings.size() - 2].offset = readings.back().offset;
            return true;
        }
        refuse(Cause::implausible);
        channel.steps.note_outlier();
    }
    if (channel.steps.is_off(channel.motion, next)) {
        channel.off = raw;
        return false;
    }
    append(k, raw, channel.last_ns, false);
    return true;
}

/// Adds an accepted reading to its channel; a step of the sensor that it shows was after `since_ns`.
///
/// off: whether the reading was off, see `judge`.
void Conditioner::append(std::size_t k, Raw raw, Nanoseconds since_ns, bool off) {
    Channel& channel = channels_[k];
    const Unwrapped unwrapped = channel.unwrap(axes_[k], raw.reading);
    channel.lag.hear();
    if (channel.counts_anew(axes_[k], raw, unwrapped.angle)) {
        channel.steps.step_by(unwrapped.angle - channel.last, axes_[k].worth);
        ++steps;
    }
    const bool doubted = channel.steps.doubts();
    if (channel.note_plausible(axes_[k], {raw.stamp_ns, unwrapped.angle}, off)) ++steps;
    if (doubted && !channel.steps.doubts()) channel.lost_way = true;
    if (channel.steps.repeats()) since_ns = channel.steps.repeated_since_ns();
    channel.alone = !channel.first;
    if (channel.alone) channel.first = unwrapped.angle;
    channel.look_at_counts(axes_[k], raw.reading);
    channel.doubt_unit(axes_[k]);
    tell_doubt(k, since_ns, raw.stamp_ns);
    time_line_.take(axes_[k], channel, raw, unwrapped, shown_by_others(k, raw.stamp_ns));
    ++accepted;
}

/// Notes that a refused reading contradicts an accepted one, which may be wrong as well.
void Conditioner::note_contradiction(std::size_t k, Nanoseconds stamp_ns) {
    Channel& channel = channels_[k];
    channel.steps.note_contradiction();
    const std::deque<Reading>& readings = channel.readings;
    Nanoseconds since_ns = stamp_ns - 1;
    for (const Reading& reading : readings) {
        if (reading.stamp_ns < stamp_ns) since_ns = reading.stamp_ns;
    }
    tell_doubt(k, since_ns, stamp_ns);
}

/// Tells the time line if an axis comes to be in doubt, since the reading after `since_ns`, or no
/// longer is, from `stamp_ns` on.
void Conditioner::tell_doubt(std::size_t k, Nanoseconds since_ns, Nanoseconds stamp_ns) {
    Channel& channel = channels_[k];
    if (channel.is_doubtful() == channel.in_doubt) return;
    channel.in_doubt = channel.is_doubtful();
    if (channel.in_doubt) {
        time_line_.begin_doubt(k, since_ns);
    } else {
        time_line_.end_doubt(k, stamp_ns);
    }
}

/// What the other axes show of the motion of an axis up to its next reading, (C13).
///
/// Cables couple the axes: where another one turns between two readings of this one, this one may have
/// done so, too, although its readings show a slow motion or none.
LeastMotion Conditioner::shown_by_others(std::size_t k, Nanoseconds stamp_ns) const {
    LeastMotion least;
    const Nanoseconds span_ns = stamp_ns - channels_[k].last_ns;
    if (channels_[k].last_ns < 0 || span_ns <= WINDOW_NS) return least;
    if (!std::isfinite(axes_[k].worth)) return least;  // no cable acts on it
    for (std::size_t other = 0; other < channels_.size(); ++other) {
        const Motion& motion = channels_[other].motion;
        if (other == k || !(axes_[other].worth > 0.0)) continue;
        if (!motion.turns_within(span_ns, channels_[other].usual_ns)) continue;
        const double ratio = axes_[k].worth / axes_[other].worth;
        least.speed = std::max(least.speed, ratio * motion.speed);
        least.acceleration = std::max(least.acceleration, ratio * motion.acceleration);
    }
    return least;
}

/// Refuses a reading that was to be judged by the next one, which belongs to another time.
void Conditioner::drop_off(Channel& channel) {
    if (channel.off) refuse(Cause::implausible);
    channel.off.reset();
}

/// Refuses a reading and notes its size.
void Conditioner::refuse(std::size_t k, Cause cause, Raw raw) {
    refuse(cause);
    const Channel& channel = channels_[k];
    const double ahead = (raw.stamp_ns - channel.last_ns) * 1e-9;
    double size = 0.0;
    if (cause == Cause::late || cause == Cause::future) {
        size = channel.last_ns >= 0 ? ahead : 0.0;
    } else if (cause == Cause::out_of_range || cause == Cause::implausible) {
        const bool countable = std::abs(raw.reading) <= LARGEST;
        size = countable ? channel.unwrap(axes_[k], raw.reading).angle : raw.reading;
        if (cause == Cause::implausible) size = ahead > 0.0 ? (size - channel.last) / ahead : 0.0;
    }
    double& most = sizes_[k][static_cast<std::size_t>(cause)];
    if (!(std::abs(size) <= std::abs(most))) most = size;
}

std::vector<Conditioner::Sizes> Conditioner::take_refused() {
    Sizes none;
    none.fill(std::numeric_limits<double>::quiet_NaN());
    return std::exchange(sizes_, std::vector<Sizes>(axes_.size(), none));
}

/// Refuses the held readings: the clock did not jump.
void Conditioner::drop_held(std::size_t k) {
    Channel& channel = channels_[k];
    for (const Raw& raw : channel.held) {
        refuse(k, raw.stamp_ns > channel.last_ns ? Cause::future : Cause::late, raw);
    }
    channel.held.clear();
}

/// Holds a reading with a distant stamp; uses all held ones once enough have followed.
bool Conditioner::hold(std::size_t k, Raw raw) {
    Channel& channel = channels_[k];
    if (!channel.held.empty() && raw.stamp_ns == channel.held.back().stamp_ns) {
        const bool equal = raw.reading == channel.held.back().reading;
        refuse(k, equal ? Cause::repeated : Cause::contradictory, raw);
        if (!equal) note_contradiction(k, raw.stamp_ns);
        return false;
    }
    if (!channel.held.empty() && !channel.follows(raw.stamp_ns)) drop_held(k);
    channel.held.push_back(raw);
    const bool regular = channel.is_regular();
    if (channel.held.size() < CONFIRMATIONS && !regular) return false;
    drop_off(channel);
    if (!regular && channel.held.front().stamp_ns < channel.last_ns) return jump_back(k);
    const std::vector<Raw> confirmed = std::exchange(channel.held, {});
    if (regular) return append_held(k, confirmed);
    ++gaps;
    const bool used = append_held(k, std::span(confirmed).first(1));
    if (used && time_line_.has_begun()) {
        channel.readings.back().unread = true;
        // an axis that stands where it stood is taken to have rested
        channel.readings.back().curvature = 0.0;
    }
    return append_held(k, std::span(confirmed).subspan(1)) || used;
}

/// Uses confirmed readings one by one; true if at least one is accepted.
bool Conditioner::append_held(std::size_t k, std::span<const Raw> confirmed) {
    const std::int64_t before = accepted;
    for (const Raw& raw : confirmed) {
        const Cause complaint = channels_[k].complaint(axes_[k], raw);
        if (complaint == Cause::none) {
            append(k, raw, channels_[k].last_ns, false);
            continue;
        }
        refuse(k, complaint, raw);
        if (complaint == Cause::implausible) channels_[k].note_implausible(axes_[k], raw);
    }
    return accepted > before;
}

/// Restarts with the held readings of every channel that have the new time, those of `k` last.
///
/// Returns whether a reading of `k` is accepted.
bool Conditioner::jump_back(std::size_t k) {
    ++clock_jumps;
    for (std::size_t i = 0; i < channels_.size(); ++i) {
        Channel& channel = channels_[i];
        drop_off(channel);
        const bool of_the_new_time =
            !channel.held.empty() && channel.held.front().stamp_ns < channel.last_ns;
        if (!of_the_new_time) drop_held(i);
    }
    const std::vector<Raw> confirmed = std::exchange(channels_[k].held, {});
    const std::vector<Channel> before = std::exchange(channels_, {});
    begin();
    for (std::size_t i = 0; i < channels_.size(); ++i) {
        channels_[i].take_over(before[i]);
        append_held(i, before[i].held);
    }
    return append_held(k, confirmed);
}

void Conditioner::reset(bool keep_turns) {
    for (std::size_t k = 0; k < channels_.size(); ++k) {
        drop_held(k);
        drop_off(channels_[k]);
    }
    const std::vector<Channel> before = std::exchange(channels_, {});
    begin();
    for (std::size_t k = 0; k < channels_.size(); ++k) {
        if (keep_turns) {
            channels_[k].keep_turns(before[k]);
        } else {
            channels_[k].keep_turns_for_a_while(before[k]);
        }
    }
}

Conditioner::Memory Conditioner::memory() {
    Memory found;
    for (Channel& channel : channels_) {
        for (const double* one : channel.remembered()) found.numbers.push_back(*one);
        found.stepped.push_back(channel.steps.memory.stepped ? 1.0 : 0.0);
    }
    return found;
}

void Conditioner::recall(std::span<const double> numbers, std::span<const double> stepped) {
    const double* next = numbers.data();
    for (std::size_t k = 0; k < channels_.size(); ++k) {
        Channel& channel = channels_[k];
        for (double* one : channel.remembered()) *one = *next++;
        channel.motion = channel.motion.without_window();
        channel.steps.memory.stepped = stepped[k] != 0.0;
    }
}

void Conditioner::expect(std::span<const double> angles, Nanoseconds stamp_ns) {
    time_line_.resume(stamp_ns);
    for (std::size_t k = 0; k < channels_.size(); ++k) {
        if (std::isnan(angles[k])) continue;  // it was never read
        channels_[k].near = angles[k];
        channels_[k].motion.take(stamp_ns, angles[k]);
    }
}

void Conditioner::set_tracking(std::vector<Axis> axes) {
    axes_ = std::move(axes);
    for (Channel& channel : channels_) channel.filter = {};
}

// -------------------------------------------------------------------------------------------------
// Readings by themselves

std::vector<double> angles_of(const Axis& axis, std::span<const double> readings) {
    Channel channel(axis);
    std::vector<double> angles(readings.size());
    for (std::size_t i = 0; i < readings.size(); ++i) {
        const bool countable = std::abs(readings[i]) <= LARGEST;
        if (!countable) {
            angles[i] = std::numeric_limits<double>::quiet_NaN();
            continue;
        }
        const Unwrapped unwrapped = channel.unwrap(axis, readings[i]);
        channel.turns.last = readings[i];
        channel.turns.count = unwrapped.turns;
        angles[i] = unwrapped.angle;
    }
    return angles;
}

double angle_near(const Axis& axis, double reading, double near) {
    Channel channel(axis);
    channel.near = near;
    return channel.unwrap(axis, reading).angle;
}

}  // namespace cdrj

#include "time_line.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace cdrj {
namespace {

/// Intervals over which a mean is taken.
constexpr Nanoseconds MANY = 32;

/// Standard deviation midway between two samples, (C3); 0 where it is negligible.
double way_between(double curvature, Nanoseconds interval_ns, double negligible) {
    const double way = curvature * interval_ns * interval_ns * 0.25;
    return way > negligible ? way : 0.0;
}

/// The angle at a stamp, linear between the readings around it; NaN where nothing is known of it. Drops
/// readings that no later one needs.
double interpolated(Channel& channel, Nanoseconds stamp_ns) {
    std::deque<Reading>& readings = channel.readings;
    while (readings.size() > 1 && readings[1].stamp_ns <= stamp_ns) {
        readings.pop_front();
        channel.was_away = channel.was_away || readings[0].after_gap;
    }
    if (readings.empty() || readings[0].stamp_ns > stamp_ns) return UNREAD;
    const Reading& before = readings[0];
    if (before.stamp_ns == stamp_ns) return before.angle;
    if (readings.size() == 1) return UNREAD;
    const Reading& after = readings[1];
    if (after.unread || after.curvature == INFINITE) return UNREAD;
    const double passed = static_cast<double>(stamp_ns - before.stamp_ns);
    const double whole = static_cast<double>(after.stamp_ns - before.stamp_ns);
    return before.angle + (after.angle - before.angle) * (passed / whole);
}

/// The reading at, or next after, the sample that `interpolated` gave last.
const Reading& reached(const Channel& channel, Nanoseconds stamp_ns) {
    return channel.readings[channel.readings[0].stamp_ns == stamp_ns ? 0 : 1];
}

/// The angle at or after the last reading, by the velocity, within the limits.
double extrapolated(const Axis& axis, const Channel& channel, Nanoseconds stamp_ns) {
    const Nanoseconds ahead_ns = stamp_ns - channel.last_ns;
    const double angle = channel.recent.back().reading + channel.velocity() * (ahead_ns * 1e-9);
    return std::min(std::max(angle, axis.lower), axis.upper);
}

/// Flags an axis among others.
void set(std::vector<bool>& flags, std::size_t axis, std::size_t axes) {
    flags.resize(axes);
    flags[axis] = true;
}

/// `Sample::unseen`, while it is found axis by axis.
struct Unseen {
    std::size_t axes;
    std::vector<double> values{};

    void set(std::size_t axis, double here, double way) {
        if (values.empty()) values.resize(2 * axes);
        values[axis] = here;
        values[axes + axis] = way;
    }
};

/// `Sample::unseen` of an interpolated sample, (C3).
std::vector<double> unseen_at(
    std::span<const Axis> axes,
    std::span<const Channel> channels,
    const Sample& sample,
    Nanoseconds previous_ns) {
    const Nanoseconds stamp_ns = sample.stamp_ns;
    Unseen unseen{channels.size()};
    for (std::size_t k = 0; k < channels.size(); ++k) {
        if (std::isnan(sample.angle[k])) continue;
        const Reading &before = channels[k].readings[0], &after = reached(channels[k], stamp_ns);
        if (after.curvature == 0.0) continue;
        const bool between = before.stamp_ns != stamp_ns;
        const double way =
            way_between(after.curvature, stamp_ns - previous_ns, axes[k].negligible);
        const double here = between ? after.curvature * (stamp_ns - before.stamp_ns) *
                                          (after.stamp_ns - stamp_ns)
                                    : 0.0;
        if (between || way > 0.0) unseen.set(k, here, way);
    }
    return unseen.values;
}

/// `Sample::unseen` of the first sample, which may continue an earlier run.
std::vector<double> unseen_before(
    std::span<const Axis> axes,
    std::span<const Channel> channels,
    const Sample& sample,
    Nanoseconds resumed_ns) {
    const Nanoseconds stamp_ns = sample.stamp_ns;
    std::vector<double> unseen = unseen_at(axes, channels, sample, stamp_ns);
    if (!(0 <= resumed_ns && resumed_ns < stamp_ns)) return unseen;
    const std::size_t n = channels.size();
    std::vector<double> ways(n);
    for (std::size_t k = 0; k < n; ++k) {
        ways[k] = way_between(channels[k].resumed, stamp_ns - resumed_ns, axes[k].negligible);
    }
    if (std::all_of(ways.begin(), ways.end(), [](double way) { return way == 0.0; })) return unseen;
    unseen.resize(2 * n);
    std::copy(ways.begin(), ways.end(), unseen.begin() + static_cast<std::ptrdiff_t>(n));
    return unseen;
}

/// `Sample::unseen` of a predicted sample, (C4).
std::vector<double> unseen_ahead(
    std::span<const Axis> axes,
    std::span<const Channel> channels,
    const Sample& sample,
    Nanoseconds previous_ns) {
    const Nanoseconds stamp_ns = sample.stamp_ns;
    Unseen unseen{channels.size()};
    for (std::size_t k = 0; k < channels.size(); ++k) {
        if (std::isnan(sample.angle[k])) continue;
        const Channel& channel = channels[k];
        const Nanoseconds horizon_ns = stamp_ns - channel.last_ns;
        double deviation = 0.0, way = 0.0;
        if (horizon_ns > 0) {
            deviation = channel.motion.ahead(horizon_ns, channel.recent_ns());
        } else if (horizon_ns == 0) {
            const double curvature = channel.readings.back().curvature;
            way = way_between(curvature, stamp_ns - previous_ns, axes[k].negligible);
        }
        if (deviation > axes[k].negligible || way > 0.0) unseen.set(k, deviation, way);
    }
    return unseen.values;
}

}  // namespace

void TimeLine::begin() {
    doubts_.clear();
    offset_.clear();
    awaited_.clear();
    resumed_ns_ = passed_over_ns_ = given_out_ns_ = ahead_ns_ = ahead_from_ns_ = -1;
}

void TimeLine::begin_doubt(std::size_t channel, Nanoseconds after_ns) {
    doubts_.push_back({channel, after_ns});
}

void TimeLine::end_doubt(std::size_t channel, Nanoseconds until_ns) {
    for (Doubt& doubt : doubts_) {
        if (doubt.channel == channel && doubt.until_ns == EVER_NS) doubt.until_ns = until_ns;
    }
}

void TimeLine::take(
    const Axis& axis, Channel& channel, Raw raw, Unwrapped unwrapped, const LeastMotion& least) {
    const auto [stamp_ns, reading] = raw;
    const double value = unwrapped.angle;
    const double angle =
        axis.bandwidth > 0.0 ? channel.between_counts(axis, stamp_ns, value) : value;
    channel.motion.take(stamp_ns, value);
    double curvature = 0.0;
    bool after_gap = false;
    if (channel.last_ns >= 0) {
        const Nanoseconds interval_ns = stamp_ns - channel.last_ns;
        after_gap = interval_ns > channel.restart_ns();
        curvature = channel.motion.curvature(interval_ns, least);
        if (std::exchange(channel.lost_way, false)) curvature = INFINITE;
        channel.usual_ns = std::max(interval_ns, channel.usual_ns / 2);
        if (interval_ns < WITHIN_NS) channel.mean_ns += (interval_ns - channel.mean_ns) / MANY;
    } else if (0 <= resumed_ns_ && resumed_ns_ < stamp_ns) {
        channel.resumed = channel.motion.curvature(stamp_ns - resumed_ns_);
    }
    channel.last_ns = stamp_ns;
    channel.last = value;
    channel.turns.last = reading;
    channel.turns.count = unwrapped.turns;
    channel.readings.push_back({stamp_ns, angle, curvature, channel.offset(axis), after_gap});
    if (channel.readings.size() > WAITING) {
        channel.readings.pop_front();
        ++crowded;
        if (has_begun()) {
            given_out_ns_ = std::max(given_out_ns_, channel.readings.front().stamp_ns);
        }
    }
    if (predict_) channel.extrapolate_from(stamp_ns, angle, horizon_ns_);
}

std::vector<Sample> TimeLine::samples(Axes axes, Channels channels) {
    std::vector<Sample> found;
    const Nanoseconds until_ns = await(channels);
    Nanoseconds newest_ns = -1;
    for (const Channel& channel : channels) newest_ns = std::max(newest_ns, channel.last_ns);
    if (until_ns < 0 || (until_ns <= given_out_ns_ && !predict_)) return found;
    interpolate(axes, channels, until_ns, found);
    if (predict_ && is_predictable(channels, newest_ns, until_ns)) {
        found.push_back(predict(axes, channels, newest_ns));
    }
    lag_ns = newest_ns - std::max(given_out_ns_, ahead_ns_);
    return found;
}

/// Finds the channels that others wait for, and the stamp that all of these have reached; -1 if one has
/// no reading.
///
/// All are awaited unless some cable can go on without those that are silent.
Nanoseconds TimeLine::await(Channels channels) {
    awaited_.clear();
    Nanoseconds until_ns = EVER_NS, spoken_ns = EVER_NS;
    for (const Channel& channel : channels) {
        until_ns = std::min(until_ns, channel.last_ns);
        if (channel.speaks()) spoken_ns = std::min(spoken_ns, channel.last_ns);
    }
    if (spoken_ns == until_ns) return until_ns;  // nobody waits for another one
    const bool goes_on = std::ranges::any_of(cables_, [&](const auto& own) {
        return std::ranges::all_of(
            own, [&](std::size_t k) { return channels[k].speaks() && channels[k].last_ns >= 0; });
    });
    if (!goes_on) return until_ns;
    for (const Channel& channel : channels) awaited_.push_back(channel.speaks());
    return spoken_ns;
}

/// Whether angles tell something of a cable.
bool TimeLine::tells(std::span<const double> angle) const {
    return std::ranges::any_of(cables_, [&](const auto& own) {
        return std::ranges::none_of(own, [&](std::size_t k) { return std::isnan(angle[k]); });
    });
}

/// The next samples, up to the stamp that every awaited channel has reached.
void TimeLine::interpolate(
    Axes axes, Channels channels, Nanoseconds until_ns, std::vector<Sample>& to) {
    bool began = has_begun();
    Nanoseconds last_ns = std::max(given_out_ns_, passed_over_ns_);
    if (!began) {  // the first sample is at the first stamp that every awaited channel reaches
        for (std::size_t k = 0; k < channels.size(); ++k) {
            if (awaits(k)) last_ns = std::max(last_ns, channels[k].readings.front().stamp_ns - 1);
        }
    }
    while (last_ns < until_ns) {
        Sample sample{.stamp_ns = until_ns, .angle = std::vector<double>(channels.size())};
        for (const Channel& channel : channels) {
            for (const Reading& reading : channel.readings) {
                if (reading.stamp_ns <= last_ns) continue;
                sample.stamp_ns = std::min(sample.stamp_ns, reading.stamp_ns);
                break;
            }
        }
        bool curved = false, whole = true;
        for (std::size_t k = 0; k < channels.size(); ++k) {
            sample.angle[k] = interpolated(channels[k], sample.stamp_ns);
            if (std::isnan(sample.angle[k])) {
                whole = false;
                continue;
            }
            const Reading& reading = reached(channels[k], sample.stamp_ns);
            curved = curved || reading.curvature != 0.0;
            const bool was_away = std::exchange(channels[k].was_away, false);
            if (reading.after_gap || was_away) set(sample.after_gap, k, channels.size());
        }
        if (!whole && !tells(sample.angle)) {
            passed_over_ns_ = last_ns = sample.stamp_ns;
            continue;
        }
        if (!began) {
            sample.unseen = unseen_before(axes, channels, sample, resumed_ns_);
        } else if (curved) {
            sample.unseen = unseen_at(axes, channels, sample, last_ns);
        }
        last_ns = sample.stamp_ns;
        for (std::size_t k = 0; k < channels.size(); ++k) channels[k].told = !std::isnan(sample.angle[k]);
        tell_offsets(channels, sample);
        std::erase_if(doubts_, [&](const Doubt& doubt) { return doubt.until_ns <= last_ns; });
        sample.doubtful = doubtful_at(last_ns, channels);
        sample.silent = last_ns <= ahead_ns_;
        began = true;
        to.push_back(std::move(sample));
    }
    if (!to.empty()) given_out_ns_ = ahead_from_ns_ = last_ns;
}

/// Give the offsets' standard deviations at a sample that `interpolated` gave, if they have changed.
void TimeLine::tell_offsets(Channels channels, Sample& sample) {
    bool changed = offset_.empty();
    offset_.resize(channels.size());
    for (std::size_t k = 0; k < channels.size(); ++k) {
        if (std::isnan(sample.angle[k])) continue;
        const Offset offset = reached(channels[k], sample.stamp_ns).offset;
        changed = changed || offset != offset_[k];
        offset_[k] = offset;
    }
    if (!changed) return;
    for (const Offset& offset : offset_) sample.offset.push_back(offset.slipped);
    for (const Offset& offset : offset_) sample.offset.push_back(offset.lag);
}

/// Whether to give a sample at the newest stamp; all channels have reached `until_ns`.
bool TimeLine::is_predictable(
    Channels channels, Nanoseconds newest_ns, Nanoseconds until_ns) const {
    const Nanoseconds last_ns = std::max(given_out_ns_, ahead_ns_);
    if (!has_begun() || newest_ns <= last_ns || newest_ns > until_ns + horizon_ns_) return false;
    for (std::size_t k = 0; k < channels.size(); ++k) {
        const Channel& channel = channels[k];
        if (!awaits(k) || channel.last_ns == newest_ns) continue;
        const bool moves = channel.recent_ns() != 0 && channel.motion.windows > 0.0;
        if (!moves || !channel.motion.knows(channel.usual_ns)) return false;
    }
    return true;
}

/// The sample at the newest stamp, with lagging channels extrapolated.
Sample TimeLine::predict(Axes axes, Channels channels, Nanoseconds stamp_ns) {
    Sample sample{.stamp_ns = stamp_ns, .angle = std::vector<double>(channels.size())};
    for (std::size_t k = 0; k < channels.size(); ++k) {
        const bool goes_on = awaits(k) && channels[k].told;
        sample.angle[k] = goes_on ? extrapolated(axes[k], channels[k], stamp_ns) : UNREAD;
    }
    sample.unseen = unseen_ahead(axes, channels, sample, ahead_from_ns_);
    ahead_ns_ = ahead_from_ns_ = stamp_ns;
    sample.doubtful = doubtful_at(stamp_ns, channels);
    const bool undecided = std::ranges::any_of(channels, [](const Channel& channel) {
        return channel.off.has_value();  // the next reading decides if others have changed, too
    });
    if (undecided) sample.doubtful.assign(channels.size(), true);
    sample.predicted = true;
    return sample;
}

/// `Sample::doubtful`: with an axis that is stuck, those whose readings have not changed since then either.
std::vector<bool> TimeLine::doubtful_at(Nanoseconds stamp_ns, Channels channels) const {
    std::vector<bool> found;
    for (const Doubt& doubt : doubts_) {
        const bool holds = doubt.after_ns < stamp_ns && stamp_ns < doubt.until_ns;
        if (holds) set(found, doubt.channel, channels.size());
    }
    for (const Channel& stuck : channels) {
        if (!stuck.steps.repeats()) continue;
        for (std::size_t k = 0; k < channels.size(); ++k) {
            const bool still = channels[k].steps.still_since_ns() <= stuck.steps.repeated_since_ns();
            if (still) set(found, k, channels.size());
        }
    }
    return found;
}

}  // namespace cdrj

#include "recording.hpp"

#include <algorithm>

namespace cdrj {
namespace {

/// Readings between two pauses.
constexpr std::size_t BETWEEN_PAUSES = 65'536;

/// Append the row of a sample, all zero where it is empty, to rows that are empty as long as all are.
template <typename T>
void append(std::vector<T>& rows, std::size_t before, const std::vector<T>& row) {
    if (row.empty()) return;
    rows.resize(before * row.size());
    rows.insert(rows.end(), row.begin(), row.end());
}

void append(Samples& samples, const Sample& sample, std::size_t motors) {
    const std::size_t row = samples.stamp_ns.size();
    const auto joints = sample.angle.begin() + static_cast<std::ptrdiff_t>(motors);
    samples.stamp_ns.push_back(sample.stamp_ns);
    samples.motor.insert(samples.motor.end(), sample.angle.begin(), joints);
    samples.joint.insert(samples.joint.end(), joints, sample.angle.end());
    append(samples.unseen, row, sample.unseen);
    append(samples.doubtful, row, sample.doubtful);
    append(samples.after_gap, row, sample.after_gap);
    if (!sample.offset.empty()) {
        samples.offset_rows.push_back(static_cast<std::int64_t>(row));
        samples.offset.insert(samples.offset.end(), sample.offset.begin(), sample.offset.end());
    }
}

/// Fill what the last samples have none of.
void complete(Samples& samples) {
    const std::size_t angles = samples.motor.size() + samples.joint.size();
    if (!samples.unseen.empty()) samples.unseen.resize(2 * angles);
    if (!samples.doubtful.empty()) samples.doubtful.resize(angles);
    if (!samples.after_gap.empty()) samples.after_gap.resize(angles);
}

/// The series whose next reading arrived first; their number where there is none.
std::size_t next(std::span<const Series> series, std::span<const std::size_t> taken) {
    std::size_t first = series.size();
    Nanoseconds earliest_ns = 0;
    for (std::size_t s = 0; s < series.size(); ++s) {
        if (taken[s] == series[s].arrival_ns.size()) continue;
        const Nanoseconds arrival_ns = series[s].arrival_ns[taken[s]];
        if (first == series.size() || arrival_ns < earliest_ns) {
            first = s;
            earliest_ns = arrival_ns;
        }
    }
    return first;
}

}  // namespace

std::vector<Samples> condition(
    Conditioner& conditioner, std::span<const Series> series, const std::function<void()>& pause) {
    std::vector<Samples> segments(1);
    std::vector<std::size_t> taken(series.size(), 0);
    std::vector<Conditioner::Target> targets;
    std::vector<double> values;
    for (std::size_t done = 0, s = 0; (s = next(series, taken)) < series.size(); ++done) {
        if (done % BETWEEN_PAUSES == 0) pause();
        const Series& one = series[s];
        const Nanoseconds stamp_ns = one.stamp_ns[taken[s]], arrival_ns = one.arrival_ns[taken[s]];
        targets.clear();
        values.clear();
        for (std::size_t other = s; other < series.size(); ++other) {  // those of one message
            const Series& its = series[other];
            for (std::size_t& i = taken[other]; i < its.stamp_ns.size(); ++i) {
                if (its.stamp_ns[i] != stamp_ns || its.arrival_ns[i] != arrival_ns) break;
                targets.push_back(its.target);
                values.push_back(its.value[i]);
            }
        }
        const std::int64_t jumps = conditioner.clock_jumps;
        const std::vector<Sample> samples =
            conditioner.take(stamp_ns, targets, values, {arrival_ns, one.by_arrival});
        if (conditioner.clock_jumps != jumps) segments.emplace_back();
        for (const Sample& sample : samples) {
            append(segments.back(), sample, conditioner.motors());
        }
    }
    std::ranges::for_each(segments, complete);
    return segments;
}

}  // namespace cdrj

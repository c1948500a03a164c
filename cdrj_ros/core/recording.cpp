#include "recording.hpp"

#include <utility>

namespace cdrj {
namespace {

void append(Samples& samples, const Sample& sample, std::size_t motors) {
    const std::size_t row = samples.stamp_ns.size();
    const auto joints = sample.angle.begin() + static_cast<std::ptrdiff_t>(motors);
    samples.stamp_ns.push_back(sample.stamp_ns);
    samples.motor.insert(samples.motor.end(), sample.angle.begin(), joints);
    samples.joint.insert(samples.joint.end(), joints, sample.angle.end());
    if (!sample.unseen.empty()) {
        samples.unseen_rows.push_back(row);
        samples.unseen.insert(samples.unseen.end(), sample.unseen.begin(), sample.unseen.end());
    }
    if (!sample.offset.empty()) {
        samples.offset_rows.push_back(row);
        samples.offset.insert(samples.offset.end(), sample.offset.begin(), sample.offset.end());
    }
    if (sample.doubtful) samples.doubtful.push_back(row);
    if (sample.after_gap) samples.after_gap.push_back(row);
}

}  // namespace

Recording::Recording(Conditioner& conditioner, std::vector<Series> series)
    : conditioner_(conditioner), series_(std::move(series)), taken_(series_.size(), 0) {}

/// The series whose next reading arrived first; their number where there is none.
std::size_t Recording::next() const {
    std::size_t first = series_.size();
    Nanoseconds earliest_ns = 0;
    for (std::size_t s = 0; s < series_.size(); ++s) {
        if (taken_[s] == series_[s].arrival_ns.size()) continue;
        const Nanoseconds arrival_ns = series_[s].arrival_ns[taken_[s]];
        if (first == series_.size() || arrival_ns < earliest_ns) {
            first = s;
            earliest_ns = arrival_ns;
        }
    }
    return first;
}

bool Recording::is_over() const {
    return next() == series_.size();
}

std::vector<Samples> Recording::advance(std::size_t most) {
    std::vector<Samples> pieces(1);
    for (; most > 0; --most) {
        const std::size_t s = next();
        if (s == series_.size()) break;
        const Series& one = series_[s];
        const std::size_t i = taken_[s]++;
        const std::int64_t jumps = conditioner_.clock_jumps;
        const std::vector<Sample> samples = conditioner_.take(
            one.stamp_ns[i], std::span(&one.target, 1), one.value.subspan(i, 1),
            {one.arrival_ns[i], one.by_arrival});
        if (conditioner_.clock_jumps != jumps) pieces.push_back({.after_jump = true});
        for (const Sample& sample : samples) {
            append(pieces.back(), sample, conditioner_.motors());
        }
    }
    return pieces;
}

}  // namespace cdrj

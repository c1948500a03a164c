// The readings of a recording, which take the way of single messages.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "conditioner.hpp"
#include "records.hpp"

namespace cdrj {

/// Readings of one name on one topic; all three have one entry per reading.
struct Series {
    Conditioner::Target target;                // where the name belongs
    std::span<const Nanoseconds> stamp_ns;
    std::span<const Nanoseconds> arrival_ns;   // never decreasing
    std::span<const double> value;
    bool by_arrival = false;                   // whether stamps are times of arrival
};

/// Consecutive samples, as columns; n is their number.
struct Samples {
    std::vector<Nanoseconds> stamp_ns{};
    std::vector<double> motor{};        // angles, (n, motors)
    std::vector<double> joint{};        // angles, (n, joints)
    std::vector<double> unseen{};       // (n, 2, axes), zero where empty; or empty for all
    std::vector<bool> doubtful{};       // (n, axes), or empty for none
    std::vector<bool> after_gap{};      // likewise
    std::vector<std::int64_t> offset_rows{};  // the samples whose `offset` is not empty
    std::vector<double> offset{};       // these, (len(offset_rows), 2, axes)
};

/// Feeds the readings of a recording to a conditioner in their order of arrival, those with one stamp and one
/// arrival as one message, at equal times those of the first series first; `pause` is called now and then.
///
/// Returns the samples that they complete: one segment, and a further one after every jump back.
std::vector<Samples> condition(
    Conditioner& conditioner, std::span<const Series> series, const std::function<void()>& pause);

}  // namespace cdrj

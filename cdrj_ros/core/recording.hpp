// The readings of a recording, which take the way of single messages.
#pragma once

#include <cstddef>
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
    bool after_jump = false;            // whether the clock went back before them
    std::vector<Nanoseconds> stamp_ns{};
    std::vector<double> motor{};        // angles, (n, motors)
    std::vector<double> joint{};        // angles, (n, joints)
    std::vector<std::size_t> unseen_rows{};  // the samples whose `unseen` is not empty
    std::vector<double> unseen{};            // these, (len(unseen_rows), 2, axes)
    std::vector<std::size_t> offset_rows{};  // the samples whose `offset` is not empty
    std::vector<double> offset{};            // these, (len(offset_rows), 2, axes)
    std::vector<std::size_t> doubtful{};     // the doubtful samples
    std::vector<std::size_t> after_gap{};    // the samples in gaps and the first ones after them
};

/// Feeds the readings of a recording to a conditioner, one by one in their order of arrival.
class Recording {
public:
    Recording(Conditioner& conditioner, std::vector<Series> series);

    /// Whether all readings have been taken.
    bool is_over() const;

    /// Takes the next readings, `most` at most; at equal times those of the first series first.
    ///
    /// Returns the samples that they complete: one piece, and a further one after every jump back.
    std::vector<Samples> advance(std::size_t most);

private:
    std::size_t next() const;

    Conditioner& conditioner_;
    std::vector<Series> series_;
    std::vector<std::size_t> taken_;  // readings of every series
};

}  // namespace cdrj

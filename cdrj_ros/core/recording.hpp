// The readings of a whole recording, conditioned one by one in their order of arrival.
#pragma once

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
};

/// Consecutive samples, as columns; n is their number.
struct Samples {
    bool after_jump;                    // whether the clock went back before them
    std::vector<Nanoseconds> stamp_ns{};
    std::vector<double> motor{};        // angles, (n, motors)
    std::vector<double> joint{};        // angles, (n, joints)
    std::vector<std::size_t> unseen_rows{};  // the samples whose `unseen` is not empty
    std::vector<double> unseen{};            // these, (len(unseen_rows), 2, axes)
    std::vector<std::size_t> offset_rows{};  // the samples whose `offset` is not empty
    std::vector<double> offset{};            // these, (len(offset_rows), 3, axes)
    std::vector<std::size_t> doubtful{};     // the doubtful samples
};

/// Feeds a recording to a conditioner.
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

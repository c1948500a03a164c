// Steps of a sensor: displacements between two readings that no motion of the axis explains.
//
// An axis whose velocity rises or falls steadily moves, between two readings, at a velocity between
// those of the intervals before and after. What a displacement exceeds that by is its unexplained
// part, (C5): noise, a motion that the readings do not resolve, or a step. It counts as a step where
// it exceeds the unexplained parts so far, (C7); otherwise it raises these, and is in the standard
// deviation of the axis's offset, (C9). See docs/estimation.md.
#pragma once

#include <array>
#include <cmath>
#include <deque>

#include "motion.hpp"
#include "records.hpp"

namespace cdrj {

/// Steps in longer intervals are not looked for.
inline constexpr Nanoseconds WITHIN_NS = 100'000'000;

/// An accepted angle and its time.
struct Point {
    Nanoseconds stamp_ns;
    double angle;
};

/// What outlasts the readings of an axis.
struct StepMemory {
    double bend = 0.0;         // greatest deviation from the line through the last two readings, (C8)
    double unexplained = 0.0;  // greatest unexplained part that was no step, U of (C7)
    double displaced = 0.0;    // sum of all steps, with their signs
    bool stepped = false;      // whether this sum is worth so much that tensions are UNSURE
};

/// Looks for steps in the accepted readings of one axis.
class StepDetector {
public:
    /// Whether the reading after this one is to decide if this one is an outlier, (C8).
    bool is_off(const Motion& motion, Point next) const;

    /// Whether a reading continues the line before one that was off.
    bool returns(Point off, Point next) const;

    /// Takes the next accepted reading. Returns whether the sensor has stepped between the last two
    /// readings before it.
    ///
    /// off: whether it is off, and later ones did not return.
    bool take(const Motion& motion, double worth, Point next, bool off);

    /// Notes an outlier.
    void note_outlier() { alternate(true); }

    /// Whether two readings for one time differ by more than errors of the sensor.
    static bool differs(const Motion& motion, double one, double other);

    /// Whether a reading that is not later than the last one differs from those accepted at its time.
    bool contradicts(const Motion& motion, Point earlier) const;

    /// Notes a contradiction: of two readings for one time one is wrong, and nothing tells which.
    void note_contradiction();

    /// Notes a step that other readings have shown.
    void step_by(double by, double worth);

    /// Forgets the last readings: the next one need not continue them.
    void restart();

    /// Standard deviation of an offset of the axis that the readings do not show, (C9).
    double offset(const Motion& motion) const;

    /// Whether the readings alternate between two motions.
    bool alternates() const { return alternates_; }

    /// Whether what they show is another angle than that of the axis.
    bool doubts() const { return memory.stepped || alternates_; }

    /// The angle at a stamp on the line through the last two readings.
    double expected(Nanoseconds stamp_ns) const;

    /// Whether the readings repeat one within its errors, right after a motion that did not slow down, (C12).
    bool repeats() const { return repeats_; }

    /// Whether an angle is no longer the one that they repeat.
    bool resumes(const Motion& motion, double angle) const {
        return repeats_ && !stays(motion, angle);
    }

    /// Stamp of the first of the last readings that are alike.
    Nanoseconds still_since_ns() const { return still_since_ns_; }

    /// Stamp of the reading that they repeat.
    Nanoseconds repeated_since_ns() const { return repeated_since_ns_; }

    StepMemory memory;

private:
    double bend(Point next) const;
    bool is_count(const Motion& motion, double worth, double deviation) const;
    bool is_judged(Point next) const;
    bool stays(const Motion& motion, double angle) const {
        return std::abs(angle - still_) <= 2.0 * motion.error();
    }
    bool is_plain(const Motion& motion, Point next, double deviation) const;
    bool is_step(const Motion& motion, double worth, Point next);
    void alternate(bool does);
    void follow(const Motion& motion, Point next);

    std::array<Point, 3> points_{};  // the last readings, oldest first
    int count_ = 0;                  // how many of them there are
    double sudden_ = 0.0;  // greatest displacement, then bend, until the axis has shown its speed
    double side_ = 0.0;              // deviation of the last reading from the line before it, if large
    double share_ = 0.0;             // of readings that alternate, of late
    bool alternates_ = false;
    std::deque<Point> latest_;       // more of the last readings, oldest first
    double still_ = 0.0;             // the angle that the last readings have, within their errors
    std::size_t equal_ = 0;          // how many of them after the first one
    double count_size_ = INFINITE;   // least change from one reading to the next so far
    bool compared_ = false;          // whether these have been compared with those before them
    bool repeats_ = false;
    Nanoseconds repeated_since_ns_ = -1;
    Nanoseconds still_since_ns_ = -1;
};

}  // namespace cdrj

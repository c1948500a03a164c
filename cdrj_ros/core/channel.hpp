// Gate of one channel, a motor or a joint: converts readings to angles, refuses impossible ones.
#pragma once

#include <array>
#include <cstddef>
#include <deque>
#include <optional>
#include <span>
#include <vector>

#include "motion.hpp"
#include "records.hpp"
#include "step_detector.hpp"

namespace cdrj {

/// A stamp further than this from the last one needs confirmation by later readings.
inline constexpr Nanoseconds MAX_GAP_NS = 1'000'000'000;

/// A jump of the clock is accepted only after this many consistent readings.
inline constexpr std::size_t CONFIRMATIONS = 5;

/// Tolerance for rounding at the ends of a joint's range.
inline constexpr double RANGE_MARGIN = 1e-9;

/// Standard deviations of errors of an angle that last, and that the readings do not show.
struct Offset {
    double slipped = 0.0;  // of an offset of the axis, (C9)
    double lag = 0.0;      // of the age of its values beyond that of their stamps, (C10) [s]

    bool operator==(const Offset&) const = default;
};

/// An accepted reading that waits for those of other channels.
struct Reading {
    Nanoseconds stamp_ns;
    double angle;
    double curvature;  // since the reading before, see `Motion::curvature` [rad/ns^2]
    Offset offset;
    bool after_gap;    // whether none came for so long before it that a driver may have started anew
    bool unread = false;  // whether nothing is known of the axis between the reading before and this one
};

/// An angle as extrapolated from a reading on, to be compared with a later one.
struct Extrapolation {
    Nanoseconds stamp_ns, window_ns;  // of that reading; over which the velocity was averaged
    double angle, velocity;           // there [rad], [rad/s]
};

/// A reading as received, with the clock's offset added to its stamp.
struct Raw {
    Nanoseconds stamp_ns;
    double reading;
};

/// The count of turns of a sensor that wraps around.
struct Turns {
    Nanoseconds stamp_ns = -1;     // of the last accepted reading; -1 before the first
    std::optional<double> last{};  // that reading, before unwrapping
    std::int64_t count = 0;        // periods that unwrapping adds to it
};

/// What a reading means if it is the next one of its channel.
struct Unwrapped {
    std::int64_t turns;
    double angle;
};

/// Result of comparing a stamp with the last one accepted.
enum class Timing { usable, repeated, contradictory, late, another_time };

/// How far the readings of an axis lag those of the others, by their stamps when they arrive.
///
/// The least lag of many readings is that of a topic that is always late, or of a clock that is behind.
/// Nothing in the stamps tells which. A reading has arrived before the next one of another axis, which
/// bounds by how much the clock can be behind; this is in the standard deviations, (C10) of
/// docs/estimation.md.
struct Lag {
    Nanoseconds lag_ns = 0;  // in the last complete window, or less since; in the first one so far
    double growth = 0.0;     // of the lag since the first window, per time
    Nanoseconds most_ns = 0;  // by how much the axis's clock may be behind others, D of (C10)
    Nanoseconds silent_ns = 0;  // by how much another axis has gone on since its last reading, by own stamps
    bool apart = false;       // whether another axis is in other messages

    /// Takes the stamp of a reading of another axis.
    void meet(std::size_t axis, Nanoseconds stamp_ns);

    /// Takes the stamp of a reading of this axis.
    void take(Nanoseconds stamp_ns);

    /// Notes that a reading of this axis is accepted.
    void hear() {
        silent_ns = 0;
        ++heard_;
    }

private:
    /// Another axis.
    struct Other {
        Nanoseconds newest_ns = -1;       // its newest stamp
        Nanoseconds heard_ns = -1;        // that when this axis was last heard, as if there had been no gap since
        std::int64_t since = -1;          // number of that reading
        bool is_new = false;              // whether it has arrived since the last reading of this axis
        // In the window in progress:
        Nanoseconds least_ns = EVER_NS;  // from a stamp of this axis to its next one
        int shared = 0;                  // readings of this axis that have its newest stamp, just arrived
    };

    std::vector<Other> others_;
    std::int64_t heard_ = 0;          // number of accepted readings
    Nanoseconds last_ns_ = -1;        // the last stamp of this axis
    Nanoseconds begin_ns_ = -1;       // of the window in progress
    Nanoseconds least_ns_ = EVER_NS;  // lag in it
    int count_ = 0;                   // readings of this axis in it
    Nanoseconds first_ns_ = -1;       // end of the first window; -1 before it
    Nanoseconds first_lag_ns_ = 0;    // in that window
};

/// How uneven the times of arrival are that replace stamps of zero, (C14) of docs/estimation.md.
class Arrivals {
public:
    /// Takes the time of arrival of a reading without stamp.
    void take(Nanoseconds arrival_ns);

    /// Standard deviation of these times as stamps [s]; 0 where every reading had a stamp.
    double stddev() const;

private:
    Nanoseconds last_ns_ = -1;      // the last one
    Nanoseconds interval_ns_ = -1;  // before it
    double uneven_ = 0.0;           // greatest difference of two intervals, which fades [s]
};

/// Gate of one channel, with the readings that wait for other channels.
class Channel {
public:
    explicit Channel(const Axis& axis);

    /// Begins after `earlier`, whose clock went back: its motion and its sensor's steps stay known.
    void take_over(const Channel& earlier);

    /// Keeps the motion so far and the count of turns, whenever the next reading comes.
    void keep_turns(const Channel& earlier);

    /// Keeps the count of turns if the first reading follows within `MAX_GAP_NS`.
    void keep_turns_for_a_while(const Channel& earlier);
    void go_on_turning(Nanoseconds stamp_ns);

    /// The turns and the angle of a reading within `LARGEST` if it is the next one.
    Unwrapped unwrap(const Axis& axis, double reading) const;

    /// Cause for refusing a reading as the next one: none, out_of_range or implausible.
    Cause complaint(const Axis& axis, Raw raw) const;

    /// Longest interval between readings in which a driver has not started anew.
    Nanoseconds restart_ns() const;

    /// Whether it has been read so lately that others wait for it.
    bool speaks() const;

    /// Whether the next reading is that of a driver that counts from where its axis stands: zero after a gap.
    bool counts_anew(const Axis& axis, Raw raw, double angle) const {
        const bool after_gap = last_ns >= 0 && raw.stamp_ns - last_ns > restart_ns();
        const double least = std::max(axis.worth, motion.reach(usual_ns * 1e-9));
        const bool moved = axis.worth > 0.0 && std::abs(angle - last) > least;
        return after_gap && moved && std::abs(axis.scale * raw.reading) <= axis.band;
    }

    /// Longest interval that needs no confirmation by later readings.
    Nanoseconds patience_ns() const;

    /// Whether a stamp continues the held readings.
    bool follows(Nanoseconds stamp_ns) const;

    /// Whether the first accepted reading and the held ones have a regular rate.
    bool is_regular() const;

    /// Compares a reading's stamp with the last one accepted; this is one of `channels`.
    Timing timing(const Axis& axis, Raw raw, std::span<const Channel> channels);

    /// Notes that readings no longer repeat an old one: the next one shows what the axis did meanwhile.
    void resume(const Axis& axis, double angle);

    /// Records a reading that the axis cannot have reached: a glitch, a step, or another publisher's.
    void note_implausible(const Axis& axis, Raw raw);

    /// Takes an accepted angle; returns whether it shows a step of the sensor.
    ///
    /// It does if it continues the refused readings before it, or with `StepDetector`.
    bool note_plausible(const Axis& axis, Point next, bool off);

    /// Whether readings may be wrong because their sensor has stepped, is stuck, or not the only one, their
    /// unit is another one, or there is but one of them.
    bool is_doubtful() const {
        return steps.doubts() || steps.repeats() || misfits || alone;
    }

    /// Its motion since the first reading.
    double moved() const { return last_ns >= 0 ? last - *first : 0.0; }

    /// Notes whether a reading shows that counts are not degrees, (C15).
    void look_at_counts(const Axis& axis, double reading);

    /// Whether its counts do not exclude degrees yet.
    bool is_unit_open(const Axis& axis) const { return axis.worth > 0.0 && axis.worth < INFINITE && !counted; }

    /// What its motion so far is wrong by if its unit is.
    double unit_error(const Axis& axis) const {
        return is_unit_open(axis) ? std::abs(moved()) : 0.0;
    }

    /// Notes whether it has moved so far that its counts must have shown its unit, which they have not.
    void doubt_unit(const Axis& axis) {
        misfits = is_unit_open(axis) && (misfits || unit_error(axis) > axis.worth);
    }

    /// Whether an error of the stamps by the lag would count: in the fastest motion so far it would be
    /// worth half of what makes tensions UNSURE.
    bool lags(const Axis& axis) const {
        return axis.worth > 0.0 && lag.lag_ns * 1e-9 * motion.fastest > 0.5 * axis.worth;
    }

    /// Standard deviations that the readings so far do not show, rounded up.
    Offset offset(const Axis& axis);

    /// Tracked angle at an accepted reading; call before it becomes the last one.
    double between_counts(const Axis& axis, Nanoseconds stamp_ns, double angle);

    /// Adds an angle to those that are extrapolated; compares it with what was expected of it half
    /// of `horizon_ns` before.
    void extrapolate_from(Nanoseconds stamp_ns, double angle, Nanoseconds horizon_ns);

    /// The numbers that outlast a restart, as does whether the sensor has stepped.
    static constexpr std::size_t REMEMBERED = 8;
    std::array<double*, REMEMBERED> remembered();

    /// The time over which the velocity is averaged, and the velocity [rad/s].
    Nanoseconds recent_ns() const { return last_ns - recent.front().stamp_ns; }
    double velocity() const;

    Nanoseconds last_ns = -1;     // stamp of the last accepted reading; -1 before the first
    double last = 0.0;            // its angle
    std::deque<Reading> readings;  // the first is the newest at or before the last sample
    std::deque<Raw> recent;       // stamps and angles from which the velocity is computed
    Motion motion;
    TrackingFilter filter;
    Turns turns;
    std::optional<double> near;   // angle expected of the first reading
    Nanoseconds usual_ns = 0;     // longest of the latest intervals; 0 before the second reading
    Nanoseconds mean_ns = 0;      // mean of some dozens but gaps: stamps may be less even than readings
    std::vector<Raw> held;        // readings after a possible jump of the clock
    double resumed = 0.0;         // curvature since the last sample of an earlier run [rad/ns^2]
    Lag lag;
    Arrivals arrivals;
    std::optional<Nanoseconds> ahead_ns;  // stamp of the last reading, less its time of arrival
    StepDetector steps;
    std::optional<Raw> off;       // a reading that the next one is to judge
    bool in_doubt = false;        // whether the time line has been told so
    std::optional<double> first;  // its first angle
    bool misfits = false;         // whether its counts leave its unit in doubt, and it has moved too far
    bool alone = false;           // whether there is only the first reading
    bool counted = false;         // whether a change was no multiple of a count in degrees, (C15)
    bool lost_way = false;        // whether the motion up to the next reading is unknown
    bool told = false;            // whether the last sample that was not predicted had its angle
    bool was_away = false;        // whether the time line has passed a reading after a gap since the last sample
    Nanoseconds left_behind_ns = -1;  // last stamp before the clock went back; -1 if it did not

private:
    std::int64_t first_turn(const Axis& axis, double reading) const;
    bool straggles(Nanoseconds stamp_ns, std::span<const Channel> channels);

    Offset exact_, rounded_;        // the last ones, before and after rounding
    std::deque<Extrapolation> tested_;  // those that wait for a reading to be compared with
    Turns before_;                  // those before a reset, until the first reading after it
    int stragglers_ = 0;            // readings from before a jump back that arrived after it
    Raw refused_{-1, 0.0};          // stamp and angle of the last reading refused as implausible
    // Such readings one after the other, each plausible after the one before:
    std::size_t agreeing_ = 0;      // their number
    double step_ = 0.0;             // from the last accepted reading to the first of them
};

}  // namespace cdrj

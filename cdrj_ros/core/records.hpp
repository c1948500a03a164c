// What the conditioning of readings takes, remembers and gives: plain records.
//
// Angles are in rad (in m for a sliding axis), times in s unless their name ends in _ns.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

namespace cdrj {

using Nanoseconds = std::int64_t;

inline constexpr double INFINITE = std::numeric_limits<double>::infinity();

/// Every stamp of a message header is below this.
inline constexpr Nanoseconds END_OF_TIME_NS = (Nanoseconds{1} << 31) * 1'000'000'000;

/// The angle of an axis of which no reading tells it.
inline constexpr double UNREAD = std::numeric_limits<double>::quiet_NaN();

/// Longer than any interval.
inline constexpr Nanoseconds EVER_NS = Nanoseconds{1} << 62;

/// Stamp before the first sample.
inline constexpr Nanoseconds NEVER_NS = -1;

/// Standard deviation of an error, by the greatest one that nothing excludes.
inline constexpr double DEVIATION = 0.35;

/// Bound on the magnitude of any reading.
inline constexpr double LARGEST = 1e12;

/// Why a reading is refused; for the first three, why a message is refused whole.
enum class Cause {
    malformed,
    empty,
    unstamped,
    unknown_name,
    not_finite,
    repeated,
    contradictory,
    late,
    future,
    out_of_range,
    implausible,
    none,  // the reading is accepted
};

inline constexpr std::size_t CAUSES = static_cast<std::size_t>(Cause::none);

/// Names of the causes, in their order.
inline constexpr std::array<std::string_view, CAUSES> CAUSE_NAMES{
    "malformed",     "empty", "unstamped", "unknown_name", "not_finite",  "repeated",
    "contradictory", "late",  "future",    "out_of_range", "implausible",
};

/// A motor or joint: how its sensor's readings become angles, and what these must satisfy.
struct Axis {
    std::string name;
    double lower = -INFINITE;
    double upper = INFINITE;
    double max_speed = INFINITE;        // [rad/s]
    Nanoseconds clock_offset_ns = 0;    // added to the stamps of the readings
    double clock_stddev = 0.0;          // standard deviation of what is added [s]
    double period = INFINITE;           // angle after which the reading wraps around
    double scale = 1.0;                 // angle = scale * unwrapped reading + offset
    double offset = 0.0;
    std::vector<double> corrected_at;   // angles at which a correction is given, increasing
    std::vector<double> correction;     // added to the angle; linear between, constant beyond
    double bandwidth = 0.0;             // of the filter between counts [Hz]; 0 for none
    bool adaptive = false;              // whether that bandwidth rises with the motion
    double band = 0.0;                  // greatest difference of an angle and its reading
    double negligible = 0.0;            // standard deviations up to this are not reported
    double count = 0.0;                 // resolution of the readings; 0 where it is unknown
    double worth = 0.0;  // change of the angle that alone makes tensions UNSURE; 0 where unknown
    double start = 0.0;                 // an ambiguous first reading means the angle nearest to it
};

/// When a message arrived.
struct Arrival {
    Nanoseconds at_ns = NEVER_NS;  // NEVER_NS where nobody knows
    bool is_stamp = false;         // whether it replaces the stamp, because the header's is zero
};

/// Angles of all motors, then all joints, at one time.
struct Sample {
    Nanoseconds stamp_ns = 0;
    std::vector<double> angle{};  // UNREAD of axes of which nothing is known
    // Standard deviations due to sparse readings: of every axis at the sample's time, then of every
    // axis midway between the sample before and this one; infinite where the motion between them is
    // unknown. Empty where all are zero.
    std::vector<double> unseen{};
    // Standard deviations of errors that last and that the readings do not show: of offsets of all
    // axes, (C9), then of how much older their values are than the stamps [s], (C10); empty where
    // they are those of the sample before.
    std::vector<double> offset{};
    // Of every axis, whether its angle may be wrong because its sensor may have stepped, and whether its
    // last reading was before a gap or is the first one after it; empty where that holds for none.
    std::vector<bool> doubtful{};
    std::vector<bool> after_gap{};
    bool predicted = false;  // an angle is extrapolated
    bool silent = false;     // a predicted sample was at least as late; not given out
};

}  // namespace cdrj

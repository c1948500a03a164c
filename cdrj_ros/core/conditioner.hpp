// Conditioning of one robot's messages: gates that check the readings, then the common time line.
//
// Every motor and joint is a channel with a gate of its own. Messages of the robot are taken here;
// readings that pass their gates go on to the time line, which makes samples of them. See
// docs/estimation.md.
#pragma once

#include <array>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "channel.hpp"
#include "messages.hpp"
#include "records.hpp"
#include "time_line.hpp"

namespace cdrj {

/// What a topic carries.
enum class Topic { motors, joints, both };

/// Gates and time line of one robot: takes messages, returns samples.
class Conditioner {
public:
    /// Where a name of a message belongs: a channel, or one of the two below.
    using Target = std::ptrdiff_t;
    static constexpr Target ELSEWHERE = -1;  // a joint in a message of motors, or the reverse
    static constexpr Target UNKNOWN = -2;    // no name of the robot

    /// What outlasts a restart.
    struct Memory {
        std::vector<double> numbers;  // `Channel::remembered` of every axis
        std::vector<double> stepped;  // 1 where its sensor has stepped, otherwise 0
    };

    /// axes: of all motors, then all joints, in the robot's order.
    /// motors: how many of them are motors.
    /// cables: the axes of every cable, see `TimeLine`.
    /// predict: whether lagging channels are extrapolated, by up to `horizon_ns`.
    Conditioner(
        std::vector<Axis> axes, std::size_t motors, std::vector<std::vector<std::size_t>> cables,
        bool predict, Nanoseconds horizon_ns);
    Conditioner(const Conditioner&) = delete;  // recordings refer to it
    Conditioner& operator=(const Conditioner&) = delete;

    /// Where a name on a topic belongs.
    Target find(Topic topic, std::string_view name) const;

    /// Takes a message, one target per position; returns the samples that are now complete.
    std::vector<Sample> take(
        Nanoseconds stamp_ns, std::span<const Target> targets, std::span<const double> positions,
        Arrival arrival = {});

    /// Takes a message of a topic; returns the samples that are now complete. A message without
    /// positions has no readings.
    std::vector<Sample> take(Topic topic, const JointState& message);

    /// Counts a message that is refused whole, or a reading.
    void refuse(Cause cause) { ++refused_[static_cast<std::size_t>(cause)]; }

    /// Forgets all readings; the counters stay.
    ///
    /// keep_turns: keeps the motion estimates of the axes and the count of turns of every sensor
    /// that wraps around. Otherwise only the count is kept, and only if the next reading follows
    /// within `MAX_GAP_NS`.
    void reset(bool keep_turns);

    /// What outlasts a restart, and its restoration before the first reading.
    Memory memory();
    void recall(std::span<const double> numbers, std::span<const double> stepped);

    /// Continues from the last sample of an earlier run, which had one angle per axis.
    void expect(std::span<const double> angles, Nanoseconds stamp_ns);

    /// Changes the tracking bandwidths to those of `axes`; no reading is lost.
    void set_tracking(std::vector<Axis> axes);

    std::size_t motors() const { return motors_; }
    const std::vector<Axis>& axes() const { return axes_; }
    const std::vector<Channel>& channels() const { return channels_; }
    const TimeLine& time_line() const { return time_line_; }
    const std::array<std::int64_t, CAUSES>& refused() const { return refused_; }

    /// The largest reading refused for each cause since the last call, axis by axis.
    ///
    /// Its size is by how much it is late or ahead of the last one accepted [s], its angle where it is
    /// out of range [rad], or the speed that it would need [rad/s]; NaN where the axis had none.
    using Sizes = std::array<double, CAUSES>;
    std::vector<Sizes> take_refused();

    std::int64_t accepted = 0;     // readings
    std::int64_t elsewhere = 0;    // readings ignored
    std::int64_t clock_jumps = 0;  // times that the clock went back and conditioning restarted
    std::int64_t gaps = 0;         // times that a channel was silent beyond its patience
    std::int64_t steps = 0;        // steps of sensors

private:
    void begin();
    bool admit(std::size_t k, Nanoseconds stamp_ns, double reading, Arrival arrival);
    bool judge(std::size_t k, Raw raw);
    void note_contradiction(std::size_t k, Nanoseconds stamp_ns);
    void tell_doubt(std::size_t k, Nanoseconds since_ns, Nanoseconds stamp_ns);
    LeastMotion shown_by_others(std::size_t k, Nanoseconds stamp_ns) const;
    void append(std::size_t k, Raw raw, Nanoseconds since_ns, bool off);
    void refuse(std::size_t k, Cause cause, Raw raw);
    void drop_held(std::size_t k);
    void drop_off(Channel& channel);
    bool hold(std::size_t k, Raw raw);
    bool append_held(std::size_t k, std::span<const Raw> confirmed);
    bool jump_back(std::size_t k);

    std::vector<Axis> axes_;
    std::size_t motors_;
    std::map<std::string, std::size_t, std::less<>> index_;
    std::vector<Channel> channels_;
    TimeLine time_line_;
    std::array<std::int64_t, CAUSES> refused_{};
    std::vector<Sizes> sizes_;     // see `take_refused`
    std::vector<Target> targets_;  // of the message that is being taken
};

/// The angles that readings of an axis mean, whether or not they are acceptable.
std::vector<double> angles_of(const Axis& axis, std::span<const double> readings);

/// Angle that a single reading means; of those that it may mean, the one in range nearest to `near`.
double angle_near(const Axis& axis, double reading, double near);

}  // namespace cdrj

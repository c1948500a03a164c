// The common time line of the samples.
//
// Accepted readings are brought to one time line: the union of all stamps, with every channel
// interpolated linearly between its own readings. An estimate therefore waits for the slowest
// channel: holding the last joint angle while the motor moves on would add a sawtooth to the
// tensions. One that is silent for longer keeps back its own cables alone. The result does not depend on the order in which different topics arrive. Where waiting
// costs too much, further samples are given in advance, for which the slower channels are
// extrapolated. See docs/estimation.md.
#pragma once

#include <span>
#include <utility>
#include <vector>

#include "channel.hpp"
#include "records.hpp"

namespace cdrj {

/// Greatest number of readings that a channel keeps for another channel: 20 s at 1 kHz.
inline constexpr std::size_t WAITING = 20'000;

/// Samples of all channels at common times.
class TimeLine {
public:
    /// cables: the axes without which nothing is known of a cable, of every cable.
    /// predict: whether lagging channels are extrapolated.
    /// horizon_ns: longest time to extrapolate.
    TimeLine(
        std::vector<std::vector<std::size_t>> cables, bool predict, Nanoseconds horizon_ns)
        : cables_(std::move(cables)), predict_(predict), horizon_ns_(horizon_ns) {}

    /// Begins without readings.
    void begin();

    /// Continues an earlier run, whose last sample had this stamp.
    void resume(Nanoseconds stamp_ns) { resumed_ns_ = stamp_ns; }

    /// Whether there has been a sample that is not predicted.
    bool has_begun() const { return given_out_ns_ >= 0; }

    /// Marks samples after a stamp as doubtful until the channel's doubt ends with another one.
    void begin_doubt(std::size_t channel, Nanoseconds after_ns);
    void end_doubt(std::size_t channel, Nanoseconds until_ns);

    /// Stores an accepted reading of a channel and its angle.
    ///
    /// least: what the other axes show of its motion since the reading before.
    void take(
        const Axis& axis, Channel& channel, Raw raw, Unwrapped unwrapped, const LeastMotion& least);

    /// Samples at all stamps that every awaited channel has reached, then a predicted one if enabled.
    std::vector<Sample> samples(std::span<const Axis> axes, std::span<Channel> channels);

    /// Whether others wait for a channel; those that are silent alone are not awaited.
    bool awaits(std::size_t channel) const { return awaited_.empty() || awaited_[channel]; }

    /// Accepted readings dropped because they had waited too long for another channel.
    std::int64_t crowded = 0;
    /// Lag of the last sample behind the newest reading.
    Nanoseconds lag_ns = 0;

private:
    /// A period in which the readings of a channel may come from a sensor that has stepped.
    struct Doubt {
        std::size_t channel;
        Nanoseconds after_ns;            // last good reading before it; -1 if there is none
        Nanoseconds until_ns = EVER_NS;  // first good reading after it
    };
    using Axes = std::span<const Axis>;
    using Channels = std::span<Channel>;

    Nanoseconds await(Channels channels);
    bool tells(std::span<const double> angle) const;
    void tell_offsets(Channels channels, Sample& sample);
    void interpolate(Axes axes, Channels channels, Nanoseconds until_ns, std::vector<Sample>& to);
    bool is_predictable(Channels channels, Nanoseconds newest_ns, Nanoseconds until_ns) const;
    Sample predict(Axes axes, Channels channels, Nanoseconds stamp_ns);
    std::vector<bool> doubtful_at(Nanoseconds stamp_ns, Channels channels) const;

    std::vector<std::vector<std::size_t>> cables_;
    std::vector<bool> awaited_;        // of every channel, see `await`; empty where all are
    bool predict_;
    Nanoseconds horizon_ns_;
    std::vector<Doubt> doubts_;
    std::vector<Offset> offset_;       // those of `Sample::offset` as last given; empty before that
    Nanoseconds resumed_ns_ = -1;      // last sample of an earlier run
    Nanoseconds passed_over_ns_ = -1;  // last sample not given because no cable's axes were all known
    Nanoseconds given_out_ns_ = -1;    // last sample that is not predicted; -1 before the first
    Nanoseconds ahead_ns_ = -1;        // last predicted sample
    Nanoseconds ahead_from_ns_ = -1;   // the sample that a predicted one continues
};

}  // namespace cdrj

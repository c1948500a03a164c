// Messages in plain CDR (XCDR version 1): sensor_msgs/JointState as they arrive, in both byte orders, and
// messages to be sent, whose names and array sizes stay the same.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "records.hpp"

namespace cdrj {

/// What a JointState says, apart from its frame and velocities.
struct JointState {
    Nanoseconds stamp_ns = 0;
    Arrival arrival{};
    std::vector<std::string> names{};
    std::vector<double> positions{};  // one per name, or none
    std::vector<double> efforts{};
};

/// Decodes the messages of one topic; every length is checked before it is used.
class JointStateDecoder {
public:
    /// efforts: whether messages with efforts for only some of their names are malformed.
    explicit JointStateDecoder(bool efforts) : efforts_(efforts) {}

    /// Decodes a message that arrived at `arrival_ns`, which replaces a stamp of zero.
    ///
    /// Returns false if it is malformed, which leaves `last` as it is.
    bool decode(std::string_view payload, Nanoseconds arrival_ns);

    /// The last message that was not malformed.
    const JointState& last() const { return last_; }

private:
    bool efforts_;
    JointState last_, next_;
};

/// Numbers that are copied into a message.
struct CopiedNumbers {
    std::size_t offset;  // of the first one in the message [bytes], encapsulation included
    std::size_t first;   // index of the first one among the numbers given
    std::size_t count;
};

/// Status of an element, or of a pulley: the flags of both elements beside it.
struct CopiedFlags {
    std::size_t offset;  // in the message [bytes]
    std::size_t before;  // index of an element's status among the values given
    std::size_t after;   // of the other one, which may be the same
};

/// Which numbers of an estimate, and of its standard deviations, a message has.
struct MessageContent {
    std::vector<CopiedNumbers> values;
    std::vector<CopiedNumbers> stddevs;
    std::vector<CopiedFlags> flags;
};

/// A message that is written once, into which stamps and numbers are copied.
class MessageEncoder {
public:
    /// `blank`: the message with any numbers. Throws std::out_of_range where content exceeds it.
    MessageEncoder(std::string blank, MessageContent content);

    /// The message with these numbers; `stamp_ns` in [0, END_OF_TIME_NS).
    const std::string& encode(
        Nanoseconds stamp_ns, std::span<const double> values, std::span<const double> stddevs);

    /// Whether so many values and standard deviations are enough.
    bool takes(std::size_t values, std::size_t stddevs) const;

private:
    std::string message_;
    MessageContent content_;
    std::size_t values_ = 0;   // values that are needed at least
    std::size_t stddevs_ = 0;
};

}  // namespace cdrj

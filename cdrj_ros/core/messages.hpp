// Messages as they arrive: sensor_msgs/JointState in plain CDR (XCDR version 1), in both byte orders.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "records.hpp"

namespace cdrj {

/// What a JointState says, apart from its frame and velocities.
struct JointState {
    Nanoseconds stamp_ns = 0;
    std::vector<std::string> names{};
    std::vector<double> positions{};  // one per name
    std::vector<double> efforts{};
};

/// Decodes the messages of one topic; every length is checked before it is used.
class JointStateDecoder {
public:
    /// efforts: whether messages with efforts for only some of their names are malformed.
    explicit JointStateDecoder(bool efforts) : efforts_(efforts) {}

    /// Decodes a message; false if it is malformed, which leaves `last` as it is.
    bool decode(std::string_view payload);

    /// The last message that was not malformed.
    const JointState& last() const { return last_; }

private:
    bool efforts_;
    JointState last_, next_;
};

/// Whether bytes are UTF-8: no longer form than needed, no surrogates, nothing beyond U+10FFFF.
bool is_utf8(std::string_view bytes);

}  // namespace cdrj

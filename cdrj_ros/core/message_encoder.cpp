#include "message_encoder.hpp"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <utility>

namespace cdrj {
namespace {

static_assert(std::endian::native == std::endian::little, "messages are encoded as they are held");

constexpr std::size_t STAMP = 4;  // where a message's header begins: after the encapsulation

/// Writes the bytes of a number.
template <typename Number>
void put(std::string& message, std::size_t offset, Number number) {
    std::memcpy(message.data() + offset, &number, sizeof number);
}

void put(std::string& message, const CopiedNumbers& to, std::span<const double> numbers) {
    std::memcpy(message.data() + to.offset, numbers.data() + to.first, to.count * sizeof(double));
}

void require_inside(const std::string& message, std::size_t offset, std::size_t size) {
    if (offset > message.size() || size > message.size() - offset) {
        throw std::out_of_range("a field is outside of the message");
    }
}

}  // namespace

MessageEncoder::MessageEncoder(std::string blank, MessageContent content)
    : message_(std::move(blank)), content_(std::move(content)) {
    require_inside(message_, STAMP, 2 * sizeof(std::uint32_t));
    for (const CopiedNumbers& one : content_.values) {
        require_inside(message_, one.offset, one.count * sizeof(double));
        values_ = std::max(values_, one.first + one.count);
    }
    for (const CopiedNumbers& one : content_.stddevs) {
        require_inside(message_, one.offset, one.count * sizeof(double));
        stddevs_ = std::max(stddevs_, one.first + one.count);
    }
    for (const CopiedFlags& one : content_.flags) {
        require_inside(message_, one.offset, 1);
        values_ = std::max(values_, std::max(one.before, one.after) + 1);
    }
}

bool MessageEncoder::takes(std::size_t values, std::size_t stddevs) const {
    return values >= values_ && stddevs >= stddevs_;
}

const std::string& MessageEncoder::encode(
    Nanoseconds stamp_ns, std::span<const double> values, std::span<const double> stddevs) {
    put(message_, STAMP, static_cast<std::int32_t>(stamp_ns / 1'000'000'000));
    put(message_, STAMP + 4, static_cast<std::uint32_t>(stamp_ns % 1'000'000'000));
    for (const CopiedNumbers& one : content_.values) put(message_, one, values);
    for (const CopiedNumbers& one : content_.stddevs) put(message_, one, stddevs);
    for (const CopiedFlags& one : content_.flags) {
        const auto before = static_cast<std::uint8_t>(values[one.before]);
        const auto after = static_cast<std::uint8_t>(values[one.after]);
        message_[one.offset] = static_cast<char>(before | after);
    }
    return message_;
}

}  // namespace cdrj

#include "messages.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <utility>

namespace cdrj {
namespace {

constexpr std::size_t ENCAPSULATION = 4;  // bytes before the first field: representation, options

/// Whether bytes are UTF-8: no longer form than needed, no surrogates, nothing beyond U+10FFFF.
bool is_utf8(std::string_view bytes) {
    const auto at = [&](std::size_t i) { return static_cast<unsigned char>(bytes[i]); };
    for (std::size_t i = 0; i < bytes.size();) {
        const unsigned char first = at(i);
        if (first < 0x80) {
            ++i;
            continue;
        }
        const std::size_t length = first >= 0xF0 ? 4 : first >= 0xE0 ? 3 : 2;
        if (first < 0xC2 || first > 0xF4 || length > bytes.size() - i) return false;
        // the range of the second byte excludes longer forms, surrogates and what is beyond the end
        const unsigned char least = first == 0xE0 ? 0xA0 : first == 0xF0 ? 0x90 : 0x80;
        const unsigned char most = first == 0xED ? 0x9F : first == 0xF4 ? 0x8F : 0xBF;
        if (at(i + 1) < least || at(i + 1) > most) return false;
        for (std::size_t k = 2; k < length; ++k) {
            if ((at(i + k) & 0xC0) != 0x80) return false;
        }
        i += length;
    }
    return true;
}

/// A cursor over one message; once a field does not fit, nothing fits any more.
class Reader {
public:
    explicit Reader(std::string_view payload) : payload_(payload) {
        fits_ = payload.size() >= ENCAPSULATION && payload[0] == 0 &&
                (payload[1] == 0 || payload[1] == 1);
        swaps_ = fits_ && (payload[1] == 1) != (std::endian::native == std::endian::little);
    }

    bool fits() const { return fits_; }

    template <typename Number>
    Number number() {
        std::array<char, sizeof(Number)> bytes{};
        const std::string_view found = take(sizeof(Number), sizeof(Number));
        std::copy(found.begin(), found.end(), bytes.begin());
        if (swaps_) std::reverse(bytes.begin(), bytes.end());
        return std::bit_cast<Number>(bytes);
    }

    /// A text, which a zero byte ends.
    std::string_view text() {
        const std::size_t size = number<std::uint32_t>();
        std::string_view found = take(size, 1);
        if (found.empty()) return found;
        fits_ = fits_ && found.back() == '\0';
        found.remove_suffix(1);
        fits_ = fits_ && is_utf8(found);
        return found;
    }

    void texts(std::vector<std::string>& to) {
        const std::size_t count = number<std::uint32_t>();
        fits_ = fits_ && count <= (payload_.size() - at_) / sizeof(std::uint32_t);
        to.resize(fits_ ? count : 0);
        for (std::string& one : to) one = text();
    }

    void numbers(std::vector<double>& to) {
        const std::size_t count = number<std::uint32_t>();
        const std::string_view found = take(count * sizeof(double), sizeof(double));
        to.resize(found.size() / sizeof(double));
        if (!to.empty()) std::memcpy(to.data(), found.data(), found.size());
        if (!swaps_) return;
        for (double& one : to) {
            auto bytes = std::bit_cast<std::array<char, sizeof(double)>>(one);
            std::reverse(bytes.begin(), bytes.end());
            one = std::bit_cast<double>(bytes);
        }
    }

private:
    /// The next bytes, aligned from the end of the encapsulation; none if they do not fit.
    std::string_view take(std::size_t size, std::size_t alignment) {
        if (size == 0) return {};
        const std::size_t over = (at_ - ENCAPSULATION) % alignment;
        const std::size_t begin = over == 0 ? at_ : at_ + alignment - over;
        fits_ = fits_ && begin <= payload_.size() && size <= payload_.size() - begin;
        if (!fits_) return {};
        at_ = begin + size;
        return payload_.substr(begin, size);
    }

    std::string_view payload_;
    std::size_t at_ = ENCAPSULATION;
    bool fits_ = false;
    bool swaps_ = false;
};

static_assert(std::endian::native == std::endian::little, "messages are encoded as they are held");

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

bool JointStateDecoder::decode(std::string_view payload, Nanoseconds arrival_ns) {
    Reader reader(payload);
    const Nanoseconds seconds = reader.number<std::int32_t>();
    next_.stamp_ns = seconds * 1'000'000'000 + reader.number<std::uint32_t>();
    next_.arrival = {arrival_ns, next_.stamp_ns == 0};
    if (next_.arrival.is_stamp) next_.stamp_ns = arrival_ns;
    reader.text();  // the frame
    reader.texts(next_.names);
    reader.numbers(next_.positions);
    reader.numbers(next_.efforts);  // the velocities, which are not used
    reader.numbers(next_.efforts);
    const bool per_name =
        next_.positions.empty() || next_.positions.size() == next_.names.size();
    if (!reader.fits() || !per_name) return false;
    const bool some = !next_.efforts.empty() && next_.efforts.size() != next_.names.size();
    if (efforts_ && some) return false;
    std::swap(last_, next_);
    return true;
}

MessageEncoder::MessageEncoder(std::string blank, MessageContent content)
    : message_(std::move(blank)), content_(std::move(content)) {
    require_inside(message_, ENCAPSULATION, 2 * sizeof(std::uint32_t));
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
    put(message_, ENCAPSULATION, static_cast<std::int32_t>(stamp_ns / 1'000'000'000));
    put(message_, ENCAPSULATION + 4, static_cast<std::uint32_t>(stamp_ns % 1'000'000'000));
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

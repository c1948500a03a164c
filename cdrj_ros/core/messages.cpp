#include "messages.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <utility>

namespace cdrj {
namespace {

constexpr std::size_t ENCAPSULATION = 4;  // bytes before the first field: representation, options

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

}  // namespace

bool JointStateDecoder::decode(std::string_view payload) {
    Reader reader(payload);
    const Nanoseconds seconds = reader.number<std::int32_t>();
    next_.stamp_ns = seconds * 1'000'000'000 + reader.number<std::uint32_t>();
    reader.text();  // the frame
    reader.texts(next_.names);
    reader.numbers(next_.positions);
    reader.numbers(next_.efforts);  // the velocities, which are not used
    reader.numbers(next_.efforts);
    if (!reader.fits() || next_.names.size() != next_.positions.size()) return false;
    const bool some = !next_.efforts.empty() && next_.efforts.size() != next_.names.size();
    if (efforts_ && some) return false;
    std::swap(last_, next_);
    return true;
}

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

}  // namespace cdrj

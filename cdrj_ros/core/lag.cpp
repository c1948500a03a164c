#include "lag.hpp"

#include <algorithm>

namespace cdrj {
namespace {

constexpr Nanoseconds WINDOW_NS = 500'000'000;  // shortest window
constexpr int READINGS = 8;                       // fewest readings in one

}  // namespace

void Lag::meet(std::size_t axis, Nanoseconds stamp_ns) {
    if (others_.size() <= axis) others_.resize(axis + 1);
    Other& other = others_[axis];
    other.newest_ns = stamp_ns;
    if (last_ns_ < 0) return;
    other.least_ns = std::min(other.least_ns, std::max<Nanoseconds>(stamp_ns - last_ns_, 0));
}

void Lag::take(Nanoseconds stamp_ns) {
    last_ns_ = stamp_ns;
    ++count_;
    Nanoseconds newest_ns = -1, most = 0;
    for (Other& other : others_) {
        if (other.newest_ns < 0) continue;  // this axis, or a silent one
        newest_ns = std::max(newest_ns, other.newest_ns);
        if (other.newest_ns == stamp_ns) ++other.shared;
        const bool one_clock = 2 * other.shared >= count_;
        const bool met = other.least_ns != EVER_NS;
        most = std::max(most, one_clock ? 0 : met ? other.least_ns : most_ns);
    }
    if (newest_ns < 0) return;
    const Nanoseconds behind_ns = std::max<Nanoseconds>(newest_ns - stamp_ns, 0);
    if (begin_ns_ < 0) begin_ns_ = stamp_ns;
    least_ns_ = std::min(least_ns_, behind_ns);
    lag_ns = first_ns_ < 0 ? least_ns_ : std::min(lag_ns, behind_ns);
    if (first_ns_ < 0) most_ns = most;
    if (count_ < READINGS || stamp_ns - begin_ns_ < WINDOW_NS) return;
    lag_ns = least_ns_;
    most_ns = most;
    if (first_ns_ < 0) {
        first_ns_ = stamp_ns;
        first_lag_ns_ = lag_ns;
    } else {
        growth = static_cast<double>(lag_ns - first_lag_ns_) /
                 static_cast<double>(stamp_ns - first_ns_);
    }
    begin_ns_ = stamp_ns;
    least_ns_ = EVER_NS;
    for (Other& other : others_) other = {other.newest_ns};
    count_ = 0;
}

}  // namespace cdrj

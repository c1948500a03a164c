#include "lag.hpp"

#include <algorithm>

namespace cdrj {
namespace {

constexpr Nanoseconds WINDOW_NS = 1'000'000'000;  // shortest window
constexpr int READINGS = 8;                       // fewest readings in one

}  // namespace

void Lag::take(Nanoseconds stamp_ns, Nanoseconds newest_ns) {
    const Nanoseconds behind_ns = std::max<Nanoseconds>(newest_ns - stamp_ns, 0);
    if (begin_ns_ < 0) begin_ns_ = stamp_ns;
    least_ns_ = std::min(least_ns_, behind_ns);
    lag_ns = std::min(lag_ns, behind_ns);
    if (++count_ < READINGS || stamp_ns - begin_ns_ < WINDOW_NS) return;
    lag_ns = least_ns_;
    if (first_ns_ < 0) {
        first_ns_ = stamp_ns;
        first_lag_ns_ = lag_ns;
    } else {
        growth = static_cast<double>(lag_ns - first_lag_ns_) /
                 static_cast<double>(stamp_ns - first_ns_);
    }
    begin_ns_ = stamp_ns;
    least_ns_ = EVER_NS;
    count_ = 0;
}

}  // namespace cdrj

#include "lag.hpp"

#include <algorithm>

namespace cdrj {
namespace {

constexpr Nanoseconds WINDOW_NS = 500'000'000;  // shortest window
constexpr Nanoseconds HIDDEN_NS = 5'000'000;    // most by which clocks may differ without a lag
constexpr int READINGS = 8;                       // fewest readings in one

}  // namespace

void Newest::take(Nanoseconds of_ns, std::size_t axes) {
    if (of_ns < stamp_ns) return;
    if (of_ns > stamp_ns) {
        if (stamp_ns >= 0) passed_ns += std::min(of_ns - stamp_ns, HIDDEN_NS);
        stamp_ns = of_ns;
        there = 0;
        ++count;
    }
    if (++there == axes) common_ns = stamp_ns;
}

void Lag::take(Nanoseconds stamp_ns, const Newest& newest) {
    const Nanoseconds behind_ns = std::max<Nanoseconds>(newest.stamp_ns - stamp_ns, 0);
    if (begin_ns_ < 0) {
        begin_ns_ = stamp_ns;
        before_ = newest;
    }
    least_ns_ = std::min(least_ns_, behind_ns);
    lag_ns = first_ns_ < 0 ? least_ns_ : std::min(lag_ns, behind_ns);
    if (first_ns_ < 0) measure_step(newest);
    if (++count_ < READINGS || stamp_ns - begin_ns_ < WINDOW_NS) return;
    lag_ns = least_ns_;
    measure_step(newest);
    if (first_ns_ < 0) {
        first_ns_ = stamp_ns;
        first_lag_ns_ = lag_ns;
    } else {
        growth = static_cast<double>(lag_ns - first_lag_ns_) /
                 static_cast<double>(stamp_ns - first_ns_);
    }
    begin_ns_ = stamp_ns;
    before_ = newest;
    least_ns_ = EVER_NS;
    count_ = 0;
}

void Lag::measure_step(const Newest& newest) {
    const std::int64_t grown = newest.count - before_.count;
    if (newest.common_ns >= before_.stamp_ns) {
        step_ns_ = 0;
    } else if (grown > 0) {
        step_ns_ = (newest.passed_ns - before_.passed_ns) / grown;
    }
}

}  // namespace cdrj

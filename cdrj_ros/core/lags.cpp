#include "lags.hpp"

#include <algorithm>
#include <cmath>

namespace cdrj {
namespace {

/// Means are taken over at least this time [s].
constexpr double SHORTEST = 0.02;

/// Blocks further apart than this are not compared [s].
constexpr double LONGEST = 0.3;

/// Blocks that are remembered: the one in progress, and three before it.
constexpr std::size_t BLOCKS = 4;

/// A speed that exceeds all before it counts as a little more, so that few do.
constexpr double MORE = 1.1;

/// Numbers of a block before its means.
constexpr std::size_t HEAD = 3;

double square(double x) { return x * x; }

}  // namespace

// `numbers` holds the offsets, the swing of every cable, the range of the velocity of every axis, the blocks,
// the fits.

Lags::Lags(std::size_t axes, std::vector<double> gains)
    : axes_(axes),
      cables_(axes == 0 ? 0 : gains.size() / axes),
      gains_(std::move(gains)),
      late_share_(cables_, 1.0),
      velocity_(axes_),
      acceleration_(axes_),
      angle_(axes_) {
    std::size_t size = 4 * axes_ + 2 * cables_ + BLOCKS * (HEAD + cables_ + axes_);
    for (std::size_t c = 0; c < cables_; ++c) {
        fits_.emplace_back(std::span(gains_).subspan(c * axes_, axes_));
        begin_.push_back(size);
        size += fits_.back().size();
    }
    numbers.resize(size);
    for (std::size_t c = 0; c < cables_; ++c) {
        swing(c)[0] = INFINITE;
        swing(c)[1] = -INFINITE;
    }
}

Lags::Block Lags::block(std::size_t k) {
    const std::size_t width = HEAD + cables_ + axes_;
    return {std::span(numbers).subspan(4 * axes_ + 2 * cables_ + k * width, width)};
}

std::span<double> Lags::memory_of(std::size_t cable) {
    return std::span(numbers).subspan(begin_[cable], fits_[cable].size());
}

std::span<const double> Lags::memory_of(std::size_t cable) const {
    return std::span(numbers).subspan(begin_[cable], fits_[cable].size());
}

double Lags::fastest(std::size_t axis) const {
    const auto range = std::span(numbers).subspan(2 * (axes_ + cables_ + axis), 2);
    return std::max(-range[0], range[1]);
}

void Lags::take_offset(std::span<const double> given) {
    std::ranges::copy(given, numbers.begin());
    renew();
}

void Lags::renew() {
    for (std::size_t c = 0; c < cables_; ++c) bound(c);
}

bool Lags::take(
    Nanoseconds stamp_ns, std::span<const double> angles, std::span<const double> tensions) {
    const double now = static_cast<double>(stamp_ns) * 1e-9;
    Block block = this->block(0);
    bool closed = false;
    if (block.count() > 0.0) {
        const double since = now - block.numbers[1];
        if (!(0.0 <= since && since <= LONGEST)) {  // a gap, or the clock was set
            for (std::size_t k = 0; k < BLOCKS; ++k) this->block(k).count() = 0.0;
        } else if (since >= SHORTEST) {
            close();
            closed = true;
        }
    }
    const double count = block.count() += 1.0;
    if (count == 1.0) {
        std::fill(block.numbers.begin() + 1, block.numbers.end(), 0.0);
        block.numbers[1] = now;
    }
    const auto mean = [&](std::size_t i, double value) {
        block.numbers[i] += (value - block.numbers[i]) / count;
    };
    mean(2, now - block.numbers[1]);
    for (std::size_t c = 0; c < cables_; ++c) {
        mean(HEAD + c, tensions[c]);
        double &lowest = swing(c)[0], &highest = swing(c)[1];
        if (lowest <= tensions[c] && tensions[c] <= highest) continue;
        lowest = std::min(lowest, tensions[c]);
        highest = std::max(highest, tensions[c]);
        bound(c);
    }
    for (std::size_t a = 0; a < axes_; ++a) mean(HEAD + cables_ + a, angles[a]);
    return closed || is_faster(now, angles);
}

/// Raises the range of the velocities by those since the last block; whether one has changed much.
bool Lags::is_faster(double now, std::span<const double> angles) {
    const Block last = block(1);
    const double since = now - last.time();
    if (last.count() == 0.0 || since < 0.5 * SHORTEST) return false;
    bool faster = false;
    for (std::size_t a = 0; a < axes_; ++a) {
        const double velocity = (angles[a] - last.numbers[HEAD + cables_ + a]) / since;
        double& end = range(a)[velocity < 0.0 ? 0 : 1];
        if (std::abs(velocity) <= std::abs(end)) continue;
        end = MORE * velocity;
        faster = true;
    }
    if (!faster) return false;
    renew();
    return true;
}

/// Ends the block in progress, and compares it with those before it.
void Lags::close() {
    for (std::size_t k = BLOCKS - 1; k > 0; --k) {
        std::ranges::copy(block(k - 1).numbers, block(k).numbers.begin());
    }
    block(0).count() = 0.0;
    const Block last = block(1), middle = block(2), first = block(3);
    if (middle.count() == 0.0) return;
    const double late = last.time() - middle.time(), early = middle.time() - first.time();
    const std::size_t angles = HEAD + cables_;
    if (first.count() == 0.0) return;
    for (std::size_t a = 0; a < axes_; ++a) {
        const double after = (last.numbers[angles + a] - middle.numbers[angles + a]) / late;
        const double before = (middle.numbers[angles + a] - first.numbers[angles + a]) / early;
        velocity_[a] = (late * before + early * after) / (late + early);
        acceleration_[a] = 2.0 * (after - before) / (late + early);
        angle_[a] = middle.numbers[angles + a];
    }
    const auto stddev = offset().last(axes_);
    for (std::size_t c = 0; c < cables_; ++c) {
        fits_[c].take(
            memory_of(c),
            {0.5 * (late + early), velocity_, angle_, acceleration_, middle.numbers[HEAD + c]}, stddev);
        bound(c);
    }
}

/// Computes the share of a cable.
void Lags::bound(std::size_t c) {
    double swung = 0.0;
    for (std::size_t a = 0; a < axes_; ++a) {
        const double gain = gains_[c * axes_ + a], lag = gain * offset()[axes_ + a];
        swung += square(lag * (range(a)[1] - range(a)[0]));
    }
    const double swung_so_far = std::max(swing(c)[1] - swing(c)[0], 0.0);
    const double seen = square(DEVIATION * swung_so_far);
    late_share_[c] = swung > seen ? seen / swung : 1.0;
    const auto stddev = offset().last(axes_);
    late_share_[c] = std::min(late_share_[c], fits_[c].share(memory_of(c), stddev));
}

LagFit::Lag Lags::lag(std::size_t axis) const {
    LagFit::Lag best{0.0, INFINITE};
    for (std::size_t c = 0; c < cables_; ++c) {
        const LagFit::Lag one = fits_[c].lag(memory_of(c), axis);
        if (one.stddev < best.stddev) best = one;
    }
    return best;
}

}  // namespace cdrj

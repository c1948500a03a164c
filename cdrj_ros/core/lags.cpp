#include "lags.hpp"

#include <algorithm>
#include <cmath>

namespace cdrj {
namespace {

/// Blocks that are remembered: the one in progress, and for a curvature three before it.
constexpr std::size_t FOR_VELOCITY = 2, FOR_CURVATURE = 4;

/// A speed that exceeds all before it counts as a little more, so that few do.
constexpr double MORE = 1.1;

/// Standard deviation of what lags are worth, by the swing of the mean tension, of which a lag is worth all at
/// first, and half of it once the axes have moved to and fro.
constexpr double SWUNG = 0.6;

double square(double x) { return x * x; }

/// Widens a range, by its ends, to a value; whether that has changed it.
bool widen(std::span<double> range, double value, double more = 1.0) {
    const bool below = value < range[0], above = value > range[1];
    if (below) range[0] = more * value;
    if (above) range[1] = more * value;
    return below || above;
}

}  // namespace

bool Blocks::take(std::span<double> memory, double now, std::span<const double> values) const {
    double &count = memory[0], &begin = memory[1];
    bool ended = false;
    if (count > 0.0) {
        const double since = now - begin;
        if (!(0.0 <= since && since <= LONGEST)) {  // a gap, or the clock was set
            for (std::size_t k = 0; k < count_; ++k) memory[k * width_] = 0.0;
        } else if (since >= SHORTEST) {
            std::shift_right(memory.begin(), memory.begin() + static_cast<std::ptrdiff_t>(size()),
                             static_cast<std::ptrdiff_t>(width_));
            count = 0.0;
            ended = true;
        }
    }
    if (count == 0.0) {
        std::fill_n(memory.begin(), width_, 0.0);
        begin = now;
    }
    count += 1.0;
    memory[2] += (now - begin - memory[2]) / count;
    for (std::size_t k = 0; k < values.size(); ++k) {
        memory[HEAD + k] += (values[k] - memory[HEAD + k]) / count;
    }
    return ended;
}

// `numbers` holds the offsets, the greatest speed of every axis, `motion_`, the cables.

Lags::Lags(std::size_t axes, std::vector<double> gains)
    : axes_(axes),
      motion_(axes, FOR_VELOCITY),
      velocity_(axes_),
      acceleration_(axes_),
      angle_(axes_) {
    std::size_t size = 3 * axes_ + motion_.size();
    for (std::size_t c = 0; axes > 0 && c < gains.size() / axes; ++c) {
        std::vector<std::size_t> own;
        std::vector<double> own_gains;
        for (std::size_t a = 0; a < axes; ++a) {
            if (!(gains[c * axes + a] > 0.0)) continue;
            own.push_back(a);
            own_gains.push_back(gains[c * axes + a]);
        }
        const Blocks blocks(1 + own.size(), FOR_CURVATURE);
        const LagFit fit{std::span(gains).subspan(c * axes, axes)};
        const std::size_t begin = size;
        size += 2 + 2 * own.size() + blocks.size() + fit.size();
        cables_.push_back({std::move(own), std::move(own_gains), begin, blocks, fit});
    }
    numbers.resize(size);
    for (const Cable& cable : cables_) {
        numbers[cable.begin] = INFINITE;
        numbers[cable.begin + 1] = -INFINITE;
    }
}

std::span<double> Lags::blocks_of(const Cable& cable) {
    const std::size_t begin = cable.begin + 2 + 2 * cable.axes.size();
    return std::span(numbers).subspan(begin, cable.blocks.size());
}

std::span<double> Lags::fit_of(const Cable& cable) {
    const std::size_t begin = cable.begin + 2 + 2 * cable.axes.size() + cable.blocks.size();
    return std::span(numbers).subspan(begin, cable.fit.size());
}

std::span<const double> Lags::fit_of(const Cable& cable) const {
    const std::size_t begin = cable.begin + 2 + 2 * cable.axes.size() + cable.blocks.size();
    return std::span(numbers).subspan(begin, cable.fit.size());
}

void Lags::take_offset(std::span<const double> given) {
    std::ranges::copy(given, numbers.begin());
    renew();
}

void Lags::renew() {
    for (Cable& cable : cables_) bound(cable);
}

bool Lags::take(
    Nanoseconds stamp_ns, std::span<const double> angles, std::span<const double> tensions,
    std::span<const double> unread) {
    const double now = static_cast<double>(stamp_ns) * 1e-9;
    for (std::size_t c = 0; c < cables_.size(); ++c) {
        Cable& cable = cables_[c];
        cable.sudden = std::max(change(cable, now, tensions[c]) - unread[c], 0.0);
        if (unread[c] == 0.0) take_cable(cable, now, angles, tensions[c]);
    }
    return note_speeds(now, angles);
}

/// Raises the greatest speeds to those since the last block; whether one has changed.
bool Lags::note_speeds(double now, std::span<const double> angles) {
    const std::span<double> memory = std::span(numbers).subspan(3 * axes_, motion_.size());
    motion_.take(memory, now, angles);
    const double since = now - motion_.time(memory, 1);
    if (!motion_.has(memory, 1) || since < 0.5 * SHORTEST) return false;
    bool faster = false;
    for (std::size_t a = 0; a < axes_; ++a) {
        const double speed = std::abs(angles[a] - motion_.mean(memory, 1, a)) / since;
        double& fastest = numbers[2 * axes_ + a];
        if (!(speed > fastest)) continue;  // nor where an axis was not read
        fastest = MORE * speed;
        faster = true;
    }
    return faster;
}

/// Change of a mean tension that neither its last block explains nor a line through two of them [N].
double Lags::change(const Cable& cable, double now, double tension) {
    const std::span<const double> memory = blocks_of(cable);
    const Blocks& blocks = cable.blocks;
    const double since = now - blocks.time(memory, 1);
    if (!blocks.has(memory, 1) || !blocks.has(memory, 2)) return 0.0;
    if (!(0.0 <= since && since <= LONGEST)) return 0.0;
    const double last = blocks.mean(memory, 1, 0), before = blocks.mean(memory, 2, 0);
    const double slope = (last - before) / (blocks.time(memory, 1) - blocks.time(memory, 2));
    const double one = tension - last, other = one - slope * since;
    return one * other > 0.0 ? std::min(std::abs(one), std::abs(other)) : 0.0;
}

/// Takes a sample at which all axes of a cable have been read.
void Lags::take_cable(Cable& cable, double now, std::span<const double> angles, double tension) {
    const auto& [axes, gains, begin, blocks, fit, late_share, sudden] = cable;
    const std::span<double> ranges = std::span(numbers).subspan(begin);
    const std::span<double> memory = blocks_of(cable);
    values_.assign(1, tension);
    for (const std::size_t a : axes) values_.push_back(angles[a]);
    const bool ended = blocks.take(memory, now, values_);
    bool changed = widen(ranges.first(2), tension) || ended;
    const double since = now - blocks.time(memory, 1);
    for (std::size_t k = 1; blocks.has(memory, 1) && since >= 0.5 * SHORTEST && k <= axes.size(); ++k) {
        const double velocity = (values_[k] - blocks.mean(memory, 1, k)) / since;
        changed = widen(ranges.subspan(2 * k, 2), velocity, MORE) || changed;
    }
    if (ended && blocks.has(memory, 2) && blocks.has(memory, 3)) fit_to(cable);
    if (changed) bound(cable);
}

/// Adds the block that has ended, with those before it, to the fit of a cable.
void Lags::fit_to(const Cable& cable) {
    const Blocks& blocks = cable.blocks;
    const std::span<double> memory = blocks_of(cable);
    const double late = blocks.time(memory, 1) - blocks.time(memory, 2);
    const double early = blocks.time(memory, 2) - blocks.time(memory, 3);
    for (std::size_t k = 0; k < cable.axes.size(); ++k) {
        const std::size_t a = cable.axes[k];
        const double middle = blocks.mean(memory, 2, k + 1);
        const double after = (blocks.mean(memory, 1, k + 1) - middle) / late;
        const double before = (middle - blocks.mean(memory, 3, k + 1)) / early;
        velocity_[a] = (late * before + early * after) / (late + early);
        acceleration_[a] = 2.0 * (after - before) / (late + early);
        angle_[a] = middle;
    }
    cable.fit.take(
        fit_of(cable),
        {0.5 * (late + early), velocity_, angle_, acceleration_, blocks.mean(memory, 2, 0)},
        offset().last(axes_));
}

/// Computes the share of a cable.
void Lags::bound(Cable& cable) {
    const auto stddev = offset().last(axes_);
    const std::span<const double> range = std::span(numbers).subspan(cable.begin);
    double swung = 0.0;
    for (std::size_t k = 0; k < cable.axes.size(); ++k) {
        const double lag = cable.gains[k] * stddev[cable.axes[k]];
        swung += square(lag * (range[2 * k + 3] - range[2 * k + 2]));
    }
    const double seen = square(SWUNG * std::max(range[1] - range[0], 0.0));
    const double share = cable.fit.share(fit_of(cable), stddev);
    cable.late_share = share * swung > seen ? seen / swung : share;
}

LagFit::Lag Lags::lag(std::size_t axis) const {
    LagFit::Lag best{0.0, INFINITE};
    for (const Cable& cable : cables_) {
        const LagFit::Lag one = cable.fit.lag(fit_of(cable), axis);
        if (one.stddev < best.stddev) best = one;
    }
    return best;
}

}  // namespace cdrj

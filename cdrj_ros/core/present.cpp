// What the latest readings say about the present, beyond the unknowns, (B4). docs/estimation.md.
#include <numeric>
#include <utility>

#include "beliefs.hpp"

namespace cdrj {
namespace {

/// A squared residual by its variance beyond which a reading does not move the present.
constexpr double FAR = 25.0;

/// What a wrong sensor's reading may be off by: a share of it, or of what preloads contribute.
constexpr double WRONG = 0.3;

/// For so long a reading also says something about the present [s].
constexpr double USED_S = 0.4;

/// Weight of a hypothesis below which no reading of a sensor that it holds right is a stray one.
constexpr double REFUTED = 1e-3;

/// Least size of what a reading should be, by what the preloads contribute, that tells a share of it.
constexpr double SMALL = 1e-3;

/// Least variance by which another one is divided.
constexpr double TINY = 1e-30;

/// Quantities to which the same sensors contribute.
struct Part {
    std::vector<std::size_t> sensors;  // their places among the latest readings
    std::vector<std::size_t> quantities;
};

/// An unknown that changes a quantity.
struct Slope {
    std::size_t unknown;
    double size;
};

/// Variance of a sum of unknowns.
double variance_of(const std::vector<Slope>& sum, const DenseMatrix& covariance) {
    double total = 0.0;
    for (std::size_t i = 0; i < sum.size(); ++i) {
        const auto row = covariance.row(sum[i].unknown);
        double others = 0.5 * row[sum[i].unknown] * sum[i].size;
        for (std::size_t j = i + 1; j < sum.size(); ++j) others += row[sum[j].unknown] * sum[j].size;
        total += 2.0 * sum[i].size * others;
    }
    return total;
}

}  // namespace

/// The latest readings of a group's sensors, as statements about the present.
struct Beliefs::Latest {
    Nanoseconds stamp_ns;             // now
    std::vector<const Heard*> read;   // the sensors that have one
    std::vector<std::size_t> places;  // their indices among all
    std::vector<double> h;            // what the model says of their quantities now
    DenseMatrix history;              // covariance of these and all quantities by the members
    std::vector<double> spread;       // variance of all quantities by the members
    std::vector<Part> parts;

    std::size_t at(std::size_t sensor) const { return read[sensor]->sensor.quantity; }
};

void Beliefs::present(
    Nanoseconds stamp_ns, std::span<const double> h, std::span<const double> slopes,
    std::span<const double> deviation, const Presence& found) const {
    const std::size_t size = h.size();
    const Latest last = latest(stamp_ns, h, deviation);
    const std::vector<double> least = least_weights();
    std::vector<std::vector<Slope>> sums(size);
    for (std::size_t i = 0; i < count(); ++i) {
        for (std::size_t q = 0; q < size; ++q) {
            if (const double slope = slopes[i * size + q]; slope != 0.0) sums[q].push_back({i, slope});
        }
    }
    for (const auto part : {found.shift, found.known, found.left}) std::ranges::fill(part, 0.0);
    std::vector<double> shifts(hypotheses.size() * size), bent(size), known(size), less(size);
    for (std::size_t b = 0; b < hypotheses.size(); ++b) {
        const Hypothesis& own = hypotheses[b];
        const auto shift = std::span(shifts).subspan(b * size, size);
        for (std::size_t q = 0; q < size; ++q) {
            bent[q] = known[q] = less[q] = 0.0;
            for (const auto [i, slope] : sums[q]) {
                shift[q] += own.mean[i] * slope;
                bent[q] += error_[i] * own.mean[i] * slope;
            }
        }
        condition(own, last, h, slopes, bent, {shift, known, less});
        for (std::size_t q = 0; q < size; ++q) {
            const double left = variance_of(sums[q], own.covariance) + square(bent[q]) - less[q];
            found.shift[q] += own.weight * shift[q];
            found.known[q] += least[b] * std::min(std::max(known[q], 0.0), 1.0);
            found.left[q] += least[b] * std::max(left, 0.0);
        }
    }
    for (std::size_t b = 0; b < hypotheses.size(); ++b) {
        for (std::size_t q = 0; q < size; ++q) {
            found.left[q] += least[b] * square(shifts[b * size + q] - found.shift[q]);
        }
    }
}

Beliefs::Latest Beliefs::latest(
    Nanoseconds stamp_ns, std::span<const double> h, std::span<const double> deviation) const {
    const std::size_t size = h.size(), members = deviation.size() / size;
    std::vector<const Heard*> read;
    std::vector<std::size_t> places;
    for (std::size_t k = 0; k < heard.size(); ++k) {
        const double age = static_cast<double>(stamp_ns - heard[k].stamp_ns) * 1e-9;
        if (std::abs(age) > USED_S || heard[k].slopes.empty() || heard[k].frozen()) continue;
        read.push_back(&heard[k]);
        places.push_back(k);
    }
    Latest found{stamp_ns, read, places, {}, DenseMatrix(read.size(), size),
                 std::vector<double>(size), {}};
    const double share = 1.0 / static_cast<double>(members);
    for (std::size_t m = 0; m < members; ++m) {
        const auto own = deviation.subspan(m * size, size);
        for (std::size_t q = 0; q < size; ++q) found.spread[q] += share * square(own[q]);
        for (std::size_t s = 0; s < read.size(); ++s) {
            const double there = share * own[found.at(s)];
            const auto row = found.history.row(s);
            for (std::size_t q = 0; q < size; ++q) row[q] += there * own[q];
        }
    }
    for (double& one : found.spread) one = std::max(one, TINY);
    for (std::size_t s = 0; s < read.size(); ++s) found.h.push_back(h[found.at(s)]);
    for (std::size_t q = 0; q < size; ++q) {
        std::vector<std::size_t> sensors;
        for (std::size_t s = 0; s < read.size(); ++s) {
            if (read[s]->sensor.contributes[q]) sensors.push_back(s);
        }
        auto part = std::ranges::find(found.parts, sensors, &Part::sensors);
        if (part == found.parts.end()) part = found.parts.insert(part, {sensors, {}});
        part->quantities.push_back(q);
    }
    return found;
}

/// Variance of a reading's errors as a statement about the present.
double Beliefs::noise_now(const Hypothesis& own, const Latest& latest, std::size_t s) const {
    const Heard& one = *latest.read[s];
    const double truth = std::max(std::abs(one.h + shift_of(own, one)), one.sensor.scale);
    const double age = static_cast<double>(latest.stamp_ns - one.stamp_ns) * 1e-9 / LASTS_S;
    const double moved = 2.0 * (latest.h[s] - one.h) / truth;
    const double history = latest.history(s, latest.at(s));
    const double noise = one.variance + history * (square(age) + square(moved));
    if (own.right[latest.places[s]]) return noise;
    return noise + square(WRONG * std::max(std::abs(one.value), one.sensor.scale));
}

/// (B4) under one hypothesis: adds the changes of all quantities; writes the shares of their
/// histories' variances, and what is taken from the variances that the unknowns leave, or given to
/// them where a sensor that is right reads something else.
///
/// `h`: the model's quantities; `bent`: standard deviation of what signatures do not say of each.
void Beliefs::condition(
    const Hypothesis& own, const Latest& latest, std::span<const double> h,
    std::span<const double> slopes, std::span<const double> bent, const Presence& found) const {
    const std::size_t sensors = latest.read.size(), size = bent.size(), all = own.mean.size();
    DenseMatrix change(sensors, all), by_unknowns(sensors, all), total(sensors, sensors);
    DenseMatrix across = latest.history;
    std::vector<double> rest(sensors);
    std::vector<bool> near(sensors);
    for (std::size_t s = 0; s < sensors; ++s) {
        const auto row = by_unknowns.row(s);
        rest[s] = latest.read[s]->value - expect(own, *latest.read[s], change.row(s));
        for (std::size_t j = 0; j < all; ++j) {
            if (change(s, j) == 0.0) continue;
            const auto column = own.covariance.row(j);
            for (std::size_t i = 0; i < all; ++i) row[i] += change(s, j) * column[i];
        }
    }
    for (std::size_t s = 0; s < sensors; ++s) {
        const auto row = by_unknowns.row(s);
        for (std::size_t other = 0; other < sensors; ++other) {
            const auto there = change.row(other);
            total(s, other) = std::inner_product(row.begin(), row.end(), there.begin(), 0.0) +
                              latest.history(s, latest.at(other)) +
                              bent[latest.at(s)] * bent[latest.at(other)];
        }
        total(s, s) += noise_now(own, latest, s);
        near[s] = square(rest[s]) <= FAR * total(s, s);
        for (std::size_t q = 0; q < size; ++q) across(s, q) += bent[latest.at(s)] * bent[q];
        // sensors that are right have told the unknowns before, by their lasting part
        if (own.right[latest.places[s]]) continue;
        for (std::size_t i = 0; i < count(); ++i) {
            for (std::size_t q = 0; q < size; ++q) across(s, q) += row[i] * slopes[i * size + q];
        }
    }
    for (const auto& [of_part, quantities] : latest.parts) {
        std::vector<std::size_t> used;
        std::ranges::copy_if(of_part, std::back_inserter(used), [&](std::size_t s) { return near[s]; });
        const std::size_t n = used.size();
        DenseMatrix matrix(n, n), inverse(n, n);
        for (std::size_t i = 0; i < n; ++i) {
            for (std::size_t j = 0; j < n; ++j) matrix(i, j) = total(used[i], used[j]);
        }
        invert(matrix, inverse);
        for (const std::size_t q : quantities) {
            double of_history = 0.0, of_all = 0.0;
            for (std::size_t i = 0; i < n; ++i) {
                double gain = 0.0;
                for (std::size_t j = 0; j < n; ++j) gain += inverse(i, j) * across(used[j], q);
                found.shift[q] += rest[used[i]] * gain;
                of_history += gain * latest.history(used[i], q);
                of_all += gain * across(used[i], q);
            }
            found.known[q] = of_history / latest.spread[q];
            found.left[q] = of_all - of_history;
        }
    }
    for (std::size_t s = 0; s < sensors; ++s) {
        const Heard& one = *latest.read[s];
        const bool alone = one.strays > 0 && one.strays <= STRAYS && one.strays < one.used;
        const bool stray = alone && own.weight > REFUTED;
        if (near[s] || stray || !own.right[latest.places[s]]) continue;
        const double share = rest[s] / std::max(std::abs(one.h), SMALL * one.sensor.scale);
        for (std::size_t q = 0; q < size; ++q) {
            if (one.sensor.contributes[q]) found.left[q] -= square(share * h[q]);
        }
    }
}

}  // namespace cdrj

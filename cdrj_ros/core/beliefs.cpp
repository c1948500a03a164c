#include "beliefs.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace cdrj {
namespace {

/// Rate at which a good sensor becomes wrong [1/s].
constexpr double FAULT_RATE = 1e-3;

/// Probability of a stray reading of a good sensor, and that another one follows it.
constexpr double OUTLIER = 0.02;

/// How far a stray reading, or one of a wrong sensor, is off, by what the preloads contribute.
constexpr double STRAY = 3.0;

/// How much a wrong sensor's error changes between readings, by what the preloads contribute.
constexpr double STEADY = 0.02;

/// Probability that the robot had changed suddenly before a sensor's first reading.
constexpr double FIRST_JUMP = 0.1;

/// Rate at which it does so later [1/s].
constexpr double JUMP_RATE = 1e-3;

/// Readings within this time weigh as one when hypotheses are compared [s].
constexpr double INDEPENDENT_S = 0.1;

/// Least time between two readings of a sensor that counts [s].
constexpr double SHORTEST_S = 1e-3;

/// A sensor is frozen if more readings than this are equal,
constexpr Index EQUAL = 3;

/// while the estimate moves by more than this number of their standard deviations.
constexpr double STIFF = 2.0;

/// Log likelihood of a frozen sensor's readings if it is right.
constexpr double FROZEN = -50.0;

/// Least weight of a hypothesis, so that it can recover.
constexpr double LEAST_WEIGHT = 1e-6;

std::vector<double> squares(std::span<const double> stddev) {
    std::vector<double> found(stddev.begin(), stddev.end());
    for (double& one : found) one *= one;
    return found;
}

/// Of a difference with this variance, up to a constant.
double log_likelihood(double rest, double variance) {
    return -0.5 * (std::log(variance) + rest * rest / variance);
}

/// Logarithm of a sum of two numbers given by their logarithms.
double log_sum(double one, double other) {
    const double most = std::max(one, other);
    return most == -INFINITE ? most : most + std::log1p(std::exp(std::min(one, other) - most));
}

}  // namespace

bool Heard::frozen() const {
    return equal >= EQUAL && highest - lowest > STIFF * std::sqrt(variance);
}

Beliefs::Beliefs(
    std::span<const double> start, std::span<const double> drift, std::span<const double> jump,
    std::span<const double> error)
    : drift_(squares(drift)), jump_(squares(jump)), error_(error.begin(), error.end()) {
    hypotheses.push_back({{}, std::vector<double>(count()), DenseMatrix(count(), count()), 1.0});
    widen(squares(start));
}

void Beliefs::hear(Accuracy sensor) {
    const std::size_t before = unknowns(), sensors = heard.size() + 1;
    const double errors[] = {sensor.bias, sensor.gain};
    std::vector<std::vector<bool>> patterns(1, std::vector<bool>(sensors, true));
    for (std::size_t k = 0; k < sensors; ++k) {
        patterns.emplace_back(sensors, true)[k] = false;
    }
    if (sensors > 1) patterns.emplace_back(sensors, false);
    std::vector<Hypothesis> now;
    double total = 0.0;
    for (const std::vector<bool>& right : patterns) {
        const Hypothesis& from = hypotheses[nearest({right.begin(), right.end() - 1})];
        const double prior = right.back() ? 1.0 - sensor.faulty : sensor.faulty;
        Hypothesis& own = now.emplace_back(Hypothesis{
            right, from.mean, DenseMatrix(before + 2, before + 2), from.weight * prior});
        own.mean.resize(before + 2);
        for (std::size_t i = 0; i < before; ++i) {
            std::ranges::copy(from.covariance.row(i), own.covariance.row(i).begin());
        }
        for (std::size_t i = 0; i < 2; ++i) {
            own.covariance(before + i, before + i) = errors[i] * errors[i];
        }
        total += own.weight;
    }
    for (Hypothesis& own : now) own.weight /= total;
    hypotheses = std::move(now);
    heard.push_back({std::move(sensor), before});
    change_.resize(before + 2);
    across_.resize(before + 2);
}

/// The hypothesis that holds the same sensors right; or that none is.
std::size_t Beliefs::nearest(const std::vector<bool>& right) const {
    const auto same = std::ranges::find(hypotheses, right, &Hypothesis::right);
    return same == hypotheses.end() ? hypotheses.size() - 1 : same - hypotheses.begin();
}

// -------------------------------------------------------------------------------------------------
// A reading

void Beliefs::take(std::size_t k, const SensorReading& reading) {
    Heard& one = heard[k];
    const bool first = one.stamp_ns == NEVER_NS;
    const double since = static_cast<double>(reading.stamp_ns - one.stamp_ns) * 1e-9;
    const double passed = first ? INDEPENDENT_S : std::max(since, SHORTEST_S);
    const double sudden = first ? FIRST_JUMP : std::min(JUMP_RATE * passed, FIRST_JUMP);
    note(one, reading);
    pass_time(one, passed);
    std::vector<Explanation> found;
    std::vector<double> scores, rests;
    for (Hypothesis& own : hypotheses) {
        const std::size_t b = found.size();
        found.push_back(explain(own, one, own.right[k], square(reading.noise), passed, sudden));
        scores.push_back(
            own.right[k] ? found[b].right : wrong(one, b, found[b], found.front().bent));
        rests.push_back(found[b].rest);
    }
    one.strays = found.front().used ? 0 : one.strays + 1;
    one.rest = std::move(rests);
    if (one.strays == 0 || one.strays > STRAYS) one.evidence.add(reading, one.sensor);
    const double most = *std::ranges::max_element(scores);
    const double share = std::min(1.0, passed / INDEPENDENT_S);
    for (std::size_t b = 0; b < scores.size(); ++b) {
        hypotheses[b].weight *= std::exp(share * (scores[b] - most));
    }
    fail(k, passed);
}

/// Note a sensor's last reading, and whether it repeats the one before.
void Beliefs::note(Heard& one, const SensorReading& reading) {
    if (one.used > 0 && reading.value == one.value) {
        ++one.equal;
    } else {
        one.equal = 0;
        one.lowest = one.highest = reading.h;
    }
    one.lowest = std::min(one.lowest, reading.h);
    one.highest = std::max(one.highest, reading.h);
    one.stamp_ns = reading.stamp_ns;
    one.value = reading.value;
    one.h = reading.h;
    one.slopes.assign(reading.slopes.begin(), reading.slopes.end());
    one.variance = square(reading.noise) + one.sensor.model_variance(reading.value) +
                   square(reading.history);
    ++one.used;
}

/// Let the unknowns drift over the time since a sensor's last reading [s].
void Beliefs::pass_time(const Heard& one, double passed) {
    for (Hypothesis& own : hypotheses) {
        for (std::size_t i = 0; i < count(); ++i) {
            own.covariance(i, i) += drift_[i] * passed / static_cast<double>(heard.size());
        }
        own.covariance(one.first, one.first) += one.sensor.drift * one.sensor.drift * passed;
    }
}

/// What the unknowns change in the quantity that a sensor reads.
double Beliefs::shift_of(const Hypothesis& own, const Heard& one) const {
    return std::inner_product(one.slopes.begin(), one.slopes.end(), own.mean.begin(), 0.0);
}

/// What a hypothesis expects of a sensor's last reading; writes its change per unknown, (B3).
double Beliefs::expect(const Hypothesis& own, const Heard& one, std::span<double> change) const {
    const double bias = own.mean[one.first], gain = own.mean[one.first + 1];
    const double truth = one.h + shift_of(own, one);
    std::ranges::fill(change, 0.0);
    for (std::size_t i = 0; i < count(); ++i) change[i] = (1.0 + gain) * one.slopes[i];
    change[one.first] = 1.0;
    change[one.first + 1] = truth;
    return (1.0 + gain) * truth + bias;
}

/// Explain a reading under a hypothesis, and let it correct the unknowns if that holds the sensor right
/// and the reading is not a stray one.
///
/// Nothing happened; or one unknown, any of them, has changed suddenly; or the reading is stray.
Beliefs::Explanation Beliefs::explain(
    Hypothesis& own, const Heard& one, bool is_right, double noise, double passed, double sudden) {
    const double rest = one.value - expect(own, one, change_);
    std::ranges::fill(across_, 0.0);
    for (std::size_t j = 0; j < change_.size(); ++j) {
        if (change_[j] == 0.0) continue;
        const auto row = own.covariance.row(j);
        for (std::size_t i = 0; i < across_.size(); ++i) across_[i] += change_[j] * row[i];
    }
    const double bent = square(NONLINEAR * shift_of(own, one));
    const double known = std::inner_product(across_.begin(), across_.end(), change_.begin(), 0.0);
    const double variance = known + one.variance + bent;
    const double frozen = one.frozen() ? FROZEN : 0.0;
    const double quiet = frozen + std::log(1.0 - sudden) + log_likelihood(rest, variance);
    const auto jumps = std::ranges::count_if(jump_, [](double size) { return size > 0.0; });
    const double each = frozen + std::log(sudden) - std::log(std::max(1.0, static_cast<double>(jumps)));
    jumped_.assign(count(), -INFINITE);
    double changed = quiet;
    for (std::size_t i = 0; i < count(); ++i) {
        if (jump_[i] == 0.0) continue;
        const double more = one.slopes[i] * one.slopes[i] * jump_[i];
        jumped_[i] = each + log_likelihood(rest, variance + more);
        changed = log_sum(changed, jumped_[i]);
    }
    const double anywhere =
        log_likelihood(rest, variance + square(STRAY * one.sensor.scale));
    const double stray = static_cast<double>(1 + one.strays) * std::log(OUTLIER) + anywhere;
    const Explanation found{
        rest, log_sum(changed, stray), anywhere, bent, is_right && stray < changed};
    if (!found.used) return found;
    // the variances of sudden changes by their probabilities: many Gaussians become one
    for (std::size_t i = 0; i < count(); ++i) {
        const double more = std::exp(jumped_[i] - changed) * jump_[i];
        own.covariance(i, i) += more;
        across_[i] += more * change_[i];
    }
    const double lasts = std::max(1.0, LASTS_S / passed);
    const double total =
        std::inner_product(across_.begin(), across_.end(), change_.begin(), 0.0) + noise +
        (one.variance - noise + bent) * lasts;
    for (std::size_t i = 0; i < across_.size(); ++i) {
        const double gain = across_[i] / total;
        own.mean[i] += gain * rest;
        const auto row = own.covariance.row(i);
        for (std::size_t j = 0; j < across_.size(); ++j) row[j] -= gain * across_[j];
    }
    return found;
}

/// Log likelihood of a reading if the sensor is wrong: anywhere, or as far off as before. It is foreseen
/// no better than if all sensors are right and signatures leave `bent` of the correction open.
double Beliefs::wrong(
    const Heard& one, std::size_t b, const Explanation& reading, double bent) const {
    if (one.rest.size() != hypotheses.size()) return reading.anywhere;
    const double steady = 2.0 * one.variance + bent + square(STEADY * one.sensor.scale);
    const double as_before = log_likelihood(reading.rest - one.rest[b], steady);
    return log_sum(reading.anywhere, as_before) - std::log(2.0);
}

/// Let a sensor become wrong with a small probability, and keep every hypothesis alive.
void Beliefs::fail(std::size_t k, double passed) {
    for (Hypothesis& own : hypotheses) {
        if (!own.right[k]) continue;
        std::vector<bool> failed = own.right;
        failed[k] = false;
        const double moved = FAULT_RATE * passed * own.weight;
        own.weight -= moved;
        hypotheses[nearest(failed)].weight += moved;
    }
    for (const double least : {LEAST_WEIGHT, 0.0}) {
        double total = 0.0;
        for (const Hypothesis& own : hypotheses) total += own.weight;
        for (Hypothesis& own : hypotheses) own.weight = std::max(own.weight / total, least);
    }
}

void Beliefs::pause() {
    for (Heard& one : heard) {
        one.slopes.clear();
        one.rest.clear();
        one.evidence = {};
        one.equal = 0;
        one.lowest = INFINITE;
        one.highest = -INFINITE;
    }
}

void Beliefs::widen(std::span<const double> variances) {
    for (Hypothesis& own : hypotheses) {
        for (std::size_t i = 0; i < count(); ++i) own.covariance(i, i) += variances[i];
    }
}

std::vector<double> Beliefs::least_weights() const {
    std::vector<double> found;
    for (const Hypothesis& own : hypotheses) {
        double least = 1.0;
        for (std::size_t k = 0; k < heard.size(); ++k) {
            if (!own.right[k]) least *= heard[k].sensor.faulty;
        }
        found.push_back(std::max(own.weight, least));
    }
    const double total = std::accumulate(found.begin(), found.end(), 0.0);
    for (double& weight : found) weight /= total;
    return found;
}

}  // namespace cdrj

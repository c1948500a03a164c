// What the latest readings of a sensor show, (B5). docs/estimation.md.
#include <cmath>
#include <utility>

#include "beliefs.hpp"

namespace cdrj {
namespace {

/// Errors of the model last for this time: part of a stroke, as in (I5) [s].
constexpr double MODEL_S = FADES_S / 16.0;

/// As `FADES_S`, for a cable that carries nothing, which a few readings show [s].
constexpr double RECENT_S = 0.5;

/// Least time between two readings that counts [s].
constexpr double SHORTEST_S = 1e-3;

}  // namespace

void Evidence::add(const SensorReading& reading, const Accuracy& sensor) {
    const std::size_t size = reading.slopes.size() + 3;
    if (stamp_ns == NEVER_NS) {
        sums = DenseMatrix(size, size);
        recent.assign(2 * reading.parts.size() + 2, 0.0);
    }
    const double passed = stamp_ns == NEVER_NS ? FADES_S
        : std::max(static_cast<double>(reading.stamp_ns - stamp_ns) * 1e-9, SHORTEST_S);
    const double noise = square(reading.noise);
    const double lasting = sensor.model_variance(reading.value) + square(reading.history);
    const double variance = noise + lasting * std::max(1.0, MODEL_S / passed);
    const double difference = reading.value - reading.h;
    std::vector<double> row(reading.slopes.begin(), reading.slopes.end());
    row.insert(row.end(), {1.0, reading.h, difference});
    const double kept = std::exp(-passed / FADES_S), share = (noise + lasting) / variance;
    for (std::size_t i = 0; i < size; ++i) {
        const auto own = sums.row(i);
        for (std::size_t j = 0; j < size; ++j) own[j] = kept * own[j] + row[i] * row[j] / variance;
    }
    number = kept * number + share;
    const double kept_recent = std::exp(-passed / RECENT_S);
    for (double& one : recent) one *= kept_recent;
    double every = 0.0;
    for (const double part : reading.parts) every += std::abs(part);
    const double model = sensor.model_variance(reading.value) + square(sensor.bias);
    const double lasts = std::max(1.0, MODEL_S / passed);
    const std::size_t cables = reading.parts.size();
    for (std::size_t c = 0; c < cables; ++c) {
        const double part = reading.parts[c];  // whose errors end with it
        const double others = every > 0.0 ? 1.0 - std::abs(part) / every : 1.0;
        const double without = square(difference + part);
        recent[c] += without / variance;
        recent[cables + c] += (square(reading.value - sensor.balance) - without) /
                              (noise + (model + square(others * reading.history)) * lasts);
    }
    recent[2 * cables] += square(difference) / variance;
    recent.back() += share;
    stamp_ns = reading.stamp_ns;
}

}  // namespace cdrj

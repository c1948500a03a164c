#include "correction.hpp"

#include <algorithm>
#include <cmath>

namespace cdrj {
namespace {

/// Least standard deviation of a corrected quantity, as a share of it.
constexpr double SMALLEST_SHARE = 1e-3;

/// Least force on a pulley by which another one is divided [N].
constexpr double SMALLEST_FORCE = 1e-9;

double with_sensors(double stddev, double history, double known, double left, double value, double least) {
    const double variance = stddev * stddev;
    const double share = SMALLEST_SHARE * value;
    const double total = std::max(variance - known * std::min(history, variance) + left, share * share);
    return std::max(std::sqrt(total), std::abs(value) <= least ? least : 0.0);
}

}  // namespace

void correct(
    const Robot& robot, std::span<double> numbers, std::span<double> stddev,
    std::span<const double> history, const Said& said, std::span<const double> least) {
    const Topology& topology = robot.topology;
    Estimate estimate(topology.sizes, numbers.data());
    std::size_t q = 0;
    for (const auto part : UNCERTAIN) {
        const bool is_magnitude = part == &Estimate::magnitude;
        const bool pulls = is_magnitude || part == &Estimate::tension;
        const auto values = estimate.*part;
        for (std::size_t k = 0; k < values.size(); ++k, ++q) {
            const double before = values[k];
            values[k] = pulls ? std::max(before + said.shift[q], 0.0) : before + said.shift[q];
            stddev[q] = with_sensors(
                stddev[q], history[q], said.known[q], said.left[q], values[k], least[q]);
            if (!is_magnitude) continue;
            const double ratio = values[k] / std::max(before, SMALLEST_FORCE);
            for (const auto force : {estimate.force_x, estimate.force_y, estimate.force_z}) {
                force[k] *= ratio;
            }
        }
    }
    for (Index p = 0; p < topology.sizes.pulleys; ++p) {
        const Index element = topology.pulleys[p].element;
        estimate.friction[p] = estimate.tension[element + 1] - estimate.tension[element];
    }
    for (Index c = 0; c < topology.sizes.cables; ++c) {
        const CableTopology& cable = topology.cables[c];
        for (Index e = cable.first_element; e < cable.first_element + cable.elements; ++e) {
            if ((static_cast<int>(estimate.status[e]) & INVALID) != 0) continue;
            set_load(estimate.status[e], estimate.tension[e], robot.constants.cables[c]);
        }
    }
}

}  // namespace cdrj

// A learned correction of single outputs on top of the model; docs/model.md, section 15.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

#include "robot.hpp"

namespace cdrj {

/// Bounds of the stop operators, as fractions of half the range seen.
inline constexpr std::array STOPS{0.01, 0.04, 0.16};

/// Longest time since the last motion of an input that counts [s].
inline constexpr double LONGEST_REST = 0.2;

/// Distance from the range seen at which nothing is corrected, as a fraction of half of it.
inline constexpr double FADED = 0.5;

/// What keeps the sign of a motion while there has been no time since; without effect otherwise.
inline constexpr double SIGN = 1e-9;

/// Weights of a correction with this many inputs: rows for all numbers of each, and columns.
inline constexpr Index residual_weights(Index inputs) {
    return Index{sizeof(ResidualInput) / sizeof(double)} * inputs * (1 + inputs);
}

/// Place of a value in the range seen: -1 at its lower, 1 at its upper end.
inline double place_in(const ResidualRange& seen, double value) {
    return (2.0 * value - seen.lower - seen.upper) / (seen.upper - seen.lower);
}

/// An input after a sample at another place (R2); `before`: where it was, unless this is the first.
inline ResidualInput followed(const ResidualInput* before, double place, double dt) {
    ResidualInput input{place, {}, 0.0};
    if (before == nullptr) return input;
    const double moved = place - before->place;
    for (std::size_t k = 0; k < STOPS.size(); ++k) {
        input.stop[k] = std::clamp(before->stop[k] + moved / STOPS[k], -1.0, 1.0);
    }
    if (moved != 0.0) {
        input.motion = std::copysign(SIGN, moved);
    } else if (before->motion != 0.0) {  // otherwise it has not moved yet
        const double rest = std::abs(before->motion) + dt / LONGEST_REST;
        input.motion = std::copysign(std::min(rest, 1.0), before->motion);
    }
    return input;
}

/// Write the products of all rows and columns of (R1), by rows.
inline void write_products(std::span<const ResidualInput> inputs, std::span<double> products) {
    double* next = products.data();
    const auto write_row = [&](double row) {
        *next++ = row;
        for (const ResidualInput& input : inputs) *next++ = row * input.place;
    };
    for (const ResidualInput& input : inputs) {
        write_row(input.place);
        for (const double stop : input.stop) write_row(stop);
        write_row(input.motion);
    }
}

/// Share of the correction that applies at places outside of the range seen, (R3).
inline double trust_in(std::span<const ResidualInput> inputs) {
    double farthest = 0.0;
    for (const ResidualInput& input : inputs) farthest = std::max(farthest, std::abs(input.place));
    return std::clamp(1.0 - (farthest - 1.0) / FADED, 0.0, 1.0);
}

/// Add the learned corrections to the estimate; without effect unless the cables are solved.
inline void correct_outputs(Step& step, double dt, bool solved) {
    auto& [topology, constants, before, after, estimate, work] = step;
    double* const values = estimate.tension.data();  // its first part
    const bool started = before.started[0] != 0.0;
    for (Index k = 0; k < topology.sizes.residual_inputs; ++k) {
        const auto [axis, column] = topology.residual_inputs[k];
        const double value = axis >= 0 ? after.angle[axis] : values[column];
        after.residual_inputs[k] = followed(
            started ? &before.residual_inputs[k] : nullptr,
            place_in(constants.residual_ranges[k], value), dt);
    }
    for (Index r = 0; r < topology.sizes.residuals; ++r) {
        const auto [column, cable, first, count, first_weight] = topology.residuals[r];
        const double bound = constants.residuals[r].bound;
        const std::span<const ResidualInput> inputs = after.residual_inputs.subspan(first, count);
        estimate.correction[r] = estimate.trust[r] = 0.0;
        if (!solved || bound == 0.0) continue;
        estimate.trust[r] = trust_in(inputs);
        if (estimate.trust[r] == 0.0) continue;
        const std::size_t size = residual_weights(count);
        const std::span<double> products = work.products.subspan(first_weight, size);
        write_products(inputs, products);
        double sum = 0.0;
        for (std::size_t k = 0; k < size; ++k) {
            sum += constants.residual_weights[first_weight + k] * products[k];
        }
        double& value = values[column];
        double corrected = value + estimate.trust[r] * std::clamp(sum, -bound, bound);
        if (cable >= 0) {  // the tension of its element `column`
            corrected = std::max(corrected, 0.0);
            set_load(estimate.status[column], corrected, constants.cables[cable]);
        }
        estimate.correction[r] = corrected - value;
        value = corrected;
    }
}

}  // namespace cdrj

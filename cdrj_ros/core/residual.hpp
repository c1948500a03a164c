// A learned correction of single outputs on top of the model; docs/model.md, section 15.
#pragma once

#include <array>
#include <span>

#include "layout.hpp"
#include "report.hpp"

namespace cdrj {

/// Bounds of the stop operators, as fractions of half the range seen.
inline constexpr std::array STOPS{0.01, 0.04, 0.16};

/// Longest time since the last motion of an input that counts [s].
inline constexpr double LONGEST_REST = 0.2;

/// Distance from the range seen at which nothing is corrected, as a fraction of half of it.
inline constexpr double FADED = 0.5;

/// Weights of a correction with this many inputs: rows for all numbers of each, and columns.
inline constexpr Index residual_weights(Index inputs) {
    return Index{sizeof(ResidualInput) / sizeof(double)} * inputs * (1 + inputs);
}

/// Place of a value in the range seen: -1 at its lower, 1 at its upper end.
inline double place_in(const ResidualRange& seen, double value) {
    return (2.0 * value - seen.lower - seen.upper) / (seen.upper - seen.lower);
}

/// An input after a sample at another place (R2); `before`: where it was, unless this is the first.
ResidualInput followed(const ResidualInput* before, double place, double dt);

/// Write the products of all rows and columns of (R1), by rows.
void write_products(std::span<const ResidualInput> inputs, std::span<double> products);

/// Share of the correction that applies at places outside of the range seen, (R3).
double trust_in(std::span<const ResidualInput> inputs);

/// Add the learned corrections to the estimate `values`; without effect unless the cables are solved.
void correct_outputs(const Step& step, double dt, bool solved, double* values);

}  // namespace cdrj

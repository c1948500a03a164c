// An estimate with what sensors say about it. docs/estimation.md.
#pragma once

#include <span>

#include "robot.hpp"

namespace cdrj {

/// What sensors say about every quantity that has a standard deviation.
struct Said {
    std::span<const double> shift;  // its change
    std::span<const double> known;  // share of the variance of its history that they take away
    std::span<const double> left;   // variance that they leave
};

/// Change an estimate of the model and its standard deviations into those with what the sensors say.
///
/// Forces on pulleys keep their directions. SLACK and OVERLOAD follow the corrected tensions, but INVALID
/// elements keep their status. `history`: variances by the members; `least`: magnitudes where cables
/// are slack, which are the least standard deviations there.
void correct(
    const Robot& robot, std::span<double> estimate, std::span<double> stddev,
    std::span<const double> history, const Said& said, std::span<const double> least);

}  // namespace cdrj

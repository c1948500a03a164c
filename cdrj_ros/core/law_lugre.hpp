// LuGre (33).
//
// Without viscous terms it is df/dx = sigma0 (1 - sgn(x) f / g), so over a slip x the distance to the
// bound shrinks by exp(-sigma0 |x| / g).
#pragma once

#include <cmath>

#include "laws.hpp"

namespace cdrj {

inline Friction lugre_force(const Bristles& bristles, double slip) {
    const auto [before, stiffness, bound, breakaway] = bristles;
    const double sign = slip >= 0.0 ? 1.0 : -1.0;
    const double x = sign * slip;
    const double f = sign * before;  // mirrored so that the slip is forward
    const double decay = std::exp(-stiffness * x / bound);
    const double force = bound + (f - bound) * decay;
    const double by_slip = -(f - bound) * decay * stiffness / bound;
    const double by_bound = 1.0 - decay + (f - bound) * decay * stiffness * x / (bound * bound);
    return {sign * force, by_slip, sign * by_bound};
}

/// The slope jumps where the slip reverses.
inline bool shorten_lugre(const Bristles&, double slip, double& next) {
    if (!(slip * next < 0.0)) return false;
    next *= 0.3;
    return true;
}

}  // namespace cdrj

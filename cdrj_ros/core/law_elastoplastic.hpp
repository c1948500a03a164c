// The elastoplastic law (E9) (Dupont, Hayward, Armstrong, Altpeter 2002).
//
// It keeps df/dx = sigma0 up to `breakaway` * g and closes the rest exponentially, continuous in slope;
// with breakaway = 1 it is an elastic, perfectly plastic contact whose minor loops close exactly.
#pragma once

#include <algorithm>
#include <cmath>

#include "laws.hpp"

namespace cdrj {

inline Friction elastoplastic_force(const Bristles& bristles, double slip) {
    const auto [before, stiffness, bound, breakaway] = bristles;
    const double sign = slip >= 0.0 ? 1.0 : -1.0;
    const double x = sign * slip;
    double f = sign * before;  // mirrored so that the slip is forward
    double elastic_by_bound = 0.0;
    if (f < -bound) {  // the bound has shrunk below the stored force: bristles let go first
        f = -bound;
        elastic_by_bound = -1.0;
    }
    const double knee = breakaway * bound;
    const double trial = f + stiffness * x;
    if (trial <= knee) return {sign * trial, stiffness, sign * elastic_by_bound};
    if (f >= bound || breakaway >= 1.0) return {sign * bound, 0.0, sign};
    const double reach = (1.0 - breakaway) * bound / stiffness;
    if (f >= knee) {
        const double decay = std::exp(-x / reach);
        const double gap = bound - f;
        const double by_bound = 1.0 - decay - gap * decay * x / (reach * bound);
        return {sign * (bound - gap * decay), gap * decay / reach, sign * by_bound};
    }
    const double plastic = x - (knee - f) / stiffness;
    const double decay = std::exp(-plastic / reach);
    const double force = bound - (bound - knee) * decay;
    const double by_bound = 1.0 - decay * (1.0 - elastic_by_bound + stiffness * plastic / bound);
    return {sign * force, stiffness * decay, sign * by_bound};
}

/// The elastic range lies between sliding forward and sliding back. A step across all of it would
/// switch the friction from one bound to the other, and the next step would switch it back; such a
/// step ends where the bristle force is zero.
inline bool shorten_elastoplastic(const Bristles& bristles, double slip, double& next) {
    const auto [stored, stiffness, bound, breakaway] = bristles;
    const double before = std::clamp(stored, -bound, bound);
    const double was = before + stiffness * slip, is = before + stiffness * next;
    if (!((was > bound && is < -bound) || (was < -bound && is > bound))) return false;
    next = -before / stiffness;
    return true;
}

}  // namespace cdrj

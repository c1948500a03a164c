// Friction of a cable that slides on a pulley: (29)-(43) of the source.
//
// beta: wrap angle [rad], v: slip speed [m/s], eta = T_hold / T_pull: transmission in (0, 1],
// g: largest difference T_pull - T_hold that friction can carry [N]. docs/model.md, section 4.
// How it follows the slip is chosen by two functions; `euler` and `steady` of a robot file are
// `elastoplastic` with constants of their own, see `cdrj_ros.robot.description`.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "robot_records.hpp"

namespace cdrj {

/// A contact whose bristles have carried a force.
struct Bristles {
    double before;     // bristle force sigma0 z before the slip [N]
    double stiffness;  // sigma0 [N/m]
    double bound;      // g: largest force that friction can carry [N], positive
    double breakaway;  // fraction of the bound up to which pre-sliding is elastic, in [0, 1]
};

/// A friction force and its derivatives.
struct Friction {
    double force;     // [N]
    double by_slip;   // derivative by the slip [N/m]
    double by_bound;  // derivative by the bound [-]
};

/// The elastoplastic law (E9) (Dupont, Hayward, Armstrong, Altpeter 2002).
///
/// It keeps df/dx = sigma0 up to `breakaway` * g and closes the rest exponentially, continuous in slope;
/// with breakaway = 1 it is an elastic, perfectly plastic contact whose minor loops close exactly.
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

/// LuGre (33).
///
/// Without viscous terms it is df/dx = sigma0 (1 - sgn(x) f / g), so over a slip x the distance to the
/// bound shrinks by exp(-sigma0 |x| / g).
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

// A new law adds two functions above, its name here, and a line in both functions below.

enum class Law : std::int64_t { none, euler, steady, lugre, elastoplastic };

/// The words of a robot file; the code of a law is its position here.
inline constexpr const char* LAW_NAMES[]{"none", "euler", "steady", "lugre", "elastoplastic"};

/// Bristle force after a slip, exact over the slip for a constant bound; `slip`: material that has
/// moved past the body's surface [m].
inline Friction bristle_force(Law law, const Bristles& bristles, double slip) {
    switch (law) {
        case Law::none: break;
        case Law::lugre: return lugre_force(bristles, slip);
        case Law::euler:
        case Law::steady:
        case Law::elastoplastic: return elastoplastic_force(bristles, slip);
    }
    return {0.0, 0.0, 0.0};
}

/// Shorten a step of Newton's method from one slip to the next where the law would make the steps
/// alternate; returns whether it did.
inline bool shorten_slip(Law law, const Bristles& bristles, double slip, double& next) {
    switch (law) {
        case Law::none: break;
        case Law::lugre: return shorten_lugre(bristles, slip, next);
        case Law::euler:
        case Law::steady:
        case Law::elastoplastic: return shorten_elastoplastic(bristles, slip, next);
    }
    return false;
}

/// Floor of eta: the printed (35) goes below zero for large mu_s / mu_c and wrap angles.
inline constexpr double MINIMUM_TRANSMISSION = 1e-3;

/// epsilon of (34) [N]: keeps the bound positive on a slack cable.
inline constexpr double BOUND_FLOOR = 1e-9;

/// 1 - eta = kinetic + fading * stribeck_share(v).
struct Loss {
    double kinetic;  // at high slip speed [-]
    double fading;   // further loss at rest [-]
};

/// (29)-(32): T_hold / T_pull of a cable sliding over a fixed cylinder.
inline double capstan_transmission(double mu, double wrap) { return std::exp(-mu * wrap); }

/// Share in [0, 1] of static friction that is left at a slip speed: the last factor of (33).
inline double stribeck_share(double slip_speed, double stribeck_speed) {
    const double ratio = slip_speed / stribeck_speed;
    return std::exp(-ratio * ratio);
}

/// (34)-(37): loss of a cable that slides.
inline Loss sliding_loss(double mu_c, double mu_s, double wrap, Stribeck form) {
    const double kinetic = 1.0 - capstan_transmission(mu_c, wrap);
    if (form == Stribeck::capstan) {
        return {kinetic, capstan_transmission(mu_c, wrap) - capstan_transmission(mu_s, wrap)};
    }
    if (mu_c <= 0.0) return {0.0, 0.0};
    return {kinetic, kinetic * (mu_s / mu_c - 1.0)};
}

/// (41): eta_r of a pulley on a bearing, from the balance (39) and the quadratic (40).
///
/// `ratio` = f_d d / r_p = 1 / alpha, so that a frictionless bearing is 0, not infinity: numerator
/// and denominator of (41) are divided by alpha^2.
inline double bearing_transmission(double wrap, double ratio) {
    if (ratio == 0.0) return 1.0;  // as (41), without its root
    const double c = ratio * ratio;
    const double cosine = std::cos(wrap);
    const double root =
        std::sqrt(std::max((1.0 - cosine) * (2.0 - c * cosine - c) * c, 0.0));
    return (1.0 - c * cosine - root) / (1.0 - c);
}

/// (42), (43): eta = rho eta_d + (1 - rho) eta_r of a pulley, kept above MINIMUM_TRANSMISSION.
inline Loss blended_loss(
    double rho, double mu_c, double mu_s, double wrap, double bearing_ratio, Stribeck form) {
    const Loss sliding = sliding_loss(mu_c, mu_s, wrap, form);
    const double bearing = 1.0 - bearing_transmission(wrap, bearing_ratio);
    const double most = 1.0 - MINIMUM_TRANSMISSION;
    const double kinetic = std::min(rho * sliding.kinetic + (1.0 - rho) * bearing, most);
    return {kinetic, std::min(rho * sliding.fading, most - kinetic)};
}

/// (E28): loss of a contact cell that has a share of its pulley's wrap.
inline Loss cell_loss(const Loss& whole, double share) {
    if (share == 1.0) return whole;
    const double fast = std::pow(1.0 - whole.kinetic, share);
    return {1.0 - fast, fast - std::pow(1.0 - whole.kinetic - whole.fading, share)};
}

}  // namespace cdrj

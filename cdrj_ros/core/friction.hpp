// Friction of a cable that slides on a pulley: (29)-(43) of the source.
//
// beta: wrap angle [rad], v: slip speed [m/s], eta = T_hold / T_pull: transmission in (0, 1],
// g: largest difference T_pull - T_hold that friction can carry [N]. docs/model.md, section 4.
// How it follows the slip: one file per law, chosen by two functions; `euler` and `steady` of a robot file
// are `elastoplastic` with constants of their own, see `cdrj_ros.robot.description`.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "law_elastoplastic.hpp"
#include "law_lugre.hpp"
#include "robot_records.hpp"

namespace cdrj {

// A new law adds a file, its name here, and a line in both functions.

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

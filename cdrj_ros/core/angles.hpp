// Angles up to whole turns.
#pragma once

#include <cmath>
#include <numbers>

namespace cdrj {

inline constexpr double PI = std::numbers::pi;

/// a - b floor(a / b), in [0, b) for positive b, rounded as Python rounds it.
inline double modulo(double a, double b) {
    const double rest = std::fmod(a, b);
    if (rest != 0.0) return (b < 0.0) != (rest < 0.0) ? rest + b : rest;
    return std::copysign(0.0, b);
}

/// The same angle in [-pi, pi).
inline double wrap_to_pi(double angle) { return modulo(angle + PI, 2.0 * PI) - PI; }

}  // namespace cdrj

// Tangents of circles about the origin of a plane, and the side on which a cable passes one: (G2), (G4), (G6).
// docs/model.md, section 13.2.
#pragma once

#include <algorithm>
#include <cmath>

#include "vectors.hpp"

namespace cdrj {

/// Where a line becomes tangent to a circle.
struct TangentPoint {
    Vector2 normal;  // unit vector from the centre to the point
    double length;   // of the line [m]
};

/// (G4): the line from `a` to the circle.
///
/// With the opposite sense, the normal is where a line to `a` leaves the circle.
inline TangentPoint tangent_from(const Vector2& a, double radius, double sense) {
    const double square = dot(a, a);
    const double length = std::sqrt(std::max(square - radius * radius, 0.0));
    return {combined(radius / square, a, sense * length / square, left_of(a)), length};
}

/// The way of a cable round a circle.
struct WayRound {
    bool touching;
    double sense;  // +1: counter-clockwise, -1: clockwise
    TangentPoint first, last;  // where it comes to the circle, and where it leaves
};

/// The way of a cable from a to b.
///
/// It touches if the straight line passes through the circle, or passes it on the side opposite to
/// the one that `turn` or, if `sided`, the point `side` demands.
WayRound way_round(
    const Vector2& a, const Vector2& b, double radius, double turn, bool sided, const Vector2& side);

/// Where a cable that runs through the inside of a ring touches it.
struct RingPoint {
    bool touching;
    Vector2 normal;  // unit vector to the point
};

/// (G6): the point of a ring at which a cable from a to b, outside of it, bends.
RingPoint point_inside(const Vector2& a, const Vector2& b, double radius);

/// Angle in [0, 2 pi) from one normal to another; rounding below 0 counts as 0.
inline double arc_angle(double sense, const Vector2& first, const Vector2& last) {
    double angle = sense * std::atan2(cross(first, last), dot(first, last));
    if (angle < -1e-9) angle += 2.0 * PI;
    return std::max(angle, 0.0);
}

}  // namespace cdrj

// What guides a cable in space: a small interface; its kinds are in guides.cpp.
//
// All vectors are in the guide's own axes: z is the axis of a round body and the origin its centre.
// `touch.before` is the point a from which the cable comes, `touch.after` the point b to which it
// goes. docs/model.md, section 13.2.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "robot_records.hpp"

namespace cdrj {

enum class Guide : std::int64_t { point, pulley, swivel, cylinder, sphere, sheath };

/// Their names in `cdrj_ros.robot.space`; the code of a guide is its place here.
inline constexpr const char* GUIDE_NAMES[]{
    "point", "pulley", "swivel", "cylinder", "sphere", "sheath"};

/// Where a cable touches a guide.
struct Meeting {
    bool possible;
    Vector3 entry;  // first point of contact
    Vector3 exit;   // last point of contact
};

/// The cable beside a guide that it touches.
struct Passing {
    Vector3 before, after;  // directions in the base, unit vectors
    double wrap;            // sum of a constant and tables [rad]; of guides whose wrap is given

    /// Angle between both directions [rad].
    double bend() const { return std::atan2(norm(cross(before, after)), dot(before, after)); }
};

/// A kind of guide.
struct GuideKind {
    /// `exit_frame` carries the point at which the cable leaves it; otherwise `frame` carries all of it.
    bool bridges;

    /// It holds the cable in the plane z = 0, on a circle whose sense is given.
    bool grooved;

    /// Find where the cable touches the guide, from `before` and `after`; null if it is fixed.
    Meeting (*meet)(const NodeConstants& node, Touch& touch);

    /// Write length and wrap of the arc, from the points of contact; returns its middle, from which its
    /// motion along the body follows (E26).
    ArcMiddle (*measure)(const NodeConstants& node, const Passing& cable, Touch& touch);

    /// Direction of the cable at the point where it comes to the guide, or `leaving` it; null if fixed.
    ///
    /// The straight piece there has this direction, of which nothing is left where it is too short.
    Vector3 (*tangent)(const NodeConstants& node, const Touch& touch, bool leaving);

    /// Its points of contact are given in frames and do not depend on its neighbours.
    bool fixed() const { return meet == nullptr; }
};

/// By the code of the guide. A new kind adds its name above, and its functions and a line in guides.cpp.
extern const GuideKind GUIDE_KINDS[];

inline const GuideKind& kind_of(Guide guide) { return GUIDE_KINDS[static_cast<std::size_t>(guide)]; }

/// Distance below the radius at which a point still counts as on the rim, over the radius [-].
///
/// It covers positions of seven digits. A geometry does not depend on the last bit of a position:
/// points down to twice that far inside make a path impossible, before a body may be ignored.
inline constexpr double RIM = 1e-6;

/// Sine of an angle below which two directions are one to rounding.
inline constexpr double ROUNDING = 1e-12;

/// Angle by which an arc is below 0 through rounding, where a free length is the root of a difference;
/// one that is nearer to a whole turn does not exist [rad].
inline constexpr double BELOW_TURN = 1e-6;

/// Whether a point is nearer to the centre than the radius less a share of it.
inline bool is_inside(double square_distance, double radius, double share) {
    const double least = (1.0 - share) * radius;
    return square_distance < least * least;
}

/// The point, or the nearest one of the circle about the origin where it lies inside.
inline Vector2 outside(const Vector2& a, double radius) {
    const double square = dot(a, a);
    return square < radius * radius ? (radius / std::sqrt(square)) * a : a;
}

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

/// What lies in the plane of an arc about the origin.
struct ArcPlane {
    Vector2 a, b;  // where the cable comes from and goes to
    Vector2 side;  // point on the side that the cable passes
};

/// Where a cable touches a round body.
struct RoundMeeting {
    bool possible;
    Vector2 entry, exit;  // unit vectors to the first and last point of contact, in the plane of the arc
};

/// Contact of a cable with a round body; free lengths, sense, angle and whether it touches are written.
///
/// It is impossible if a point of a neighbour lies inside the body, unless it then is ignored, and
/// where rounding decides between two ways.
RoundMeeting touch_round(const NodeConstants& node, Touch& touch, const ArcPlane& plane);

/// Mean of a cable's directions before and after the point at which it bends over a ring.
///
/// It is shorter than 1: where the point moves on the ring by x, the cable before it grows by the
/// component of x along its direction, which is the same as that along the direction after it.
Vector3 direction_through_ring(const NodeConstants& node, const Touch& touch, double height);

/// Direction of a cable before or after the point at which it bends over a ring, from the other one.
///
/// Both have the same component along the ring (G6).
Vector3 direction_at_ring(const Touch& touch, bool leaving);

}  // namespace cdrj

// What a cylinder and a sphere have in common: the cable may pass them by, or run through a ring.
#pragma once

#include "guide.hpp"

namespace cdrj {

/// The plane of the arc, and the points in it.
struct ArcPlane {
    Vector3 axis;  // its unit normal
    Vector3 a, b;  // where the cable comes from and goes to
    Vector3 side;  // point on the side that the cable passes
};

/// Contact of a cable with a round body: normals, free lengths, sense and whether it touches.
///
/// Returns false if a point of a neighbour lies inside the body, unless it then is ignored.
bool touch_round(const NodeConstants& node, Touch& touch, const ArcPlane& plane);

/// Mean of a cable's directions before and after the point at which it bends over a ring.
///
/// It is shorter than 1: where the point moves on the ring by x, the cable before it grows by the
/// component of x along its direction, which is the same as that along the direction after it.
Vector3 direction_through_ring(const NodeConstants& node, const Touch& touch, double height);

}  // namespace cdrj

// Lengths, wraps and lever arms in the plane: tangents and arcs (E4) to (E7), (E26), (E27).
//
// A cable is a path of directed circles: radius r and turn sigma = +1 where the cable goes round it
// counter-clockwise on its way from the first node to the last, -1 clockwise. Points are circles of
// radius 0. docs/model.md, section 3.
#pragma once

#include <span>

#include "layout.hpp"

namespace cdrj {

struct Point {
    double x, y;
};

/// Directed common tangent of two circles.
struct Tangent {
    double length;  // between the tangent points [m]; NaN where there is none
    double angle;   // its direction [rad]
};

/// (E4): with h = sigma2 r2 - sigma1 r1 and u at the angle phi + gamma, where phi is the direction of
/// the line of centres, sin gamma = -h / D and length^2 = D^2 - h^2.
Tangent tangent(const Point& a, double signed_radius_a, const Point& b, double signed_radius_b);

/// Pose of every frame of a robot in the plane, and its velocity per joint.
///
/// A rolling frame follows two equal circles of radius R: its origin lies at 2R (cos q, sin q), it
/// turns by 2q, and its instant centre is the point of contact (5).
void place_frames(
    const Topology& topology, const Constants& constants, std::span<const double> joint_angle,
    Workspace& work);

/// Lengths, wraps, arcs, middles, directions and lever arms of one cable given by positions.
///
/// Returns false where a common tangent does not exist or a wrap is negative.
bool route_in_plane(
    const Topology& topology, const Constants& constants, Index cable, Workspace& work);

}  // namespace cdrj

// Lengths, wraps and lever arms of the cables in space. docs/geometry.md.
#pragma once

#include <span>

#include "layout.hpp"

namespace cdrj {

/// Pose of every frame in space, and its velocity per joint (G1).
///
/// A rolling frame follows two equal circles as in the plane (5): it rolls about its z axis and
/// starts on its x axis.
void place_spatial_frames(
    const Topology& topology, const Constants& constants, std::span<const double> joint_angle,
    Workspace& work);

/// Lengths, arcs, middles, directions and lever arms of one cable; false if its path is impossible.
///
/// `motor_angle` [rad] may be empty, for drums at rest; only drums with a pitch depend on it. The
/// wraps of sheaths are given, all others written.
bool route_in_space(
    const Topology& topology, const Constants& constants, Index cable,
    std::span<const double> motor_angle, std::span<const double> joint_angle, Workspace& work);

/// Motion of the middle of an arc on its body along the cable [m], towards the last node (E26).
///
/// It is exact on a circle, on a helix of constant slope and on a great circle, and of second order
/// where slope or plane change. It is 0 where the cable did not touch the body in both samples.
double motion_along(double radius, const ArcMiddle& before, const ArcMiddle& now);

}  // namespace cdrj

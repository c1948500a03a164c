// Lengths, wraps and lever arms of a cable given by positions. docs/model.md.
//
// A cable in the plane is one in space: its pulleys and drums lie at z = 0, their axes along z.
#pragma once

#include <span>

#include "layout.hpp"

namespace cdrj {

/// Lengths, arcs, middles, directions and lever arms of one cable; false if its path is impossible.
///
/// `motor_angle` [rad] may be empty, for drums at rest; only drums with a pitch depend on it. The
/// wraps of sheaths are given, all others written.
bool route_cable(
    const Topology& topology, const Constants& constants, Index cable,
    std::span<const double> motor_angle, std::span<const double> joint_angle, Workspace& work);

/// Motion of the middle of an arc on its body along the cable [m], towards the last node (E26).
///
/// It is exact on a circle, on a helix of constant slope and on a great circle, and of second order
/// where slope or plane change. It is 0 where the cable did not touch the body in both samples.
double motion_along(double radius, const ArcMiddle& before, const ArcMiddle& now);

}  // namespace cdrj

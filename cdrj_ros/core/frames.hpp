// Poses and velocities of the frames that carry the nodes. docs/model.md, section 13.1.
#pragma once

#include <span>

#include "layout.hpp"

namespace cdrj {

/// Pose of every frame, and its velocity per joint (G1).
///
/// A rolling frame follows two equal circles (5): it rolls about its z axis and
/// starts on its x axis.
void place_frames(
    const Topology& topology, const Constants& constants, std::span<const double> joint_angle,
    Workspace& work);

/// Velocity of a point that moves with a frame; both vectors are in the base (G1).
inline Vector3 velocity_of(const Twist& twist, const Vector3& point) {
    return twist.linear + cross(twist.angular, point);
}

}  // namespace cdrj

#include "frames.hpp"

#include <cmath>

namespace cdrj {
namespace {

/// Add an angular velocity about a line in the base.
void turn(Twist& twist, const Vector3& axis, const Vector3& origin) {
    twist.angular = twist.angular + axis;
    twist.linear = twist.linear + cross(origin, axis);
}

/// Turn a pose about a unit vector in its own axes.
///
/// Turning about the vector in the base would multiply rounding errors from joint to joint.
void turn(Pose& pose, const Vector3& axis, double angle) {
    const double c = std::cos(angle), s = std::sin(angle);
    const Vector3 first = rotated(pose.rotation, about(axis, c, s, {1.0, 0.0, 0.0}));
    const Vector3 second = rotated(pose.rotation, about(axis, c, s, {0.0, 1.0, 0.0}));
    const Vector3 third = rotated(pose.rotation, about(axis, c, s, {0.0, 0.0, 1.0}));
    pose.rotation.row = {
        first.x, second.x, third.x, first.y, second.y, third.y, first.z, second.z, third.z};
}

/// The product of two rotations.
Matrix3 product(const Matrix3& left, const Matrix3& right) {
    Matrix3 result{};
    for (int i = 0; i < 3; ++i) {
        for (int k = 0; k < 3; ++k) {
            result.row[3 * i + k] = left.row[3 * i] * right.row[k] +
                                    left.row[3 * i + 1] * right.row[3 + k] +
                                    left.row[3 * i + 2] * right.row[6 + k];
        }
    }
    return result;
}

}  // namespace

void place_frames(
    const Topology& topology, const Constants& constants, std::span<const double> joint_angle,
    Workspace& work) {
    for (Index f = 0; f < topology.sizes.frames; ++f) {
        const FrameConstants& frame = constants.frames[f];
        const auto [parent, motion, joint] = topology.frames[f];
        Pose& pose = work.pose[f];
        Vector3 origin = frame.origin;
        pose.rotation = frame.rotation;
        if (parent >= 0) {
            const Pose& carrier = work.pose[parent];
            pose.rotation = product(carrier.rotation, frame.rotation);
            origin = carrier.origin + rotated(carrier.rotation, frame.origin);
        }
        for (Index j = 0; j < topology.sizes.joints; ++j) {
            work.twist(f, j) =
                parent >= 0 ? work.twist(parent, j) : Twist{ZERO, ZERO};
        }
        if (joint >= 0) {
            const double q = frame.multiplier * joint_angle[joint] + frame.offset;
            const Vector3 axis = rotated(pose.rotation, frame.axis);
            const Vector3 rate = frame.multiplier * axis;
            Twist& twist = work.twist(f, joint);
            switch (motion) {
                case FrameMotion::fixed: break;
                case FrameMotion::revolute:
                    turn(twist, rate, origin);
                    turn(pose, frame.axis, q);
                    break;
                case FrameMotion::prismatic:
                    twist.linear = twist.linear + rate;
                    origin = combined(1.0, origin, q, axis);
                    break;
                case FrameMotion::rolling: {
                    const Vector3 start = rotated(pose.rotation, {frame.rolling_radius, 0.0, 0.0});
                    const Vector3 radius = about(axis, std::cos(q), std::sin(q), start);
                    turn(twist, 2.0 * rate, origin + radius);
                    origin = combined(1.0, origin, 2.0, radius);
                    turn(pose, frame.axis, 2.0 * q);
                    break;
                }
            }
        }
        pose.origin = origin;
    }
}

}  // namespace cdrj

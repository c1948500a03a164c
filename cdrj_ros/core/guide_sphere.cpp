// A sphere: the cable lies on a great circle in the plane of the centre, a and b.
#include <cmath>

#include "guide.hpp"

namespace cdrj {
namespace {

/// Sine below which two directions count as parallel.
constexpr double PARALLEL = 1e-12;

Meeting meet(const NodeConstants& node, Touch& touch) {
    const Vector3 &a = touch.before, &b = touch.after;
    Vector3 axis = cross(a, b);
    const double size = norm(axis);
    if (size > PARALLEL * norm(a) * norm(b)) {
        axis = (1.0 / size) * axis;
    } else {  // a, b and the centre lie on one line: choose any plane through it
        const bool along_x = !(std::abs(a.x) < 0.5 * norm(a));
        axis = cross(a, along_x ? Vector3{0.0, 1.0, 0.0} : Vector3{1.0, 0.0, 0.0});
        axis = (1.0 / norm(axis)) * axis;
    }
    // axes of the plane: towards a, and to the left of it
    const Vector3 ahead = (1.0 / norm(a)) * a, left = cross(axis, ahead);
    const auto in_plane = [&](const Vector3& v) { return Vector2{dot(v, ahead), dot(v, left)}; };
    const auto [possible, first, last] =
        touch_round(node, touch, {in_plane(a), in_plane(b), in_plane(touch.side)});
    touch.normal = axis;
    touch.entry_normal = combined(first.x, ahead, first.y, left);
    touch.exit_normal = combined(last.x, ahead, last.y, left);
    return {possible, node.radius * touch.entry_normal, node.radius * touch.exit_normal};
}

ArcMiddle measure(const NodeConstants& node, const Passing& cable, Touch& touch) {
    if (node.inside == 1.0) {
        touch.wrap = cable.bend();
        return {touch.entry_normal, direction_through_ring(node, touch, 0.0), 0.0};
    }
    touch.wrap = touch.angle;
    touch.arc = node.radius * touch.angle;
    const double turned = touch.sense * (0.5 * touch.angle);
    const Vector3 normal =
        about(touch.normal, std::cos(turned), std::sin(turned), touch.entry_normal);
    return {normal, touch.sense * cross(touch.normal, normal), 0.0};
}

Vector3 tangent(const NodeConstants& node, const Touch& touch, bool leaving) {
    if (node.inside == 1.0) return direction_at_ring(touch, leaving);
    return touch.sense * cross(touch.normal, leaving ? touch.exit_normal : touch.entry_normal);
}

}  // namespace

const GuideKind SPHERE{
    .bridges = false, .grooved = false, .meet = meet, .measure = measure, .tangent = tangent};

}  // namespace cdrj

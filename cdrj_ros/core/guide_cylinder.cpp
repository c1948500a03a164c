// A cylinder: the cable is a helix, straight on the unrolled surface (G5).
#include <cmath>

#include "guide.hpp"

namespace cdrj {
namespace {

Meeting meet(const NodeConstants& node, Touch& touch) {
    const Vector3 &a = touch.before, &b = touch.after;
    const auto [possible, first, last] =
        touch_round(node, touch, {flat(a), flat(b), flat(touch.side)});
    touch.entry_normal = in_space(first);
    touch.exit_normal = in_space(last);
    const double rise = b.z - a.z;
    const double whole = touch.before_length + node.radius * touch.angle + touch.after_length;
    Vector3 entry = node.radius * touch.entry_normal, exit = node.radius * touch.exit_normal;
    entry.z = a.z + rise * touch.before_length / whole;
    exit.z = b.z - rise * touch.after_length / whole;
    return {possible, entry, exit};
}

/// Rise of the helix over its length around the axis.
double slope_of(const NodeConstants& node, const Touch& touch) {
    const double unrolled =
        touch.before_length + node.radius * touch.angle + touch.after_length;
    return (touch.after.z - touch.before.z) / unrolled;
}

ArcMiddle measure(const NodeConstants& node, const Passing& cable, Touch& touch) {
    const Vector3 rise = combined(0.5, touch.entry + touch.exit, -1.0, touch.centre);
    const double height = dot(axis_of(touch.basis), rise);
    if (node.inside == 1.0) {
        touch.wrap = cable.bend();
        return {touch.entry_normal, direction_through_ring(node, touch, height), height};
    }
    const double slope = slope_of(node, touch);
    const double stretch = std::sqrt(1.0 + slope * slope);  // 1 / cos of the helix angle
    touch.wrap = touch.angle / stretch;
    touch.arc = node.radius * touch.angle * stretch;
    const Vector2 normal = turned(flat(touch.entry_normal), touch.sense * (0.5 * touch.angle));
    const Vector2 along = touch.sense * left_of(normal);
    return {in_space(normal), (1.0 / stretch) * Vector3{along.x, along.y, slope}, height};
}

Vector3 tangent(const NodeConstants& node, const Touch& touch, bool leaving) {
    if (node.inside == 1.0) return direction_at_ring(touch, leaving);
    const Vector3& normal = leaving ? touch.exit_normal : touch.entry_normal;
    const double slope = slope_of(node, touch), stretch = std::sqrt(1.0 + slope * slope);
    return (1.0 / stretch) * (touch.sense * cross(Z_AXIS, normal) + slope * Z_AXIS);
}

}  // namespace

const GuideKind CYLINDER{
    .bridges = false, .grooved = false, .meet = meet, .measure = measure, .tangent = tangent};

}  // namespace cdrj

// A cylinder: the cable is a helix, straight on the unrolled surface (G5).
#include <cmath>

#include "guide.hpp"
#include "tangents.hpp"
#include "vectors.hpp"

namespace cdrj {
namespace {

Meeting meet(const NodeConstants& node, Touch& touch) {
    const Vector3 &a = touch.before, &b = touch.after;
    const double radius = node.radius;
    const bool possible = touch_round(node, touch, {Z_AXIS, flat(a), flat(b), flat(touch.side)});
    Vector3 entry = radius * touch.entry_normal, exit = radius * touch.exit_normal;
    touch.angle = 0.0;
    if (node.inside == 0.0) {
        touch.angle = arc_angle(Z_AXIS, touch.sense, touch.entry_normal, touch.exit_normal) +
                      2.0 * PI * node.turns;
    }
    const double rise = b.z - a.z;
    const double whole = touch.before_length + radius * touch.angle + touch.after_length;
    entry.z = a.z + rise * touch.before_length / whole;
    exit.z = b.z - rise * touch.after_length / whole;
    return {possible, entry, exit};
}

ArcMiddle measure(const NodeConstants& node, const Passing& cable, Touch& touch) {
    const Vector3 rise = combined(0.5, touch.entry + touch.exit, -1.0, touch.centre);
    const double height = dot(axis_of(touch.basis), rise);
    if (node.inside == 1.0) {
        touch.wrap = cable.bend();
        return {touch.entry_normal, direction_through_ring(node, touch, height), height};
    }
    const double unrolled =
        touch.before_length + node.radius * touch.angle + touch.after_length;
    const double slope = (touch.after.z - touch.before.z) / unrolled;  // of the helix
    const double stretch = std::sqrt(1.0 + slope * slope);  // 1 / cos of the helix angle
    touch.wrap = touch.angle / stretch;
    touch.arc = node.radius * touch.angle * stretch;
    const double turned = touch.sense * (0.5 * touch.angle);
    const Vector3 normal = about(Z_AXIS, std::cos(turned), std::sin(turned), touch.entry_normal);
    const Vector3 along = touch.sense * cross(Z_AXIS, normal);
    return {normal, (1.0 / stretch) * Vector3{along.x, along.y, slope}, height};
}

}  // namespace

const GuideKind CYLINDER{
    .fixed = false, .bridges = false, .grooved = false, .meet = meet, .measure = measure};

}  // namespace cdrj

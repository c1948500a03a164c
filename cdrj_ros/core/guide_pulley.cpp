// A pulley whose groove holds the cable in its plane; also drums and sectors at the ends.
#include <algorithm>
#include <cmath>

#include "guide.hpp"

namespace cdrj {
namespace {

/// Points of contact with a circle in the plane z = 0; impossible where a tangent does not exist.
Meeting meet(const NodeConstants& node, Touch& touch) {
    touch.sense = node.turn;
    const Vector2 a = flat(touch.before), b = flat(touch.after);
    const TangentPoint first = tangent_from(outside(a, node.radius), node.radius, node.turn);
    const TangentPoint last = tangent_from(outside(b, node.radius), node.radius, -node.turn);
    touch.entry_normal = in_space(first.normal);
    touch.exit_normal = in_space(last.normal);
    touch.before_length = first.length;
    touch.after_length = last.length;
    return {
        !is_inside(std::min(dot(a, a), dot(b, b)), node.radius, RIM), node.radius * touch.entry_normal,
        node.radius * touch.exit_normal};
}

/// (E5): the wrap is continuous within half a turn of that in the reference pose.
ArcMiddle measure(const NodeConstants& node, const Passing&, Touch& touch) {
    const Vector2 first = flat(touch.entry_normal), last = flat(touch.exit_normal);
    const double angle = node.turn * std::atan2(cross(first, last), dot(first, last));
    const double expected = node.arc_reference;
    touch.angle = expected + modulo(angle - expected + PI, 2.0 * PI) - PI;
    touch.wrap = touch.angle;
    touch.arc = node.radius * touch.angle;
    const Vector2 normal = turned(first, touch.sense * (0.5 * touch.angle));
    return {in_space(normal), touch.sense * in_space(left_of(normal)), 0.0};
}

Vector3 tangent(const NodeConstants&, const Touch& touch, bool leaving) {
    return touch.sense * cross(Z_AXIS, leaving ? touch.exit_normal : touch.entry_normal);
}

}  // namespace

const GuideKind PULLEY{
    .bridges = false, .grooved = true, .meet = meet, .measure = measure, .tangent = tangent};

}  // namespace cdrj

// A pulley whose groove holds the cable in its plane; also drums and sectors at the ends.
#include <cmath>

#include "guide.hpp"

namespace cdrj {
namespace {

/// Points of contact with a circle in the plane z = 0; impossible where a tangent does not exist.
Meeting meet(const NodeConstants& node, Touch& touch) {
    touch.sense = node.turn;
    const TangentPoint first = tangent_from(flat(touch.before), node.radius, node.turn);
    const TangentPoint last = tangent_from(flat(touch.after), node.radius, -node.turn);
    touch.entry_normal = in_space(first.normal);
    touch.exit_normal = in_space(last.normal);
    touch.before_length = first.length;
    touch.after_length = last.length;
    return {
        first.length > 0.0 && last.length > 0.0, node.radius * touch.entry_normal,
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

}  // namespace

const GuideKind PULLEY{.bridges = false, .grooved = true, .meet = meet, .measure = measure};

}  // namespace cdrj

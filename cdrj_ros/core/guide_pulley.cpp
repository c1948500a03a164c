// A pulley whose groove holds the cable in its plane; also drums and sectors at the ends.
#include <cmath>

#include "vectors.hpp"
#include "guide.hpp"
#include "tangents.hpp"

namespace cdrj {
namespace {

/// Points of contact with a circle in the plane z = 0; impossible where a tangent does not exist.
Meeting meet(const NodeConstants& node, Touch& touch) {
    touch.sense = node.turn;
    const TangentPoint first = tangent_from(flat(touch.before), Z_AXIS, node.radius, node.turn);
    const TangentPoint last = tangent_from(flat(touch.after), Z_AXIS, node.radius, -node.turn);
    touch.entry_normal = first.normal;
    touch.exit_normal = last.normal;
    touch.before_length = first.length;
    touch.after_length = last.length;
    return {
        first.length > 0.0 && last.length > 0.0, node.radius * first.normal,
        node.radius * last.normal};
}

/// (E5): the wrap is continuous within half a turn of that in the reference pose.
ArcMiddle measure(const NodeConstants& node, const Passing&, Touch& touch) {
    const Vector3 &first = touch.entry_normal, &last = touch.exit_normal;
    const double angle =
        node.turn * std::atan2(dot(Z_AXIS, cross(first, last)), dot(first, last));
    const double expected = node.arc_reference;
    touch.angle = expected + modulo(angle - expected + PI, 2.0 * PI) - PI;
    touch.wrap = touch.angle;
    touch.arc = node.radius * touch.angle;
    const double turned = touch.sense * (0.5 * touch.angle);
    const Vector3 normal = about(Z_AXIS, std::cos(turned), std::sin(turned), first);
    return {normal, touch.sense * cross(Z_AXIS, normal), 0.0};
}

}  // namespace

const GuideKind PULLEY{
    .fixed = false, .bridges = false, .grooved = true, .meet = meet, .measure = measure};

}  // namespace cdrj

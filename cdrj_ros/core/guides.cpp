// The kinds of guides, docs/model.md, section 13.2.
#include "guide.hpp"

#include <algorithm>
#include <cmath>

namespace cdrj {
namespace {

// A point: an eyelet, or an anchor at an end.
namespace point {

/// The middle never moves in the body.
ArcMiddle measure(const NodeConstants&, const Passing& cable, Touch& touch) {
    touch.wrap = cable.bend();
    return {Z_AXIS, Z_AXIS, 0.0};
}

}  // namespace point

// A sheath: it keeps the length of the cable between two points.
namespace sheath {

/// The middle never moves in the body.
ArcMiddle measure(const NodeConstants& node, const Passing& cable, Touch& touch) {
    touch.wrap = cable.wrap;
    touch.arc = node.length;
    return {Z_AXIS, Z_AXIS, 0.0};
}

}  // namespace sheath

// A pulley whose groove holds the cable in its plane; also drums and sectors at the ends.
namespace pulley {

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

}  // namespace pulley

// A pulley that swivels about the cable that enters it: (G7).
namespace swivel {

/// Its plane contains the axis z, along which the cable enters at the origin, and the point b.
Meeting meet(const NodeConstants& node, Touch& touch) {
    const Vector3& b = touch.after;
    const double radius = node.radius;
    const double out = std::hypot(b.x, b.y);
    const bool on_axis = out <= ROUNDING * norm(b);  // then any plane holds both, straight ahead
    const double x = out - radius, y = b.z;
    const double length = std::sqrt(std::max(x * x + y * y - radius * radius, 0.0));
    touch.angle = std::atan2(length * x + radius * y, length * y - radius * x);
    if (touch.angle < -BELOW_TURN) touch.angle += 2.0 * PI;
    touch.angle = std::max(touch.angle, 0.0);
    touch.after_length = length;
    // direction of the pulley's plane
    touch.exit_normal = on_axis ? Vector3{1.0, 0.0, 0.0} : Vector3{b.x / out, b.y / out, 0.0};
    const Vector3 aside = (radius * (1.0 - std::cos(touch.angle))) * touch.exit_normal;
    const bool possible = !is_inside(x * x + y * y, radius, RIM) && (!on_axis || y > 0.0);
    return {possible, ZERO, {aside.x, aside.y, radius * std::sin(touch.angle)}};
}

/// The middle is given in the plane of the pulley, which swivels with it.
ArcMiddle measure(const NodeConstants& node, const Passing&, Touch& touch) {
    touch.wrap = touch.angle;
    touch.arc = node.radius * touch.angle;
    const double half = 0.5 * touch.angle;
    const double c = std::cos(half), s = std::sin(half);
    return {{-c, s, 0.0}, {s, c, 0.0}, 0.0};
}

Vector3 tangent(const NodeConstants&, const Touch& touch, bool leaving) {
    if (!leaving) return Z_AXIS;
    return combined(std::sin(touch.angle), touch.exit_normal, std::cos(touch.angle), Z_AXIS);
}

}  // namespace swivel

// A cylinder: the cable is a helix, straight on the unrolled surface (G5).
namespace cylinder {

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

}  // namespace cylinder

// A sphere: the cable lies on a great circle in the plane of the centre, a and b.
namespace sphere {

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

}  // namespace sphere

}  // namespace

// bridges, grooved, meet, measure, tangent, by the code of the guide
const GuideKind GUIDE_KINDS[]{
    {false, false, nullptr, point::measure, nullptr},
    {false, true, pulley::meet, pulley::measure, pulley::tangent},
    {false, false, swivel::meet, swivel::measure, swivel::tangent},
    {false, false, cylinder::meet, cylinder::measure, cylinder::tangent},
    {false, false, sphere::meet, sphere::measure, sphere::tangent},
    {true, false, nullptr, sheath::measure, nullptr},
};

}  // namespace cdrj

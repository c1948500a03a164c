// A pulley that swivels about the cable that enters it: (G7).
#include <algorithm>
#include <cmath>

#include "guide.hpp"

namespace cdrj {
namespace {

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

}  // namespace

const GuideKind SWIVEL{
    .bridges = false, .grooved = false, .meet = meet, .measure = measure, .tangent = tangent};

}  // namespace cdrj

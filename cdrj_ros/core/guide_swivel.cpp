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
    const double x = out - radius, y = b.z;
    const double length = std::sqrt(std::max(x * x + y * y - radius * radius, 0.0));
    touch.angle = std::atan2(length * x + radius * y, length * y - radius * x);
    if (touch.angle < 0.0) touch.angle += 2.0 * PI;
    touch.after_length = length;
    touch.exit_normal = {b.x / out, b.y / out, 0.0};  // direction of the pulley's plane
    const Vector3 aside = (radius * (1.0 - std::cos(touch.angle))) * touch.exit_normal;
    return {
        length > 0.0 && out > 0.0, ZERO, {aside.x, aside.y, radius * std::sin(touch.angle)}};
}

/// The middle is given in the plane of the pulley, which swivels with it.
ArcMiddle measure(const NodeConstants& node, const Passing&, Touch& touch) {
    touch.wrap = touch.angle;
    touch.arc = node.radius * touch.angle;
    const double half = 0.5 * touch.angle;
    const double c = std::cos(half), s = std::sin(half);
    return {{-c, s, 0.0}, {s, c, 0.0}, 0.0};
}

}  // namespace

const GuideKind SWIVEL{.bridges = false, .grooved = false, .meet = meet, .measure = measure};

}  // namespace cdrj

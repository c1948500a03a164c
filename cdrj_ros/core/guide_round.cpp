#include "guide.hpp"

#include "tangents.hpp"

namespace cdrj {
namespace {

/// Contact of a cable that runs through the inside of the body (G6).
void touch_inside(const NodeConstants& node, Touch& touch, const ArcPlane& plane) {
    const RingPoint ring = point_inside(plane.a, plane.b, plane.axis, node.radius);
    touch.touching = ring.touching ? 1.0 : 0.0;
    touch.sense = 1.0;
    touch.normal = plane.axis;
    touch.entry_normal = ring.normal;
    touch.exit_normal = ring.normal;
    const Vector3 point = node.radius * ring.normal;
    touch.before_length = norm(plane.a - point);
    touch.after_length = norm(plane.b - point);
}

}  // namespace

bool touch_round(const NodeConstants& node, Touch& touch, const ArcPlane& plane) {
    const auto& [axis, a, b, side] = plane;
    const double radius = node.radius;
    if (!(dot(a, a) > radius * radius && dot(b, b) > radius * radius)) {
        touch.touching = 0.0;
        touch.entry_normal = Z_AXIS;
        touch.exit_normal = Z_AXIS;
        return node.ignored_inside == 1.0;
    }
    if (node.inside == 1.0) {
        touch_inside(node, touch, plane);
        return true;
    }
    const auto [touching, sense] =
        way_round(a, b, axis, radius, node.turn, node.sided == 1.0, side);
    touch.touching = touching || node.turns > 0.0 ? 1.0 : 0.0;
    touch.sense = sense;
    touch.normal = axis;
    const TangentPoint first = tangent_from(a, axis, radius, sense);
    const TangentPoint last = tangent_from(b, axis, radius, -sense);
    touch.before_length = first.length;
    touch.after_length = last.length;
    touch.entry_normal = first.normal;
    touch.exit_normal = last.normal;
    return true;
}

Vector3 direction_through_ring(const NodeConstants& node, const Touch& touch, double height) {
    Vector3 point = node.radius * touch.entry_normal;
    point.z += height;
    const Vector3 came = point - touch.before, goes = touch.after - point;
    return combined(0.5 / norm(came), came, 0.5 / norm(goes), goes);
}

}  // namespace cdrj

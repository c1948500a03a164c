#include "guide.hpp"

#include "tangents.hpp"

namespace cdrj {

RoundMeeting touch_round(const NodeConstants& node, Touch& touch, const ArcPlane& plane) {
    const auto& [a, b, side] = plane;
    const double radius = node.radius;
    touch.angle = 0.0;
    if (!(dot(a, a) > radius * radius && dot(b, b) > radius * radius)) {
        touch.touching = 0.0;
        return {node.ignored_inside == 1.0, {0.0, 0.0}, {0.0, 0.0}};
    }
    if (node.inside == 1.0) {  // (G6)
        const RingPoint ring = point_inside(a, b, radius);
        const Vector2 point = radius * ring.normal;
        touch.touching = ring.touching ? 1.0 : 0.0;
        touch.sense = 1.0;
        touch.before_length = norm(a - point);
        touch.after_length = norm(b - point);
        return {true, ring.normal, ring.normal};
    }
    const auto [touching, sense, first, last] =
        way_round(a, b, radius, node.turn, node.sided == 1.0, side);
    touch.touching = touching || node.turns > 0.0 ? 1.0 : 0.0;
    touch.sense = sense;
    touch.angle = arc_angle(sense, first.normal, last.normal) + 2.0 * PI * node.turns;
    touch.before_length = first.length;
    touch.after_length = last.length;
    return {true, first.normal, last.normal};
}

Vector3 direction_through_ring(const NodeConstants& node, const Touch& touch, double height) {
    Vector3 point = node.radius * touch.entry_normal;
    point.z += height;
    const Vector3 came = point - touch.before, goes = touch.after - point;
    return combined(0.5 / norm(came), came, 0.5 / norm(goes), goes);
}

}  // namespace cdrj

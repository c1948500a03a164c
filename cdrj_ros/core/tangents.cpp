// Where a cable touches a circle about the origin of a plane, and the side on which it passes: (G2), (G4), (G6).
// docs/model.md, section 13.2.
#include <algorithm>
#include <cmath>

#include "guide.hpp"

namespace cdrj {
namespace {

/// Largest number of Newton or bisection steps for the point of a ring.
constexpr int MOST_STEPS = 100;

/// Angle below which an arc is rounding, because a free length is the root of a difference [rad]; and
/// free length beside a ring, over the radius, below which the cable bends at the neighbour instead.
constexpr double GRAZING = 1e-9;

/// The way of a cable round a circle.
struct WayRound {
    bool touching;
    double sense;  // +1: counter-clockwise, -1: clockwise
    TangentPoint first, last;  // where it comes to the circle, and where it leaves
};

WayRound way_in_sense(
    const Vector2& a, const Vector2& b, double radius, double sense, bool touching) {
    return {touching, sense, tangent_from(a, radius, sense), tangent_from(b, radius, -sense)};
}

/// Whether two vectors point to opposite sides to rounding, so that the sign of their product is none.
bool opposite(const Vector2& a, const Vector2& b) {
    const double sine = cross(a, b);
    return dot(a, b) < 0.0 && sine * sine <= ROUNDING * ROUNDING * dot(a, a) * dot(b, b);
}

/// Whether the straight line from a to b, both outside of the circle, passes through it.
bool passes_through(const Vector2& a, const Vector2& b, double radius) {
    const Vector2 way = b - a;
    const double square = dot(way, way), share = -dot(way, a);
    if (!(0.0 < share && share < square)) return false;
    const Vector2 nearest = combined(1.0, a, share / square, way);
    return dot(nearest, nearest) <= radius * radius;
}

/// (G15): the way of a cable from a to b, in `node.turn`, past `side`, or the shorter one.
WayRound way_round(const NodeConstants& node, const ArcPlane& plane) {
    const auto& [a, b, side] = plane;
    const bool through = passes_through(a, b, node.radius);
    const double left = cross(a, b);  // positive: the centre lies to the left of the line
    const double shorter = left >= 0.0 ? 1.0 : -1.0;
    if (node.turn != 0.0) {
        return way_in_sense(a, b, node.radius, node.turn, through || node.turn * left < 0.0);
    }
    const bool far = node.sided == 1.0 && shorter * cross(side, a) > 0.0 &&
                     shorter * cross(b, side) > 0.0;
    return way_in_sense(a, b, node.radius, far ? -shorter : shorter, through || far);
}

/// Whether two ways between which a cable jumps are the same to rounding.
bool undecided(const NodeConstants& node, const ArcPlane& plane) {
    const auto& [a, b, side] = plane;
    if (node.turn != 0.0) return opposite(a, -1.0 * b) && !passes_through(a, b, node.radius);
    if (node.sided == 1.0) return opposite(a, side) || opposite(b, side);
    return opposite(a, b);
}

/// Where a cable that runs through the inside of a ring touches it.
struct RingPoint {
    bool touching;
    Vector2 normal;  // unit vector to the point
};

/// Change of the distance from a point to a ring per angle, and its derivative.
struct Slope {
    double value;       // [m/rad]
    double derivative;  // [m/rad^2]
};

/// `distance`: of the point from the centre [m]; `angle`: between the radius to the point on the ring
/// and the line to the point [rad].
Slope slope_of(double distance, double radius, double angle) {
    const double way =
        std::hypot(distance - radius * std::cos(angle), radius * std::sin(angle));
    const double slope = radius * distance * std::sin(angle) / way;
    return {slope, (radius * distance * std::cos(angle) - slope * slope) / way};
}

/// (G6): the point of a ring at which a cable from a to b, outside of it, bends.
RingPoint point_inside(const Vector2& a, const Vector2& b, double radius) {
    const bool free = passes_through(a, b, radius);
    const double from_a = norm(a), from_b = norm(b);
    double whole = std::atan2(cross(a, b), dot(a, b));
    const double sense = whole >= 0.0 ? 1.0 : -1.0;
    whole = std::abs(whole);
    // the point is seen from a and from b: between these angles the slope increases
    double low = std::max(0.0, whole - std::acos(std::min(radius / from_b, 1.0)));
    double high = std::min(whole, std::acos(std::min(radius / from_a, 1.0)));
    double angle = 0.5 * (low + high);
    for (int k = 0; k < MOST_STEPS; ++k) {
        const Slope one = slope_of(from_a, radius, angle);
        const Slope other = slope_of(from_b, radius, whole - angle);
        const double slope = one.value - other.value;
        const double curve = one.derivative + other.derivative;
        (slope > 0.0 ? high : low) = angle;
        double step = curve > 0.0 ? angle - slope / curve : low;
        if (!(low < step && step < high)) step = 0.5 * (low + high);
        if (std::abs(step - angle) <= 1e-16) break;
        angle = step;
    }
    const double c = std::cos(sense * angle) / from_a, s = std::sin(sense * angle) / from_a;
    return {!free, combined(c, a, s, left_of(a))};
}

/// Angle in [0, 2 pi) from one normal to another; rounding below 0 counts as 0.
double arc_angle(double sense, const Vector2& first, const Vector2& last) {
    double angle = sense * std::atan2(cross(first, last), dot(first, last));
    if (angle < -BELOW_TURN) angle += 2.0 * PI;
    return std::max(angle, 0.0);
}

}  // namespace

RoundMeeting touch_round(const NodeConstants& node, Touch& touch, const ArcPlane& seen) {
    const double radius = node.radius;
    touch.angle = 0.0;
    const double nearest = std::min(dot(seen.a, seen.a), dot(seen.b, seen.b));
    if (is_inside(nearest, radius, RIM)) {
        touch.touching = 0.0;
        const bool ignored = node.ignored_inside == 1.0 && is_inside(nearest, radius, 2.0 * RIM);
        return {ignored, {0.0, 0.0}, {0.0, 0.0}};
    }
    const ArcPlane plane{outside(seen.a, radius), outside(seen.b, radius), seen.side};
    const auto& [a, b, side] = plane;
    if (node.inside == 1.0) {  // (G6)
        const RingPoint ring = point_inside(a, b, radius);
        const Vector2 point = radius * ring.normal;
        touch.sense = 1.0;
        touch.before_length = norm(a - point);
        touch.after_length = norm(b - point);
        const double shorter = std::min(touch.before_length, touch.after_length);
        touch.touching = ring.touching && shorter > GRAZING * radius ? 1.0 : 0.0;
        return {true, ring.normal, ring.normal};
    }
    const auto [touching, sense, first, last] = way_round(node, plane);
    const double angle = arc_angle(sense, first.normal, last.normal) + 2.0 * PI * node.turns;
    touch.touching = (touching && angle > GRAZING) || node.turns > 0.0 ? 1.0 : 0.0;
    touch.sense = sense;
    touch.angle = angle;
    touch.before_length = first.length;
    touch.after_length = last.length;
    return {!undecided(node, plane), first.normal, last.normal};
}

Vector3 direction_at_ring(const Touch& touch, bool leaving) {
    const Vector3& normal = touch.entry_normal;
    const Vector3 point = rotated(touch.basis, touch.entry - touch.centre);
    const Vector3 other = leaving ? point - touch.before : touch.after - point;
    const Vector3 unit = (1.0 / norm(other)) * other;
    return combined(1.0, unit, -2.0 * dot(unit, normal), normal);
}

Vector3 direction_through_ring(const NodeConstants& node, const Touch& touch, double height) {
    Vector3 point = node.radius * touch.entry_normal;
    point.z += height;
    const Vector3 came = point - touch.before, goes = touch.after - point;
    return combined(0.5 / norm(came), came, 0.5 / norm(goes), goes);
}

}  // namespace cdrj

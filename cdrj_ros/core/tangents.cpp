// Where a cable touches a circle about the origin of a plane, and the side on which it passes: (G2), (G4), (G6).
// docs/model.md, section 13.2.
#include <algorithm>
#include <cmath>

#include "guide.hpp"

namespace cdrj {
namespace {

/// Largest number of Newton or bisection steps for the point of a ring.
constexpr int MOST_STEPS = 100;

/// The way of a cable round a circle.
struct WayRound {
    bool touching;
    double sense;  // +1: counter-clockwise, -1: clockwise
    TangentPoint first, last;  // where it comes to the circle, and where it leaves
};

/// Whether the segments a-b and c-d intersect.
bool lines_cross(const Vector2& a, const Vector2& b, const Vector2& c, const Vector2& d) {
    const Vector2 ab = b - a, cd = d - c, ca = a - c;
    const double determinant = cross(ab, cd);
    if (std::abs(determinant) < 1e-15) return false;
    const double first = cross(cd, ca) / determinant;
    const double second = cross(ab, ca) / determinant;
    return 0.0 <= first && first <= 1.0 && 0.0 <= second && second <= 1.0;
}

WayRound way_in_sense(
    const Vector2& a, const Vector2& b, double radius, double sense, bool touching) {
    return {touching, sense, tangent_from(a, radius, sense), tangent_from(b, radius, -sense)};
}

/// Cosine of the angle between a way's arc and the side point; -2 if its two lines cross.
double goodness(
    const WayRound& way, const Vector2& a, const Vector2& b, double radius, const Vector2& side) {
    const Vector2 &first = way.first.normal, &last = way.last.normal;
    if (lines_cross(a, radius * first, b, radius * last)) return -2.0;
    const Vector2 middle = first + last;
    return dot(middle, side) / std::max(norm(middle) * norm(side), 1e-300);
}

/// The way of a cable from a to b.
///
/// It touches if the straight line passes through the circle, or passes it on the side opposite to
/// the one that `turn` or, if `sided`, the point `side` demands.
WayRound way_round(
    const Vector2& a, const Vector2& b, double radius, double turn, bool sided, const Vector2& side) {
    const Vector2 way = b - a;
    const double square = dot(way, way);
    const double share =
        square > 0.0 ? std::min(std::max(-dot(way, a) / square, 0.0), 1.0) : 0.0;
    const Vector2 nearest = combined(1.0, a, share, way);
    const bool through = dot(nearest, nearest) <= radius * radius;
    const double left = cross(a, b);  // positive: the centre lies to the left of the line
    if (turn != 0.0) return way_in_sense(a, b, radius, turn, through || turn * left < 0.0);
    if (!sided) return way_in_sense(a, b, radius, left >= 0.0 ? 1.0 : -1.0, through);
    if (!(through || dot(side, nearest) < 0.0)) return way_in_sense(a, b, radius, 1.0, false);
    const WayRound plus = way_in_sense(a, b, radius, 1.0, true);
    const WayRound minus = way_in_sense(a, b, radius, -1.0, true);
    const double of_plus = goodness(plus, a, b, radius, side);
    const double of_minus = goodness(minus, a, b, radius, side);
    WayRound better = of_plus > of_minus ? plus : minus;
    better.touching = std::max(of_plus, of_minus) >= -1.0;
    return better;
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
    const Vector2 way = b - a;
    const double square = dot(way, way);
    const double share = square > 0.0 ? -dot(way, a) / square : 0.0;
    const Vector2 nearest = combined(1.0, a, share, way);
    const bool free = 0.0 < share && share < 1.0 && dot(nearest, nearest) <= radius * radius;
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
    if (angle < -1e-9) angle += 2.0 * PI;
    return std::max(angle, 0.0);
}

}  // namespace

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

// Poses of the frames, and the path of one cable that is given by positions: lengths, wraps and lever arms.
// A cable in the plane is one in space: its pulleys and drums lie at z = 0, their axes along z.
//
// The points of contact of neighbouring round bodies depend on each other. Sweeps along the cable
// recompute each node from the points of its neighbours until no point moves any more. A point that
// moves along a tangent does not move the tangent, so two circles in a plane converge quadratically.
// The result depends on the pose alone, not on the samples before it. docs/model.md, section 13.3.
#include <algorithm>
#include <cmath>
#include <limits>

#include "guide.hpp"
#include "robot.hpp"

namespace cdrj {
namespace {

/// Largest number of sweeps for a path.
constexpr int MOST_SWEEPS = 200;

/// Motion of the points of contact, relative to the size of the cable, at which sweeps stop.
constexpr double SETTLED = 4e-15;

/// Largest such motion in the last sweep; with a larger one the path counts as impossible.
constexpr double ACCEPTED = 1e-12;

/// Smallest distance of neighbouring nodes along a line that misses some, over its length [-].
constexpr double LEAST_SHARE = 1e-3;

/// Distance of two points over the size of the cable below which their direction is rounding [-].
constexpr double COINCIDENT = 1e-9;

/// Sine of an angle between two axes that count as parallel.
constexpr double PARALLEL = 1e-12;

/// Add an angular velocity about a line in the base.
void turn(Twist& twist, const Vector3& axis, const Vector3& origin) {
    twist.angular = twist.angular + axis;
    twist.linear = twist.linear + cross(origin, axis);
}

/// Turn a pose about a unit vector in its own axes.
///
/// Turning about the vector in the base would multiply rounding errors from joint to joint.
void turn(Pose& pose, const Vector3& axis, double angle) {
    const double c = std::cos(angle), s = std::sin(angle);
    const Vector3 first = rotated(pose.rotation, about(axis, c, s, {1.0, 0.0, 0.0}));
    const Vector3 second = rotated(pose.rotation, about(axis, c, s, {0.0, 1.0, 0.0}));
    const Vector3 third = rotated(pose.rotation, about(axis, c, s, {0.0, 0.0, 1.0}));
    pose.rotation.row = {
        first.x, second.x, third.x, first.y, second.y, third.y, first.z, second.z, third.z};
}

/// Velocity of a point that moves with a frame; both vectors are in the base (G1).
Vector3 velocity_of(const Twist& twist, const Vector3& point) {
    return twist.linear + cross(twist.angular, point);
}

/// One cable with its nodes; the first and the last are its ends.
struct Path {
    std::span<const NodeTopology> topology;
    std::span<const NodeConstants> nodes;
    std::span<Touch> touches;

    Index last() const { return static_cast<Index>(nodes.size()) - 1; }

    /// The next node that the cable touches, in the direction of `step`.
    Index neighbour(Index k, Index step) const {
        do k += step;
        while (touches[k].touching == 0.0);
        return k;
    }

    const GuideKind& kind(Index k) const { return kind_of(topology[k].kind); }

    /// Whether an end winds cable.
    bool winds(Index end) const { return !kind(end).fixed(); }
};

/// (E4): where the common tangent of two pulleys with parallel axes leaves one and meets the other.
///
/// With h = sigma2 r2 - sigma1 r1, the line turns from that of the centres by -gamma, sin gamma = h / D.
/// The points stay as they are where there is no such tangent.
void start_on_tangent(
    const NodeConstants& one, Touch& from, const NodeConstants& other, Touch& to) {
    const Vector3 axis = axis_of(from.basis), far_axis = axis_of(to.basis);
    if (norm(cross(axis, far_axis)) > PARALLEL) return;
    const Vector3 way = to.centre - from.centre;
    const Vector3 across = combined(1.0, way, -dot(way, axis), axis);
    const double r1 = one.turn * one.radius;
    const double r2 = other.turn * other.radius * (dot(axis, far_axis) > 0.0 ? 1.0 : -1.0);
    const double h = r2 - r1, square = dot(across, across);
    if (!(square > h * h)) return;
    const double length = std::sqrt(square - h * h);
    const Vector3 unit = combined(length / square, across, -h / square, cross(axis, across));
    const Vector3 right = cross(unit, axis);
    from.exit = from.centre + r1 * right;
    to.entry = to.centre + r2 * right;
}

/// Place all nodes in the base, with contact at the centres; returns the cable's size [m].
///
/// Neighbouring pulleys with parallel axes already have their points of contact.
double place_nodes(const Path& path, std::span<const Pose> poses) {
    double size = 0.0;
    for (Index k = 0; k <= path.last(); ++k) {
        const NodeTopology& links = path.topology[k];
        const NodeConstants& node = path.nodes[k];
        const Pose& pose = poses[links.frame];
        Touch& touch = path.touches[k];
        const Vector3 centre = pose.origin + rotated(pose.rotation, node.centre);
        touch.centre = touch.entry = touch.exit = centre;
        touch.touching = 1.0;
        touch.angle = touch.wrap = touch.arc = 0.0;
        touch.share = 0.0;
        touch.normal = Z_AXIS;
        const GuideKind& kind = path.kind(k);
        if (kind.bridges) {
            const Pose& far = poses[links.exit_frame];
            touch.exit = far.origin + rotated(far.rotation, node.exit);
        } else if (!kind.fixed()) {
            for (int i = 0; i < 3; ++i) {
                const auto& own = node.basis.row;
                const Vector3 row{own[3 * i], own[3 * i + 1], own[3 * i + 2]};
                const Vector3 turned = rotated(pose.rotation, row);
                touch.basis.row[3 * i] = turned.x;
                touch.basis.row[3 * i + 1] = turned.y;
                touch.basis.row[3 * i + 2] = turned.z;
            }
            if (node.sided == 1.0) {
                const Pose& far = poses[links.exit_frame];
                const Vector3 point = far.origin + rotated(far.rotation, node.exit);
                touch.side = rotated(touch.basis, point - centre);
            }
        }
        if (k == 0) continue;
        Touch& before = path.touches[k - 1];
        size += norm(centre - before.centre) + node.radius;
        if (kind.grooved && path.kind(k - 1).grooved) {
            start_on_tangent(path.nodes[k - 1], before, node, touch);
        }
    }
    return size;
}

/// Turn of an end's frame about its axis by all joints [rad]; exact for parallel axes.
double turn_of_frame(
    Index frame, std::span<const Index> joints, const Grid<Twist>& twists, const Touch& touch,
    std::span<const double> joint_angle) {
    const Vector3 axis = axis_of(touch.basis);
    double turned = 0.0;
    for (const Index j : joints) turned += dot(axis, twists(frame, j).angular) * joint_angle[j];
    return turned;
}

/// (G8): angle of cable that has come onto an end since the reference pose, its motor at rest [rad].
///
/// `touch.twisted`, the turn of its frame, makes the result continuous over whole turns.
double wound_angle(const NodeConstants& node, Touch& touch, bool first) {
    const Vector3& normal = first ? touch.exit_normal : touch.entry_normal;
    touch.angle = std::atan2(normal.y, normal.x);
    double turned = wrap_to_pi(touch.angle + touch.twisted - node.arc_reference);
    turned -= touch.twisted - node.turn_reference;
    return node.turn * (first ? turned : -turned);
}

/// What one sweep along the cable found.
struct Sweep {
    bool possible;
    double moved;  // largest motion of a point of contact [m]
};

/// Compute every contact once.
Sweep sweep(const Path& path) {
    Sweep found{true, 0.0};
    const Index last = path.last();
    for (Index k = 0; k <= last; ++k) {
        const GuideKind& kind = path.kind(k);
        if (kind.fixed()) continue;
        const NodeConstants& node = path.nodes[k];
        Touch& touch = path.touches[k];
        const Vector3 centre = touch.centre;
        Vector3 came = k > 0 ? path.touches[path.neighbour(k, -1)].exit : centre;
        const Vector3 goes = k < last ? path.touches[path.neighbour(k, 1)].entry : came;
        if (k == 0) came = goes;
        touch.before = rotated(touch.basis, came - centre);
        touch.after = rotated(touch.basis, goes - centre);
        const double was = touch.touching;
        auto [possible, entry, exit] = kind.meet(node, touch);
        if (node.lead != 0.0) {  // (G10): height at which the cable leaves a helical groove
            const double height = node.lead * (touch.wound + wound_angle(node, touch, k == 0));
            entry = entry + Vector3{0.0, 0.0, height};
            exit = exit + Vector3{0.0, 0.0, height};
        }
        found.possible = found.possible && possible;
        entry = centre + rotated_back(touch.basis, entry);
        exit = centre + rotated_back(touch.basis, exit);
        if (touch.touching != was) found.moved = std::numeric_limits<double>::infinity();
        if (touch.touching == 0.0) entry = exit = centre;
        found.moved = std::max(found.moved, norm(entry - touch.entry));
        found.moved = std::max(found.moved, norm(exit - touch.exit));
        touch.entry = entry;
        touch.exit = exit;
    }
    return found;
}

/// Find the points of contact of all nodes; false if a tangent does not exist.
bool find_path(const Path& path, double size) {
    bool coupled = false;  // one sweep is exact if both neighbours of every round body are points
    for (Index k = 1; k <= path.last(); ++k) {
        coupled |= !(path.kind(k).fixed() || path.kind(k - 1).fixed());
    }
    Sweep found = sweep(path);
    if (!coupled) return found.possible;
    for (int k = 0; k < MOST_SWEEPS && !(found.moved <= SETTLED * size); ++k) found = sweep(path);
    return found.possible && found.moved <= ACCEPTED * size;
}

/// (G9): positions along the line from p to q of the nodes between, which it misses.
void share_line(std::span<Touch> touches, Index p, Index q) {
    const Vector3 begin = touches[p].exit, way = touches[q].entry - begin;
    double least = 0.0;
    for (Index k = p + 1; k < q; ++k) {
        const double share = dot(touches[k].centre - begin, way) / dot(way, way);
        const double most = 1.0 - static_cast<double>(q - k) * LEAST_SHARE;
        least += LEAST_SHARE;
        touches[k].share = std::min(std::max(share, least), most);
        least = touches[k].share;
    }
}

/// Of two nodes with a straight piece of the length `line` between them, the one on whose rim the other
/// lies; -1 if there is none.
///
/// Such a piece is too short to have a direction: the cable is tangent to the body.
Index at_rim(const Path& path, Index p, Index q, double line) {
    for (const Index k : {p, q}) {
        if (line <= 2.0 * RIM * path.nodes[k].radius && !path.kind(k).fixed()) return k;
    }
    return -1;
}

/// Lengths (E6) without the arcs of ends, wraps, arcs with their middles, and directions; false if
/// impossible.
bool measure_cable(const Path& path, const CableTopology& own, double size, Workspace& work) {
    const auto touches = path.touches;
    const Index last = path.last(), first = own.first_element;
    double* length = work.element_length.data() + first;
    double* wrap = work.wrap.data() + own.first_pulley;
    double* arc = work.arc.data() + own.first_pulley;
    Vector3* along = work.direction.data() + first;
    bool possible = true;
    for (Index p = 0; p < last;) {
        const Index q = path.neighbour(p, 1);
        const Vector3 way = touches[q].entry - touches[p].exit;
        const double line = norm(way);
        const Index rim = at_rim(path, p, q, line);
        Vector3 unit = (1.0 / line) * way;
        if (rim >= 0) {
            const Vector3 tangent = path.kind(rim).tangent(path.nodes[rim], touches[rim], rim == p);
            unit = rotated_back(touches[rim].basis, tangent);
        }
        possible = possible && (line > COINCIDENT * size || (rim >= 0 && q == p + 1));
        share_line(touches, p, q);
        double begin = 0.0;
        for (Index e = p; e < q; ++e) {
            const double end = e + 1 < q ? touches[e + 1].share : 1.0;
            length[e] = (end - begin) * line;
            along[e] = unit;
            begin = end;
        }
        p = q;
    }
    ArcMiddle* middle = work.middles.data() + own.first_node;
    middle[0] = middle[last] = {Z_AXIS, Z_AXIS, 0.0};  // cable sticks to an end
    for (Index k = 1; k < last; ++k) {
        Touch& touch = touches[k];
        if (touch.touching == 0.0) {
            wrap[k - 1] = arc[k - 1] = 0.0;
            middle[k] = {Z_AXIS, ZERO, 0.0};
            continue;
        }
        const Passing cable{along[k - 1], along[k], wrap[k - 1]};
        middle[k] = path.kind(k).measure(path.nodes[k], cable, touch);
        wrap[k - 1] = touch.wrap;
        arc[k - 1] = touch.arc;
        possible = possible && touch.wrap >= 0.0;
        length[k - 1] += 0.5 * touch.arc;
        length[k] += 0.5 * touch.arc;
    }
    return possible;
}

}  // namespace

void place_frames(
    const Topology& topology, const Constants& constants, std::span<const Index> frames,
    std::span<const double> joint_angle, Workspace& work) {
    for (const Index f : frames) {
        const FrameConstants& frame = constants.frames[f];
        const auto [parent, motion, joint] = topology.frames[f];
        Pose& pose = work.pose[f];
        Vector3 origin = frame.origin;
        pose.rotation = frame.rotation;
        if (parent >= 0) {
            const Pose& carrier = work.pose[parent];
            pose.rotation = product(carrier.rotation, frame.rotation);
            origin = carrier.origin + rotated(carrier.rotation, frame.origin);
        }
        for (const Index j : topology.paths->joints_of_frame[f]) {
            work.twist(f, j) = parent >= 0 ? work.twist(parent, j) : Twist{ZERO, ZERO};
        }
        if (joint >= 0) {
            const double q = frame.multiplier * joint_angle[joint] + frame.offset;
            const Vector3 axis = rotated(pose.rotation, frame.axis);
            const Vector3 rate = frame.multiplier * axis;
            Twist& twist = work.twist(f, joint);
            switch (motion) {
                case FrameMotion::fixed: break;
                case FrameMotion::revolute:
                    turn(twist, rate, origin);
                    turn(pose, frame.axis, q);
                    break;
                case FrameMotion::prismatic:
                    twist.linear = twist.linear + rate;
                    origin = combined(1.0, origin, q, axis);
                    break;
                case FrameMotion::rolling: {
                    const Vector3 start = rotated(pose.rotation, {frame.rolling_radius, 0.0, 0.0});
                    const Vector3 radius = about(axis, std::cos(q), std::sin(q), start);
                    turn(twist, 2.0 * rate, origin + radius);
                    origin = combined(1.0, origin, 2.0, radius);
                    turn(pose, frame.axis, 2.0 * q);
                    break;
                }
            }
        }
        pose.origin = origin;
    }
}

bool route_cable(
    const Topology& topology, const Constants& constants, Index cable,
    std::span<const double> motor_angle, std::span<const double> joint_angle, Workspace& work) {
    const CableTopology& own = topology.cables[cable];
    const Path path{
        topology.nodes.subspan(own.first_node, own.elements + 1),
        constants.nodes.subspan(own.first_node, own.elements + 1),
        work.touches.subspan(own.first_node, own.elements + 1),
    };
    const Index last = path.last();
    for (const Index end : {Index{0}, Index{1}}) {
        path.touches[end * last].wound =
            motor_angle.empty() ? 0.0
                                : turned_by_motors(topology, constants, 2 * cable + end, motor_angle);
    }
    const double size = place_nodes(path, work.pose);
    for (const Index k : {Index{0}, last}) {
        if (!path.winds(k)) continue;
        path.touches[k].twisted =
            turn_of_frame(
                path.topology[k].frame, topology.paths->joints_of_frame[path.topology[k].frame],
                work.twist, path.touches[k], joint_angle);
    }
    bool possible = find_path(path, size);
    possible = measure_cable(path, own, size, work) && possible;
    double* length = work.element_length.data() + own.first_element;
    for (const Index end : {Index{0}, Index{1}}) {
        const Index k = end * last;
        double& laid = work.laid[2 * cable + end];
        laid = 0.0;
        if (!path.winds(k)) continue;
        laid = path.nodes[k].effective_radius * wound_angle(path.nodes[k], path.touches[k], k == 0);  // (G8)
        length[std::min(k, last - 1)] += laid;
    }
    const Vector3* along = work.direction.data() + own.first_element;
    for (Index e = 0; e < last; ++e) {
        // (E27), in the plane (E7): velocity along the cable of the point at which it arrives on a body, less that of the
        // point at which it has left one
        const NodeTopology& from = path.topology[e];
        const Index left = path.kind(e).bridges ? from.exit_frame : from.frame;
        const Index right = path.topology[e + 1].frame;
        const Touch &begin = path.touches[e], &end = path.touches[e + 1];
        // the length between two points of one frame does not change
        const bool rigid = left == right && begin.touching == 1.0 && end.touching == 1.0;
        for (const Index j : topology.paths->of_cable[cable].joints) {
            double& lever_arm = work.lever_arm(own.first_element + e, j);
            lever_arm = 0.0;
            if (rigid) continue;
            const Vector3 arrives = velocity_of(work.twist(right, j), end.entry);
            const Vector3 leaves = velocity_of(work.twist(left, j), begin.exit);
            lever_arm = dot(along[e], arrives - leaves);
        }
    }
    for (const Index k : {Index{0}, last}) {
        if (!path.winds(k)) continue;
        // moment about the axis of the drum per newton
        Touch& touch = path.touches[k];
        const Vector3 arm = (k == 0 ? touch.exit : touch.entry) - touch.centre;
        const Vector3& unit = along[std::min(k, last - 1)];
        touch.lever = path.nodes[k].turn * dot(axis_of(touch.basis), cross(arm, unit));
    }
    return possible;
}

}  // namespace cdrj

#include "plane.hpp"

#include <cmath>
#include <limits>

#include "angles.hpp"

namespace cdrj {
namespace {

/// Centre of a node in the base [m].
Point centre_of(const NodeConstants& node, const Pose& pose) {
    const double c = std::cos(pose.angle), s = std::sin(pose.angle);
    return {pose.x + c * node.x - s * node.y, pose.y + s * node.x + c * node.y};
}

}  // namespace

Tangent tangent(const Point& a, double signed_radius_a, const Point& b, double signed_radius_b) {
    const double dx = b.x - a.x, dy = b.y - a.y;
    const double h = signed_radius_b - signed_radius_a;
    const double square = dx * dx + dy * dy - h * h;
    if (!(square > 0.0)) {
        const double none = std::numeric_limits<double>::quiet_NaN();
        return {none, none};
    }
    const double length = std::sqrt(square);
    return {length, std::atan2(dy, dx) - std::atan2(h, length)};
}

void place_frames(
    const Topology& topology, const Constants& constants, std::span<const double> joint_angle,
    Workspace& work) {
    const Index joints = topology.sizes.joints;
    for (Index f = 0; f < topology.sizes.frames; ++f) {
        const FrameConstants& frame = constants.frames[f];
        const auto [parent, motion, joint] = topology.frames[f];
        const Pose from = parent >= 0 ? work.pose[parent] : Pose{0.0, 0.0, 0.0};
        for (Index j = 0; j < joints; ++j) {
            work.twist(f, j) = parent >= 0 ? work.twist(parent, j) : Twist{0.0, 0.0, 0.0};
        }
        double c = std::cos(from.angle), s = std::sin(from.angle);
        double x = from.x + c * frame.x - s * frame.y;
        double y = from.y + s * frame.x + c * frame.y;
        double angle = from.angle + frame.angle;
        switch (motion) {
            case Motion::fixed: break;
            case Motion::revolute: {
                Twist& twist = work.twist(f, joint);
                twist.turn += 1.0;
                twist.x += y;
                twist.y -= x;
                angle += joint_angle[joint];
                break;
            }
            case Motion::prismatic: {
                c = std::cos(angle);
                s = std::sin(angle);
                const double dx = c * frame.direction_x - s * frame.direction_y;
                const double dy = s * frame.direction_x + c * frame.direction_y;
                Twist& twist = work.twist(f, joint);
                twist.x += dx;
                twist.y += dy;
                x += joint_angle[joint] * dx;
                y += joint_angle[joint] * dy;
                break;
            }
            case Motion::rolling: {
                const double q = joint_angle[joint], radius = frame.rolling_radius;
                c = std::cos(angle + q);
                s = std::sin(angle + q);
                Twist& twist = work.twist(f, joint);
                twist.turn += 2.0;
                twist.x += 2.0 * (y + radius * s);
                twist.y -= 2.0 * (x + radius * c);
                x += 2.0 * radius * c;
                y += 2.0 * radius * s;
                angle += 2.0 * q;
                break;
            }
        }
        work.pose[f] = {x, y, angle};
    }
}

bool route_in_plane(
    const Topology& topology, const Constants& constants, Index cable, Workspace& work) {
    const CableTopology& own = topology.cables[cable];
    const auto plans = topology.nodes.subspan(own.first_node, own.elements + 1);
    const auto nodes = constants.nodes.subspan(own.first_node, own.elements + 1);
    const Index last = own.elements, joints = topology.sizes.joints;
    double* length = work.element_length.data() + own.first_element;
    bool possible = true;
    Point a = centre_of(nodes[0], work.pose[plans[0].frame]);
    double angle_before = 0.0;
    for (Index e = 0; e < last; ++e) {
        const double r1 = nodes[e].turn * nodes[e].radius;
        const double r2 = nodes[e + 1].turn * nodes[e + 1].radius;
        const Index f1 = plans[e].frame, f2 = plans[e + 1].frame;
        const Point b = centre_of(nodes[e + 1], work.pose[f2]);
        const auto [span, angle] = tangent(a, r1, b, r2);
        if (!(span > 0.0)) possible = false;
        const double ux = std::cos(angle), uy = std::sin(angle);
        work.direction(own.first_element + e, 0) = ux;
        work.direction(own.first_element + e, 1) = uy;
        double arcs;  // half of the arc at a pulley; the whole arc at an end, which winds cable itself
        if (e == 0) {
            const double turned = wrap_to_pi(angle - nodes[0].arc_reference);
            arcs = r1 * (nodes[0].arc_angle * nodes[0].turn + turned);
            arcs -= r1 * work.pose[f1].angle;
            work.laid[2 * cable] = arcs;
        } else {
            const double turn = nodes[e].turn, radius = nodes[e].radius;
            const double expected = nodes[e].arc_angle;
            const double beta =
                expected + wrap_to_pi(turn * (angle - angle_before) - expected);  // (E5)
            if (!(beta >= 0.0)) possible = false;
            const double half = 0.5 * radius * beta;
            const Index p = own.first_pulley + e - 1;
            work.wrap[p] = beta;
            work.arc[p] = radius * beta;
            work.middle[p] = radius * (turn * (angle_before - work.pose[f1].angle)) + half;
            length[e - 1] += half;
            arcs = half;
        }
        if (e == last - 1) {
            const double arrival = wrap_to_pi(angle - nodes[last].arc_reference);
            double laid = r2 * (nodes[last].arc_angle * nodes[last].turn - arrival);
            laid += r2 * work.pose[f2].angle;
            work.laid[2 * cable + 1] = laid;
            arcs += laid;
        }
        length[e] = span + arcs;  // (E6)
        for (Index j = 0; j < joints; ++j) {
            // relative velocity along the element of the bodies' surfaces where it leaves them
            const Twist &one = work.twist(f1, j), &other = work.twist(f2, j);
            const double vx = other.x - other.turn * b.y - one.x + one.turn * a.y;
            const double vy = other.y + other.turn * b.x - one.y - one.turn * a.x;
            const double arm = ux * vx + uy * vy;
            work.lever_arm(own.first_element + e, j) = arm + r2 * other.turn - r1 * one.turn;
        }
        angle_before = angle;
        a = b;
    }
    return possible;
}

}  // namespace cdrj

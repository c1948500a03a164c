// Results of a sample: status, nodal forces and efforts; docs/model.md, section 6. When an element is
// UNSURE: docs/estimation.md.
#include <algorithm>
#include <cmath>

#include "guide.hpp"
#include "robot.hpp"

namespace cdrj {
namespace {

/// Force of a cable on a pulley [N] from the tensions before and after it.
///
/// The components of a routed cable are in the base. For other cables x lies along the bisector of
/// the cable's two directions and y across it.
Vector3 force_on_pulley(const Step& step, Index p, Route routed, double t_in, double t_out) {
    const Workspace& work = step.work;
    if (routed == Route::positions) {
        const Index e = step.topology.pulleys[p].element;
        return t_out * work.direction[e + 1] - t_in * work.direction[e];
    }
    double along = step.constants.pulleys[p].half_sine;
    double across = step.constants.pulleys[p].half_cosine;
    if (step.topology.pulleys[p].wrap_changes == 1) {
        along = std::sin(0.5 * work.wrap[p]);
        across = std::cos(0.5 * work.wrap[p]);
    }
    return {(t_out + t_in) * along, (t_out - t_in) * across, 0.0};
}

/// Moment of a cable about the axis of the drum at one end per newton [m], (E27).
double drum_lever(const Step& step, Index c, Index end) {
    const CableTopology& cable = step.topology.cables[c];
    const Index node = cable.first_node + end * cable.elements;
    if (cable.routed == Route::positions && !kind_of(step.topology.nodes[node].kind).fixed()) {
        return step.work.touches[node].lever;
    }
    return step.constants.ends[2 * c + end].radius;
}

}  // namespace

void report_cable(Step& step, Index c, bool solved) {
    auto& [topology, constants, before, after, estimate, work] = step;
    const CableTopology& cable = topology.cables[c];
    const CableConstants& own = constants.cables[c];
    const Index first = cable.first_element, last = first + cable.elements;
    const Index pulley = cable.first_pulley, beyond = pulley + cable.pulleys;
    for (Index k = 0; k < cable.elements; ++k) {
        const double t = work.segments[topology.span_segment(c, k)].tension;
        const Index e = first + k;
        estimate.tension[e] = t;
        estimate.status[e] = solved ? OK : INVALID;
        set_load(estimate.status[e], t, own);
    }
    for (Index p = pulley; p < beyond; ++p) {
        const PulleyTopology& own = topology.pulleys[p];
        const double t_in = estimate.tension[own.element];
        const double t_out = estimate.tension[own.element + 1];
        const Vector3 force = force_on_pulley(step, p, cable.routed, t_in, t_out);
        estimate.force_x[p] = force.x;
        estimate.force_y[p] = force.y;
        estimate.force_z[p] = force.z;
        estimate.magnitude[p] = norm(force);
        estimate.friction[p] = t_out - t_in;
        estimate.slip_speed[p] = after.slip_speed[own.first_contact];
        if (own.cells > 1) {  // the mean over the arc
            double speed = 0.0;
            for (Index q = own.first_contact; q < own.first_contact + own.cells; ++q) {
                speed += work.contacts[q].share * after.slip_speed[q];
            }
            estimate.slip_speed[p] = speed;
        }
    }
    if (solved) return;
    // the distribution of the elongation is unknown: report no numbers
    for (Index e = first; e < last; ++e) estimate.tension[e] = 0.0;
    for (Index p = pulley; p < beyond; ++p) {
        estimate.force_x[p] = estimate.force_y[p] = estimate.force_z[p] = 0.0;
        estimate.magnitude[p] = estimate.friction[p] = estimate.slip_speed[p] = 0.0;
    }
}

double motor_arm(const Step& step, Index c, Index end, Index turn) {
    return step.constants.turns[turn].winding * drum_lever(step, c, end);
}

double effort_of_cable(const Step& step, Index axis, Index c, double effort) {
    const auto& [topology, constants, before, after, estimate, work] = step;
    const Index joint = axis - topology.sizes.motors;
    const CableTopology& cable = topology.cables[c];
    const std::span tension = estimate.tension.subspan(cable.first_element, cable.elements);
    for (Index k = 0; joint >= 0 && k < cable.elements; ++k) {
        effort -= tension[k] * work.lever_arm(cable.first_element + k, joint);
    }
    for (const Index end : {Index{0}, Index{1}}) {
        const auto [first, beyond] = topology.turns_of(2 * c + end);
        for (Index t = first; t < beyond; ++t) {
            if (topology.turns[t].motor != axis) continue;
            effort -= motor_arm(step, c, end, t) * (end == 0 ? tension.front() : tension.back());
        }
    }
    return effort;
}

void report_efforts(Step& step, std::span<const Index> axes, const SampleAngles& angles) {
    auto& [topology, constants, before, after, estimate, work] = step;
    const Index motors = topology.sizes.motors;
    const bool started = before.started[0] != 0.0;
    for (const Index a : axes) {
        const AxisConstants& axis = constants.axes[a];
        const double read = a < motors ? angles.motor[a] : angles.joint[a - motors];
        const double angle = std::isnan(read) ? before.angle[a] : read;
        const double turned = started ? angle - before.angle[a] : 0.0;
        const double most = axis.bearing_torque;
        double friction = before.bearing_friction[a] + axis.bearing_stiffness * turned;
        friction = std::min(std::max(friction, -most), most);
        const double torque = -friction - axis.spring_stiffness * (angle - axis.spring_rest);
        after.angle[a] = angle;
        after.bearing_friction[a] = friction;
        double& effort =
            a < motors ? estimate.motor_effort[a] : estimate.joint_effort[a - motors];
        double cables = 0.0;
        for (const Index c : topology.paths->cables_of_axis[a]) {
            cables = effort_of_cable(step, a, c, cables);
        }
        effort = axis.effort_sign * (cables + torque);
    }
}

}  // namespace cdrj

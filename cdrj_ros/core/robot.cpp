#include "robot.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "cable.hpp"
#include "friction.hpp"
#include "residual.hpp"

namespace cdrj {
namespace {

/// Newton steps for the common factor of a stiffening cable's tensions; a linear one needs 3.
constexpr int MOST_ROUNDS = 12;

/// Greatest magnitude of any number of a state, in SI units.
constexpr double LARGEST_IN_STATE = 1e9;

/// Spans, wraps and lever arms of a cable from constants and tables over joint angle; no arcs yet.
void read_tables(
    const Topology& topology, const Constants& constants, Index c,
    std::span<const double> joint_angle, Workspace& work) {
    const CableTopology& cable = topology.cables[c];
    const CablePath& path = topology.paths->of_cable[c];
    for (Index e = cable.first_element; e < cable.first_element + cable.elements; ++e) {
        work.element_length[e] = constants.elements[e].span;
        for (const Index j : path.joints) work.lever_arm(e, j) = 0.0;
    }
    for (const Index k : path.terms) {
        const auto [adds_to_wrap, target, joint] = topology.terms[k];
        const JointConstants& grid = constants.joints[joint];
        const double position = (joint_angle[joint] - grid.lower) / grid.interval;
        const Index interval =
            std::min(std::max(static_cast<Index>(position), Index{0}), TABLE_INTERVALS - 1);
        const auto& [c0, c1, c2, c3] = constants.tables[k * TABLE_INTERVALS + interval];
        const double u = position - static_cast<double>(interval);
        const double value = c0 + u * (c1 + u * (c2 + u * c3));
        const double slope = c1 + u * (2.0 * c2 + 3.0 * u * c3);
        if (adds_to_wrap == 0) {
            work.element_length[target] += value;
            work.lever_arm(target, joint) += slope / grid.interval;
        } else {
            work.wrap[target] += value;
            // cable is laid on from the element at the end of the arc that moves
            const PulleyConstants& pulley = constants.pulleys[target];
            const Index element = topology.pulleys[target].element;
            const double laid = pulley.radius * slope / grid.interval;
            work.lever_arm(element, joint) += (0.5 - pulley.moved_after) * laid;
            work.lever_arm(element + 1, joint) += (0.5 + pulley.moved_after) * laid;
        }
    }
}

/// Add the arcs on the pulleys of one cable given by tables to the lengths.
void add_arcs(const Topology& topology, const Constants& constants, Index c, Workspace& work) {
    work.laid[2 * c] = work.laid[2 * c + 1] = 0.0;
    const CableTopology& cable = topology.cables[c];
    if (!work.middles.empty()) {  // of other cables, which are given by positions
        std::ranges::fill(
            work.middles.subspan(cable.first_node, cable.elements + 1),
            ArcMiddle{ZERO, ZERO, 0.0});
    }
    for (Index p = cable.first_pulley; p < cable.first_pulley + cable.pulleys; ++p) {
        const double arc = constants.pulleys[p].radius * work.wrap[p];
        const Index element = topology.pulleys[p].element;
        work.element_length[element] += 0.5 * arc;
        work.element_length[element + 1] += 0.5 * arc;
        work.arc[p] = arc;
        work.middle[p] = constants.pulleys[p].moved_after * arc;
    }
}

/// Angle through which an end has wound cable in: by its motors, its frame and its tangent (E3).
double wound_angle(const Step& step, Index end, std::span<const double> motor_angle) {
    return turned_by_motors(step.topology, step.constants, end, motor_angle) +
           step.work.laid[end] / step.constants.ends[end].radius;
}

/// Start a cable without friction history: its material determines one tension throughout.
///
/// Returns false if no material is left because the cable is wound in entirely.
bool start_cable(Step& step, Index c, std::span<const double> motor_angle) {
    auto& [topology, constants, before, after, estimate, work] = step;
    const CableTopology& cable = topology.cables[c];
    const CableConstants& own = constants.cables[c];
    const auto [first, beyond] = topology.segments_of(c);
    const Elasticity elastic = elasticity_of(own);
    // with an unknown history, assume that the drum was wound at the cable's wound tension
    const double stretch = 1.0 + strain_at(elastic, own.wound_tension);
    double total = 0.0, span = 0.0;
    for (Index e = first; e < beyond; ++e) {
        total += constants.segments[e].material;
        span += after.length[e];
    }
    for (Index end = 2 * c; end < 2 * c + 2; ++end) {
        const Index drum = topology.ends[end].drum;
        if (drum < 0) continue;
        const double rate = constants.ends[end].radius / stretch;
        const double angle = wound_angle(step, end, motor_angle);
        start_drum(after.drums[drum], angle, rate * angle, rate);
        total -= rate * angle;
    }
    for (Index e = first; e < beyond; ++e) {
        after.material[e] = after.length[e] * (total / span);
        work.segments[e].tension = tension_of(elastic, after.length[e], after.material[e]);
        after.delayed[e] = own.creep_share * strain_at(elastic, own.preload);
    }
    for (Index q = cable.first_contact; q < cable.first_contact + cable.contacts; ++q) {
        after.bristle[q] = after.slip_speed[q] = after.lagged_speed[q] = 0.0;
    }
    estimate.iterations[c] = estimate.residual[c] = 0.0;
    return after.material[first] > 0.0;
}

/// Material that the drums of a cable take in a sample [m].
struct Fluxes {
    double first;  // enters at the first node
    double last;   // leaves at the last node
};

Fluxes turn_drums(Step& step, Index c, std::span<const double> motor_angle) {
    auto& [topology, constants, before, after, estimate, work] = step;
    const auto [first, beyond] = topology.segments_of(c);
    Fluxes fluxes{0.0, 0.0};
    for (const Index end : {Index{0}, Index{1}}) {
        const Index number = topology.ends[2 * c + end].drum;
        if (number < 0) continue;
        const double stretch = before.stretch(end == 0 ? first : beyond - 1);
        Drum& memory = after.drums[number];
        const double held = material_held(memory);
        const double angle = wound_angle(step, 2 * c + end, motor_angle);
        const double wound =
            turn_drum(memory, angle, constants.ends[2 * c + end].radius / stretch);
        (end == 0 ? fluxes.first : fluxes.last) = end == 0 ? held - wound : wound - held;
    }
    return fluxes;
}

/// Lengthen the material of every segment by what it has crept since the sample before (E24).
void yield(Step& step, Index c, double dt) {
    auto& [topology, constants, before, after, estimate, work] = step;
    const CableConstants& own = constants.cables[c];
    const Creep law{own.creep_share, own.creep_time, own.flow_time};
    const bool none = law.share == 0.0 && std::isinf(law.flow_time) && law.flow_time > 0.0;
    const auto [first, beyond] = topology.segments_of(c);
    std::ranges::copy(before.delayed.subspan(first, beyond - first), after.delayed.begin() + first);
    if (none) return;
    for (Index e = first; e < beyond; ++e) {
        const double strain = before.length[e] / before.material[e] - 1.0;
        const auto [delayed, growth] = crept(law, strain, before.delayed[e], dt);
        after.delayed[e] = delayed;
        work.segments[e].material_before = growth * before.material[e];
    }
}

/// Distribute the elongation of a cable evenly, because its fluxes were not solved.
void spread_evenly(const Cable& cable) {
    double total = cable.first_flux - cable.last_flux, span = 0.0;
    for (const Segment& segment : cable.segments) {
        total += segment.material_before;
        span += segment.length;
    }
    for (Segment& segment : cable.segments) {
        segment.material = segment.length * (total / span);
        segment.tension = tension_of(cable.elastic, segment.length, segment.material);
    }
}

/// Whether no segment of a cable had tension before, to the accuracy of a solution, and none has.
bool stays_slack(const Cable& cable) {
    return std::ranges::all_of(cable.segments, [&](const Segment& one) {
        const double before =
            tension_of(cable.elastic, one.length_before, one.material_before);
        return before <= acceptable(cable.elastic) && !(one.tension > 0.0);
    });
}

/// Advance a cable with a friction history; false if its fluxes could not be solved.
bool move_cable(Step& step, Index c, std::span<const double> motor_angle, double dt) {
    auto& [topology, constants, before, after, estimate, work] = step;
    const CableTopology& own = topology.cables[c];
    const auto [first, beyond] = topology.segments_of(c);
    const auto [first_flux, last_flux] = turn_drums(step, c, motor_angle);
    for (Index e = first; e < beyond; ++e) {
        work.segments[e].length_before = before.length[e];
        work.segments[e].material_before = before.material[e];
    }
    yield(step, c, dt);
    const Index contact = own.first_contact, last = contact + own.contacts;
    for (Index q = contact; q < last; ++q) {
        work.contacts[q].flux = before.slip_speed[q] * dt - work.contacts[q].shift;
        work.contacts[q].bristle_before = before.bristle[q];
    }
    Cable cable{
        elasticity_of(constants.cables[c]), own.law, first_flux, last_flux, dt,
        work.segments.subspan(first, beyond - first), work.contacts.subspan(contact, own.contacts),
    };
    const Effort effort = cable.solve();
    bool solved =
        effort.imbalance <= acceptable(cable.elastic) &&
        std::ranges::all_of(cable.segments, [](const Segment& one) { return one.material > 0.0; });
    if (!solved) {
        spread_evenly(cable);
        for (Contact& one : cable.contacts) {
            one.bristle = 0.0;
            one.flux = -one.shift;
        }
        solved = stays_slack(cable);  // wherever its material lies
    }
    for (Index e = first; e < beyond; ++e) after.material[e] = work.segments[e].material;
    for (Index q = contact; q < last; ++q) {
        after.bristle[q] = work.contacts[q].bristle;
        const double slip = work.contacts[q].flux + work.contacts[q].shift;  // (E25)
        after.slip_speed[q] = dt > 0.0 ? slip / dt : 0.0;
    }
    for (Index p = own.first_pulley; p < own.first_pulley + own.pulleys; ++p) {
        const double lag = constants.pulleys[p].stribeck_lag;  // (E10)
        const PulleyTopology& pulley = topology.pulleys[p];
        for (Index q = pulley.first_contact; q < pulley.first_contact + pulley.cells; ++q) {
            const double moved = lag * before.lagged_speed[q] + dt * after.slip_speed[q];
            after.lagged_speed[q] = moved / (lag + dt);
        }
    }
    estimate.iterations[c] = static_cast<double>(effort.iterations);
    estimate.residual[c] = effort.imbalance;
    return solved;
}

/// Keep the state of a cable whose path is impossible or unknown, and report no numbers.
void keep_cable(Step& step, Index c) {
    auto& [topology, constants, before, after, estimate, work] = step;
    after.take_cable(topology, c, before);
    estimate.iterations[c] = estimate.residual[c] = 0.0;
    report_cable(step, c, false);
    const CableTopology& cable = topology.cables[c];
    std::fill_n(
        estimate.status.begin() + cable.first_element, cable.elements,
        static_cast<double>(INVALID));
}

}  // namespace

Step::Step(const Robot& robot, const double* before_state, double* out)
    : topology(robot.topology),
      constants(robot.constants),
      before(topology.sizes, const_cast<double*>(before_state)),
      after(topology.sizes, out),
      estimate(topology.sizes, out + robot.state_size()),
      work(topology.sizes, out + robot.state_size() + robot.estimate_size()) {
    if (topology.sizes.surfaces == 0) return;
    std::copy_n(before_state, robot.state_size(), work.history);
    before = State(topology.sizes, work.history);
}

bool shape_cable(
    const Topology& topology, const Constants& constants, Index c,
    std::span<const double> motor_angle, std::span<const double> joint_angle, Workspace& work) {
    const CableTopology& cable = topology.cables[c];
    for (Index p = cable.first_pulley; p < cable.first_pulley + cable.pulleys; ++p) {
        work.wrap[p] = constants.pulleys[p].wrap;
    }
    bool possible = true;
    if (cable.routed == Route::tables) {
        read_tables(topology, constants, c, joint_angle, work);
        add_arcs(topology, constants, c, work);
    } else {
        possible = route_cable(topology, constants, c, motor_angle, joint_angle, work);
    }
    divide_arcs(topology, c, work);
    return possible;
}

bool Robot::shape(
    std::span<const double> motor_angle, std::span<const double> joint_angle,
    Workspace& work) const {
    bool possible = true;
    place_frames(topology, constants, topology.paths->all.frames, joint_angle, work);
    for (Index c = 0; c < topology.sizes.cables; ++c) {
        possible = shape_cable(topology, constants, c, motor_angle, joint_angle, work) && possible;
    }
    return possible;
}

bool is_read(const Topology& topology, Index c, const SampleAngles& angles) {
    const Index motors = topology.sizes.motors;
    return std::ranges::none_of(topology.paths->of_cable[c].axes, [&](Index a) {
        return std::isnan(a < motors ? angles.motor[a] : angles.joint[a - motors]);
    });
}

bool advance_cable(Step& step, Index c, const SampleAngles& angles) {
    auto& [topology, constants, before, after, estimate, work] = step;
    if (!is_read(topology, c, angles) ||
        !shape_cable(topology, constants, c, angles.motor, angles.joint, work)) {
        keep_cable(step, c);
        return false;
    }
    follow_arcs(topology, constants, c, before, after, work);
    if (topology.sizes.surfaces > 0) cover_surfaces(topology, constants, c, before, after, work);
    const CableTopology& cable = topology.cables[c];
    const auto [first, beyond] = topology.segments_of(c);
    for (Index e = first; e < beyond; ++e) after.length[e] = work.segments[e].length;
    if (!work.middles.empty()) {
        std::copy_n(
            work.middles.begin() + cable.first_node, cable.elements + 1,
            after.middles.begin() + cable.first_node);
    }
    place_contacts(topology, constants, c, before, after, work);
    friction_losses(topology, constants, c, before, work);
    for (const Index end : {2 * c, 2 * c + 1}) {
        const Index drum = topology.ends[end].drum;
        if (drum >= 0) after.drums[drum] = before.drums[drum];
    }
    const bool solved = before.holds(first) ? move_cable(step, c, angles.motor, angles.dt)
                                            : start_cable(step, c, angles.motor);
    report_cable(step, c, solved);
    return solved;
}

bool advance_cables(Step& step, const CableSet& some, const SampleAngles& angles) {
    place_frames(step.topology, step.constants, some.frames, angles.joint, step.work);
    bool solved = true;
    for (const Index c : some.cables) solved = advance_cable(step, c, angles) && solved;
    report_efforts(step, some.axes, angles);
    step.after.started[0] = 1.0;
    return solved;
}

bool Robot::advance(
    const double* before, std::span<const double> motor_angle,
    std::span<const double> joint_angle, double dt, double* out) const {
    return advance(before, motor_angle, joint_angle, dt, topology.paths->all, out);
}

bool Robot::advance(
    const double* before, std::span<const double> motor_angle,
    std::span<const double> joint_angle, double dt, const CableSet& some, double* out) const {
    Step step(*this, before, out);
    const SampleAngles angles{motor_angle, joint_angle, dt};
    const bool solved = advance_cables(step, some, angles);
    correct_outputs(step, dt, solved);
    return solved;
}

bool Robot::is_state(std::span<const double> numbers) const {
    if (numbers.size() != state_size()) return false;
    for (const double number : numbers) {
        if (!(std::abs(number) <= LARGEST_IN_STATE)) return false;
    }
    std::vector<double> copy(numbers.begin(), numbers.end());
    const State state(topology.sizes, copy.data());
    if (state.started[0] == 0.0) return true;
    for (Index end = 0; end < 2 * topology.sizes.cables; ++end) {
        const Index drum = topology.ends[end].drum;
        if (drum < 0 || !state.holds(topology.segments_of(end / 2).first)) continue;
        const double points = state.drums[drum].points;
        if (!(points >= 1.0 && points <= CAPACITY && points == std::floor(points))) return false;
    }
    return true;
}

// -------------------------------------------------------------------------------------------------
// Histories that are assumed, not computed: friction before the start, and drums that slip

void impose_friction(Step& step, Index c, std::span<const double> share) {
    auto& [topology, constants, before, after, estimate, work] = step;
    const CableTopology& cable = topology.cables[c];
    if (cable.law == Law::none) return;
    const Elasticity elastic = elasticity_of(constants.cables[c]);
    const auto [first, beyond] = topology.segments_of(c);
    double total = 0.0, span = 0.0;
    for (Index e = first; e < beyond; ++e) {
        total += after.material[e];
        span += after.length[e];
    }
    const double mean = tension_of(elastic, span, total);
    if (!(mean > 0.0)) return;
    // compute the ratios of the tensions, then the common factor that keeps the elongation
    double ratio = 1.0;
    work.segments[first].tension = ratio;
    double weighted = after.length[first];
    for (Index p = cable.first_pulley; p < cable.first_pulley + cable.pulleys; ++p) {
        const PulleyTopology& own = topology.pulleys[p];
        for (Index q = own.first_contact; q < own.first_contact + own.cells; ++q) {
            const Contact& contact = work.contacts[q];
            const double hold = 1.0 - contact.loss - contact.drag / (mean + contact.drag);
            ratio *= std::pow(std::max(hold, 1e-3), -share[p]);
            work.segments[q + c + 1].tension = ratio;
            weighted += after.length[q + c + 1] * ratio;
        }
    }
    double scale = mean * span / weighted;
    const int rounds = elastic.bedding_strain == 0.0 ? 3 : MOST_ROUNDS;
    for (int round = 0; round < rounds; ++round) {
        double held = 0.0, slope = 0.0;
        for (Index e = first; e < beyond; ++e) {
            ratio = work.segments[e].tension;
            const double stretch = 1.0 + strain_at(elastic, scale * ratio);
            const double modulus = modulus_at(elastic, scale * ratio);
            held += after.length[e] / stretch;
            slope -= after.length[e] * ratio / (modulus * stretch * stretch);
        }
        scale -= (held - total) / slope;
    }
    for (Index e = first; e < beyond; ++e) {
        ratio = work.segments[e].tension;
        after.material[e] = after.length[e] / (1.0 + strain_at(elastic, scale * ratio));
        if (e > first) {
            after.bristle[e - 1 - c] = scale * (ratio - work.segments[e - 1].tension);
        }
    }
}

void Robot::impose_friction(std::span<const double> share, double* out) const {
    Step step(*this, out, out);
    for (Index c = 0; c < topology.sizes.cables; ++c) cdrj::impose_friction(step, c, share);
}

void forget_drums(const Robot& robot, Index c, State& now) {
    const Topology& topology = robot.topology;
    const auto [first, beyond] = topology.segments_of(c);
    if (!now.holds(first)) return;
    for (const Index end : {Index{0}, Index{1}}) {
        const Index number = topology.ends[2 * c + end].drum;
        if (number < 0) continue;
        Drum& drum = now.drums[number];
        const int top = static_cast<int>(drum.points) - 1;
        const double rate = robot.constants.ends[2 * c + end].radius /
                            now.stretch(end == 0 ? first : beyond - 1);
        start_drum(drum, drum.angle[top], drum.material[top], rate);
    }
}

void Robot::forget_drums(double* state) const {
    State now(topology.sizes, state);
    for (Index c = 0; c < topology.sizes.cables; ++c) cdrj::forget_drums(*this, c, now);
}

}  // namespace cdrj

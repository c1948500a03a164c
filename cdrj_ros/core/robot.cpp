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

/// Spans, wraps and lever arms from constants and tables over joint angle; no arcs yet.
void read_tables(
    const Topology& topology, const Constants& constants, std::span<const double> joint_angle,
    Workspace& work) {
    const Sizes& sizes = topology.sizes;
    for (Index e = 0; e < sizes.elements; ++e) work.element_length[e] = constants.elements[e].span;
    for (Index p = 0; p < sizes.pulleys; ++p) work.wrap[p] = constants.pulleys[p].wrap;
    std::fill_n(work.lever_arm.data, sizes.elements * sizes.joints, 0.0);
    for (Index k = 0; k < sizes.terms; ++k) {
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

/// Angle through which an end has wound cable in: by its motor, its frame and its tangent (E3).
double wound_angle(const Step& step, Index end, std::span<const double> motor_angle) {
    const Index motor = step.topology.ends[end].motor;
    const EndConstants& own = step.constants.ends[end];
    double turned = 0.0;
    if (motor >= 0) turned = motor_angle[motor] - step.constants.motors[motor].reference_angle;
    return own.winding * turned + step.work.laid[end] / own.radius;
}

/// Start a cable without friction history: its material determines one tension throughout.
///
/// Returns false if no material is left because the cable is wound in entirely.
bool start_cable(const Step& step, Index c, std::span<const double> motor_angle) {
    const auto& [topology, constants, before, after, estimate, work] = step;
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

Fluxes turn_drums(const Step& step, Index c, std::span<const double> motor_angle) {
    const auto& [topology, constants, before, after, estimate, work] = step;
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
void yield(const Step& step, Index c, double dt) {
    const auto& [topology, constants, before, after, estimate, work] = step;
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

/// Advance a cable with a friction history; false if its fluxes could not be solved.
bool move_cable(const Step& step, Index c, std::span<const double> motor_angle, double dt) {
    const auto& [topology, constants, before, after, estimate, work] = step;
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
    const bool solved =
        effort.imbalance <= acceptable(cable.elastic) &&
        std::ranges::all_of(cable.segments, [](const Segment& one) { return one.material > 0.0; });
    if (!solved) {
        spread_evenly(cable);
        for (Contact& one : cable.contacts) {
            one.bristle = 0.0;
            one.flux = -one.shift;
        }
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

}  // namespace

bool Robot::shape(
    std::span<const double> motor_angle, std::span<const double> joint_angle,
    Workspace& work) const {
    bool possible = true;
    read_tables(topology, constants, joint_angle, work);
    place_frames(topology, constants, joint_angle, work);
    for (Index c = 0; c < topology.sizes.cables; ++c) {
        const CableTopology& cable = topology.cables[c];
        if (cable.routed == Route::tables) {
            add_arcs(topology, constants, c, work);
        } else {
            possible =
                route_cable(topology, constants, c, motor_angle, joint_angle, work) && possible;
        }
    }
    divide_arcs(topology, work);
    return possible;
}

bool Robot::advance(
    const double* before_state, std::span<const double> motor_angle,
    std::span<const double> joint_angle, double dt, double* out) const {
    const Sizes& sizes = topology.sizes;
    State before(sizes, const_cast<double*>(before_state));
    State after(sizes, out);
    Estimate estimate(sizes, out + state_size());
    Workspace work(sizes, out + state_size() + estimate_size());
    if (!shape(motor_angle, joint_angle, work)) {  // keep the state, report nothing
        std::copy_n(before_state, state_size(), out);
        std::fill_n(out + state_size(), estimate_size(), 0.0);
        std::ranges::fill(estimate.status, static_cast<double>(INVALID));
        return false;
    }
    follow_arcs(topology, constants, before, after, work);
    if (sizes.surfaces > 0) {  // the state before, by the contact cells of this sample
        cover_surfaces(topology, constants, before_state, after, work);
        before = State(sizes, work.history);
    }
    for (Index e = 0; e < sizes.segments(); ++e) after.length[e] = work.segments[e].length;
    std::ranges::copy(work.middles, after.middles.begin());
    for (Index c = 0; c < sizes.cables; ++c) {
        place_contacts(topology, constants, c, before, after, work);
    }
    friction_losses(topology, constants, before, work);
    const bool started = *before.started != 0.0;
    *after.started = 1.0;
    std::ranges::copy(before.drums, after.drums.begin());
    std::ranges::fill(estimate.motor_effort, 0.0);
    std::ranges::fill(estimate.joint_effort, 0.0);
    const Step step{topology, constants, before, after, estimate, work};
    bool solved_all = true;
    for (Index c = 0; c < sizes.cables; ++c) {
        const bool solved =
            started ? move_cable(step, c, motor_angle, dt) : start_cable(step, c, motor_angle);
        report_cable(step, c, solved);
        solved_all = solved_all && solved;
    }
    add_axes(step, motor_angle, joint_angle);
    correct_outputs(step, dt, solved_all, out + state_size());
    return solved_all;
}

bool Robot::is_state(std::span<const double> numbers) const {
    if (numbers.size() != state_size()) return false;
    for (const double number : numbers) {
        if (!(std::abs(number) <= LARGEST_IN_STATE)) return false;
    }
    std::vector<double> copy(numbers.begin(), numbers.end());
    const State state(topology.sizes, copy.data());
    if (*state.started == 0.0) return true;
    return std::ranges::all_of(state.drums, [](const Drum& drum) {
        return drum.points >= 1.0 && drum.points <= CAPACITY && drum.points == std::floor(drum.points);
    });
}

// -------------------------------------------------------------------------------------------------
// Histories that are assumed, not computed: friction before the start, and drums that slip

void Robot::impose_friction(std::span<const double> share, double* out) const {
    const Sizes& sizes = topology.sizes;
    State after(sizes, out);
    Workspace work(sizes, out + state_size() + estimate_size());
    for (Index c = 0; c < sizes.cables; ++c) {
        const CableTopology& cable = topology.cables[c];
        if (cable.law == Law::none) continue;
        const Elasticity elastic = elasticity_of(constants.cables[c]);
        const auto [first, beyond] = topology.segments_of(c);
        double total = 0.0, span = 0.0;
        for (Index e = first; e < beyond; ++e) {
            total += after.material[e];
            span += after.length[e];
        }
        const double mean = tension_of(elastic, span, total);
        if (!(mean > 0.0)) continue;
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
}

void Robot::forget_drums(double* state) const {
    State now(topology.sizes, state);
    for (Index c = 0; c < topology.sizes.cables; ++c) {
        const auto [first, beyond] = topology.segments_of(c);
        for (const Index end : {Index{0}, Index{1}}) {
            const Index number = topology.ends[2 * c + end].drum;
            if (number < 0) continue;
            Drum& drum = now.drums[number];
            const int top = static_cast<int>(drum.points) - 1;
            const double rate = constants.ends[2 * c + end].radius /
                                now.stretch(end == 0 ? first : beyond - 1);
            start_drum(drum, drum.angle[top], drum.material[top], rate);
        }
    }
}

}  // namespace cdrj

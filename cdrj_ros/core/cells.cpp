#include "cells.hpp"

#include <algorithm>
#include <cmath>

#include "angles.hpp"
#include "friction.hpp"
#include "route.hpp"

namespace cdrj {

double middle_to_outer(double arc, Index cells) {
    return 0.5 * std::max(arc / static_cast<double>(cells), SHORTEST_SEGMENT) *
           static_cast<double>(cells - 1);
}

bool touches_anew(
    const CableTopology& cable, Index k, const State& before, const Workspace& work) {
    if (cable.routed == Route::tables) return false;
    const Vector3& tangent = before.middles[cable.first_node + 1 + k].tangent;
    const bool missed = tangent.x == 0.0 && tangent.y == 0.0 && tangent.z == 0.0;
    return missed && work.wrap[cable.first_pulley + k] > 0.0;
}

void share_out(Contact& contact, const PulleyConstants& pulley, double share) {
    contact.share = share;
    contact.stiffness = share * pulley.bristle_stiffness;
    contact.damping = share * pulley.bristle_damping;
    contact.viscous = share * pulley.viscous;
    contact.drag = share * pulley.drag;
    contact.breakaway = pulley.breakaway;
}

void divide_arcs(const Topology& topology, Workspace& work) {
    for (Index c = 0; c < topology.sizes.cables; ++c) {
        const CableTopology& cable = topology.cables[c];
        for (Index k = 0; k < cable.elements; ++k) {
            work.segments[topology.span_segment(c, k)].length =
                work.element_length[cable.first_element + k];
        }
        // cable on an end keeps the strain at which it was laid on
        work.segments[topology.segments_of(c).first].length -= work.laid[2 * c];
        work.segments[topology.segments_of(c).beyond - 1].length -= work.laid[2 * c + 1];
        for (Index p = cable.first_pulley; p < cable.first_pulley + cable.pulleys; ++p) {
            const Index first = topology.pulleys[p].first_contact;
            const Index cells = topology.pulleys[p].cells;
            if (cells == 1) continue;
            const double between =
                std::max(work.arc[p] / static_cast<double>(cells), SHORTEST_SEGMENT);
            const double outer = middle_to_outer(work.arc[p], cells);
            work.segments[first + c].length -= outer;
            work.segments[first + cells + c].length -= outer;
            for (Index q = first + 1; q < first + cells; ++q) work.segments[q + c].length = between;
        }
    }
}

void follow_arc(
    const Topology& topology, const Constants& constants, Index cable, Index k, const State& before,
    State& after, const Workspace& work) {
    const CableTopology& own = topology.cables[cable];
    const Index p = own.first_pulley + k;
    double moved;
    if (own.routed == Route::positions) {
        const Index node = own.first_node + 1 + k;
        moved = motion_along(
            constants.nodes[node].radius, before.middles[node], work.middles[node]);
    } else {
        moved = work.middle[p] - before.track[p];
        const double half_turn = PI * constants.pulleys[p].radius;
        if (std::abs(moved) > half_turn && half_turn > 0.0) {  // whole turns are no motion
            moved = modulo(moved + half_turn, 2.0 * half_turn) - half_turn;
        }
    }
    after.track[p] = before.track[p] + moved;
}

void place_contacts(
    const Topology& topology, const Constants& constants, Index cable, const State& before,
    State& after, Workspace& work) {
    const CableTopology& own = topology.cables[cable];
    const bool started = *before.started != 0.0;
    for (Index k = 0; k < own.pulleys; ++k) {
        const Index p = own.first_pulley + k;
        if (topology.pulleys[p].surface >= 0) continue;
        const PulleyConstants& pulley = constants.pulleys[p];
        const Index first = topology.pulleys[p].first_contact, cells = topology.pulleys[p].cells;
        follow_arc(topology, constants, cable, k, before, after, work);
        if (started && touches_anew(own, k, before, work)) work.wrap[p] = 0.0;
        double share = 1.0, between = work.arc[p];
        if (cells > 1) {
            share = 1.0 / static_cast<double>(cells);
            between = work.arc[p] / static_cast<double>(cells);
        }
        for (Index q = first; q < first + cells; ++q) {
            Contact& contact = work.contacts[q];
            share_out(contact, pulley, share);
            const double cell =
                static_cast<double>(q - first) - 0.5 * static_cast<double>(cells - 1);
            after.place[q] = after.track[p] + cell * between;
            const double moved = after.place[q] - before.place[q];
            contact.shift = 0.0;
            if (started && moved != 0.0) contact.shift = moved / before.stretch_at(q, cable);
        }
    }
}

void friction_losses(
    const Topology& topology, const Constants& constants, const State& before, Workspace& work) {
    for (Index p = 0; p < topology.sizes.pulleys; ++p) {
        const PulleyConstants& pulley = constants.pulleys[p];
        const PulleyTopology& plan = topology.pulleys[p];
        Loss whole{pulley.kinetic_loss, pulley.static_loss};
        if (plan.wrap_changes == 1) {
            whole = blended_loss(
                pulley.rho, pulley.mu_c, pulley.mu_s, work.wrap[p], pulley.bearing_ratio,
                plan.stribeck);
        }
        double share = work.contacts[plan.first_contact].share;
        Loss loss = cell_loss(whole, share);
        for (Index q = plan.first_contact; q < plan.first_contact + plan.cells; ++q) {
            Contact& contact = work.contacts[q];
            if (contact.share != share) {
                share = contact.share;
                loss = cell_loss(whole, share);
            }
            contact.static_share = stribeck_share(before.lagged_speed[q], pulley.stribeck_speed);
            contact.loss = loss.kinetic + loss.fading * contact.static_share;
        }
    }
}

}  // namespace cdrj

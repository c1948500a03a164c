// Contact cells of pulleys, their places on the bodies, and slip against the bodies.
// docs/model.md, section 4.
#include <algorithm>
#include <cmath>

#include "friction.hpp"
#include "robot.hpp"

namespace cdrj {
namespace {

/// Length of the segments between cells of a body that the cable does not touch [m].
constexpr double SHORTEST_SEGMENT = 1e-6;

/// Chord of the unit circle below which two terms of a series give the arc to rounding.
constexpr double SMALL_CHORD = 1e-4;

/// Cable from the middle of an arc to the middle of the last of its equal cells [m].
double middle_to_outer(double arc, Index cells) {
    return 0.5 * std::max(arc / static_cast<double>(cells), SHORTEST_SEGMENT) *
           static_cast<double>(cells - 1);
}

/// Give a contact cell its share of the pulley's constants.
void share_out(Contact& contact, const PulleyConstants& pulley, double share) {
    contact.share = share;
    contact.stiffness = share * pulley.bristle_stiffness;
    contact.damping = share * pulley.bristle_damping;
    contact.viscous = share * pulley.viscous;
    contact.drag = share * pulley.drag;
    contact.breakaway = pulley.breakaway;
}

/// Motion of the middle of an arc on its body along the cable [m], towards the last node (E26).
///
/// It is exact on a circle, on a helix of constant slope and on a great circle, and of second order
/// where slope or plane change. It is 0 where the cable did not touch the body in both samples.
double motion_along(double radius, const ArcMiddle& before, const ArcMiddle& now) {
    const Vector3 along = before.tangent + now.tangent;
    const double size = norm(along), was = norm(before.tangent), is = norm(now.tangent);
    if (size == 0.0 || was == 0.0 || is == 0.0) return 0.0;
    const Vector3 way = now.normal - before.normal;
    const double chord = norm(way);
    double stretch = 1.0 + chord * chord / 24.0;  // arc over chord
    if (chord > SMALL_CHORD) stretch = 2.0 * std::asin(std::min(0.5 * chord, 1.0)) / chord;
    const double moved =
        radius * stretch * dot(way, along) + (now.height - before.height) * along.z;
    return moved * (0.5 * (was + is) / size);
}

}  // namespace

void divide_arcs(const Topology& topology, Index c, Workspace& work) {
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
        const double between = std::max(work.arc[p] / static_cast<double>(cells), SHORTEST_SEGMENT);
        const double outer = middle_to_outer(work.arc[p], cells);
        work.segments[first + c].length -= outer;
        work.segments[first + cells + c].length -= outer;
        for (Index q = first + 1; q < first + cells; ++q) work.segments[q + c].length = between;
    }
}

void follow_arcs(
    const Topology& topology, const Constants& constants, Index c, const State& before,
    State& after, Workspace& work) {
    const CableTopology& cable = topology.cables[c];
    const bool started = before.holds(topology.segments_of(c).first);
    for (Index k = 0; k < cable.pulleys; ++k) {
        const Index p = cable.first_pulley + k;
        double moved;
        if (cable.routed == Route::positions) {
            const Index node = cable.first_node + 1 + k;
            const ArcMiddle& was = before.middles[node];
            moved = motion_along(constants.nodes[node].radius, was, work.middles[node]);
            if (started && dot(was.tangent, was.tangent) == 0.0) work.wrap[p] = 0.0;
        } else {
            moved = work.middle[p] - before.track[p];
            const double half_turn = PI * constants.pulleys[p].radius;
            if (std::abs(moved) > half_turn && half_turn > 0.0) {  // whole turns are no motion
                moved = modulo(moved + half_turn, 2.0 * half_turn) - half_turn;
            }
        }
        after.track[p] = before.track[p] + moved;
    }
}

void place_contacts(
    const Topology& topology, const Constants& constants, Index cable, const State& before,
    State& after, Workspace& work) {
    const CableTopology& own = topology.cables[cable];
    const bool started = before.holds(topology.segments_of(cable).first);
    for (Index k = 0; k < own.pulleys; ++k) {
        const Index p = own.first_pulley + k;
        if (topology.pulleys[p].surface >= 0) continue;
        const PulleyConstants& pulley = constants.pulleys[p];
        const Index first = topology.pulleys[p].first_contact, cells = topology.pulleys[p].cells;
        const double share = 1.0 / static_cast<double>(cells);
        const double between = work.arc[p] / static_cast<double>(cells);
        double place = after.track[p] - 0.5 * between * static_cast<double>(cells - 1);
        for (Index q = first; q < first + cells; ++q) {
            Contact& contact = work.contacts[q];
            share_out(contact, pulley, share);
            const double moved = place - before.place[q];
            contact.shift = 0.0;
            if (started && moved != 0.0) contact.shift = moved / before.stretch_at(q, cable);
            after.place[q] = place;
            place += between;
        }
    }
}

void friction_losses(
    const Topology& topology, const Constants& constants, Index c, const State& before,
    Workspace& work) {
    const CableTopology& cable = topology.cables[c];
    for (Index p = cable.first_pulley; p < cable.first_pulley + cable.pulleys; ++p) {
        const PulleyConstants& pulley = constants.pulleys[p];
        const PulleyTopology& own = topology.pulleys[p];
        Loss whole{pulley.kinetic_loss, pulley.static_loss};
        if (own.wrap_changes == 1) {
            whole = blended_loss(
                pulley.rho, pulley.mu_c, pulley.mu_s, work.wrap[p], pulley.bearing_ratio,
                own.stribeck);
        }
        double share = work.contacts[own.first_contact].share;
        Loss loss = cell_loss(whole, share);
        for (Index q = own.first_contact; q < own.first_contact + own.cells; ++q) {
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

// Contact cells that are fixed to the surface of a body, of which the simulated rig has some.
//
// The path of a cable on its body is measured by the place of a point on it [m], towards the last
// node (E26). Cell j takes the places from j w to (j + 1) w. An arc covers those between its ends;
// where an end moves, cable is laid onto new cells, or leaves cells with what they remember.
//
// A pulley has a row of cells at hand, the first of which holds the arc's beginning. When another one
// does, the row moves on. Cells at its end that are not covered have no friction; their contacts lie
// in the free span behind the arc. docs/model.md, section 8.
namespace {

/// Places between which an arc, or its part on a cell, lies [m].
struct Stretch {
    double begin, end;
};

Stretch arc_of(const State& state, Index p, Index surface) {
    const double half = 0.5 * state.covered[surface];
    return {state.track[p] - half, state.track[p] + half};
}

/// The part of an arc on a cell; the last one at hand takes the rest of the arc.
Stretch part_on(Index cell, Index last, double width, const Stretch& arc) {
    const double from = static_cast<double>(cell) * width;
    const double to = static_cast<double>(cell + 1) * width;
    return {std::max(arc.begin, from), cell == last ? arc.end : std::min(arc.end, to)};
}

/// A row of cells, seen from the end at which some leave.
struct Row {
    State& state;
    Index contact, segment;  // the outermost ones where cells leave
    Index way;               // +1 where this is the beginning of the row, otherwise -1
    Index cells;

    /// Join the segments between the `count` cells that leave; the others move up.
    void leave(Index count) {
        double length = 0.0, material = 0.0, delayed = 0.0;
        for (Index i = 0; i <= count; ++i) {
            const Index e = segment + way * i;
            length += state.length[e];
            material += state.material[e];
            delayed += state.material[e] * state.delayed[e];
        }
        state.length[segment] = length;
        state.material[segment] = material;
        state.delayed[segment] = delayed / material;
        for (Index i = 1; i <= cells - count; ++i) {
            const Index e = segment + way * i, source = segment + way * (i + count);
            state.length[e] = state.length[source];
            state.material[e] = state.material[source];
            state.delayed[e] = state.delayed[source];
        }
        for (Index i = 0; i < cells - count; ++i) {
            const Index q = contact + way * i, source = contact + way * (i + count);
            state.place[q] = state.place[source];
            state.bristle[q] = state.bristle[source];
            state.slip_speed[q] = state.slip_speed[source];
            state.lagged_speed[q] = state.lagged_speed[source];
        }
    }

    /// Divide a segment into `count` pieces and the rest; returns the length of a piece [m].
    ///
    /// No material is lost, and each piece has the strain of the whole.
    double divide(Index from, Index count, double width) {
        const double length = state.length[from], material = state.material[from];
        const double delayed = state.delayed[from];
        const double piece = std::min(width, 0.5 * length / static_cast<double>(count + 1));
        const double content = material * (piece / length);
        for (Index i = 0; i < count; ++i) {
            const Index e = from + way * i;
            state.length[e] = piece;
            state.material[e] = content;
            state.delayed[e] = delayed;
        }
        const Index beyond = from + way * count;
        state.length[beyond] = length - static_cast<double>(count) * piece;
        state.material[beyond] = material - static_cast<double>(count) * content;
        state.delayed[beyond] = delayed;
        return piece;
    }

    /// Let `count` cells leave here, and as many without history enter at the other end.
    ///
    /// `edge`: place of the arc's other end, for new cells if all leave [m].
    void exchange(Index count, double width, double edge) {
        const Index rest = cells - count;
        leave(count);
        double place = edge, slip_speed = 0.0, lagged_speed = 0.0;
        if (rest > 0) {  // the cable slides on new cells as on their neighbour
            const Index q = contact + way * (rest - 1);
            place = state.place[q];
            slip_speed = state.slip_speed[q];
            lagged_speed = state.lagged_speed[q];
        }
        const double piece = divide(segment + way * rest, count, width);
        for (Index i = rest; i < cells; ++i) {
            const Index q = contact + way * i;
            place += static_cast<double>(way) * piece;
            state.place[q] = place;
            state.bristle[q] = 0.0;
            state.slip_speed[q] = slip_speed;
            state.lagged_speed[q] = lagged_speed;
        }
    }
};

Index cell_at(double place, double width) { return static_cast<Index>(std::floor(place / width)); }

/// Let the row of a pulley begin with the cell that now holds the arc's beginning.
///
/// `history`: the state before by the cells at hand before, afterwards by those now.
void move_row(
    const Topology& topology, const Constants& constants, Index c, Index p, State& history,
    const State& after) {
    const PulleyTopology& own = topology.pulleys[p];
    const double width = constants.pulleys[p].cell_width;
    const Index cells = own.cells, contact = own.first_contact;
    const Stretch old_arc = arc_of(history, p, own.surface), arc = arc_of(after, p, own.surface);
    const Index old_first = cell_at(old_arc.begin, width), first = cell_at(arc.begin, width);
    if (first > old_first) {
        Row row{history, contact, contact + c, 1, cells};
        row.exchange(std::min(first - old_first, cells), width, old_arc.end);
    } else if (first < old_first) {
        Row row{history, contact + cells - 1, contact + cells + c, -1, cells};
        row.exchange(std::min(old_first - first, cells), width, old_arc.begin);
    }
    // a cell keeps the bristles of that part of it that stays covered
    for (Index i = 0; i < cells; ++i) {
        const Stretch was = part_on(first + i, old_first + cells - 1, width, old_arc);
        const Stretch is = part_on(first + i, first + cells - 1, width, arc);
        const double whole = was.end - was.begin;
        const double stays = std::min(was.end, is.end) - std::max(was.begin, is.begin);
        const double share = whole > 0.0 && stays > 0.0 ? std::min(stays / whole, 1.0) : 0.0;
        history.bristle[contact + i] *= share;
    }
}

/// Length of the free span after a pulley [m].
double room_after(const Topology& topology, Index c, Index p, const Workspace& work) {
    const CableTopology& cable = topology.cables[c];
    double room = work.element_length[topology.pulleys[p].element + 1] - 0.5 * work.arc[p];
    if (p + 1 < cable.first_pulley + cable.pulleys) room -= 0.5 * work.arc[p + 1];
    return std::max(room, 0.0);
}

/// Constants, places and shifts (E25) of a pulley's cells, and the lengths of the segments.
///
/// The contact of a cell lies in the middle of its covered part.
void place_row(
    const Topology& topology, const Constants& constants, Index c, Index p, const State& history,
    State& after, Workspace& work) {
    const PulleyTopology& own = topology.pulleys[p];
    const PulleyConstants& pulley = constants.pulleys[p];
    const Index cells = own.cells;
    const double width = pulley.cell_width, arc = work.arc[p], track = after.track[p];
    const Stretch covered = arc_of(after, p, own.surface);
    const Index first = cell_at(covered.begin, width);
    const double spacing =
        std::min(width, 0.5 * room_after(topology, c, p, work) / static_cast<double>(cells));
    const bool started = history.holds(topology.segments_of(c).first);
    double beyond = covered.end, place_before = 0.0;
    for (Index i = 0; i < cells; ++i) {
        const Index q = own.first_contact + i;
        const Stretch part = part_on(first + i, first + cells - 1, width, covered);
        Contact& contact = work.contacts[q];
        double place;
        if (part.end > part.begin) {
            share_out(contact, pulley, (part.end - part.begin) / arc);
            place = 0.5 * (part.begin + part.end);
        } else {
            share_out(contact, pulley, 0.0);
            beyond += spacing;
            place = beyond;
        }
        if (i > 0) {
            place = std::max(place, place_before + SHORTEST_SEGMENT);
            work.segments[q + c].length = place - place_before;
        }
        after.place[q] = place;
        place_before = place;
        contact.shift = 0.0;
        if (started && place != history.place[q]) {
            contact.shift = (place - history.place[q]) / history.stretch_at(q, c);
        }
    }
    // an element ends in the middle of the arc
    const double outer = middle_to_outer(arc, cells);
    work.segments[own.first_contact + c].length +=
        after.place[own.first_contact] - track + outer;
    work.segments[own.first_contact + cells + c].length -= place_before - track - outer;
}

}  // namespace

void cover_surfaces(
    const Topology& topology, const Constants& constants, Index c, State& before, State& after,
    Workspace& work) {
    const CableTopology& cable = topology.cables[c];
    const bool started = before.holds(topology.segments_of(c).first);
    for (Index p = cable.first_pulley; p < cable.first_pulley + cable.pulleys; ++p) {
        const Index surface = topology.pulleys[p].surface;
        if (surface < 0) continue;
        after.covered[surface] = work.arc[p];
        if (started) move_row(topology, constants, c, p, before, after);
        place_row(topology, constants, c, p, before, after, work);
    }
}

}  // namespace cdrj

// Contact cells of pulleys, their places on the bodies, and slip against the bodies.
// docs/model.md, section 4.
#pragma once

#include "layout.hpp"

namespace cdrj {

/// Length of the segments between cells of a body that the cable does not touch [m].
inline constexpr double SHORTEST_SEGMENT = 1e-6;

/// Cable from the middle of an arc to the middle of the last of its equal cells [m].
double middle_to_outer(double arc, Index cells);

/// Lengths of the segments from those of the elements: the arc of every pulley in equal cells.
///
/// An element ends in the middle of an arc, its outer segment in the middle of the first cell, and
/// has no part in what lies on an end.
void divide_arcs(const Topology& topology, Workspace& work);

/// Move the places of the middles of all arcs along their bodies (E26), from the tracks and middles of
/// `before` to the tracks of `after`.
///
/// Where the cable comes to touch a body in this sample, its wrap is set to 0: the contact holds no
/// friction yet.
void follow_arcs(
    const Topology& topology, const Constants& constants, const State& before, State& after,
    Workspace& work);

/// Give a contact cell its share of the pulley's constants.
void share_out(Contact& contact, const PulleyConstants& pulley, double share);

/// Constants and places of the contacts of one cable, and the shift of (E25).
///
/// Cells that are fixed to a surface are left to `cover_surfaces`.
void place_contacts(
    const Topology& topology, const Constants& constants, Index cable, const State& before,
    State& after, Workspace& work);

/// Loss of every contact: (37), (41), their blend for the pulley, (E28) for its cells.
///
/// Constant wraps use losses computed beforehand. Static friction fades with the slip speed delayed
/// by `stribeck_lag` (E10), frictional memory. With the speed of the sample itself, friction would
/// fall while the cable slips; a massless cable then has several solutions or none, and would jump
/// from sample to sample.
void friction_losses(
    const Topology& topology, const Constants& constants, const State& before, Workspace& work);

// Contact cells that are fixed to the surface of a body, of which the simulated rig has some.
//
// The path of a cable on its body is measured by the place of a point on it [m], towards the last
// node (E26). Cell j takes the places from j w to (j + 1) w. An arc covers those between its ends;
// where an end moves, cable is laid onto new cells, or leaves cells with what they remember.
//
// A pulley has a row of cells at hand, the first of which holds the arc's beginning. When another one
// does, the row moves on. Cells at its end that are not covered have no friction; their contacts lie
// in the free span behind the arc. docs/model.md, section 8.

/// Lay the arcs of a sample onto the cells of their surfaces (E29).
///
/// `before`: the state before the sample; `after`: with the tracks of the sample, `place` and `covered`
/// are written; `work`: with the geometry of the sample; the contacts of the cells, the lengths of the
/// segments and `history` are written.
void cover_surfaces(
    const Topology& topology, const Constants& constants, const double* before, State& after,
    Workspace& work);

}  // namespace cdrj

// Contact cells that are fixed to the surface of a body, of which the simulated rig has some.
//
// The path of a cable on its body is measured by the place of a point on it [m], towards the last
// node (E26). Cell j takes the places from j w to (j + 1) w. An arc covers those between its ends;
// where an end moves, cable is laid onto new cells, or leaves cells with what they remember.
//
// A pulley has a row of cells at hand, the first of which holds the arc's beginning. When another one
// does, the row moves on. Cells at its end that are not covered have no friction; their contacts lie
// in the free span behind the arc. docs/model.md, section 8.
#pragma once

#include "layout.hpp"

namespace cdrj {

/// Lay the arcs of a sample onto the cells of their surfaces (E29).
///
/// `before`: the state before the sample; `after`: `track`, `place` and `covered` are written; `work`:
/// with the geometry of the sample; the contacts of the cells, the lengths of the segments and
/// `history` are written. Where the cable comes to touch a body in this sample, the wrap is set to 0.
void cover_surfaces(
    const Topology& topology, const Constants& constants, const double* before, State& after,
    Workspace& work);

}  // namespace cdrj

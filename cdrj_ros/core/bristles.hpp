// What the friction laws share: contacts as bristles that carry a force.
#pragma once

namespace cdrj {

/// A contact whose bristles have carried a force.
struct Bristles {
    double before;     // bristle force sigma0 z before the slip [N]
    double stiffness;  // sigma0 [N/m]
    double bound;      // g: largest force that friction can carry [N], positive
    double breakaway;  // fraction of the bound up to which pre-sliding is elastic, in [0, 1]
};

/// A friction force and its derivatives.
struct Friction {
    double force;     // [N]
    double by_slip;   // derivative by the slip [N/m]
    double by_bound;  // derivative by the bound [-]
};

}  // namespace cdrj

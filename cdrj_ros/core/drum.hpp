// What a winch drum holds: cable comes off at the strain at which it went on (E3).
//
// The rate form ds = -r dphi / (1 + t/EA) forgets this. Where winding and unwinding happen at
// different tensions, as friction makes them, it feeds a little cable out in every cycle and the
// preload decays to nothing. A drum without slip is a stack: last on, first off.
// docs/model.md, section 2.
#pragma once

#include "state_records.hpp"

namespace cdrj {

/// Distance of break points until the memory is full for the first time [rad].
inline constexpr double FIRST_SPACING = 0.1;

/// Forget everything: below `angle` [rad] the drum holds `rate` [m/rad] of material throughout.
///
/// `material` is the unstretched material wound on since the reference [m].
inline void start_drum(Drum& drum, double angle, double material, double rate) {
    drum.points = 1.0;
    drum.spacing = FIRST_SPACING;
    drum.rate_below = rate;
    drum.angle[0] = angle;
    drum.material[0] = material;
}

/// Unstretched material on the drum since the reference [m].
inline double material_held(const Drum& drum) {
    return drum.material[static_cast<int>(drum.points) - 1];
}

/// (E3): turn the drum to a wound angle [rad]; returns the material on it [m].
///
/// New layers go on at `rate` [m/rad], that is r_drum / (1 + t/EA) for the present tension; old ones
/// come off at the rate at which they went on.
double turn_drum(Drum& drum, double angle, double rate);


}  // namespace cdrj

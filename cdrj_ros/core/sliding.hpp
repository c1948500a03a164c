// Friction along a recorded motion whose slips are known: (E10), (E20). docs/model.md, section 10.
#pragma once

#include <algorithm>

#include "friction.hpp"

namespace cdrj {

/// Loss 1 - eta of a pulley, static friction lagging behind its slip speed (E10).
struct LaggingLoss {
    const PulleyConstants& pulley;
    double lagged = 0.0;  // slip speed [m/s]

    /// The loss at a sample. `moved`: slip since the sample before [m], `dt`: time since then [s].
    double next(const Loss& loss, double moved, double dt) {
        const double share = stribeck_share(lagged, pulley.stribeck_speed);
        if (dt > 0.0) {
            lagged = (pulley.stribeck_lag * lagged + moved) / (pulley.stribeck_lag + dt);
        }
        return loss.kinetic + loss.fading * share;
    }
};

/// (E20) from both ends: least and largest share of its bound that a pulley's friction may have.
///
/// The share changes by slip / reach and is limited to [-1, 1], as in an elastic, perfectly plastic
/// contact. The initial share is unknown, so one solution starts at -1 and one at +1; where both have
/// met at -1 or +1, the pulley has slipped far enough.
struct ShareOfBound {
    const PulleyConstants& pulley;
    double least = -1.0, most = 1.0;

    /// The shares after a slip `moved` [m].
    ///
    /// `loss`: 1 - eta; `pull`: tension on the pull side [N]; `arc`: strain of the arc per newton [m/N];
    /// `hidden`: slip that the sensors cannot resolve [m]. The reach is the slip from no friction to
    /// the full bound: deflection of the bristles, strain of the arc, and `hidden`.
    void next(double moved, double loss, double pull, double arc, double hidden) {
        const double bound = loss * pull + pulley.drag + BOUND_FLOOR;
        const double reach = bound * (1.0 / pulley.bristle_stiffness + arc) + hidden;
        least = std::min(std::max(least + moved / reach, -1.0), 1.0);
        most = std::min(std::max(most + moved / reach, -1.0), 1.0);
    }
};

}  // namespace cdrj

// One cable in one sample: all its contacts solved together (E11). docs/model.md, section 5.
//
// The n contacts of a cable divide it into n + 1 segments: contact i lies between segments i and
// i + 1. The unknowns are the fluxes: the unstretched material that moves past the middle of each
// contact towards the last node. Friction follows the slip against the body, flux + shift (E25).
#pragma once

#include <span>

#include "laws.hpp"
#include "robot_records.hpp"

namespace cdrj {

/// Largest force imbalance of a solved contact [N]; the second term allows for rounding.
inline double tolerance(const Elasticity& law) { return 1e-8 + 1e-14 * law.axial_stiffness; }

/// Largest force imbalance of a usable sample [N]; with a larger one it counts as unsolved.
inline double acceptable(const Elasticity& law) { return 1e-4 + 1e-14 * law.axial_stiffness; }

/// What the solution of a cable took.
struct Effort {
    std::int64_t iterations;  // of Newton's method, in all
    double imbalance;         // largest remaining force imbalance of a contact [N]
};

/// One cable and the material that its ends take in this sample.
struct Cable {
    Elasticity elastic;
    Law law;                         // of friction
    double first_flux;               // material that enters at the first node [m]
    double last_flux;                // material that leaves at the last node [m]
    double dt;                       // duration of the sample [s]; 0 where it is unknown
    std::span<Segment> segments;     // lengths and the material before are given
    std::span<Contact> contacts;     // constants, shifts and bristle forces before are given
    double hardness = 1.0;           // factor of the bristles' stiffness, (E23)

    /// Force imbalance of contacts `first` to `beyond` at their trial fluxes (E11); returns the largest [N].
    ///
    /// Residual i is (t_{i+1} - t_i) - friction_i, whose bound is (E8). Material and tension of the
    /// segments, bristle force, bound, residual and derivatives of the contacts are written.
    double balance(std::size_t first, std::size_t beyond);

    /// Solve (E11), from the fluxes of the contacts or a guess of its own.
    ///
    /// The contacts hold a first guess of the fluxes, and then the solution. Unless the remaining
    /// imbalance is `acceptable`, the sample is not solved, and the caller must report it.
    Effort solve();

private:
    /// Newton's method from the fluxes of the contacts; its iterations are added to those before.
    Effort newton(const Effort& before);

    /// Try a step of which a share leaves all segments material; returns the imbalance left [N].
    double search(double share, double before);

    /// Balance all contacts, or those between slack segments, one after another; returns what is left [N].
    ///
    /// The residual of a contact falls as its own flux grows and rises with its neighbours': (E11) is an
    /// M-function, so that this leads to its only solution from anywhere (Rheinboldt 1970), while Newton's
    /// method may turn in circles between slack and taut. It is slow where taut segments follow each other.
    double settle(bool all);

    /// Balance one contact alone: move its flux to where its residual is 0, and keep the others'.
    void relax(std::size_t i);
};

// What a winch drum holds: cable comes off at the strain at which it went on (E3).
//
// The rate form ds = -r dphi / (1 + t/EA) forgets this. Where winding and unwinding happen at
// different tensions, as friction makes them, it feeds a little cable out in every cycle and the
// preload decays to nothing. A drum without slip is a stack: last on, first off.
// docs/model.md, section 2.

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

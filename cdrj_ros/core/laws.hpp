// The laws of a cable's material: elasticity (E1), (E21), (E22), and creep (E24). docs/model.md, section 2.
#pragma once

#include <algorithm>
#include <cmath>

#include "robot_records.hpp"

namespace cdrj {

/// Tension-strain law of a cable.
struct Elasticity {
    double axial_stiffness;  // EA, slope of the tension over the strain at high load [N]
    double bedding_strain;   // e_b: strain that the strands' bedding adds; 0 for a linear cable [-]
    double bedding_tension;  // T_b: tension at which half of it is taken up [N]
};

inline Elasticity elasticity_of(const CableConstants& cable) {
    return {cable.axial_stiffness, cable.bedding_strain, cable.bedding_tension};
}

/// (E21): strain at a tension [-]; below 0 the law goes on with its slope at 0.
inline double strain_at(const Elasticity& law, double tension) {
    const double taut = std::max(tension, 0.0);
    return tension / law.axial_stiffness +
           law.bedding_strain * tension / (taut + law.bedding_tension);
}

/// dT / d(strain) at a tension [N].
inline double modulus_at(const Elasticity& law, double tension) {
    const double close = std::max(tension, 0.0) + law.bedding_tension;
    const double share =
        law.axial_stiffness * law.bedding_strain * law.bedding_tension / (close * close);
    return law.axial_stiffness / (1.0 + share);
}

/// (E22): (E21) solved for the tension at a strain that is not negative [N].
inline double stiffened_tension(const Elasticity& law, double strain) {
    const double linear = law.bedding_tension / law.axial_stiffness;
    const double b = linear + law.bedding_strain - strain;
    const double q = 0.5 * (std::abs(b) + std::sqrt(b * b + 4.0 * strain * linear));
    return b > 0.0 ? law.bedding_tension * strain / q : law.axial_stiffness * q;
}

/// (E1), (E21): tension of a segment from its length and its material [N].
inline double tension_of(const Elasticity& law, double length, double material) {
    const double strain = length / material - 1.0;
    if (law.bedding_strain != 0.0 && strain > 0.0) return stiffened_tension(law, strain);
    return std::max(law.axial_stiffness * strain, 0.0);
}

/// How a cable yields with time (E24).
struct Creep {
    double share;      // c: delayed strain under constant load as a share of the elastic one [-]
    double time;       // tau: time constant of the delayed strain at constant length [s]
    double flow_time;  // tau_f: time in which the flow equals the elastic strain [s]
};

/// What a segment has become after a time at constant length.
struct Crept {
    double delayed;  // its delayed strain [-]
    double growth;   // factor of its unstretched length [-]
};

/// (E24) over a time `dt` [s] in which a segment keeps its length.
///
/// `strain` is its elastic strain at first, negative by as much as it hangs loose.
inline Crept crept(const Creep& law, double strain, double delayed, double dt) {
    if (strain <= 0.0) {  // no load: the delayed strain recedes
        const double left = delayed * std::exp(-dt / law.time);
        return {left, (1.0 + left) / (1.0 + delayed)};
    }
    const double settled = (strain + delayed) / (1.0 + law.share);
    const double after =
        settled + (strain - settled) * std::exp(-(1.0 + law.share) * dt / law.time);
    return {
        delayed + strain - after,
        (1.0 + strain) / (1.0 + after * std::exp(-dt / law.flow_time)),
    };
}

}  // namespace cdrj

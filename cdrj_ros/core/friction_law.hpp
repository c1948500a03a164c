// How friction follows the slip: a small interface, one file per law. docs/model.md, section 4.
//
// The laws `euler` and `steady` of a robot file are `elastoplastic` with constants of their own, see
// `cdrj_ros.robot.laws`.
#pragma once

#include <cstdint>

namespace cdrj {

enum class Law : std::int64_t { none, euler, steady, lugre, elastoplastic };

/// The words of a robot file; the code of a law is its place here.
inline constexpr const char* LAW_NAMES[]{"none", "euler", "steady", "lugre", "elastoplastic"};

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

/// A friction law.
struct FrictionLaw {
    /// Bristle force after a slip, exact over the slip for a constant bound; `slip`: material that has
    /// moved past the body's surface [m].
    Friction (*force)(const Bristles& bristles, double slip);

    /// Shorten a step of Newton's method from one slip to the next where the law would make the steps
    /// alternate; returns whether it did.
    bool (*shorten)(const Bristles& bristles, double slip, double& next);
};

extern const FrictionLaw FRICTIONLESS, LUGRE, ELASTOPLASTIC;

/// A new law adds its name above, a file and a line here.
inline const FrictionLaw& law_of(Law law) {
    switch (law) {
        case Law::none: return FRICTIONLESS;
        case Law::lugre: return LUGRE;
        case Law::euler:
        case Law::steady:
        case Law::elastoplastic: return ELASTOPLASTIC;
    }
    return FRICTIONLESS;
}

}  // namespace cdrj

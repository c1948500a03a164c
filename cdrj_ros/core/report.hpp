// Results of a sample: status, nodal forces and efforts; docs/model.md, section 6. When an element is
// UNSURE: docs/uncertainty.md.
#pragma once

#include <algorithm>
#include <span>

#include "layout.hpp"

namespace cdrj {

/// Bit flags of an element's status, as in `cdrj_ros.model.packing`.
enum Status { OK = 0, SLACK = 1, OVERLOAD = 2, UNSURE = 4, STALE = 8, INVALID = 16 };

/// Everything that one sample reads and writes.
struct Step {
    const Topology& topology;
    const Constants& constants;
    const State& before;
    State& after;
    Estimate& estimate;
    Workspace& work;
};

/// Write tensions, status, slip speeds, nodal forces (38) and share in the efforts (E12) of a cable.
///
/// Tensions are those of the free spans; a pulley's slip speed is the mean of its cells'. `solved`:
/// whether the fluxes of the cable were found; otherwise its elements are INVALID.
void report_cable(const Step& step, Index cable, bool solved);

/// Add friction and spring of every motor and joint to the efforts (E13), and apply their signs.
void add_axes(
    const Step& step, std::span<const double> motor_angle, std::span<const double> joint_angle);

/// Set SLACK and OVERLOAD in an element's status by its tension.
inline void set_load(double& status, double tension, const CableConstants& cable) {
    int flags = static_cast<int>(status) & ~(SLACK | OVERLOAD);
    if (tension <= cable.slack_tension) flags |= SLACK;
    if (tension > cable.maximum_tension) flags |= OVERLOAD;
    status = static_cast<double>(flags);
}

/// Set UNSURE on an element's status, unless it is INVALID.
inline void doubt(double& status) {
    const int flags = static_cast<int>(status);
    if ((flags & INVALID) == 0) status = static_cast<double>(flags | UNSURE);
}

/// Set UNSURE where the standard deviation exceeds `share` of the tension or of the preload,
/// whichever is larger.
///
/// `estimate`: tensions, then status of all elements, then the rest. `preload`: of every element's
/// cable [N]. `stddev`: of the tensions, then the rest [N].
inline void mark_unsure(
    std::span<double> estimate, std::span<const double> preload, std::span<const double> stddev,
    double share) {
    const std::size_t elements = preload.size();
    for (std::size_t e = 0; e < elements; ++e) {
        if (stddev[e] > share * std::max(estimate[e], preload[e])) doubt(estimate[elements + e]);
    }
}

}  // namespace cdrj

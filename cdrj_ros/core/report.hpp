// Results of a sample: status, nodal forces and efforts. docs/model.md, section 6.
#pragma once

#include <span>

#include "layout.hpp"

namespace cdrj {

/// Bit flags of an element's status, as in `cdrj_ros.model.state`.
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

}  // namespace cdrj

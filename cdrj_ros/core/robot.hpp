// One sample of a whole robot: geometry, friction bounds, every cable, all outputs.
// docs/model.md.
#pragma once

#include <span>

#include "layout.hpp"

namespace cdrj {

/// A robot: its topology, which members of an ensemble share, and its constants.
class Robot {
public:
    /// `topology` and `constants`: see `cdrj_ros.model.packing`; they must outlive the robot.
    Robot(const Index* topology, const double* constants)
        : topology(topology), constants(this->topology.sizes, constants) {}

    /// The same robot with other constants.
    Robot(const Topology& topology, const double* constants)
        : topology(topology), constants(topology.sizes, constants) {}

    /// Geometry of all cables in a pose; false if the path of a cable is impossible.
    ///
    /// `motor_angle` [rad] may be empty, for drums at rest; only drums with a pitch depend on it.
    /// Lengths, lever arms, wraps, arcs, segments, poses and, for routed elements only, directions
    /// are written.
    bool shape(
        std::span<const double> motor_angle, std::span<const double> joint_angle,
        Workspace& work) const;

    /// One sample: (state, angles) -> (state, estimate).
    ///
    /// `before` begins with the state and does not change; `out` has the new state, the estimate and
    /// the workspace, of `out_size` numbers. `dt`: time since the state [s]; 0 for the first sample or
    /// where it is unknown.
    ///
    /// Returns false where the geometry is impossible (the state is then kept) or the fluxes of some
    /// cable could not be solved; the elements concerned are INVALID.
    bool advance(
        const double* before, std::span<const double> motor_angle,
        std::span<const double> joint_angle, double dt, double* out) const;

    /// Impose a friction history on a robot that has just been started; keep the elongations.
    ///
    /// `share`: friction as a share of every pulley's bound, in [-1, 1], positive where the tension
    /// rises towards the last node. `out` is what `advance` wrote for the first sample.
    void impose_friction(std::span<const double> share, double* out) const;

    /// Give all cable on the drums the present strain, as of a cable that slips on its drum.
    void forget_drums(double* state) const;

    /// Whether numbers may be a state: within bounds that keep every step defined.
    bool is_state(std::span<const double> numbers) const;

    std::size_t state_size() const { return State::size(topology.sizes); }
    std::size_t estimate_size() const { return Estimate::size(topology.sizes); }
    std::size_t out_size() const {
        return state_size() + estimate_size() + Workspace::size(topology.sizes);
    }

    Topology topology;
    Constants constants;
};

// -------------------------------------------------------------------------------------------------
// The stages of a sample, in their order

/// Pose of every frame, and its velocity per joint (G1).
///
/// A rolling frame follows two equal circles (5): it rolls about its z axis and
/// starts on its x axis.
void place_frames(
    const Topology& topology, const Constants& constants, std::span<const double> joint_angle,
    Workspace& work);

/// Lengths, arcs, middles, directions and lever arms of one cable; false if its path is impossible.
///
/// `motor_angle` [rad] may be empty, for drums at rest; only drums with a pitch depend on it. The
/// wraps of sheaths are given, all others written.
bool route_cable(
    const Topology& topology, const Constants& constants, Index cable,
    std::span<const double> motor_angle, std::span<const double> joint_angle, Workspace& work);

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

/// Lay the arcs of a sample onto the cells of their surfaces (E29).
///
/// `before`: the state before the sample; `after`: with the tracks of the sample, `place` and `covered`
/// are written; `work`: with the geometry of the sample; the contacts of the cells, the lengths of the
/// segments and `history` are written.
void cover_surfaces(
    const Topology& topology, const Constants& constants, const double* before, State& after,
    Workspace& work);

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

}  // namespace cdrj

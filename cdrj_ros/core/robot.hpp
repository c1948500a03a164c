// One sample of a whole robot: geometry, friction bounds, every cable, all outputs.
// docs/model.md.
#pragma once

#include <span>

#include "layout.hpp"

namespace cdrj {

struct Step;

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
    /// the workspace, of `out_size` numbers, all zero at first. `dt`: time since the state [s]; 0 for the first sample or
    /// where it is unknown.
    ///
    /// Returns false where the path of some cable is impossible, or an angle on it is unknown (NaN; its state is
    /// then kept), or its fluxes could not be solved; its elements are INVALID.
    bool advance(
        const double* before, std::span<const double> motor_angle,
        std::span<const double> joint_angle, double dt, double* out) const;

    /// The same for some cables; what belongs to others stays 0.
    bool advance(
        const double* before, std::span<const double> motor_angle,
        std::span<const double> joint_angle, double dt, const CableSet& some, double* out) const;

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

/// Everything that one sample reads and writes.
struct Step {
    /// `before` and `out` as of `Robot::advance`.
    Step(const Robot& robot, const double* before, double* out);

    const Topology& topology;
    const Constants& constants;
    State before;
    State after;
    Estimate estimate;
    Workspace work;
};

/// Angles of a sample, and the time since the state before it.
struct SampleAngles {
    std::span<const double> motor;  // [rad]
    std::span<const double> joint;  // [rad], of prismatic joints [m]
    double dt;                      // [s]; 0 for the first sample or where it is unknown
};

/// Whether all angles on which a cable depends are known.
bool is_read(const Topology& topology, Index cable, const SampleAngles& angles);

/// Advance one cable, which depends on nothing but its path; the frames on it have been placed.
///
/// State and estimate of the cable are written. Returns as `Robot::advance`, for this cable.
bool advance_cable(Step& step, Index cable, const SampleAngles& angles);

/// Advance some cables, and write the efforts of the axes given with them.
///
/// Returns as `Robot::advance`, for these cables.
bool advance_cables(Step& step, const CableSet& some, const SampleAngles& angles);

/// As `Robot::impose_friction` and `Robot::forget_drums`, of one cable.
void impose_friction(Step& step, Index cable, std::span<const double> share);
void forget_drums(const Robot& robot, Index cable, State& state);

// -------------------------------------------------------------------------------------------------
// The stages of a sample, in their order

/// Pose of some frames, parents first, and their velocity per joint (G1).
///
/// A rolling frame follows two equal circles (5): it rolls about its z axis and
/// starts on its x axis.
void place_frames(
    const Topology& topology, const Constants& constants, std::span<const Index> frames,
    std::span<const double> joint_angle, Workspace& work);

/// Lengths, arcs, middles, directions and lever arms of one cable; false if its path is impossible.
///
/// `motor_angle` [rad] may be empty, for drums at rest; only drums with a pitch depend on it. The
/// wraps of sheaths are given, all others written.
bool route_cable(
    const Topology& topology, const Constants& constants, Index cable,
    std::span<const double> motor_angle, std::span<const double> joint_angle, Workspace& work);

/// Geometry of one cable, whose frames have been placed; false if its path is impossible.
bool shape_cable(
    const Topology& topology, const Constants& constants, Index cable,
    std::span<const double> motor_angle, std::span<const double> joint_angle, Workspace& work);

/// Lengths of a cable's segments from those of its elements: the arc of every pulley in equal cells.
///
/// An element ends in the middle of an arc, its outer segment in the middle of the first cell, and
/// has no part in what lies on an end.
void divide_arcs(const Topology& topology, Index cable, Workspace& work);

/// Move the places of the middles of a cable's arcs along their bodies (E26), from the tracks and middles of
/// `before` to the tracks of `after`.
///
/// Where the cable comes to touch a body in this sample, its wrap is set to 0: the contact holds no
/// friction yet.
void follow_arcs(
    const Topology& topology, const Constants& constants, Index cable, const State& before,
    State& after, Workspace& work);

/// Lay the arcs of a cable onto the cells of their surfaces (E29).
///
/// `before`: the state before the sample, which becomes that by the contact cells of this sample;
/// `after`: with the tracks of the sample, `place` and `covered` are written; `work`: with the geometry
/// of the sample; the contacts of the cells and the lengths of the segments are written.
void cover_surfaces(
    const Topology& topology, const Constants& constants, Index cable, State& before, State& after,
    Workspace& work);

/// Constants and places of the contacts of one cable, and the shift of (E25).
///
/// Cells that are fixed to a surface are left to `cover_surfaces`.
void place_contacts(
    const Topology& topology, const Constants& constants, Index cable, const State& before,
    State& after, Workspace& work);

/// Loss of every contact of a cable: (37), (41), their blend for the pulley, (E28) for its cells.
///
/// Constant wraps use losses computed beforehand. Static friction fades with the slip speed delayed
/// by `stribeck_lag` (E10), frictional memory. With the speed of the sample itself, friction would
/// fall while the cable slips; a massless cable then has several solutions or none, and would jump
/// from sample to sample.
void friction_losses(
    const Topology& topology, const Constants& constants, Index cable, const State& before,
    Workspace& work);

/// Write tensions, status, slip speeds and nodal forces (38) of a cable.
///
/// Tensions are those of the free spans; a pulley's slip speed is the mean of its cells'. `solved`:
/// whether the fluxes of the cable were found; otherwise its elements are INVALID.
void report_cable(Step& step, Index cable, bool solved);

/// Moment arm of a cable at one of its ends about the axis of a motor that turns its drum [m]: its
/// share in the motor's effort per newton (E12), (E27).
double motor_arm(const Step& step, Index cable, Index end, Index turn);

/// Add the effort of one cable on an axis (E12), before the sign, to that of others.
double effort_of_cable(const Step& step, Index axis, Index cable, double others = 0.0);

/// Write the efforts of some axes: those of their cables (E12), friction and spring (E13), and the sign.
void report_efforts(Step& step, std::span<const Index> axes, const SampleAngles& angles);

/// Set SLACK and OVERLOAD in an element's status by its tension.
inline void set_load(double& status, double tension, const CableConstants& cable) {
    int flags = static_cast<int>(status) & ~(SLACK | OVERLOAD);
    if (tension <= cable.slack_tension) flags |= SLACK;
    if (tension > cable.maximum_tension) flags |= OVERLOAD;
    status = static_cast<double>(flags);
}

}  // namespace cdrj

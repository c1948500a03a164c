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

}  // namespace cdrj

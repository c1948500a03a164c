// Joints without encoder in one sample, from the angles and efforts of the motors.
//
// The angles are predicted from the cables and the loads (M1), then corrected by the measured efforts
// (M2). At the start, or where a joint is lost, they are searched over their ranges first.
// docs/model.md. Every member of an ensemble solves the same problems as the nominal robot; their
// spread gives the standard deviations.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "ensemble.hpp"
#include "normal_equations.hpp"

namespace cdrj {

/// A joint without encoder, and what is known of it.
struct EncoderlessJoint {
    Index joint;        // its index among all joints of the robot
    double lower;       // ends of its range [rad] or [m]
    double upper;
    double start;       // angle from which the first search begins [rad] or [m]
    double load_drift;  // standard deviation of its load's change in 1 s [N m]; 0 where unknown

    double range() const { return upper - lower; }

    /// Difference by which derivatives are taken.
    double difference() const { return 1e-4 * range(); }

    /// Variance per second of its departure from the motion that its cables impose.
    double wander() const { return (0.04 * range()) * (0.04 * range()); }

    /// Variance of an angle that is only known to be in its range.
    double variance() const { return range() * range() / 12.0; }
};

/// What a robot remembers of the u joints of a group, beside its state.
struct EncoderlessMemory {
    explicit EncoderlessMemory(std::size_t joints)
        : angle(joints, 0.0), load(joints, 0.0), covariance(joints, joints) {}

    double lost = 0.0;           // time since which the efforts have not been explained [s]
    double left = 0.0;           // what a search has left of their misfit at most
    std::vector<double> angle;   // [rad] or [m]
    std::vector<double> load;    // efforts of these joints [N m] or [N]
    DenseMatrix covariance;      // of the angles, shape (u, u)
};

/// Joints without encoder that are solved together, with the cables and motors that connect them; its
/// axes are these motors and joints.
struct EncoderlessGroup : CableSet {
    std::vector<std::size_t> places;  // of the joints among all that have no encoder
    std::vector<Index> motors;
};

/// One robot, its history and the readings of a sample.
struct EncoderlessSample {
    const Robot& robot;
    std::span<const double> state;           // before the sample
    EncoderlessMemory& memory;               // `solve` replaces it
    std::span<const double> motor_angle;     // [rad]
    std::span<const double> measured_angle;  // of the joints that have an encoder [rad] or [m]
    std::span<const double> effort;          // of the motors [N m]; NaN where none was heard
    double dt;                               // time since the last update [s]; 0 at the first one
    std::span<const double> near{};          // of a member: the estimated angles of the group
};

/// Finds the angles of a group of joints without encoder in one sample.
class EncoderlessSolver {
public:
    /// `joints`: all without encoder. `effort_noise`: standard deviation of the measured effort of every
    /// motor [N m]. `out`: as of `Robot::advance`; it must outlive this object, which writes what
    /// concerns the cables of the group.
    EncoderlessSolver(
        const Robot& robot, const std::vector<EncoderlessJoint>& joints, EncoderlessGroup group,
        std::vector<double> effort_noise, std::span<double> out);

    /// Find the angles, near those before or, with `anew`, anywhere in the joints' ranges, of a member near
    /// the estimated ones; the memory becomes that after the sample. Returns whether all cables were
    /// solved at these angles, for which `out` is written.
    bool solve(const EncoderlessSample& sample, bool anew);

    const EncoderlessGroup group;

private:
    /// Begin anew: at the angles that a search finds, of a member at the estimated ones. Returns as
    /// `evaluate`.
    bool find(const EncoderlessSample& sample);

    // Evaluation at the present angles; whether all cables could be solved.
    bool evaluate(const EncoderlessSample& sample);       // efforts and loads
    bool differentiate(const EncoderlessSample& sample);  // and their derivatives

    /// Effort of a motor of the group or, after these, load of a joint.
    double effort(std::size_t k) const;

    // Prediction (M1), and its parts.
    void predict(const EncoderlessSample& sample);
    void turn_with_cables(const EncoderlessSample& sample);
    double elongation(const EncoderlessSample& sample, Index cable);
    void weigh_prediction(const EncoderlessSample& sample);
    void widen(const EncoderlessSample& sample, bool loads_known);

    // Correction (M2); whether the angles have arrived at those that were evaluated last.
    bool correct(const EncoderlessSample& sample);
    void weigh_correction(const EncoderlessSample& sample);
    double misfit(const EncoderlessSample& sample) const;

    // Search over the ranges of the joints.
    void search(const EncoderlessSample& sample);
    void search_along(const EncoderlessSample& sample, std::size_t joint);

    /// Make the present angles the predicted ones.
    void aim();

    /// Solve the normal equations and change the angles, within limits; whether they have arrived.
    bool move();

    double& angle_of(std::size_t a) { return angle_[joints_[a].joint]; }

    std::vector<EncoderlessJoint> joints_;  // u joints of the group
    std::vector<Index> measured_;           // indices of the joints that have an encoder
    std::vector<double> effort_noise_;      // [N m]
    bool any_load_known_;                   // whether anything is known of a load

    std::span<double> out_;
    Estimate estimate_;          // parts of it
    Workspace work_;
    std::vector<double> angle_;  // present angles of all joints [rad] or [m]
    DenseMatrix slopes_;         // derivatives of the efforts, shape (motors + u, u)
    std::vector<double> arms_;   // by how much a cable gets longer per unit of each angle
    std::vector<double> target_;  // predicted angles: q0 of (M1), then q1 of (M2)
    DenseMatrix information_;    // inverse of the predicted covariance, P^-1 of (M2)
    NormalEquations equations_;
};

/// Readings of a sample.
struct EncoderlessReadings {
    Nanoseconds stamp_ns;
    std::span<const double> motor_angle;     // [rad]
    std::span<const double> measured_angle;  // of the joints with encoder [rad] or [m]
    std::span<const double> effort;          // of the motors [N m]; NaN where none was heard
};

/// Where the results of a sample are written; without any effort all numbers are NaN.
struct EncoderlessResults {
    std::span<double> estimate;
    std::span<double> stddev;        // of the ensemble's quantities
    std::span<double> angle;         // of the joints without encoder [rad] or [m]
    std::span<double> angle_stddev;  // [rad] or [m]
};

/// The estimate of a robot with joints without encoder.
class EncoderlessEstimator {
public:
    /// `ensemble`: of the robot; it must outlive this object, which alone advances its members.
    /// `effort_noise`: standard deviation of the measured effort of every motor [N m].
    EncoderlessEstimator(
        Ensemble& ensemble, std::vector<EncoderlessJoint> joints, std::vector<double> effort_noise);
    EncoderlessEstimator(const EncoderlessEstimator&) = delete;
    EncoderlessEstimator& operator=(const EncoderlessEstimator&) = delete;

    /// Estimate a sample.
    ///
    /// At the first one all members are updated, later one in turn, as by `Ensemble::update`.
    void take(const EncoderlessReadings& readings, const EncoderlessResults& results);

    /// Discard everything that was heard; the next effort starts anew.
    void reset();

    /// Keep the history, unless that has been done.
    void keep();

    /// Return to the history that was kept; without effect if there is none.
    void roll_back();

    /// State of the nominal robot after the last sample.
    std::span<const double> state() const { return history_.state; }

    const Ensemble& ensemble() const { return ensemble_; }
    std::size_t joints() const { return joints_.size(); }
    std::size_t measured_joints() const { return measured_.size(); }

private:
    /// What a robot remembers beside its state.
    struct Memory {
        bool started = false;                   // whether there has been a sample
        std::vector<EncoderlessMemory> groups;
    };

    /// All that samples change, beside the ensemble.
    struct History {
        std::vector<double> state;               // of the nominal robot
        Nanoseconds stamp_ns;                    // of its last sample
        Memory nominal;
        std::vector<Memory> members;
        DenseMatrix deviation;                   // of every member's angles from the estimated ones
        std::vector<double> variance;            // of the angles
    };

    History before_first_sample() const;
    void solve(
        const Robot& robot, std::span<const double> share, std::span<double> state, Memory& memory,
        Nanoseconds since, const Memory* estimated = nullptr);
    std::span<const double> estimate() const;
    void update_member(const EncoderlessReadings& readings, const EncoderlessResults& results);
    void write_unknown(const EncoderlessResults& results) const;

    Ensemble& ensemble_;
    std::vector<EncoderlessJoint> joints_;
    std::vector<Index> measured_;          // indices of the other joints
    std::vector<double> out_;              // as of `Robot::advance`
    std::vector<EncoderlessSolver> solvers_;  // of the groups
    CableSet rest_;                        // the cables of no group; all axes and frames
    std::vector<double> angle_;            // of all joints [rad] or [m]
    History history_;
    std::optional<History> kept_;
    std::vector<double> motor_angle_;     // readings with the errors of a member
    std::vector<double> measured_angle_;
    std::vector<double> effort_;
};

}  // namespace cdrj

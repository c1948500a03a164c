// The simulated rig's stepper: a robot that is advanced sample by sample along a plan.
//
// All joints follow the plan, or one of them obeys a condition instead, and the stepper looks in each
// sample for the angle that satisfies it: the drive of the motors at which the cables' torque on a
// balanced joint is the wanted one, or the angle of a free joint at which the torque gives it the
// acceleration that takes it there.
#pragma once

#include <span>
#include <variant>
#include <vector>

#include "robot.hpp"

namespace cdrj {

/// A robot in one sample, tried with different angles, of which the last one may be kept.
class Trials {
public:
    /// `joint`: the one whose torque counts.
    Trials(const Robot& robot, Index joint);

    /// Effort of the cables on the joint at these angles, `dt` [s] after the state [N m].
    double effort(
        std::span<const double> motor_angle, std::span<const double> joint_angle, double dt);

    /// Go on from the last trial; its estimate is copied to `estimate`.
    void keep(std::span<double> estimate);

    std::vector<double> state;  // of the robot, replaced by `keep`

private:
    const Robot& robot_;
    std::vector<double> out_;
    std::size_t effort_;  // index in `out_` of the joint's effort
};

/// What is prescribed, one row a phase.
struct Plan {
    Table motors;                    // angles of all motors [rad]
    Table pose;                      // angles of all joints [rad] or [m]
    std::span<const double> torque;  // wanted of a balanced joint, external on a free one [N m]
};

/// One sample: time since the one before, and the faults in it.
struct Interval {
    double dt;                       // [s]
    std::span<const double> offset;  // of the motors by faults [rad]
    bool happening;                  // whether a fault happens
};

/// How a sample ended.
struct Outcome {
    bool done;
    double imbalance;  // torque of the cables less the needed one [N m]
};

/// Angles of a sample: those of the plan before, those that were found after it.
struct Angles {
    std::span<double> motors;  // of all motors, without the offsets of faults [rad]
    std::span<double> pose;    // of all joints [rad] or [m]
    std::vector<double>& offset_motors;  // with them, as a trial takes them
};

/// Inertia and load of a joint that moves freely, by the powers of its angle q.
struct JointLoad {
    double inertia;       // [kg m^2]
    double inertia_cos;   // times cos q [kg m^2]
    double weight;        // [N m]
    double weight_cos;    // times cos q [N m]
    double weight_cos_2;  // times cos 2q [N m]
    double damping;       // [N m s/rad]
};

/// Motion of a free joint.
struct Swing {
    double angle;         // [rad] or [m]
    double speed;         // [rad/s]
    double acceleration;  // [rad/s^2]
    double torque;        // of the cables, along positive angle [N m]
};

/// Every joint follows the plan.
struct PrescribedJoints {
    Outcome step(Trials& trials, Angles& angles, double dt) const;
};

/// One joint that moves by its dynamics.
///
/// Every step solves for the joint's next angle with the cables' torque at both ends of the step
/// (trapezoidal rule): cables are stiff, and an explicit step would be unstable for a light joint.
/// Without friction and damping the rule conserves the energy of a linear spring exactly.
struct FreeJoint {
    JointLoad load;
    Index joint;
    double effort_sign;   // +1 or -1: that of the joint's efforts in the robot file
    double lower, upper;  // its range [rad] or [m]

    /// Advance the joint by `dt` [s] under the cables and an external torque [N m].
    ///
    /// The swing is kept, and the sample not done, where the joint leaves its range.
    Outcome step(
        Trials& trials, Swing& swing, Angles& angles, double external_torque, double dt) const;
};

/// The motors drive one joint so that the torque of the cables on it is the wanted one.
///
/// The motors have the angles of the plan + `direction` * drive. Speed and acceleration of the drive are
/// limited. Where the plan asks for more, it is carried out more slowly (or faster, if the drive cannot
/// brake as hard), so that the joint stays balanced. At a reversal no phase is balanced before the drive
/// has taken up the difference along the cable: the joint waits, and the drive brakes in time.
struct BalancedJoint {
    std::vector<double> direction;  // of the motors per unit of the drive
    double rising;                  // sign of the torque's change with the drive
    double most_speed;              // of the drive [rad/s]
    double most_acceleration;       // of the drive [rad/s^2]
    double drive;                   // present drive [rad]
    double speed = 0.0;             // of the drive [rad/s]
    bool excused = false;           // whether the motor compensates a fault

    /// One sample from `phase`, which it advances.
    Outcome step(
        Trials& trials, const Plan& plan, const Interval& sample, double& phase, Angles& angles);

    /// Torque of the cables less the wanted one with a drive, in phase `at` [N m].
    double imbalance(
        Trials& trials, const Plan& plan, const Interval& sample, double at, double drive_at,
        Angles& angles) const;
};

using JointRule = std::variant<PrescribedJoints, FreeJoint, BalancedJoint>;

/// A robot on its way along a plan.
class Stepper {
public:
    /// `joint`: the one that may be free or balanced.
    Stepper(const Robot& robot, Index joint) : trials(robot, joint) {}

    /// Take the next sample; `angles` and `estimate` are written, the state is kept if it is done.
    Outcome step(
        const Plan& plan, const Interval& sample, std::span<double> motors, std::span<double> pose,
        std::span<double> estimate);

    Trials trials;
    JointRule rule = PrescribedJoints{};
    Swing swing{};       // of the free joint
    double phase = 0.0;  // of the plan: its row, between two rows where the plan is slowed down

private:
    std::vector<double> offset_motors_;
};

}  // namespace cdrj

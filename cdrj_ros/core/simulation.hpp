// Motion of the simulated rig: a joint that the cables balance, and a joint that moves freely.
//
// Both advance a robot sample by sample and look in each one for the angle with which it satisfies a
// condition: the drive of the motors at which the torque of a joint is the wanted one, or the angle
// of the joint at which its torque gives it the acceleration that takes it there.
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "robot.hpp"

namespace cdrj {

/// A robot in one sample, tried with different angles, of which the last one may be kept.
class Trials {
public:
    /// `state`: of the robot, replaced by `keep`; `joint`: the one whose torque counts.
    Trials(const Robot& robot, std::span<double> state, Index joint);

    /// Effort of the cables on the joint at these angles, `dt` [s] after the state [N m].
    double effort(
        std::span<const double> motor_angle, std::span<const double> joint_angle, double dt);

    /// Go on from the last trial; its estimate is copied to `estimate`.
    void keep(std::span<double> estimate);

private:
    const Robot& robot_;
    std::span<double> state_;
    std::vector<double> out_;
    std::size_t effort_;  // index in `out_` of the joint's effort
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

    /// Advance by `dt` [s] with these angles of the motors and of the other joints.
    ///
    /// Returns the remaining imbalance of torque [N m]. `pose` gets the angle of the joint.
    double step(
        Trials& trials, Swing& swing, std::span<const double> motor_angle, std::span<double> pose,
        double dt) const;

    bool is_in_range(double angle) const { return lower <= angle && angle <= upper; }
};

/// The motors drive one joint so that the torque of the cables on it is the wanted one.
///
/// The motors have the angles `base` + `direction` * drive + `offset`, and a largest speed of the
/// drive. Where they would have to be faster, the joint waits: it stays in its phase.
struct BalancedJoint {
    std::span<const double> direction;  // of the motors per unit of the drive
    double rising;                      // sign of the torque's change with the drive
    double motor_speed;                 // largest speed of the drive [rad/s]

    double drive;                       // present drive [rad]
    Index phase;                        // present sample of the prescribed motion
    bool excused;                       // whether the motor compensates a fault
    std::vector<double> motor_angle{};  // of a trial [rad]

    /// Prescribed motion: poses, torques and angles of the motors, one row a phase.
    struct Motion {
        Table pose;                      // of all joints
        std::span<const double> torque;  // of the balanced joint [N m]
        Table base;                      // of all motors [rad]
    };

    /// How a sample ended.
    struct Outcome {
        bool balanced;
        double imbalance;  // torque of the cables less the wanted one [N m]
        double asked;      // speed that was asked of the motors where they could not follow [rad/s]
    };

    /// One sample; `offset`: of the motors by faults [rad]; `happening`: whether a fault happens.
    Outcome step(
        Trials& trials, const Motion& motion, std::span<const double> offset, bool happening,
        double dt);

    /// Torque of the cables less the wanted one with a drive, in phase `at` [N m].
    double imbalance(
        Trials& trials, const Motion& motion, Index at, std::span<const double> offset,
        double drive_at, double dt);
};

}  // namespace cdrj

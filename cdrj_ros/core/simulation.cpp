#include "simulation.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace cdrj {
namespace {

/// Largest imbalance of a balanced joint [N m].
constexpr double BALANCE_TOLERANCE = 1e-6;

/// Largest imbalance of torque in a step of a free joint [N m].
constexpr double MOTION_TOLERANCE = 1e-9;

/// Torque that the step q0 -> q1 needs minus the mean torque of the cables [N m].
double required(
    const JointLoad& load, double q0, double v0, double q1, double dt, double torque0,
    double torque1) {
    const double q = 0.5 * (q0 + q1), v = (q1 - q0) / dt;
    const double inertia = load.inertia + load.inertia_cos * std::cos(q);
    const double held =
        load.weight + load.weight_cos * std::cos(q) + load.weight_cos_2 * std::cos(2.0 * q);
    const double turning =
        inertia * 2.0 * (v - v0) / dt - 0.5 * load.inertia_cos * std::sin(q) * v * v;
    return turning + load.damping * v + held - 0.5 * (torque0 + torque1);
}

}  // namespace

Trials::Trials(const Robot& robot, Index joint)
    : state(robot.state_size(), 0.0), robot_(robot), out_(robot.out_size()) {
    const Estimate estimate(robot.topology.sizes, out_.data() + robot.state_size());
    effort_ = static_cast<std::size_t>(estimate.joint_effort.data() + joint - out_.data());
}

double Trials::effort(
    std::span<const double> motor_angle, std::span<const double> joint_angle, double dt) {
    robot_.advance(state.data(), motor_angle, joint_angle, dt, out_.data());
    return out_[effort_];
}

void Trials::keep(std::span<double> estimate) {
    std::copy_n(out_.begin(), state.size(), state.begin());
    std::copy_n(out_.begin() + static_cast<std::ptrdiff_t>(state.size()), estimate.size(),
                estimate.begin());
}

Outcome PrescribedJoints::step(Trials& trials, Angles& angles, double dt) const {
    trials.effort(angles.offset_motors, angles.pose, dt);
    return {true, 0.0};
}

Outcome FreeJoint::step(
    Trials& trials, Swing& swing, Angles& angles, double external_torque, double dt) const {
    const auto [q0, v0, acceleration, torque0] = swing;
    JointLoad pushed = load;
    pushed.weight -= external_torque;
    const std::span<double> pose = angles.pose;
    double q = q0, excess = 0.0, torque;
    if (dt > 0.0) {
        q = q0 + dt * v0 + 0.5 * dt * dt * acceleration;
        const double slope =
            2.0 * (load.inertia + load.inertia_cos * std::cos(q0)) / (dt * dt);
        double low = -std::numeric_limits<double>::infinity(), high = -low;
        double below = 0.0, above = 0.0, last = q, last_excess = 0.0;
        bool tried = false;
        for (int k = 0; k < 100; ++k) {
            pose[joint] = q;
            torque = effort_sign * trials.effort(angles.offset_motors, pose, dt);
            excess = required(pushed, q0, v0, q, dt, torque0, torque);
            if (std::abs(excess) <= MOTION_TOLERANCE) break;
            if (excess < 0.0) {
                low = q;
                below = excess;
            } else {
                high = q;
                above = excess;
            }
            double steep = slope;
            if (tried && q != last) steep = std::max((excess - last_excess) / (q - last), slope);
            last = q;
            last_excess = excess;
            tried = true;
            q -= excess / steep;
            if (!(low < q && q < high)) q = low - below * (high - low) / (above - below);
            if (!(low < q && q < high) || q == last) break;  // within numerical precision
        }
    } else {
        pose[joint] = q;
        torque = effort_sign * trials.effort(angles.offset_motors, pose, 0.0);
    }
    if (!(lower <= pose[joint] && pose[joint] <= upper)) return {false, excess};
    if (dt > 0.0) {
        const double v1 = 2.0 * (pose[joint] - q0) / dt - v0;
        swing.acceleration = (v1 - v0) / dt;
        swing.speed = v1;
    }
    swing.angle = pose[joint];
    swing.torque = torque;
    return {true, excess};
}

double BalancedJoint::imbalance(
    Trials& trials, const Plan& plan, const Interval& sample, Index at, double drive_at,
    Angles& angles) const {
    for (std::size_t m = 0; m < direction.size(); ++m) {
        angles.motors[m] = plan.motors(at, static_cast<Index>(m)) + direction[m] * drive_at;
        angles.offset_motors[m] = angles.motors[m] + sample.offset[m];
    }
    std::copy_n(&plan.pose(at, 0), angles.pose.size(), angles.pose.begin());
    return trials.effort(angles.offset_motors, angles.pose, sample.dt) - plan.torque[at];
}

/// Bracket, then regula falsi (Illinois). Just after a reversal, friction makes the joint's effort a
/// very flat function of the winch angle, so the bracket is widened geometrically.
Outcome BalancedJoint::step(
    Trials& trials, const Plan& plan, const Interval& sample, Index& phase, Index following,
    Angles& angles) {
    const double dt = sample.dt;
    const auto tried = [&](double at) {
        return imbalance(trials, plan, sample, following, at, angles);
    };
    const double far = 2.0 * motor_speed * dt + 1e-2;
    double a = drive, fa = tried(a), b = a, fb = fa, width = 1e-5;
    const double towards = fa > 0.0 ? -rising : rising;
    while (std::abs(fb) > BALANCE_TOLERANCE && fa * fb > 0.0 && width < 2.0 * far) {
        a = b;
        fa = fb;
        b = drive + towards * width;
        fb = tried(b);
        width *= 2.0;
    }
    int side = 0;
    for (int k = 0; k < 200; ++k) {
        if (std::abs(fb) <= BALANCE_TOLERANCE || fa * fb > 0.0) break;
        const double c = b - fb * (b - a) / (fb - fa);
        const double fc = tried(c);
        if (fc * fb < 0.0) {
            a = b;
            fa = fb;
            side = 0;
        } else {
            ++side;
            fa *= side > 0 ? 0.5 : 1.0;
        }
        b = c;
        fb = fc;
    }
    excused = excused || sample.happening;
    if (std::abs(b - drive) > motor_speed * dt && dt > 0.0) {
        const double asked = std::abs(fb) <= BALANCE_TOLERANCE ? std::abs(b - drive) / dt : 0.0;
        following = phase;  // the joint waits for the motor
        b = b > drive ? drive + motor_speed * dt : drive - motor_speed * dt;
        const double before = tried(drive);
        fb = tried(b);
        if (std::abs(fb - before) > 0.1 * (1.0 + std::abs(plan.torque[phase])) && !excused) {
            return {false, fb, asked};
        }
    } else if (std::abs(fb) > BALANCE_TOLERANCE) {
        return {false, fb};
    } else {
        excused = sample.happening;
    }
    drive = b;
    phase = following;
    return {true, fb};
}

Outcome Stepper::step(
    const Plan& plan, const Interval& sample, std::span<double> motors, std::span<double> pose,
    std::span<double> estimate) {
    const Index last = static_cast<Index>(plan.torque.size()) - 1;
    const Index following = sample.dt > 0.0 ? std::min(phase + 1, last) : phase;
    std::copy_n(&plan.motors(following, 0), motors.size(), motors.begin());
    std::copy_n(&plan.pose(following, 0), pose.size(), pose.begin());
    offset_motors_.assign(motors.begin(), motors.end());
    for (std::size_t m = 0; m < motors.size(); ++m) offset_motors_[m] += sample.offset[m];
    Angles angles{motors, pose, offset_motors_};
    Outcome outcome;
    if (auto* balanced = std::get_if<BalancedJoint>(&rule)) {
        outcome = balanced->step(trials, plan, sample, phase, following, angles);
    } else {
        if (const auto* moving = std::get_if<FreeJoint>(&rule)) {
            outcome = moving->step(trials, swing, angles, plan.torque[following], sample.dt);
        } else {
            outcome = std::get<PrescribedJoints>(rule).step(trials, angles, sample.dt);
        }
        if (outcome.done) phase = following;
    }
    if (outcome.done) trials.keep(estimate);
    return outcome;
}

}  // namespace cdrj

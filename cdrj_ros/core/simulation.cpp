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

Trials::Trials(const Robot& robot, std::span<double> state, Index joint)
    : robot_(robot), state_(state), out_(robot.out_size()) {
    const Estimate estimate(robot.topology.sizes, out_.data() + robot.state_size());
    effort_ = static_cast<std::size_t>(estimate.joint_effort.data() + joint - out_.data());
}

double Trials::effort(
    std::span<const double> motor_angle, std::span<const double> joint_angle, double dt) {
    robot_.advance(state_.data(), motor_angle, joint_angle, dt, out_.data());
    return out_[effort_];
}

void Trials::keep(std::span<double> estimate) {
    std::copy_n(out_.begin(), state_.size(), state_.begin());
    std::copy_n(out_.begin() + static_cast<std::ptrdiff_t>(state_.size()), estimate.size(),
                estimate.begin());
}

double FreeJoint::step(
    Trials& trials, Swing& swing, std::span<const double> motor_angle, std::span<double> pose,
    double dt) const {
    const auto [q0, v0, acceleration, torque0] = swing;
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
            torque = effort_sign * trials.effort(motor_angle, pose, dt);
            excess = required(load, q0, v0, q, dt, torque0, torque);
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
        torque = effort_sign * trials.effort(motor_angle, pose, 0.0);
    }
    if (!is_in_range(pose[joint])) return excess;
    if (dt > 0.0) {
        const double v1 = 2.0 * (pose[joint] - q0) / dt - v0;
        swing.acceleration = (v1 - v0) / dt;
        swing.speed = v1;
    }
    swing.angle = pose[joint];
    swing.torque = torque;
    return excess;
}

double BalancedJoint::imbalance(
    Trials& trials, const Motion& motion, Index at, std::span<const double> offset, double drive_at,
    double dt) {
    const std::size_t motors = offset.size();
    motor_angle.resize(motors);
    for (std::size_t m = 0; m < motors; ++m) {
        motor_angle[m] =
            motion.base(at, static_cast<Index>(m)) + direction[m] * drive_at + offset[m];
    }
    const std::span<const double> pose{
        &motion.pose(at, 0), static_cast<std::size_t>(motion.pose.width)};
    return trials.effort(motor_angle, pose, dt) - motion.torque[at];
}

/// Bracket, then regula falsi (Illinois). Just after a reversal, friction makes the joint's effort a
/// very flat function of the winch angle, so the bracket is widened geometrically.
BalancedJoint::Outcome BalancedJoint::step(
    Trials& trials, const Motion& motion, std::span<const double> offset, bool happening,
    double dt) {
    const Index last = static_cast<Index>(motion.torque.size()) - 1;
    Index following = dt > 0.0 ? std::min(phase + 1, last) : phase;
    const auto tried = [&](double at) {
        return imbalance(trials, motion, following, offset, at, dt);
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
    excused = excused || happening;
    if (std::abs(b - drive) > motor_speed * dt && dt > 0.0) {
        const double asked = std::abs(fb) <= BALANCE_TOLERANCE ? std::abs(b - drive) / dt : 0.0;
        following = phase;  // the joint waits for the motor
        b = b > drive ? drive + motor_speed * dt : drive + -motor_speed * dt;
        const double before = tried(drive);
        fb = tried(b);
        if (std::abs(fb - before) > 0.1 * (1.0 + std::abs(motion.torque[phase])) && !excused) {
            return {false, fb, asked};
        }
    } else if (std::abs(fb) > BALANCE_TOLERANCE) {
        return {false, fb, 0.0};
    } else {
        excused = happening;
    }
    drive = b;
    phase = following;
    return {true, fb, 0.0};
}

}  // namespace cdrj

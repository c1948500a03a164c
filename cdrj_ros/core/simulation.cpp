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

/// A drive that balances the joint is looked for this far from the present one [rad].
constexpr double FARTHEST = 1.0;

/// The first interval of that search [rad].
constexpr double NEAREST = 1e-5;

/// Phases that a drive which cannot brake as hard as the plan may take in a sample.
constexpr double MOST_PHASES = 2.0;

/// Where a function vanishes, as far as is known: the point last tried, and its value there.
struct Root {
    double at, left;

    bool is_found() const { return std::abs(left) <= BALANCE_TOLERANCE; }
};

/// Root between two points (regula falsi, Illinois); the second one if both values have one sign.
template <typename Function>
Root root_between(Function& tried, Root one, Root other) {
    auto [a, fa] = one;
    auto [b, fb] = other;
    int side = 0;
    for (int k = 0; k < 200; ++k) {
        if (std::abs(fb) <= BALANCE_TOLERANCE || !(fa * fb < 0.0)) break;
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
    return {b, fb};
}

/// Root on one side of a point; the interval is widened geometrically, because friction makes the
/// joint's effort a very flat function of the winch angle just after a reversal.
template <typename Function>
Root root_beyond(Function& tried, double begin, double rising) {
    Root one{begin, tried(begin)}, other = one;
    const double towards = one.left > 0.0 ? -rising : rising;
    for (double width = NEAREST; width <= FARTHEST; width *= 2.0) {
        if (other.is_found() || !(one.left * other.left > 0.0)) break;
        one = other;
        other = {begin + towards * width, tried(begin + towards * width)};
    }
    return root_between(tried, one, other);
}

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
    Trials& trials, const Plan& plan, const Interval& sample, double at, double drive_at,
    Angles& angles) const {
    const Index before = static_cast<Index>(at);
    const Index after = std::min(before + 1, static_cast<Index>(plan.torque.size()) - 1);
    const double share = at - static_cast<double>(before);
    const auto between = [&](double one, double other) { return one + share * (other - one); };
    for (std::size_t m = 0; m < direction.size(); ++m) {
        const Index motor = static_cast<Index>(m);
        angles.motors[m] = between(plan.motors(before, motor), plan.motors(after, motor)) +
                           direction[m] * drive_at;
        angles.offset_motors[m] = angles.motors[m] + sample.offset[m];
    }
    for (std::size_t j = 0; j < angles.pose.size(); ++j) {
        const Index joint = static_cast<Index>(j);
        angles.pose[j] = between(plan.pose(before, joint), plan.pose(after, joint));
    }
    const double wanted = between(plan.torque[before], plan.torque[after]);
    return trials.effort(angles.offset_motors, angles.pose, sample.dt) - wanted;
}

Outcome BalancedJoint::step(
    Trials& trials, const Plan& plan, const Interval& sample, double& phase, Angles& angles) {
    const double dt = sample.dt, last = static_cast<double>(plan.torque.size() - 1);
    const double next = dt > 0.0 ? std::min(phase + 1.0, last) : phase;
    const auto balanced_in = [&](double at) {
        const auto tried = [&](double with) {
            return imbalance(trials, plan, sample, at, with, angles);
        };
        return root_beyond(tried, drive, rising);
    };
    excused = excused || sample.happening;
    const Root wanted = balanced_in(next);
    if (!wanted.is_found() && !excused) return {false, wanted.left};
    const double least = std::max(speed - most_acceleration * dt, -most_speed);
    const double most = std::min(speed + most_acceleration * dt, most_speed);
    const double change = wanted.at - drive;
    if (wanted.is_found() && (dt == 0.0 || (least * dt <= change && change <= most * dt))) {
        if (dt > 0.0) speed = change / dt;
        drive = wanted.at;
        phase = next;
        excused = sample.happening;
        return {true, wanted.left};
    }
    // no faster than it can brake without getting ahead of the plan
    const double side = change < 0.0 ? -1.0 : 1.0;
    double fast = std::abs(change) / dt;
    for (double ahead = 2.0; ahead * dt * most_acceleration < 2.0 * most_speed; ahead *= 2.0) {
        const double way = side * (balanced_in(std::min(phase + ahead, last)).at - drive);
        fast = std::min(fast, way / (ahead * dt) + 0.5 * most_acceleration * ahead * dt);
    }
    speed = std::clamp(side * fast, least, most);
    drive += speed * dt;
    const auto tried = [&](double at) {
        return imbalance(trials, plan, sample, at, drive, angles);
    };
    const double end = std::min(phase + MOST_PHASES, last);
    const Root early{phase, tried(phase)}, late{end, tried(end)};
    Root found = root_between(tried, early, late);
    if (!(early.left * late.left < 0.0) && std::abs(early.left) <= std::abs(late.left)) {
        found = {phase, tried(phase)};
    }
    phase = found.at;
    return {true, found.left};
}

Outcome Stepper::step(
    const Plan& plan, const Interval& sample, std::span<double> motors, std::span<double> pose,
    std::span<double> estimate) {
    const Index last = static_cast<Index>(plan.torque.size()) - 1;
    const Index row = static_cast<Index>(phase);
    const Index following = sample.dt > 0.0 ? std::min(row + 1, last) : row;
    std::copy_n(&plan.motors(following, 0), motors.size(), motors.begin());
    std::copy_n(&plan.pose(following, 0), pose.size(), pose.begin());
    offset_motors_.assign(motors.begin(), motors.end());
    for (std::size_t m = 0; m < motors.size(); ++m) offset_motors_[m] += sample.offset[m];
    Angles angles{motors, pose, offset_motors_};
    Outcome outcome;
    if (auto* balanced = std::get_if<BalancedJoint>(&rule)) {
        outcome = balanced->step(trials, plan, sample, phase, angles);
    } else {
        if (const auto* moving = std::get_if<FreeJoint>(&rule)) {
            outcome = moving->step(trials, swing, angles, plan.torque[following], sample.dt);
        } else {
            outcome = std::get<PrescribedJoints>(rule).step(trials, angles, sample.dt);
        }
        if (outcome.done) phase = static_cast<double>(following);
    }
    if (outcome.done) trials.keep(estimate);
    return outcome;
}

}  // namespace cdrj

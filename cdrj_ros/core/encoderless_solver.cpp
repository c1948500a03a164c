// The angles of joints without encoder in one sample: prediction (M1), correction (M2) and search of
// docs/model.md.
#include <algorithm>
#include <cmath>
#include <utility>

#include "encoderless.hpp"

namespace cdrj {
namespace {

/// A difference between measured and estimated effort above this multiple of the effort's standard
/// deviation means that a joint is lost,
constexpr double LOST = 5.0;

/// if it lasts this long [s].
constexpr double LOST_FOR = 0.05;

/// What searches have left of the misfit at most is that of wrong numbers; only this multiple of it, more,
/// means that a joint is lost again.
constexpr double REMAINING = 2.0;

/// Most Gauss-Newton steps of a prediction or a correction.
constexpr int STEPS = 6;

/// A Gauss-Newton step below this fraction of the difference step ends the iteration.
constexpr double TOLERANCE = 0.01;

/// Largest Gauss-Newton step, as a multiple of the difference step.
constexpr double LARGEST_STEP = 150.0;

/// T of (M2): time over which the error of an effort persists [s].
constexpr double CORRELATED = 0.05;

/// Angles of each joint that are tried where the angle is unknown.
constexpr int ANGLES = 301;

/// Rounds of a search over several joints.
constexpr int ROUNDS = 3;

double squared(double number) { return number * number; }

}  // namespace

EncoderlessSolver::EncoderlessSolver(
    const Robot& robot, const std::vector<EncoderlessJoint>& joints, EncoderlessGroup of_group,
    std::vector<double> effort_noise, std::span<double> out)
    : group(std::move(of_group)),
      effort_noise_(std::move(effort_noise)),
      out_(out),
      estimate_(robot.topology.sizes, out_.data() + robot.state_size()),
      work_(robot.topology.sizes, out_.data() + robot.state_size() + robot.estimate_size()),
      angle_(robot.topology.sizes.joints, 0.0),
      slopes_(group.axes.size(), group.places.size()),
      arms_(group.places.size(), 0.0),
      target_(group.places.size(), 0.0),
      information_(group.places.size(), group.places.size()),
      equations_(group.places.size()) {
    for (const std::size_t place : group.places) joints_.push_back(joints[place]);
    any_load_known_ = std::ranges::any_of(
        joints_, [](const EncoderlessJoint& one) { return one.load_drift > 0.0; });
    for (Index j = 0; j < robot.topology.sizes.joints; ++j) {
        if (std::ranges::find(joints, j, &EncoderlessJoint::joint) == joints.end()) {
            measured_.push_back(j);
        }
    }
}

bool EncoderlessSolver::solve(const EncoderlessSample& sample, bool anew) {
    EncoderlessMemory& memory = sample.memory;
    for (std::size_t k = 0; k < measured_.size(); ++k) {
        angle_[measured_[k]] = sample.measured_angle[k];
    }
    for (std::size_t a = 0; a < joints_.size(); ++a) angle_of(a) = memory.angle[a];
    bool solved = true;
    if (anew) {
        solved = find(sample);
    } else {
        if (sample.dt > 0.0) predict(sample);
        if (!(sample.dt > 0.0 && correct(sample))) solved = evaluate(sample);
        const double motors = static_cast<double>(group.motors.size());
        const double most = LOST * LOST * motors + REMAINING * memory.left;
        memory.lost = misfit(sample) > most ? memory.lost + sample.dt : 0.0;
        if (memory.lost > LOST_FOR) solved = find(sample);
    }
    for (std::size_t a = 0; a < joints_.size(); ++a) {
        memory.angle[a] = angle_of(a);
        memory.load[a] = effort(group.motors.size() + a);
    }
    return solved;
}

bool EncoderlessSolver::find(const EncoderlessSample& sample) {
    if (sample.near.empty()) {
        search(sample);
    } else {
        for (std::size_t a = 0; a < joints_.size(); ++a) angle_of(a) = sample.near[a];
    }
    aim();
    sample.memory.covariance.fill(0.0);
    for (std::size_t a = 0; a < joints_.size(); ++a) {
        sample.memory.covariance(a, a) = joints_[a].variance();
    }
    correct(sample);
    const bool solved = evaluate(sample);
    sample.memory.lost = 0.0;
    sample.memory.left = std::max(sample.memory.left, misfit(sample));
    return solved;
}

bool EncoderlessSolver::evaluate(const EncoderlessSample& sample) {
    Step step(sample.robot, sample.state.data(), out_.data());
    return advance_cables(step, group, {sample.motor_angle, angle_, sample.dt});
}

double EncoderlessSolver::effort(std::size_t k) const {
    const std::size_t motors = group.motors.size();
    return k < motors ? estimate_.motor_effort[group.motors[k]]
                      : estimate_.joint_effort[joints_[k - motors].joint];
}

bool EncoderlessSolver::differentiate(const EncoderlessSample& sample) {
    bool solved = true;
    for (std::size_t a = 0; a < joints_.size(); ++a) {
        const double before = angle_of(a);
        angle_of(a) += joints_[a].difference();
        solved = evaluate(sample) && solved;
        angle_of(a) = before;
        for (std::size_t k = 0; k < slopes_.rows(); ++k) slopes_(k, a) = effort(k);
    }
    solved = evaluate(sample) && solved;
    for (std::size_t k = 0; k < slopes_.rows(); ++k) {
        for (std::size_t a = 0; a < joints_.size(); ++a) {
            slopes_(k, a) = (slopes_(k, a) - effort(k)) / joints_[a].difference();
        }
    }
    return solved;
}

void EncoderlessSolver::aim() {
    for (std::size_t a = 0; a < joints_.size(); ++a) target_[a] = angle_of(a);
}

bool EncoderlessSolver::move() {
    equations_.invert();
    bool arrived = true;
    for (std::size_t a = 0; a < joints_.size(); ++a) {
        const EncoderlessJoint& joint = joints_[a];
        const double most = LARGEST_STEP * joint.difference();
        const double change = std::min(std::max(equations_.change(a), -most), most);
        const double now = std::min(std::max(angle_of(a) + change, joint.lower), joint.upper);
        arrived = arrived && std::abs(now - angle_of(a)) <= TOLERANCE * joint.difference();
        angle_of(a) = now;
    }
    return arrived;
}

// -------------------------------------------------------------------------------------------------
// Prediction (M1)

void EncoderlessSolver::predict(const EncoderlessSample& sample) {
    turn_with_cables(sample);
    aim();
    bool loads_known = false;
    for (int step = 0; any_load_known_ && step < STEPS; ++step) {
        loads_known = differentiate(sample);
        if (!loads_known) break;
        weigh_prediction(sample);
        if (move()) break;
    }
    aim();
    widen(sample, loads_known);
}

/// Move the angles to q0 of (M1): as the cables would turn the joints if their elongation stayed the
/// same.
///
/// The change is the least-squares solution over all cables; winches and measured joints have moved
/// since the state.
void EncoderlessSolver::turn_with_cables(const EncoderlessSample& sample) {
    const auto& [topology, constants] = sample.robot;
    equations_.clear();
    place_frames(topology, constants, group.frames, angle_, work_);
    for (const Index c : group.cables) {
        shape_cable(topology, constants, c, sample.motor_angle, angle_, work_);
        const double longer = elongation(sample, c);
        equations_.weigh(arms_, -longer, 1.0);
    }
    double most = 0.0;
    for (std::size_t a = 0; a < joints_.size(); ++a) most = std::max(most, equations_.matrix(a, a));
    if (!(most > 0.0)) return;
    for (std::size_t a = 0; a < joints_.size(); ++a) equations_.matrix(a, a) += 1e-9 * most;
    move();
}

/// By how much winches and measured joints have made a cable, whose lever arms are known, longer since the
/// state [m].
///
/// `arms_` becomes by how much it gets longer per unit of each angle without encoder.
double EncoderlessSolver::elongation(const EncoderlessSample& sample, Index c) {
    const auto& [topology, constants] = sample.robot;
    const CableTopology& cable = topology.cables[c];
    const State before(topology.sizes, const_cast<double*>(sample.state.data()));
    double longer = 0.0, taken = 0.0;
    std::ranges::fill(arms_, 0.0);
    for (Index e = cable.first_element; e < cable.first_element + cable.elements; ++e) {
        for (std::size_t a = 0; a < arms_.size(); ++a) {
            arms_[a] += work_.lever_arm(e, joints_[a].joint);
        }
        for (const Index j : measured_) {
            longer += work_.lever_arm(e, j) * (angle_[j] - before.angle[topology.sizes.motors + j]);
        }
    }
    for (Index end = 2 * c; end < 2 * c + 2; ++end) {
        const auto [first, beyond] = topology.turns_of(end);
        for (Index t = first; t < beyond; ++t) {
            const Index motor = topology.turns[t].motor;
            taken += constants.ends[end].radius * constants.turns[t].winding *
                     (sample.motor_angle[motor] - before.angle[motor]);
        }
    }
    return longer + taken;
}

/// Normal equations of (M1): near the target, and with loads near those of the sample before.
void EncoderlessSolver::weigh_prediction(const EncoderlessSample& sample) {
    for (std::size_t a = 0; a < joints_.size(); ++a) {
        const double weight = 1.0 / (joints_[a].wander() * sample.dt);
        equations_.right[a] = weight * (target_[a] - angle_of(a));
        for (std::size_t b = 0; b < joints_.size(); ++b) {
            equations_.matrix(a, b) = a == b ? weight : 0.0;
        }
    }
    for (std::size_t k = 0; k < joints_.size(); ++k) {
        const double drift = joints_[k].load_drift;
        if (!(drift > 0.0)) continue;
        const std::size_t row = group.motors.size() + k;
        const double weight = 1.0 / (drift * drift * sample.dt);
        equations_.weigh(slopes_.row(row), sample.memory.load[k] - effort(row), weight);
    }
}

/// Widen the covariance by that of the change, or, where no load is known, by free wandering.
///
/// Standard deviations stay within those of an angle that is only known to be in its range.
void EncoderlessSolver::widen(const EncoderlessSample& sample, bool loads_known) {
    DenseMatrix& covariance = sample.memory.covariance;
    for (std::size_t a = 0; a < joints_.size(); ++a) {
        for (std::size_t b = 0; b < joints_.size(); ++b) {
            const double own = a == b ? joints_[a].wander() * sample.dt : 0.0;
            covariance(a, b) += loads_known ? equations_.inverse(a, b) : own;
        }
    }
    for (std::size_t a = 0; a < joints_.size(); ++a) {
        const double most = joints_[a].variance();
        if (!(covariance(a, a) > most)) continue;
        const double share = std::sqrt(most / covariance(a, a));
        for (std::size_t b = 0; b < joints_.size(); ++b) {
            covariance(a, b) *= share;
            covariance(b, a) *= share;
        }
    }
}

// -------------------------------------------------------------------------------------------------
// Correction (M2)

bool EncoderlessSolver::correct(const EncoderlessSample& sample) {
    equations_.matrix = sample.memory.covariance;
    invert(equations_.matrix, information_);
    for (int step = 0; step < STEPS; ++step) {
        if (!differentiate(sample)) break;
        weigh_correction(sample);
        const bool arrived = move();
        sample.memory.covariance = equations_.inverse;
        if (arrived) return true;
    }
    return false;
}

/// Normal equations of (M2): near the target, and with the measured efforts.
///
/// At the start dt is 0, and the efforts count as independent of earlier ones.
void EncoderlessSolver::weigh_correction(const EncoderlessSample& sample) {
    const double independent = sample.dt > 0.0 ? std::min(sample.dt / CORRELATED, 1.0) : 1.0;
    for (std::size_t a = 0; a < joints_.size(); ++a) {
        equations_.right[a] = 0.0;
        for (std::size_t b = 0; b < joints_.size(); ++b) {
            equations_.right[a] += information_(a, b) * (target_[b] - angle_of(b));
            equations_.matrix(a, b) = information_(a, b);
        }
    }
    for (std::size_t k = 0; k < group.motors.size(); ++k) {
        const Index m = group.motors[k];
        if (!std::isfinite(sample.effort[m])) continue;
        const double weight = independent / squared(effort_noise_[m]);
        equations_.weigh(slopes_.row(k), sample.effort[m] - effort(k), weight);
    }
}

/// Sum of the squared differences of measured and estimated efforts, in standard deviations.
double EncoderlessSolver::misfit(const EncoderlessSample& sample) const {
    double total = 0.0;
    for (const Index m : group.motors) {
        if (!std::isfinite(sample.effort[m])) continue;
        total += squared((sample.effort[m] - estimate_.motor_effort[m]) / effort_noise_[m]);
    }
    return total;
}

// -------------------------------------------------------------------------------------------------
// Search

/// Search the angles over their ranges: one joint after the other, several times if there are several.
void EncoderlessSolver::search(const EncoderlessSample& sample) {
    const int rounds = joints_.size() == 1 ? 1 : ROUNDS;
    for (int round = 0; round < rounds; ++round) {
        for (std::size_t a = 0; a < joints_.size(); ++a) search_along(sample, a);
    }
}

/// Move one joint to the angle of its range that explains the efforts best.
///
/// Among angles that explain them equally well, the nearest to the one before is taken.
void EncoderlessSolver::search_along(const EncoderlessSample& sample, std::size_t a) {
    const EncoderlessJoint& joint = joints_[a];
    const double before = angle_of(a);
    double best = before, least = 1e300;
    for (int k = 0; k < ANGLES; ++k) {
        angle_of(a) = joint.lower + joint.range() * (k / (ANGLES - 1.0));
        const bool solved = evaluate(sample);
        const double away = (angle_of(a) - before) / joint.range();
        const double total = misfit(sample) + 1e-3 * away * away;
        if (solved && total < least) {
            best = angle_of(a);
            least = total;
        }
    }
    angle_of(a) = best;
}

}  // namespace cdrj

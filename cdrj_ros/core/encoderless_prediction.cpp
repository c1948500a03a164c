// Prediction of the joints without encoder from cables and loads, (M1) of docs/motor_alone.md.
#include <algorithm>
#include <cmath>

#include "encoderless.hpp"

namespace cdrj {

void EncoderlessSolver::predict(const EncoderlessSample& sample) {
    evaluate(sample);
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
/// since the state. `work_` is that of the angles before.
void EncoderlessSolver::turn_with_cables(const EncoderlessSample& sample) {
    equations_.clear();
    for (Index c = 0; c < sample.robot.topology.sizes.cables; ++c) {
        const double longer = elongation(sample, c);
        equations_.weigh(arms_, -longer, 1.0);
    }
    double most = 0.0;
    for (std::size_t a = 0; a < joints_.size(); ++a) most = std::max(most, equations_.matrix(a, a));
    if (!(most > 0.0)) return;
    for (std::size_t a = 0; a < joints_.size(); ++a) equations_.matrix(a, a) += 1e-9 * most;
    move();
}

/// By how much winches and measured joints have made a cable longer since the state [m].
///
/// `arms_` becomes by how much it gets longer per unit of each angle without encoder.
double EncoderlessSolver::elongation(const EncoderlessSample& sample, Index c) {
    const auto& [topology, constants] = sample.robot;
    const CableTopology& cable = topology.cables[c];
    const State before(topology.sizes, sample.state.data());
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
        const Index motor = topology.ends[end].motor;
        if (motor < 0) continue;
        const EndConstants& drum = constants.ends[end];
        taken += drum.radius * drum.winding * (sample.motor_angle[motor] - before.angle[motor]);
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
        const double load = estimate_.joint_effort[joints_[k].joint];
        const double weight = 1.0 / (drift * drift * sample.dt);
        equations_.weigh(by_load_.row(k), sample.memory.load[k] - load, weight);
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

}  // namespace cdrj

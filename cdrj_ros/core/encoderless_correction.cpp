// Correction of the joints without encoder by the measured efforts, (M2) of docs/motor_alone.md, and
// the search of their angles where nothing else is known of them.
#include <algorithm>
#include <cmath>

#include "encoderless.hpp"

namespace cdrj {
namespace {

/// T of (M2): time over which the error of an effort persists [s].
constexpr double CORRELATED = 0.05;

/// Angles of each joint that are tried where the angle is unknown.
constexpr int PLACES = 301;

/// Rounds of a search over several joints.
constexpr int ROUNDS = 3;

double squared(double number) { return number * number; }

}  // namespace

void EncoderlessSolver::correct(const EncoderlessSample& sample) {
    equations_.matrix = sample.memory.covariance;
    invert(equations_.matrix, information_);
    for (int step = 0; step < STEPS; ++step) {
        if (!differentiate(sample)) break;
        weigh_correction(sample);
        const bool arrived = move();
        sample.memory.covariance = equations_.inverse;
        if (arrived) break;
    }
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
    for (std::size_t m = 0; m < effort_noise_.size(); ++m) {
        if (!std::isfinite(sample.effort[m])) continue;
        const double weight = independent / squared(effort_noise_[m]);
        equations_.weigh(by_effort_.row(m), sample.effort[m] - estimate_.motor_effort[m], weight);
    }
}

/// Sum of the squared differences of measured and estimated efforts, in standard deviations.
double EncoderlessSolver::misfit(const EncoderlessSample& sample) const {
    double total = 0.0;
    for (std::size_t m = 0; m < effort_noise_.size(); ++m) {
        if (!std::isfinite(sample.effort[m])) continue;
        total += squared((sample.effort[m] - estimate_.motor_effort[m]) / effort_noise_[m]);
    }
    return total;
}

/// Search the angles over their ranges: one joint after the other, several times if there are several.
void EncoderlessSolver::search(const EncoderlessSample& sample) {
    const int rounds = joints_.size() == 1 ? 1 : ROUNDS;
    for (int round = 0; round < rounds; ++round) {
        for (std::size_t a = 0; a < joints_.size(); ++a) search_along(sample, a);
    }
    aim();
    sample.memory.covariance.fill(0.0);
    for (std::size_t a = 0; a < joints_.size(); ++a) {
        sample.memory.covariance(a, a) = joints_[a].variance();
    }
}

/// Move one joint to the angle of its range that explains the efforts best.
///
/// Among angles that explain them equally well, the nearest to the one before is taken.
void EncoderlessSolver::search_along(const EncoderlessSample& sample, std::size_t a) {
    const EncoderlessJoint& joint = joints_[a];
    const double before = angle_of(a);
    double best = before, least = 1e300;
    for (int place = 0; place < PLACES; ++place) {
        angle_of(a) = joint.lower + joint.range() * (place / (PLACES - 1.0));
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

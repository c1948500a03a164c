// The estimate of a robot with joints without encoder, and its members. docs/model.md.
#include "encoderless.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace cdrj {

EncoderlessEstimator::EncoderlessEstimator(
    Ensemble& ensemble, std::vector<EncoderlessJoint> joints, std::vector<double> effort_noise)
    : ensemble_(ensemble),
      solver_(ensemble.robot(), std::move(joints), std::move(effort_noise)),
      history_(before_first_sample()),
      motor_angle_(ensemble.robot().topology.sizes.motors),
      measured_angle_(measured_joints()),
      effort_(motor_angle_.size()) {}

EncoderlessEstimator::History EncoderlessEstimator::before_first_sample() const {
    const auto members = static_cast<std::size_t>(ensemble_.members());
    return {
        .state = std::vector<double>(ensemble_.robot().state_size(), 0.0),
        .stamp_ns = 0,
        .nominal = EncoderlessMemory(joints()),
        .members = std::vector<EncoderlessMemory>(members, EncoderlessMemory(joints())),
        .deviation = DenseMatrix(members, joints()),
        .variance = std::vector<double>(joints(), 0.0),
    };
}

void EncoderlessEstimator::take(
    const EncoderlessReadings& readings, const EncoderlessResults& results) {
    if (std::ranges::none_of(readings.effort, [](double one) { return std::isfinite(one); })) {
        reset();
        write_unknown(results);
        return;
    }
    const bool first = !history_.nominal.started;
    const bool due = first || ensemble_.is_due(readings.stamp_ns);
    const std::vector<double> none(ensemble_.robot().topology.sizes.pulleys, 0.0);
    std::ranges::copy(readings.motor_angle, motor_angle_.begin());
    std::ranges::copy(readings.measured_angle, measured_angle_.begin());
    std::ranges::copy(readings.effort, effort_.begin());
    solve(
        ensemble_.robot(), none, history_.state, history_.nominal,
        readings.stamp_ns - history_.stamp_ns);
    history_.stamp_ns = readings.stamp_ns;
    std::ranges::copy(solver_.estimate(), results.estimate.begin());
    std::ranges::copy(history_.nominal.angle, results.angle.begin());
    const Index members = ensemble_.members();
    const Index updated = first ? members : due ? std::min<Index>(members, 1) : 0;
    for (Index k = 0; k < updated; ++k) update_member(readings, results);
    // (U5) is in the lasting errors of the members' efforts
    ensemble_.write_stddev(results.estimate, results.stddev);
    for (std::size_t a = 0; a < joints(); ++a) {
        const double spread = std::max(history_.variance[a], 0.0);
        results.angle_stddev[a] = std::sqrt(spread + history_.nominal.covariance(a, a));
    }
}

void EncoderlessEstimator::reset() {
    const Nanoseconds stamp_ns = history_.stamp_ns;
    history_ = before_first_sample();
    history_.stamp_ns = stamp_ns;
    ensemble_.start_anew();
}

void EncoderlessEstimator::keep() {
    if (!kept_) kept_ = history_;
    ensemble_.keep();
}

void EncoderlessEstimator::roll_back() {
    if (!kept_) return;
    history_ = *std::exchange(kept_, std::nullopt);
    ensemble_.roll_back();
}

/// Solve the readings in `motor_angle_`, `measured_angle_` and `effort_` for one robot.
///
/// `since`: time since its last sample, if it has had one.
void EncoderlessEstimator::solve(
    const Robot& robot, std::span<const double> share, std::span<double> state,
    EncoderlessMemory& memory, Nanoseconds since) {
    const double dt = memory.started ? static_cast<double>(since) * 1e-9 : 0.0;
    solver_.solve({robot, share, state, memory, motor_angle_, measured_angle_, effort_, dt});
}

/// Update the member whose turn it is, with its own errors of the readings.
void EncoderlessEstimator::update_member(
    const EncoderlessReadings& readings, const EncoderlessResults& results) {
    const Index member = ensemble_.next_member();
    const std::span<const double> errors = ensemble_.errors_of(member);
    const std::size_t motors = motor_angle_.size();
    const std::vector<Index>& measured = solver_.measured_joints();
    for (std::size_t m = 0; m < motors; ++m) {
        motor_angle_[m] = readings.motor_angle[m] + errors[m];
        effort_[m] = readings.effort[m] + ensemble_.draws.effort_error[member * motors + m];
    }
    for (std::size_t a = 0; a < measured.size(); ++a) {
        measured_angle_[a] = readings.measured_angle[a] + errors[motors + measured[a]];
    }
    EncoderlessMemory& memory = history_.members[member];
    const Index cables = ensemble_.cables();
    const auto stamps = std::span(ensemble_.memory.stamps).subspan(member * cables, cables);
    const std::size_t pulleys = ensemble_.robot().topology.sizes.pulleys;
    solve(
        ensemble_.population[member],
        std::span(ensemble_.draws.friction_share).subspan(member * pulleys, pulleys),
        ensemble_.population.state(member), memory, readings.stamp_ns - stamps.front());
    std::ranges::fill(stamps, readings.stamp_ns);
    ensemble_.compare(readings.stamp_ns, solver_.estimate(), results.estimate);
    const auto members = static_cast<double>(ensemble_.members());
    for (std::size_t a = 0; a < joints(); ++a) {
        double& before = history_.deviation(member, a);
        const double now = memory.angle[a] - results.angle[a];
        history_.variance[a] += (now * now - before * before) / members;
        before = now;
    }
}

void EncoderlessEstimator::write_unknown(const EncoderlessResults& results) const {
    constexpr double UNKNOWN = std::numeric_limits<double>::quiet_NaN();
    std::ranges::fill(results.estimate, UNKNOWN);
    Estimate estimate(ensemble_.robot().topology.sizes, results.estimate.data());
    std::ranges::fill(estimate.status, static_cast<double>(INVALID));
    std::ranges::fill(results.stddev, UNKNOWN);
    std::ranges::fill(results.angle, UNKNOWN);
    std::ranges::fill(results.angle_stddev, UNKNOWN);
}

}  // namespace cdrj

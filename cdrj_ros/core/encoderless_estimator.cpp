#include "encoderless_estimator.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "report.hpp"

namespace cdrj {

EncoderlessEstimator::EncoderlessEstimator(
    EncoderlessEnsemble ensemble, std::vector<EncoderlessJoint> joints,
    std::vector<double> effort_noise)
    : ensemble_(std::move(ensemble)),
      solver_(ensemble_.robots[0].robot, std::move(joints), std::move(effort_noise)),
      motor_angle_(sizes().motors),
      measured_angle_(measured_joints()),
      effort_(sizes().motors) {
    const std::size_t robots = ensemble_.robots.size(), state = ensemble_.robots[0].robot.state_size();
    const std::size_t quantities = columns() + this->joints();
    history_ = {
        std::vector<OfRobot>(
            robots, {std::vector<double>(state, 0.0), EncoderlessMemory(this->joints()), 0}),
        0, 0, DenseMatrix(robots - 1, quantities), std::vector<double>(quantities, 0.0)};
}

void EncoderlessEstimator::take(
    const EncoderlessReadings& readings, const EncoderlessResults& results) {
    if (std::ranges::none_of(readings.effort, [](double one) { return std::isfinite(one); })) {
        forget();
        write_unknown(results);
        return;
    }
    const bool first = !history_.robots[0].memory.started;
    const bool due = first || readings.stamp_ns - history_.updated_ns >= APART_NS;
    solve(0, readings);
    std::ranges::copy(solver_.estimate(), results.estimate.begin());
    std::ranges::copy(history_.robots[0].memory.angle, results.angle.begin());
    const std::size_t members = ensemble_.robots.size() - 1;
    const std::size_t updated = first ? members : due ? std::min<std::size_t>(members, 1) : 0;
    for (std::size_t k = 0; k < updated; ++k) update_member(readings, results);
    write_stddev(results);
}

void EncoderlessEstimator::forget() {
    for (OfRobot& one : history_.robots) {
        std::ranges::fill(one.state, 0.0);
        one.memory = EncoderlessMemory(joints());
    }
    history_.updates = 0;
    history_.deviation.fill(0.0);
    std::ranges::fill(history_.variance, 0.0);
}

void EncoderlessEstimator::look_ahead() {
    if (!before_look_) before_look_ = history_;
}

void EncoderlessEstimator::look_back() {
    if (before_look_) history_ = *std::exchange(before_look_, std::nullopt);
}

/// Solve a sample with the numbers and the history of one robot; a member reads with its errors.
void EncoderlessEstimator::solve(std::size_t robot, const EncoderlessReadings& readings) {
    const EncoderlessRobot& own = ensemble_.robots[robot];
    OfRobot& history = history_.robots[robot];
    const std::size_t rows = ensemble_.reading_errors.rows(), motors = motor_angle_.size();
    const auto error = [&](std::size_t axis) {
        return robot == 0 ? 0.0 : ensemble_.reading_errors(history_.updates % rows, axis);
    };
    for (std::size_t m = 0; m < motors; ++m) {
        motor_angle_[m] = readings.motor_angle[m] + error(m);
        effort_[m] = readings.effort[m] + own.effort_error[m];
    }
    for (std::size_t a = 0; a < measured_angle_.size(); ++a) {
        measured_angle_[a] = readings.measured_angle[a] + error(motors + a);
    }
    const double since = static_cast<double>(readings.stamp_ns - history.stamp_ns) * 1e-9;
    const double dt = history.memory.started ? since : 0.0;
    solver_.solve(
        {own.robot, own.share, history.state, history.memory, motor_angle_, measured_angle_, effort_,
         dt});
    history.stamp_ns = readings.stamp_ns;
}

/// Update the member whose turn it is.
void EncoderlessEstimator::update_member(
    const EncoderlessReadings& readings, const EncoderlessResults& results) {
    const std::size_t member = history_.updates % (ensemble_.robots.size() - 1);
    solve(1 + member, readings);
    note_deviation(member, results);
    ++history_.updates;
    history_.updated_ns = readings.stamp_ns;
}

/// Note a member's difference from the estimate, and its part of the variance.
void EncoderlessEstimator::note_deviation(std::size_t member, const EncoderlessResults& results) {
    const double members = static_cast<double>(ensemble_.robots.size() - 1);
    const std::vector<double>& angle = history_.robots[1 + member].memory.angle;
    const std::span<const double> estimate = solver_.estimate();
    for (std::size_t c = 0; c < history_.variance.size(); ++c) {
        double difference;
        if (c < columns()) {
            const Index column = ensemble_.columns[c];
            difference = estimate[column] - results.estimate[column];
        } else {
            difference = angle[c - columns()] - results.angle[c - columns()];
        }
        if (!std::isfinite(difference)) continue;
        const double before = history_.deviation(member, c);
        history_.variance[c] += (difference * difference - before * before) / members;
        history_.deviation(member, c) = difference;
    }
}

/// Standard deviations of the quantities, with (U6), and of the angles.
///
/// There is no model error (U5): the members' lasting errors of the efforts contain it.
void EncoderlessEstimator::write_stddev(const EncoderlessResults& results) const {
    for (std::size_t c = 0; c < columns(); ++c) {
        double total = std::max(history_.variance[c], 0.0);
        const double slack = ensemble_.slack[c];
        if (std::abs(results.estimate[ensemble_.columns[c]]) <= slack) {
            total = std::max(total, slack * slack);
        }
        results.stddev[c] = std::sqrt(total);
    }
    const DenseMatrix& covariance = history_.robots[0].memory.covariance;
    for (std::size_t a = 0; a < joints(); ++a) {
        const double spread = std::max(history_.variance[columns() + a], 0.0);
        results.angle_stddev[a] = std::sqrt(spread + covariance(a, a));
    }
}

void EncoderlessEstimator::write_unknown(const EncoderlessResults& results) const {
    constexpr double UNKNOWN = std::numeric_limits<double>::quiet_NaN();
    std::ranges::fill(results.estimate, UNKNOWN);
    Estimate estimate(sizes(), results.estimate.data());
    std::ranges::fill(estimate.status, static_cast<double>(INVALID));
    std::ranges::fill(results.stddev, UNKNOWN);
    std::ranges::fill(results.angle, UNKNOWN);
    std::ranges::fill(results.angle_stddev, UNKNOWN);
}

}  // namespace cdrj

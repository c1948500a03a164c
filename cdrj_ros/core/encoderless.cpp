#include "encoderless.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace cdrj {
namespace {

/// A difference between measured and estimated effort above this multiple of the effort's standard
/// deviation means that a joint is lost,
constexpr double LOST = 5.0;

/// if it lasts this long [s].
constexpr double LOST_FOR = 0.05;

/// A Gauss-Newton step below this fraction of the difference step ends the iteration.
constexpr double TOLERANCE = 0.01;

/// Largest Gauss-Newton step, as a multiple of the difference step.
constexpr double LARGEST_STEP = 150.0;

}  // namespace

EncoderlessSolver::EncoderlessSolver(
    const Robot& robot, std::vector<EncoderlessJoint> joints, std::vector<double> effort_noise)
    : joints_(std::move(joints)),
      effort_noise_(std::move(effort_noise)),
      any_load_known_(std::ranges::any_of(
          joints_, [](const EncoderlessJoint& one) { return one.load_drift > 0.0; })),
      state_size_(robot.state_size()),
      estimate_size_(robot.estimate_size()),
      out_(robot.out_size(), 0.0),
      estimate_(robot.topology.sizes, out_.data() + state_size_),
      work_(robot.topology.sizes, out_.data() + state_size_ + estimate_size_),
      angle_(robot.topology.sizes.joints, 0.0),
      by_effort_(effort_noise_.size(), joints_.size()),
      by_load_(joints_.size(), joints_.size()),
      arms_(joints_.size(), 0.0),
      target_(joints_.size(), 0.0),
      information_(joints_.size(), joints_.size()),
      equations_(joints_.size()) {
    for (Index j = 0; j < robot.topology.sizes.joints; ++j) {
        if (std::ranges::find(joints_, j, &EncoderlessJoint::joint) == joints_.end()) {
            measured_.push_back(j);
        }
    }
}

void EncoderlessSolver::solve(const EncoderlessSample& sample) {
    EncoderlessMemory& memory = sample.memory;
    for (std::size_t k = 0; k < measured_.size(); ++k) {
        angle_[measured_[k]] = sample.measured_angle[k];
    }
    if (!memory.started) return start(sample);
    for (std::size_t a = 0; a < joints_.size(); ++a) angle_of(a) = memory.angle[a];
    if (sample.dt > 0.0) {
        predict(sample);
        correct(sample);
    }
    evaluate(sample);
    const double motors = static_cast<double>(sample.effort.size());
    const bool unexplained = misfit(sample) > LOST * LOST * motors;
    memory.lost = unexplained ? memory.lost + sample.dt : 0.0;
    if (memory.lost > LOST_FOR) {
        search(sample);
        correct(sample);
        evaluate(sample);
        memory.lost = 0.0;
    }
    accept(sample);
}

void EncoderlessSolver::start(const EncoderlessSample& sample) {
    std::ranges::fill(sample.state, 0.0);
    for (std::size_t a = 0; a < joints_.size(); ++a) angle_of(a) = joints_[a].start;
    search(sample);
    correct(sample);
    evaluate(sample);
    if (*State(sample.robot.topology.sizes, out_.data()).started == 0.0) return;  // no such pose
    sample.robot.impose_friction(sample.share, out_.data());
    std::copy_n(out_.begin(), sample.state.size(), sample.state.begin());
    search(sample);
    correct(sample);
    evaluate(sample);
    accept(sample);
}

void EncoderlessSolver::accept(const EncoderlessSample& sample) {
    sample.memory.started = true;
    std::copy_n(out_.begin(), sample.state.size(), sample.state.begin());
    for (std::size_t a = 0; a < joints_.size(); ++a) {
        sample.memory.angle[a] = angle_of(a);
        sample.memory.load[a] = estimate_.joint_effort[joints_[a].joint];
    }
}

bool EncoderlessSolver::evaluate(const EncoderlessSample& sample) {
    return sample.robot.advance(
        sample.state.data(), sample.motor_angle, angle_, sample.dt, out_.data());
}

bool EncoderlessSolver::differentiate(const EncoderlessSample& sample) {
    bool solved = true;
    const std::size_t motors = by_effort_.rows(), count = joints_.size();
    for (std::size_t a = 0; a < count; ++a) {
        const double before = angle_of(a);
        angle_of(a) += joints_[a].difference();
        solved = evaluate(sample) && solved;
        angle_of(a) = before;
        for (std::size_t m = 0; m < motors; ++m) by_effort_(m, a) = estimate_.motor_effort[m];
        for (std::size_t b = 0; b < count; ++b) {
            by_load_(b, a) = estimate_.joint_effort[joints_[b].joint];
        }
    }
    solved = evaluate(sample) && solved;
    for (std::size_t a = 0; a < count; ++a) {
        const double difference = joints_[a].difference();
        for (std::size_t m = 0; m < motors; ++m) {
            by_effort_(m, a) = (by_effort_(m, a) - estimate_.motor_effort[m]) / difference;
        }
        for (std::size_t b = 0; b < count; ++b) {
            const double load = estimate_.joint_effort[joints_[b].joint];
            by_load_(b, a) = (by_load_(b, a) - load) / difference;
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

}  // namespace cdrj

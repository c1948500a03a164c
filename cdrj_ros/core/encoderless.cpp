// The estimate of a robot with joints without encoder, and its members. docs/model.md.
#include "encoderless.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "residual.hpp"

namespace cdrj {
namespace {

/// The joints in groups that share no cable and no motor, through any number of cables.
std::vector<EncoderlessGroup> groups_of(
    const Topology& topology, const std::vector<EncoderlessJoint>& joints) {
    const Sizes& sizes = topology.sizes;
    const Paths& paths = *topology.paths;
    std::vector<char> connects(sizes.axes(), 0), seen(sizes.axes(), 0);
    std::fill_n(connects.begin(), sizes.motors, 1);
    for (const EncoderlessJoint& joint : joints) connects[sizes.motors + joint.joint] = 1;
    std::vector<EncoderlessGroup> groups;
    for (const EncoderlessJoint& joint : joints) {
        if (seen[sizes.motors + joint.joint]) continue;
        EncoderlessGroup group;
        group.axes = {sizes.motors + joint.joint};
        seen[group.axes.front()] = 1;
        for (std::size_t k = 0; k < group.axes.size(); ++k) {  // which grows
            for (const Index c : paths.cables_of_axis[group.axes[k]]) {
                group.cables.push_back(c);
                for (const Index a : paths.of_cable[c].axes) {
                    if (connects[a] && !std::exchange(seen[a], 1)) group.axes.push_back(a);
                }
            }
        }
        for (std::vector<Index>* list : {&group.axes, &group.cables}) {
            std::ranges::sort(*list);
            list->erase(std::unique(list->begin(), list->end()), list->end());
        }
        for (const Index a : group.axes) {
            if (a < sizes.motors) group.motors.push_back(a);
        }
        for (std::size_t k = 0; k < joints.size(); ++k) {
            if (std::ranges::binary_search(group.axes, sizes.motors + joints[k].joint)) {
                group.places.push_back(k);
            }
        }
        for (const Index f : paths.all.frames) {
            const auto moves = [&](Index c) {
                return std::ranges::binary_search(paths.of_cable[c].frames, f);
            };
            if (std::ranges::any_of(group.cables, moves)) group.frames.push_back(f);
        }
        groups.push_back(std::move(group));
    }
    return groups;
}

std::vector<EncoderlessSolver> solvers_of(
    const Robot& robot, const std::vector<EncoderlessJoint>& joints,
    const std::vector<double>& effort_noise, std::span<double> out) {
    std::vector<EncoderlessSolver> solvers;
    for (EncoderlessGroup& group : groups_of(robot.topology, joints)) {
        solvers.emplace_back(robot, joints, std::move(group), effort_noise, out);
    }
    return solvers;
}

}  // namespace

EncoderlessEstimator::EncoderlessEstimator(
    Ensemble& ensemble, std::vector<EncoderlessJoint> joints, std::vector<double> effort_noise)
    : ensemble_(ensemble),
      joints_(std::move(joints)),
      out_(ensemble.robot().out_size()),
      solvers_(solvers_of(ensemble.robot(), joints_, effort_noise, out_)),
      rest_(ensemble.robot().topology.paths->all),
      angle_(ensemble.robot().topology.sizes.joints),
      history_(before_first_sample()),
      motor_angle_(ensemble.robot().topology.sizes.motors),
      effort_(motor_angle_.size()) {
    for (Index j = 0; j < ensemble.robot().topology.sizes.joints; ++j) {
        if (std::ranges::find(joints_, j, &EncoderlessJoint::joint) == joints_.end()) {
            measured_.push_back(j);
        }
    }
    measured_angle_.resize(measured_.size());
    for (const EncoderlessSolver& one : solvers_) {
        for (const Index c : one.group.cables) std::erase(rest_.cables, c);
    }
}

EncoderlessEstimator::History EncoderlessEstimator::before_first_sample() const {
    const auto members = static_cast<std::size_t>(ensemble_.members());
    Memory memory;
    for (const EncoderlessSolver& one : solvers_) memory.groups.emplace_back(one.group.places.size());
    return {
        .state = std::vector<double>(ensemble_.robot().state_size(), 0.0),
        .stamp_ns = 0,
        .nominal = memory,
        .members = std::vector<Memory>(members, memory),
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
    std::ranges::copy(estimate(), results.estimate.begin());
    for (std::size_t a = 0; a < joints(); ++a) results.angle[a] = angle_[joints_[a].joint];
    const Index members = ensemble_.members();
    const Index updated = first ? members : due ? std::min<Index>(members, 1) : 0;
    for (Index k = 0; k < updated; ++k) update_member(readings, results);
    // (U5) is in the lasting errors of the members' efforts
    ensemble_.write_stddev(results.estimate, results.stddev);
    for (std::size_t g = 0; g < solvers_.size(); ++g) {
        const std::vector<std::size_t>& places = solvers_[g].group.places;
        for (std::size_t k = 0; k < places.size(); ++k) {
            const double spread = std::max(history_.variance[places[k]], 0.0);
            const double own = history_.nominal.groups[g].covariance(k, k);
            results.angle_stddev[places[k]] = std::sqrt(spread + own);
        }
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

/// Solve the readings in `motor_angle_`, `measured_angle_` and `effort_` for one robot, group by group.
///
/// `since`: time since its last sample, if it has had one. `estimated`: of a member, what the nominal robot
/// remembers. Where a cable has no path in any pose that was tried at the start, state and memory stay as if
/// there had been no sample.
void EncoderlessEstimator::solve(
    const Robot& robot, std::span<const double> share, std::span<double> state, Memory& memory,
    Nanoseconds since, const Memory* estimated) {
    const double dt = memory.started ? static_cast<double>(since) * 1e-9 : 0.0;
    for (std::size_t k = 0; k < measured_.size(); ++k) angle_[measured_[k]] = measured_angle_[k];
    const auto advance = [&](bool anew) {
        bool solved = true;
        for (std::size_t g = 0; g < solvers_.size(); ++g) {
            EncoderlessMemory& own = memory.groups[g];
            EncoderlessSample sample{
                robot, state, own, motor_angle_, measured_angle_, effort_, dt};
            if (estimated != nullptr) sample.near = estimated->groups[g].angle;
            solved = solvers_[g].solve(sample, anew) && solved;
            const std::vector<std::size_t>& places = solvers_[g].group.places;
            for (std::size_t k = 0; k < places.size(); ++k) {
                angle_[joints_[places[k]].joint] = own.angle[k];
            }
        }
        Step step(robot, state.data(), out_.data());
        solved = advance_cables(step, rest_, {motor_angle_, angle_, dt}) && solved;
        correct_outputs(step, dt, solved);
    };
    if (!memory.started) {
        std::ranges::fill(state, 0.0);
        for (std::size_t g = 0; g < solvers_.size(); ++g) {
            const std::vector<std::size_t>& places = solvers_[g].group.places;
            for (std::size_t k = 0; k < places.size(); ++k) {
                memory.groups[g].angle[k] = joints_[places[k]].start;
            }
        }
        advance(true);
        const State after(robot.topology.sizes, out_.data());
        for (Index c = 0; c < robot.topology.sizes.cables; ++c) {
            if (!after.holds(robot.topology.segments_of(c).first)) return;
        }
        robot.impose_friction(share, out_.data());
        std::copy_n(out_.begin(), state.size(), state.begin());
    }
    advance(!memory.started);
    std::copy_n(out_.begin(), state.size(), state.begin());
    memory.started = true;
}

std::span<const double> EncoderlessEstimator::estimate() const {
    const Robot& robot = ensemble_.robot();
    return std::span(out_).subspan(robot.state_size(), robot.estimate_size());
}

/// Update the member whose turn it is, with its own errors of the readings.
void EncoderlessEstimator::update_member(
    const EncoderlessReadings& readings, const EncoderlessResults& results) {
    const Index member = ensemble_.next_member();
    const std::span<const double> errors = ensemble_.errors_of(member);
    const std::size_t motors = motor_angle_.size();
    const std::vector<Index>& measured = measured_;
    for (std::size_t m = 0; m < motors; ++m) {
        motor_angle_[m] = readings.motor_angle[m] + errors[m];
        effort_[m] = readings.effort[m] + ensemble_.draws.effort_error[member * motors + m];
    }
    for (std::size_t a = 0; a < measured.size(); ++a) {
        measured_angle_[a] = readings.measured_angle[a] + errors[motors + measured[a]];
    }
    Memory& memory = history_.members[member];
    const Index cables = ensemble_.cables();
    const auto stamps = std::span(ensemble_.memory.stamps).subspan(member * cables, cables);
    const std::size_t pulleys = ensemble_.robot().topology.sizes.pulleys;
    solve(
        ensemble_.population[member],
        std::span(ensemble_.draws.friction_share).subspan(member * pulleys, pulleys),
        ensemble_.population.state(member), memory, readings.stamp_ns - stamps.front(),
        &history_.nominal);
    std::ranges::fill(stamps, readings.stamp_ns);
    ensemble_.compare(readings.stamp_ns, estimate(), results.estimate);
    const auto members = static_cast<double>(ensemble_.members());
    for (std::size_t a = 0; a < joints(); ++a) {
        double& before = history_.deviation(member, a);
        const double now = angle_[joints_[a].joint] - results.angle[a];
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

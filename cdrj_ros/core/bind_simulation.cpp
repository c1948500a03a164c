// Motion of the simulated rig, as `cdrj_ros.rig` uses it.
#include <pybind11/numpy.h>

#include "arrays.hpp"
#include "bind.hpp"
#include "bind_robot.hpp"
#include "simulation.hpp"

namespace py = pybind11;
using namespace py::literals;

namespace cdrj {
namespace {

using Flags = py::array_t<bool, py::array::c_style>;

/// Row `k` of a table, to be written.
std::span<double> written_row(Matrix& table, py::ssize_t k) {
    return {begin_of_row(table, k), std::size_t(table.shape(1))};
}

void require_rows(const py::array& table, py::ssize_t rows, Index columns, const char* name) {
    if (table.ndim() == 2 && table.shape(0) == rows && table.shape(1) == columns) return;
    throw py::value_error(std::string(name) + " has not the shape of this robot's");
}

void require_state(const Vector& state, const HeldRobot& held, Index joint) {
    require(
        state.size() == py::ssize_t(held.robot.state_size()),
        "state has not the size of this robot's");
    require(0 <= joint && joint < held.robot.topology.sizes.joints, "there is no such joint");
}

/// Effort on a joint for many drives of the motors, without a state before.
void scan(
    const HeldRobot& held, const Given& base, const Given& direction, const Given& drives,
    const Given& joint_angle, Index joint, Vector& efforts) {
    const Sizes& sizes = held.robot.topology.sizes;
    held.require_angles(base.size(), joint_angle.size());
    require(direction.size() == base.size(), "direction needs an entry for every motor");
    require(efforts.size() == drives.size(), "efforts needs an entry for every drive");
    std::vector<double> state(held.robot.state_size(), 0.0);
    Trials trials(held.robot, state, joint);
    std::vector<double> motor_angle(sizes.motors);
    py::gil_scoped_release free;
    for (py::ssize_t k = 0; k < drives.size(); ++k) {
        for (Index m = 0; m < sizes.motors; ++m) {
            motor_angle[m] = base.data()[m] + direction.data()[m] * drives.data()[k];
        }
        efforts.mutable_data()[k] = trials.effort(motor_angle, span_of(joint_angle), 0.0);
    }
}

/// Samples of a balanced joint; see `_core.pyi`.
py::tuple balance(
    const HeldRobot& held, Vector& state, double drive, double rising, Index phase, bool excused,
    const Given& joints, const Given& torque, const Given& dt, double motor_speed, Index joint,
    Matrix& base, const Given& direction, const Given& offset, const Flags& happening,
    Vector& drives, py::array_t<Index, py::array::c_style>& phases, Vector& lacking,
    Matrix& estimates) {
    const Sizes& sizes = held.robot.topology.sizes;
    const py::ssize_t samples = dt.size();
    require_state(state, held, joint);
    require_rows(joints, torque.size(), sizes.joints, "joints");
    require_rows(base, torque.size(), sizes.motors, "base");
    require_rows(offset, samples, sizes.motors, "offset");
    require_rows(estimates, samples, Index(held.robot.estimate_size()), "estimates");
    require(
        direction.size() == sizes.motors && happening.size() == samples &&
            drives.size() == samples && phases.size() == samples && lacking.size() == samples &&
            0 <= phase && phase < torque.size(),
        "the arrays differ in their numbers of samples");
    BalancedJoint balanced{span_of(direction), rising, motor_speed, drive, phase, excused};
    const BalancedJoint::Motion motion{
        {const_cast<double*>(joints.data()), sizes.joints}, span_of(torque),
        {base.mutable_data(), sizes.motors}};
    Trials trials(held.robot, {state.mutable_data(), std::size_t(state.size())}, joint);
    for (py::ssize_t k = 0; k < samples; ++k) {
        const auto outcome = balanced.step(
            trials, motion, row_of(offset, k), happening.data()[k], dt.data()[k]);
        if (!outcome.balanced) {
            return py::make_tuple(
                k, balanced.drive, balanced.phase, balanced.excused, outcome.asked);
        }
        drives.mutable_data()[k] = balanced.drive;
        phases.mutable_data()[k] = balanced.phase;
        lacking.mutable_data()[k] = outcome.imbalance;
        trials.keep(written_row(estimates, k));
    }
    return py::make_tuple(samples, balanced.drive, balanced.phase, balanced.excused, 0.0);
}

/// Steps of a free joint within its range; see `_core.pyi`.
py::ssize_t swing(
    const HeldRobot& held, Vector& state, Vector& course, const std::array<double, 6>& load,
    Index joint, double effort_sign, double lower, double upper, const Given& motors,
    Matrix& joints, const Given& dt, Vector& residual, Matrix& estimates) {
    const Sizes& sizes = held.robot.topology.sizes;
    const py::ssize_t steps = dt.size();
    require_state(state, held, joint);
    require(course.size() == 4 && residual.size() == steps, "course or residual has another size");
    require_rows(motors, steps, sizes.motors, "motors");
    require_rows(joints, steps, sizes.joints, "joints");
    require_rows(estimates, steps, Index(held.robot.estimate_size()), "estimates");
    const FreeJoint moving{
        {load[0], load[1], load[2], load[3], load[4], load[5]}, joint, effort_sign, lower, upper};
    auto& present = *reinterpret_cast<Swing*>(course.mutable_data());
    Trials trials(held.robot, {state.mutable_data(), std::size_t(state.size())}, joint);
    std::vector<double> pose(sizes.joints);
    py::gil_scoped_release free;
    for (py::ssize_t k = 0; k < steps; ++k) {
        std::copy_n(begin_of_row(joints, k), pose.size(), pose.begin());
        const double excess =
            moving.step(trials, present, row_of(motors, k), pose, dt.data()[k]);
        if (!moving.is_in_range(pose[joint])) return k;
        *joints.mutable_data(k, joint) = pose[joint];
        residual.mutable_data()[k] = excess;
        trials.keep(written_row(estimates, k));
    }
    return steps;
}

}  // namespace

void bind_simulation(py::module_& core) {
    core.def(
        "scan", scan, "robot"_a, "base"_a, "direction"_a, "drives"_a, "joint_angle"_a, "joint"_a,
        "efforts"_a.noconvert());
    core.def(
        "balance", balance, "robot"_a, "state"_a.noconvert(), "drive"_a, "rising"_a, "phase"_a,
        "excused"_a, "joints"_a, "torque"_a, "dt"_a, "motor_speed"_a, "joint"_a,
        "base"_a.noconvert(), "direction"_a, "offset"_a, "happening"_a,
        "drives"_a.noconvert(), "phases"_a.noconvert(), "lacking"_a.noconvert(),
        "estimates"_a.noconvert());
    core.def(
        "swing", swing, "robot"_a, "state"_a.noconvert(), "course"_a.noconvert(), "load"_a,
        "joint"_a, "effort_sign"_a, "lower"_a, "upper"_a, "motors"_a, "joints"_a.noconvert(),
        "dt"_a, "residual"_a.noconvert(), "estimates"_a.noconvert());
}

}  // namespace cdrj

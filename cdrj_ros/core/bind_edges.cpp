// What lies at the edges of an estimator: messages that come and go, as nodes and `cdrj_ros.recordings` use
// them, and the stepper of the simulated rig.
#include <algorithm>
#include <string>
#include <vector>

#include "bind.hpp"
#include "messages.hpp"
#include "simulation.hpp"

namespace py = pybind11;
using namespace py::literals;

namespace cdrj {
namespace {

py::tuple names_of(const JointStateDecoder& decoder) {
    const std::vector<std::string>& names = decoder.last().names;
    py::tuple found(names.size());
    for (std::size_t i = 0; i < names.size(); ++i) found[i] = py::str(names[i]);
    return found;
}

using Numbers = std::vector<std::array<std::size_t, 3>>;

std::vector<CopiedNumbers> copied(const Numbers& numbers) {
    std::vector<CopiedNumbers> found;
    for (const auto& [offset, first, count] : numbers) found.push_back({offset, first, count});
    return found;
}

MessageEncoder encoder_of(
    const py::bytes& blank, const Numbers& values, const Numbers& stddevs, const Numbers& flags) {
    MessageContent content{copied(values), copied(stddevs), {}};
    for (const auto& [offset, before, after] : flags) {
        content.flags.push_back({offset, before, after});
    }
    return {std::string(blank), std::move(content)};
}

py::bytes encode(
    MessageEncoder& encoder, Nanoseconds stamp_ns, const py::object& values,
    const py::object& stddevs) {
    const Given value = quickly(values), stddev = quickly(stddevs);
    require(
        stamp_ns >= 0 && stamp_ns < END_OF_TIME_NS,
        "the stamp does not fit a ROS header");
    require(
        encoder.takes(
            static_cast<std::size_t>(value.size()), static_cast<std::size_t>(stddev.size())),
        "the message needs more values or standard deviations");
    return encoder.encode(stamp_ns, span_of(value), span_of(stddev));
}

using Flags = py::array_t<bool, py::array::c_style>;

void require_rows(const py::array& table, py::ssize_t rows, Index columns, const char* name) {
    if (table.ndim() == 2 && table.shape(0) == rows && table.shape(1) == columns) return;
    throw py::value_error(std::string(name) + " has not the shape of this robot's");
}

/// A stepper with the robot that it refers to; see `_core.pyi`.
class HeldStepper {
public:
    HeldStepper(const HeldRobot& held, Index joint)
        : robot_(held.robot), stepper_(held.robot, checked(held, joint)), joint_(joint) {}

    void release(
        const std::array<double, 6>& load, double effort_sign, double lower, double upper) {
        stepper_.rule = FreeJoint{
            {load[0], load[1], load[2], load[3], load[4], load[5]}, joint_, effort_sign, lower,
            upper};
    }

    void balance(const Given& direction, double rising, double motor_speed, double drive) {
        require(
            direction.size() == robot_.topology.sizes.motors,
            "direction needs an entry for every motor");
        const auto given = span_of(direction);
        stepper_.rule = BalancedJoint{
            {given.begin(), given.end()}, rising, motor_speed, drive};
    }

    void prescribe() { stepper_.rule = PrescribedJoints{}; }

    /// Effort of the joint in poses without a state before.
    Vector efforts(const Given& motors, const Given& joints) const {
        const Sizes& sizes = robot_.topology.sizes;
        const py::ssize_t poses = motors.ndim() == 2 ? motors.shape(0) : 0;
        require_rows(motors, poses, sizes.motors, "motors");
        require_rows(joints, poses, sizes.joints, "joints");
        Vector found(poses);
        double* written = found.mutable_data();
        Trials trials(robot_, joint_);
        for_samples(poses, [&](py::ssize_t k) {
            written[k] = trials.effort(row_of(motors, k), row_of(joints, k), 0.0);
            return true;
        });
        return found;
    }

    py::tuple run(
        const Given& motors, const Given& joints, const Given& torque, const Given& dt,
        const Given& offset, const Flags& happening, Matrix& motors_out, Matrix& joints_out,
        Vector& imbalance, Matrix& estimates) {
        const Sizes& sizes = robot_.topology.sizes;
        const py::ssize_t phases = torque.size(), samples = dt.size();
        require_rows(motors, phases, sizes.motors, "motors");
        require_rows(joints, phases, sizes.joints, "joints");
        require_rows(offset, samples, sizes.motors, "offset");
        require_rows(motors_out, samples, sizes.motors, "motors_out");
        require_rows(joints_out, samples, sizes.joints, "joints_out");
        require_rows(estimates, samples, Index(robot_.estimate_size()), "estimates");
        require(
            happening.size() == samples && imbalance.size() == samples &&
                stepper_.phase < phases,
            "the arrays differ in their numbers of samples");
        const Plan plan{
            {const_cast<double*>(motors.data()), sizes.motors},
            {const_cast<double*>(joints.data()), sizes.joints}, span_of(torque)};
        Outcome outcome{true, 0.0};
        const py::ssize_t done = for_samples(samples, [&](py::ssize_t k) {
            const Interval sample{dt.data()[k], row_of(offset, k), happening.data()[k]};
            outcome = stepper_.step(
                plan, sample, written_row(motors_out, k), written_row(joints_out, k),
                written_row(estimates, k));
            if (outcome.done) imbalance.mutable_data()[k] = outcome.imbalance;
            return outcome.done;
        });
        return py::make_tuple(done, outcome.asked);
    }

    Vector state() const { return copy_of(stepper_.trials.state); }

    void set_state(const Given& given) {
        require(
            given.size() == py::ssize_t(robot_.state_size()),
            "state has not the size of this robot's");
        std::ranges::copy(span_of(given), stepper_.trials.state.begin());
    }

    Vector swing() const {
        const Swing& now = stepper_.swing;
        return copy_of(std::array{now.angle, now.speed, now.acceleration, now.torque});
    }

    void set_swing(const std::array<double, 4>& given) {
        stepper_.swing = {given[0], given[1], given[2], given[3]};
    }

    Index phase() const { return stepper_.phase; }

private:
    static Index checked(const HeldRobot& held, Index joint) {
        const Index joints = held.robot.topology.sizes.joints;
        require(0 <= joint && joint < std::max<Index>(joints, 1), "there is no such joint");
        return joint;
    }

    const Robot& robot_;
    Stepper stepper_;
    Index joint_;
};

}  // namespace

void bind_messages(py::module_& core) {
    py::class_<JointStateDecoder>(core, "JointStateDecoder")
        .def(py::init<bool>(), "efforts"_a = false)
        .def(
            "decode",
            [](JointStateDecoder& decoder, const py::bytes& payload) {
                return decoder.decode(std::string_view(payload));
            },
            "payload"_a)
        .def_property_readonly(
            "stamp_ns", [](const JointStateDecoder& d) { return d.last().stamp_ns; })
        .def_property_readonly(
            "has_efforts", [](const JointStateDecoder& d) { return !d.last().efforts.empty(); })
        .def_property_readonly("names", &names_of)
        .def_property_readonly(
            "positions", [](const JointStateDecoder& d) { return copy_of(d.last().positions); })
        .def_property_readonly(
            "efforts", [](const JointStateDecoder& d) { return copy_of(d.last().efforts); });
    py::class_<MessageEncoder>(core, "MessageEncoder")
        .def(
            py::init(&encoder_of), "blank"_a, "values"_a, "stddevs"_a,
            "flags"_a)
        .def("encode", &encode, "stamp_ns"_a, "values"_a, "stddevs"_a);
    core.attr("END_OF_TIME_NS") = END_OF_TIME_NS;
}

void bind_simulation(py::module_& core) {
    py::class_<HeldStepper>(core, "Stepper")
        .def(py::init<const HeldRobot&, Index>(), "robot"_a, "joint"_a, py::keep_alive<1, 2>())
        .def("prescribe", &HeldStepper::prescribe)
        .def(
            "release", &HeldStepper::release, "load"_a, "effort_sign"_a, "lower"_a, "upper"_a)
        .def(
            "balance", &HeldStepper::balance, "direction"_a, "rising"_a, "motor_speed"_a,
            "drive"_a)
        .def("efforts", &HeldStepper::efforts, "motors"_a, "joints"_a)
        .def(
            "run", &HeldStepper::run, "motors"_a, "joints"_a, "torque"_a, "dt"_a, "offset"_a,
            "happening"_a, "motors_out"_a.noconvert(), "joints_out"_a.noconvert(),
            "imbalance"_a.noconvert(), "estimates"_a.noconvert())
        .def_property("state", &HeldStepper::state, &HeldStepper::set_state)
        .def_property("swing", &HeldStepper::swing, &HeldStepper::set_swing)
        .def_property_readonly("phase", &HeldStepper::phase);
}

}  // namespace cdrj

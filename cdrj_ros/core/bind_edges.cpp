// What lies at the edges of an estimator: messages that come and go, as nodes and `cdrj_ros.recordings` use
// them, and the stepper of the simulated rig.
#include <algorithm>
#include <string>
#include <vector>

#include <nanobind/stl/array.h>

#include "bind.hpp"
#include "messages.hpp"
#include "simulation.hpp"

namespace cdrj {
namespace {

using Numbers = std::vector<std::array<std::size_t, 3>>;

std::vector<CopiedNumbers> copied(const Numbers& numbers) {
    std::vector<CopiedNumbers> found;
    for (const auto& [offset, first, count] : numbers) found.push_back({offset, first, count});
    return found;
}

void make_encoder(
    MessageEncoder* made, const nb::bytes& blank, const Numbers& values, const Numbers& stddevs,
    const Numbers& flags) {
    MessageContent content{copied(values), copied(stddevs), {}};
    for (const auto& [offset, before, after] : flags) {
        content.flags.push_back({offset, before, after});
    }
    new (made) MessageEncoder({blank.c_str(), blank.size()}, std::move(content));
}

nb::bytes encode(
    MessageEncoder& encoder, Nanoseconds stamp_ns, const Given& values, const Given& stddevs) {
    require(
        stamp_ns >= 0 && stamp_ns < END_OF_TIME_NS,
        "the stamp does not fit a ROS header");
    require(
        encoder.takes(
            static_cast<std::size_t>(values.size()), static_cast<std::size_t>(stddevs.size())),
        "the message needs more values or standard deviations");
    const std::string& message = encoder.encode(stamp_ns, span_of(values), span_of(stddevs));
    return nb::bytes(message.data(), message.size());
}

void require_rows(const auto& table, Index rows, Index columns, const char* name) {
    require(
        table.has({rows, columns}),
        (std::string(name) + " has not the shape of this robot's").c_str());
}

/// A stepper with the robot that it refers to; see `_core.pyi`.
class HeldStepper {
public:
    HeldStepper(const HeldRobot& held, Index joint)
        : robot_(held.robot), stepper_(held.robot, checked(held, joint)), joint_(joint) {}
    HeldStepper(const HeldStepper&) = delete;  // refers to a robot
    HeldStepper& operator=(const HeldStepper&) = delete;

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
    Written efforts(const Given& motors, const Given& joints) const {
        const Sizes& sizes = robot_.topology.sizes;
        const Index poses = motors.ndim() == 2 ? motors.shape(0) : 0;
        require_rows(motors, poses, sizes.motors, "motors");
        require_rows(joints, poses, sizes.joints, "joints");
        Written found({poses});
        const auto written = span_of(found);
        Trials trials(robot_, joint_);
        for_samples(poses, [&](Index k) {
            written[k] = trials.effort(row_of(motors, k), row_of(joints, k), 0.0);
            return true;
        });
        return found;
    }

    nb::tuple run(
        const Given& motors, const Given& joints, const Given& torque, const Given& dt,
        const Given& offset, const GivenFlags& happening, const Written& motors_out, const Written& joints_out,
        const Written& imbalance, const Written& estimates) {
        const Sizes& sizes = robot_.topology.sizes;
        const Index phases = torque.size(), samples = dt.size();
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
        const Index done = for_samples(samples, [&](Index k) {
            const Interval sample{dt.data()[k], row_of(offset, k), happening.data()[k]};
            outcome = stepper_.step(
                plan, sample, row_of(motors_out, k), row_of(joints_out, k), row_of(estimates, k));
            if (outcome.done) imbalance.data()[k] = outcome.imbalance;
            return outcome.done;
        });
        return nb::make_tuple(done, outcome.asked);
    }

    Written state() const { return copy_of(stepper_.trials.state); }

    void set_state(const Given& given) {
        require(
            given.size() == Index(robot_.state_size()),
            "state has not the size of this robot's");
        std::ranges::copy(span_of(given), stepper_.trials.state.begin());
    }

    Written swing() const {
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

void bind_messages(nb::module_& core) {
    nb::class_<JointStateDecoder>(core, "JointStateDecoder")
        .def(nb::init<bool>(), "efforts"_a = false)
        .def(
            "decode",
            [](JointStateDecoder& decoder, const nb::bytes& payload, Nanoseconds arrival_ns) {
                return decoder.decode({payload.c_str(), payload.size()}, arrival_ns);
            },
            "payload"_a, "arrival_ns"_a = NEVER_NS)
        .def_prop_ro(
            "stamp_ns", [](const JointStateDecoder& d) { return d.last().stamp_ns; })
        .def_prop_ro(
            "by_arrival", [](const JointStateDecoder& d) { return d.last().arrival.is_stamp; })
        .def_prop_ro(
            "has_efforts", [](const JointStateDecoder& d) { return !d.last().efforts.empty(); })
        .def_prop_ro(
            "names", [](const JointStateDecoder& d) { return nb::tuple(nb::cast(d.last().names)); })
        .def_prop_ro(
            "positions", [](const JointStateDecoder& d) { return copy_of(d.last().positions); })
        .def_prop_ro(
            "efforts", [](const JointStateDecoder& d) { return copy_of(d.last().efforts); });
    nb::class_<MessageEncoder>(core, "MessageEncoder")
        .def(
            "__init__", make_encoder, "blank"_a, "values"_a, "stddevs"_a, "flags"_a)
        .def("encode", &encode, "stamp_ns"_a, "values"_a, "stddevs"_a);
    core.attr("END_OF_TIME_NS") = END_OF_TIME_NS;
}

void bind_simulation(nb::module_& core) {
    nb::class_<HeldStepper>(core, "Stepper")
        .def(nb::init<const HeldRobot&, Index>(), "robot"_a, "joint"_a, nb::keep_alive<1, 2>())
        .def("prescribe", &HeldStepper::prescribe)
        .def(
            "release", &HeldStepper::release, "load"_a, "effort_sign"_a, "lower"_a, "upper"_a)
        .def(
            "balance", &HeldStepper::balance, "direction"_a, "rising"_a, "motor_speed"_a, "drive"_a)
        .def("efforts", &HeldStepper::efforts, "motors"_a, "joints"_a)
        .def(
            "run", &HeldStepper::run, "motors"_a, "joints"_a, "torque"_a, "dt"_a, "offset"_a,
            "happening"_a, "motors_out"_a, "joints_out"_a, "imbalance"_a, "estimates"_a)
        .def_prop_rw("state", &HeldStepper::state, &HeldStepper::set_state)
        .def_prop_rw("swing", &HeldStepper::swing, &HeldStepper::set_swing)
        .def_prop_ro("phase", &HeldStepper::phase);
}

}  // namespace cdrj

// What lies at the edges of an estimator: messages that come and go, as nodes and `cdrj_ros.recordings` use
// them, and the stepper of the simulated rig.
#include <algorithm>
#include <array>
#include <string>
#include <vector>

#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>

#include "bind.hpp"
#include "messages.hpp"
#include "simulation.hpp"

namespace cdrj {
namespace {

using Numbers = std::vector<std::tuple<std::size_t, std::size_t, std::size_t>>;

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

/// A stepper with the robot that it refers to.
class HeldStepper {
public:
    HeldStepper(const HeldRobot& held, Index joint)
        : robot_(held.robot), stepper_(held.robot, checked(held, joint)), joint_(joint) {}
    HeldStepper(const HeldStepper&) = delete;  // refers to a robot
    HeldStepper& operator=(const HeldStepper&) = delete;

    void release(const Given& coefficients, double effort_sign, double lower, double upper) {
        require(coefficients.size() == 6, "a load has six coefficients");
        const auto load = span_of(coefficients);
        stepper_.rule = FreeJoint{
            {load[0], load[1], load[2], load[3], load[4], load[5]}, joint_, effort_sign, lower,
            upper};
    }

    void balance(
        const Given& direction, double rising, double speed, double acceleration, double drive) {
        require(
            direction.size() == robot_.topology.sizes.motors,
            "direction needs an entry for every motor");
        const auto given = span_of(direction);
        stepper_.rule = BalancedJoint{
            {given.begin(), given.end()}, rising, speed, acceleration, drive};
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

    Index run(
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
                stepper_.phase < static_cast<double>(phases),
            "the arrays differ in their numbers of samples");
        const Plan plan{
            {const_cast<double*>(motors.data()), sizes.motors},
            {const_cast<double*>(joints.data()), sizes.joints}, span_of(torque)};
        return for_samples(samples, [&](Index k) {
            const Interval sample{dt.data()[k], row_of(offset, k), happening.data()[k]};
            const Outcome outcome = stepper_.step(
                plan, sample, row_of(motors_out, k), row_of(joints_out, k), row_of(estimates, k));
            if (outcome.done) imbalance.data()[k] = outcome.imbalance;
            return outcome.done;
        });
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

    void set_swing(const Given& given) {
        require(given.size() == 4, "a swing has four numbers");
        const auto now = span_of(given);
        stepper_.swing = {now[0], now[1], now[2], now[3]};
    }

    double phase() const { return stepper_.phase; }

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
    nb::class_<JointStateDecoder>(core, "JointStateDecoder",
        "Decodes JointState messages of one topic; its properties are those of the last good one.")
        .def(nb::init<bool>(), "efforts"_a = false, R"(
            Start without a message.

            Args:
                efforts: whether messages with efforts for only some of their names are malformed.)")
        .def(
            "decode",
            [](JointStateDecoder& decoder, const nb::bytes& payload, Nanoseconds arrival_ns) {
                return decoder.decode({payload.c_str(), payload.size()}, arrival_ns);
            },
            "payload"_a, "arrival_ns"_a = NEVER_NS, R"(
            Decode a message in plain CDR; False if it is malformed, which changes nothing.

            Args:
                payload: the message.
                arrival_ns: when it arrived [ns], which replaces a stamp of zero.)")
        .def_prop_ro(
            "stamp_ns", [](const JointStateDecoder& d) { return d.last().stamp_ns; })
        .def_prop_ro(
            "by_arrival", [](const JointStateDecoder& d) { return d.last().arrival.is_stamp; },
            "Whether the stamp is the time of arrival, because the header's is zero.")
        .def_prop_ro(
            "has_efforts", [](const JointStateDecoder& d) { return !d.last().efforts.empty(); })
        .def_prop_ro(
            "names", [](const JointStateDecoder& d) { return nb::typed<nb::tuple, nb::str, nb::ellipsis>(nb::tuple(nb::cast(d.last().names))); })
        .def_prop_ro(
            "positions", [](const JointStateDecoder& d) { return copy_of(d.last().positions); },
            "[rad], one per name.")
        .def_prop_ro(
            "efforts", [](const JointStateDecoder& d) { return copy_of(d.last().efforts); },
            "[N m]; empty if the message has none.");
    nb::class_<MessageEncoder>(core, "MessageEncoder",
        "A message whose names and array sizes stay the same, in plain CDR, little-endian.")
        .def(
            "__init__", make_encoder, "blank"_a, "values"_a, "stddevs"_a, "flags"_a, R"(
            Prepare the message.

            Args:
                blank: the message with any numbers.
                values: which numbers are copied from the values: offset of the first one in the
                    message [bytes], its index among the values, their count.
                stddevs: the same for the standard deviations.
                flags: bytes of status: offset in the message [bytes], then the indices of two values,
                    which may be the same, whose flags it unites.

            Raises:
                IndexError: a field is outside of the message.)")
        .def("encode", &encode, "stamp_ns"_a, "values"_a, "stddevs"_a, R"(
            Encode the message with this stamp and these numbers.

            Raises:
                ValueError: a stamp that no header can hold, or fewer numbers than are copied.)");
    core.attr("END_OF_TIME_NS") = END_OF_TIME_NS;
}

void bind_simulation(nb::module_& core) {
    nb::class_<HeldStepper>(core, "Stepper", R"(
        A robot on its way along a plan; one of its joints may move freely or be balanced.

        A new one is at rest in phase 0 of the plan, and all joints follow the plan.)")
        .def(nb::init<const HeldRobot&, Index>(), "robot"_a, "joint"_a, nb::keep_alive<1, 2>(),
            "Start at rest; ``joint`` is the one that may move freely or be balanced.")
        .def("prescribe", &HeldStepper::prescribe,
            "From now on, every joint follows the plan.")
        .def(
            "release", &HeldStepper::release, "load"_a, "effort_sign"_a, "lower"_a, "upper"_a, R"(
            From now on, the joint moves by its dynamics (trapezoidal rule) within its range.

            Args:
                load: inertia, times cos q, weight, times cos q, times cos 2q, damping; SI.
                effort_sign: +1 or -1, that of its efforts.
                lower, upper: its range [rad] or [m].)")
        .def(
            "balance", &HeldStepper::balance, "direction"_a, "rising"_a, "speed"_a, "acceleration"_a,
            "drive"_a, R"(
            From now on, the motors turn so that the cables exert the plan's torque on the joint.

            Args:
                direction: of the motors per unit of the drive, shape (motors,).
                rising: sign of the joint's effort over the drive.
                speed: largest speed of the drive; the plan waits for the motors [rad/s].
                acceleration: its largest acceleration [rad/s^2].
                drive: angle by which the motors are driven beyond the plan at first [rad].)")
        .def("efforts", &HeldStepper::efforts, "motors"_a, "joints"_a, R"(
            Effort on the joint in poses without a state before [N m], shape (n,).

            Args:
                motors: angles of all motors [rad], shape (n, motors).
                joints: angles of all joints [rad] or [m], shape (n, joints).)")
        .def(
            "run", &HeldStepper::run, "motors"_a, "joints"_a, "torque"_a, "dt"_a, "offset"_a,
            "happening"_a, "motors_out"_a, "joints_out"_a, "imbalance"_a, "estimates"_a, R"(
            Take n samples, each of which goes on by a phase of the plan, or less.

            Args:
                motors, joints: the plan's angles [rad] or [m], one row a phase.
                torque: of every phase, wanted of the balanced or external on the free joint [N m].
                dt: time since the sample before [s], shape (n,); with 0 the phase is kept.
                offset: of the motors by faults [rad], shape (n, motors).
                happening: whether a fault happens, shape (n,).
                motors_out: angles of the motors without the offsets [rad], shape (n, motors), written.
                joints_out: angles of the joints [rad] or [m], shape (n, joints), written.
                imbalance: torque of the cables less the needed one [N m], shape (n,), written.
                estimates: shape (n, estimate_size), written.

            Returns:
                Number of samples done: fewer than n where the free joint leaves its range or no drive
                balances the joint.)")
        .def_prop_rw("state", &HeldStepper::state, &HeldStepper::set_state,
            "The robot's state, shape (state_size,); a copy.")
        .def_prop_rw("swing", &HeldStepper::swing, &HeldStepper::set_swing,
            "Angle, speed, acceleration of the free joint, and the cables' torque on it; a copy.")
        .def_prop_ro("phase", &HeldStepper::phase,
            "Row of the plan that is carried out; between two rows where the plan is slowed down.");
}

}  // namespace cdrj

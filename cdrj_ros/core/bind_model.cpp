// The module `cdrj_ros._core`: the parts of a robot's arrays, and a robot and its samples, as `cdrj_ros.model` and
// `cdrj_ros.estimation` use them.
#include <algorithm>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>

#include "bind.hpp"
#include "cable.hpp"
#include "guide.hpp"
#include "residual.hpp"

namespace cdrj {
namespace {

using Columns = List<std::pair<std::string, std::string>>;

/// Numbers of a field of a record, and whether they are whole.
struct FieldType {
    std::size_t numbers;
    bool whole;
};

/// Names and types of all fields of a record, in its order; for NumPy: `f8`, `i8`, or `3f8` for three numbers.
Columns columns_of(const char* names, std::initializer_list<FieldType> types) {
    const nb::object name = nb::str(names).attr("split")(", ");
    Columns columns;
    for (const auto& [numbers, whole] : types) {
        const std::string count = numbers == 1 ? "" : std::to_string(numbers);
        columns.append(nb::make_tuple(name[nb::len(columns)], count + (whole ? "i8" : "f8")));
    }
    return columns;
}

template <typename Record, typename... Fields>
Columns columns_of(const char* names, const Fields&...) {
    static_assert((sizeof(Fields) + ...) == sizeof(Record), "not all fields");
    return columns_of(
        names, {{sizeof(Fields) / sizeof(Index), std::is_same_v<Fields, Index> || std::is_enum_v<Fields>}...});
}

/// Names and types of the fields of a record; of plain numbers, none.
template <typename Record>
struct Described {
    static_assert(std::is_same_v<Record, double> || std::is_same_v<Record, Vector3>, "not described");
    Columns columns() const { return {}; }
};

/// In a scope of the record its fields are variables, which are named once: for the compiler and as text.
#define DESCRIBE(Record, ...)                                                                    \
    template <>                                                                                  \
    struct Described<Record> : Record {                                                          \
        Columns columns() const { return columns_of<Record>(#__VA_ARGS__, __VA_ARGS__); }        \
    }

DESCRIBE(
    CableTopology, first_element, elements, first_pulley, pulleys, first_contact, contacts,
    first_node, law, routed);
DESCRIBE(EndTopology, first_turn, turns, drum);
DESCRIBE(TurnTopology, motor);
DESCRIBE(PulleyTopology, element, first_contact, cells, surface, wrap_changes, stribeck);
DESCRIBE(TermTopology, adds_to_wrap, target, joint);
DESCRIBE(FrameTopology, parent, motion, joint);
DESCRIBE(NodeTopology, kind, frame, exit_frame);
DESCRIBE(
    CableConstants, axial_stiffness, bedding_strain, bedding_tension, creep_share, creep_time,
    flow_time, preload, maximum_tension, credible_tension, wound_tension, slack_tension);
DESCRIBE(EndConstants, radius);
DESCRIBE(TurnConstants, winding);
DESCRIBE(
    PulleyConstants, radius, rho, mu_c, mu_s, stribeck_speed, stribeck_lag, bearing_ratio, drag,
    bristle_stiffness, bristle_damping, viscous, breakaway, wrap, moved_after, cell_width,
    kinetic_loss, static_loss, half_sine, half_cosine);
DESCRIBE(ElementConstants, span);
DESCRIBE(SegmentConstants, material);
DESCRIBE(MotorConstants, reference_angle);
DESCRIBE(JointConstants, lower, interval);
DESCRIBE(
    AxisConstants, effort_sign, bearing_torque, bearing_stiffness, spring_stiffness, spring_rest);
DESCRIBE(Cubic, c0, c1, c2, c3);
DESCRIBE(FrameConstants, origin, rotation, axis, rolling_radius, multiplier, offset);
DESCRIBE(
    NodeConstants, centre, basis, exit, sided, ignored_inside, radius, turn, inside, turns, lead,
    effective_radius, length, arc_reference, turn_reference);
DESCRIBE(ResidualTopology, column, cable, first_input, inputs, first_weight);
DESCRIBE(ResidualInputTopology, axis, column);
DESCRIBE(ResidualRange, lower, upper);
DESCRIBE(ResidualConstants, bound, variance);
DESCRIBE(ResidualInput, place, stop, motion);
DESCRIBE(Drum, points, spacing, rate_below, angle, material);
DESCRIBE(ArcMiddle, normal, tangent, height);
DESCRIBE(Segment, length_before, length, material_before, material, tension);
DESCRIBE(
    Contact, share, stiffness, damping, viscous, drag, breakaway, shift, flux, bristle_before,
    bristle, loss, static_share, bound, trial, step, residual, by_slip, by_pull, upper);
DESCRIBE(Pose, rotation, origin);
DESCRIBE(Twist, angular, linear);
DESCRIBE(
    Touch, centre, basis, entry, exit, before, after, side, normal, entry_normal, exit_normal,
    before_length, after_length, sense, touching, angle, wrap, arc, share, twisted, wound, lever);

using PartList = List<std::tuple<std::string, std::vector<Index>, Columns>>;

/// Name, shape and fields of every part of an array, in their order.
template <typename Whole>
PartList parts_of(const Sizes& sizes) {
    PartList found;
    Whole::parts(sizes, [&](const char* name, auto member, auto... shape) {
        using Record = std::remove_const_t<decltype(record_of(member))>;
        std::vector<Index> whole{shape...};
        if (std::is_same_v<Record, Vector3>) whole.push_back(3);
        found.append(nb::make_tuple(name, whole, Described<Record>{}.columns()));
    });
    return found;
}

/// The parts of all arrays of a robot of these sizes.
ByName<PartList> robot_parts(const GivenIntegers& given) {
    require(given.size() == Index{sizeof(Sizes) / sizeof(Index)}, "sizes are not those of a topology");
    const Sizes& sizes = *reinterpret_cast<const Sizes*>(given.data());
    ByName<PartList> found;
    found["topology"] = parts_of<Topology>(sizes);
    found["constants"] = parts_of<Constants>(sizes);
    found["state"] = parts_of<State>(sizes);
    found["scratch"] = parts_of<Workspace>(sizes);
    return found;
}

Array<bool> touched(const HeldRobot& held) {
    const auto& own = held.robot.topology.paths->cables_of_axis;
    const Index cables = held.robot.topology.sizes.cables;
    std::vector<bool> found(own.size() * cables);
    for (std::size_t a = 0; a < own.size(); ++a) {
        for (const Index c : own[a]) found[a * cables + c] = true;
    }
    return copy_of(found, {static_cast<Index>(own.size()), cables});
}

std::tuple<HeldState, Written, bool> step(
    HeldRobot& held, const HeldState& before, Nanoseconds stamp_ns, const Given& motor_angle,
    const Given& joint_angle) {
    held.require_angles(motor_angle.size(), joint_angle.size());
    held.require_state(before);
    const bool solved = held.robot.advance(
        before.numbers.data(), span_of(motor_angle), span_of(joint_angle),
        before.seconds_until(stamp_ns), held.out.data());
    return {HeldState{stamp_ns, held.state()}, held.estimate(), solved};
}

/// Advance a state by many samples; `slipping`: which cables slip on their drums, if any; `chosen`:
/// which are computed, if not all.
HeldState run(
    const HeldRobot& held, HeldState state, const GivenIntegers& stamp_ns, const Given& motor_angle,
    const Given& joint_angle, const Written& estimates, const std::optional<GivenFlags>& slipping,
    const std::optional<GivenFlags>& chosen) {
    const Robot& robot = held.robot;
    const Index samples = stamp_ns.size();
    for (const auto& flags : {slipping, chosen}) {
        require(
            !flags || flags->has({robot.topology.sizes.cables}),
            "slipping or chosen is not by cables");
    }
    require(
        !chosen || robot.topology.sizes.residuals == 0 ||
            std::ranges::all_of(span_of(*chosen), [](bool one) { return one; }),
        "learned corrections are of all cables");
    const Paths& paths = *robot.topology.paths;
    const CableSet some = chosen ? paths.some(span_of(*chosen)) : paths.all;
    require(
        motor_angle.ndim() == 2 && joint_angle.ndim() == 2 && estimates.ndim() == 2,
        "motor_angle, joint_angle and estimates need two axes");
    const std::size_t size = robot.state_size(), wanted = robot.estimate_size();
    held.require_state(state);
    held.require_angles(motor_angle.shape(1), joint_angle.shape(1));
    require(
        motor_angle.shape(0) == samples && joint_angle.shape(0) == samples &&
            estimates.shape(0) == samples && estimates.shape(1) == Index(wanted),
        "stamp_ns, motor_angle, joint_angle and estimates differ in their numbers of samples");
    std::vector<double> out(robot.out_size());
    double* now = state.numbers.data();
    State memory(robot.topology.sizes, now);
    for_samples(samples, [&](Index k) {
        const Nanoseconds stamp = stamp_ns.data()[k];
        const bool solved = robot.advance(
            now, row_of(motor_angle, k), row_of(joint_angle, k), state.seconds_until(stamp), some,
            out.data());
        state.stamp_ns = stamp;
        std::copy_n(out.data(), size, now);
        std::copy_n(out.data() + size, wanted, row_of(estimates, k).begin());
        for (Index c = 0; slipping && solved && c < slipping->size(); ++c) {
            if (slipping->data()[c]) forget_drums(robot, c, memory);
        }
        return true;
    });
    return state;
}

bool shape(
    const HeldRobot& held, const Given& motor_angle, const Given& joint_angle, const Written& scratch) {
    const Sizes& sizes = held.robot.topology.sizes;
    held.require_angles(motor_angle.size() ? motor_angle.size() : sizes.motors, joint_angle.size());
    require(scratch.size() == Index(Workspace::size(sizes)), "scratch has not the size of this robot's");
    Workspace work(sizes, scratch.data());
    return held.robot.shape(span_of(motor_angle), span_of(joint_angle), work);
}

/// Geometry of poses that follow each other; returns the first impossible one, or their number.
Index course(
    const HeldRobot& held, const Given& joint_angle, const Written& length, const Written& lever_arm,
    const Written& wrap, const Written& arc, const Written& track) {
    const Robot& robot = held.robot;
    const Sizes& sizes = robot.topology.sizes;
    require(joint_angle.ndim() == 2, "joint_angle needs two axes");
    held.require_angles(sizes.motors, joint_angle.shape(1));
    const Index poses = joint_angle.shape(0);
    const auto fits = [poses](const auto& one, Index width) { return one.has({poses, width}); };
    require(
        fits(length, sizes.elements) && fits(lever_arm, sizes.elements * sizes.joints) &&
            fits(wrap, sizes.pulleys) && fits(arc, sizes.pulleys) && fits(track, sizes.pulleys),
        "the results have not the shapes of this robot's");
    std::vector<double> one(robot.state_size(), 0.0), other(robot.state_size(), 0.0);
    std::vector<double> scratch(Workspace::size(sizes), 0.0);
    State before(sizes, one.data()), after(sizes, other.data());
    Workspace work(sizes, scratch.data());
    return for_samples(poses, [&](Index k) {
        if (!robot.shape({}, row_of(joint_angle, k), work)) return false;
        for (Index c = 0; c < sizes.cables; ++c) {
            follow_arcs(robot.topology, robot.constants, c, before, after, work);
        }
        std::ranges::copy(work.middles, before.middles.begin());
        std::ranges::copy(after.track, before.track.begin());
        std::ranges::copy(after.track, row_of(track, k).begin());
        std::ranges::copy(work.element_length, row_of(length, k).begin());
        std::ranges::copy(work.wrap, row_of(wrap, k).begin());
        std::ranges::copy(work.arc, row_of(arc, k).begin());
        std::copy_n(work.lever_arm.data, sizes.elements * sizes.joints, row_of(lever_arm, k).begin());
        return true;
    });
}

/// Products and trust of (R1) to (R3) along a motion; `ranges`: of all inputs.
std::pair<Written, Written> residual_products(const Given& inputs, const Given& dt, const Given& ranges) {
    const Index samples = dt.size(), count = inputs.shape(1);
    require(
        inputs.shape(0) == samples && ranges.size() == 2 * count,
        "inputs, dt and ranges differ in their numbers of samples or inputs");
    const Written products({samples, residual_weights(count)}), trust({samples});
    std::vector<ResidualInput> state(count);
    for_samples(samples, [&](Index k) {
        for (Index i = 0; i < count; ++i) {
            const ResidualRange seen{ranges.data()[2 * i], ranges.data()[2 * i + 1]};
            const double place = place_in(seen, row_of(inputs, k)[i]);
            state[i] = followed(k > 0 ? &state[i] : nullptr, place, dt.data()[k]);
        }
        write_products(state, row_of(products, k));
        trust.data()[k] = trust_in(state);
        return true;
    });
    return {products, trust};
}

/// By name of a part: first and end among an estimate's numbers, and first among the uncertain ones, or -1.
ByName<std::tuple<Index, Index, Index>> estimate_parts(const GivenIntegers& topology) {
    require(topology.size() >= Index{sizeof(Sizes) / sizeof(Index)}, "topology is too short");
    const Sizes& sizes = *reinterpret_cast<const Sizes*>(topology.data());
    ByName<std::tuple<Index, Index, Index>> parts;
    Estimate::parts(sizes, [&](const char* name, auto member, Index count) {
        const Index first = first_of(sizes, member);
        const bool is_uncertain = std::ranges::find(UNCERTAIN, member) != std::end(UNCERTAIN);
        parts[name] = std::tuple(
            first, first + count, is_uncertain ? first_of(sizes, member, true) : -1);
    });
    return parts;
}

HeldState start(
    HeldRobot& held, const Given& motor_angle, const Given& joint_angle, const Given& share) {
    held.require_angles(motor_angle.size(), joint_angle.size());
    require(
        share.size() == held.robot.topology.sizes.pulleys, "share has not one entry per pulley");
    const std::vector<double> before(held.robot.state_size());
    held.robot.advance(
        before.data(), span_of(motor_angle), span_of(joint_angle), 0.0, held.out.data());
    held.robot.impose_friction(span_of(share), held.out.data());
    return {NEVER_NS, held.state()};
}

void bind_robot(nb::module_& core) {
    bind_kinds<Guide>(
        core, "Guide", GUIDE_NAMES,
        "What a cable given by positions touches, by the kinds of ``cdrj_ros.robot.space``.");
    bind_kinds<FrameMotion>(
        core, "FrameMotion", FRAME_MOTION_NAMES,
        "Motion of a frame relative to its parent, by the words of a robot file.");
    core.def("residual_products", residual_products, "inputs"_a, "dt"_a, "ranges"_a, R"(
        What a learned correction depends on, along a motion: (R1) to (R3) in docs/model.md.

        Args:
            inputs: the output without correction [N] or [N m], then angles [rad] or [m], shape
                (n, inputs).
            dt: time since the sample before [s], shape (n,).
            ranges: lowest and highest value of every input that was seen, shape (inputs, 2).

        Returns:
            The products of all rows and columns, shape (n, weights), and the share of the correction
            that applies, shape (n,).)");
    core.def("robot_parts", robot_parts, "sizes"_a, R"(
        Parts of ``topology`` after its sizes, ``constants``, ``state`` and ``scratch`` of a robot of these sizes.

        Of each part, in their order: its name, its shape, and the fields of its rows with NumPy's types,
        none for plain numbers.)");
    core.def("estimate_parts", estimate_parts, "topology"_a, R"(
        Parts of an estimate in their order: first and end among its numbers, first of the standard deviations.

        The last is -1 for a part without standard deviations.)");
    core.attr("NEVER") = NEVER_NS;
    nb::class_<HeldState>(core, "State",
        "History-dependent state of the cables; opaque, never changed in place.")
        .def(
            "__init__",
            [](HeldState* made, Nanoseconds stamp_ns, const Given& values) {
                new (made) HeldState{stamp_ns, {values.data(), values.data() + values.size()}};
            },
            "stamp_ns"_a, "values"_a, R"(
            The state after a sample.

            Args:
                stamp_ns: stamp of the sample [ns]; ``NEVER`` before the first.
                values: shape (state_size,), see ``State`` in core/layout.hpp; copied.)")
        .def("__getstate__", [](const HeldState& one) { return std::tuple(one.stamp_ns, one.numbers); })
        .def("__setstate__", [](HeldState* made, const std::tuple<Nanoseconds, std::vector<double>>& parts) {
            new (made) HeldState{std::get<0>(parts), std::get<1>(parts)};
        })
        .def_ro("stamp_ns", &HeldState::stamp_ns)
        .def_prop_ro("values", [](const HeldState& state) { return copy_of(state.numbers); },
            "A copy, shape (state_size,).");
    nb::class_<HeldRobot>(core, "Robot",
        "A robot as ``cdrj_ros.model.packing`` packs it; it keeps its arrays alive.")
        .def(
            nb::init<GivenIntegers, Given>(), "topology"_a, "constants"_a, R"(
            Take the connections of a robot's parts and their constants; neither is copied.

            Raises:
                TypeError: an array is not contiguous or of another type.)")
        .def("__getstate__", [](const HeldRobot& held) { return std::tuple(held.topology, held.constants); })
        .def("__setstate__", [](HeldRobot& held, const std::tuple<GivenIntegers, Given>& parts) {
            new (&held) HeldRobot(std::get<0>(parts), std::get<1>(parts));
        })
        .def(
            "is_state",
            [](const HeldRobot& held, const Given& numbers) {
                return held.robot.is_state(span_of(numbers));
            },
            "numbers"_a,
            "Whether numbers may be a state: within bounds that keep every step defined.")
        .def_prop_ro("state_size", [](const HeldRobot& h) { return h.robot.state_size(); },
            "Numbers of a state.")
        .def_prop_ro("touched", touched,
            "Whether the path of a cable leads over a motor or joint, shape (axes, cables).")
        .def_prop_ro(
            "scratch_size", [](const HeldRobot& h) { return Workspace::size(h.robot.topology.sizes); },
            "Numbers of the workspace.")
        .def("step", step, "before"_a, "stamp_ns"_a, "motor_angle"_a, "joint_angle"_a, R"(
            One sample: (state, angles) -> (state, estimate, solved).

            Args:
                before: the state; not changed.
                stamp_ns: of the sample, later than the state's [ns].
                motor_angle, joint_angle: angles [rad], of prismatic joints [m], in the robot's order.

            Returns:
                The new state, the estimate, shape (estimate_size,), and whether it is solved.  It is
                not where the geometry is impossible at these joint angles (the state is then kept) or
                some cable could not be solved; the elements concerned are ``INVALID``.

            Raises:
                TypeError: an array is not contiguous or of another type.
                ValueError: the angles or the state are not those of this robot.)")
        .def(
            "run", run, "before"_a, "stamp_ns"_a, "motor_angle"_a, "joint_angle"_a, "estimates"_a,
            "slipping"_a = nb::none(), "chosen"_a = nb::none(), R"(
            ``step`` for many samples, bit for bit.

            Args:
                before: the state; not changed.
                stamp_ns: increasing, later than the state's [ns], shape (samples,).
                motor_angle, joint_angle: [rad] or [m], shapes (samples, motors), (samples, joints).
                estimates: shape (samples, estimate_size), written.
                slipping: which cables slip on their drums, shape (cables,); None: none.
                chosen: which cables are computed, shape (cables,), the tensions of the others and
                    their shares of efforts are 0; None: all, as with learned corrections.

            Returns:
                The state after the last sample.

            Raises:
                TypeError, ValueError: as ``step``.
                KeyboardInterrupt: between some thousand samples.)")
        .def("shape", shape, "motor_angle"_a, "joint_angle"_a, "scratch"_a, R"(
            Geometry of all cables in a pose; False if the path of a cable is impossible.

            Args:
                motor_angle: [rad], shape (motors,), or (0,) for drums at rest.
                joint_angle: [rad] or [m], shape (joints,).
                scratch: the workspace, written.)")
        .def(
            "course", course, "joint_angle"_a, "length"_a, "lever_arm"_a, "wrap"_a, "arc"_a, "track"_a, R"(
            Geometry along a motion, see ``Course``; all shapes begin with the poses.

            Returns:
                The first impossible pose, or their number.)")
        .def("start", start, "motor_angle"_a, "joint_angle"_a, "share"_a, R"(
            The state before the first sample, with a friction history.

            Args:
                motor_angle, joint_angle: as ``step``.
                share: friction as a share of every pulley's bound, in [-1, 1], shape (pulleys,).)");
}

}  // namespace
}  // namespace cdrj

NB_MODULE(_core, core) {
    namespace nb = nanobind;
    core.doc() = R"(
        The step of every sample and all that runs with it, in C++: the module `cdrj_ros._core`.

        Angles are in rad (in m for a sliding axis), stamps in ns since the clock's epoch.)";
    nb::set_leak_warnings(false);  // Python does not free what its modules hold when it ends
    cdrj::use_numpy();
    cdrj::bind_messages(core);
    cdrj::bind_conditioning(core);
    cdrj::bind_ensemble(core);
    cdrj::bind_encoderless(core);
    cdrj::bind_laws(core);
    cdrj::bind_beliefs(core);
    cdrj::bind_robot(core);
    cdrj::bind_simulation(core);
}

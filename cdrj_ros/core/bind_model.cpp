// The module `cdrj_ros._core`: the laws of a cable, each by itself, the records, and a robot and its
// samples, as `cdrj_ros.model` and `cdrj_ros.estimation` use them.
#include <algorithm>
#include <vector>

#include "bind.hpp"
#include "cable.hpp"
#include "friction.hpp"
#include "guide.hpp"
#include "laws.hpp"
#include "state_records.hpp"

namespace py = pybind11;
using namespace py::literals;

namespace cdrj {
namespace {

using Numbers3 = std::array<double, 3>;

Elasticity elasticity_of(const Numbers3& elastic) { return {elastic[0], elastic[1], elastic[2]}; }

py::tuple pair(const Loss& loss) { return py::make_tuple(loss.kinetic, loss.fading); }

void bind_friction(py::module_& core) {
    bind_kinds<Law>(core, "Law", LAW_NAMES);
    bind_kinds<Stribeck>(core, "Stribeck", STRIBECK_NAMES);
    core.attr("MINIMUM_TRANSMISSION") = MINIMUM_TRANSMISSION;
    core.attr("BOUND_FLOOR") = BOUND_FLOOR;
    core.def("stribeck_share", stribeck_share, "slip_speed"_a, "stribeck_speed"_a);
    core.def(
        "sliding_loss",
        [](double mu_c, double mu_s, double wrap_angle, Stribeck stribeck) {
            return pair(sliding_loss(mu_c, mu_s, wrap_angle, stribeck));
        },
        "mu_c"_a, "mu_s"_a, "wrap_angle"_a, "stribeck"_a);
    core.def(
        "sliding_transmission",
        [](double slip_speed, double mu_c, double mu_s, double stribeck_speed, double wrap_angle,
           Stribeck stribeck) {
            return sliding_transmission(
                slip_speed, mu_c, mu_s, stribeck_speed, wrap_angle, stribeck);
        },
        "slip_speed"_a, "mu_c"_a, "mu_s"_a, "stribeck_speed"_a, "wrap_angle"_a, "stribeck"_a);
    core.def("bearing_transmission", bearing_transmission, "wrap_angle"_a, "bearing_ratio"_a);
    core.def(
        "blended_loss",
        [](double rho, double mu_c, double mu_s, double wrap_angle, double bearing_ratio,
           Stribeck stribeck) {
            return pair(
                blended_loss(rho, mu_c, mu_s, wrap_angle, bearing_ratio, stribeck));
        },
        "rho"_a, "mu_c"_a, "mu_s"_a, "wrap_angle"_a, "bearing_ratio"_a, "stribeck"_a);
    core.def(
        "cell_loss",
        [](double kinetic, double static_, double share) {
            return pair(cell_loss({kinetic, static_}, share));
        },
        "kinetic"_a, "static"_a, "share"_a);
    core.def(
        "friction_force",
        [](Law law, double before, double slip, double stiffness, double bound, double breakaway) {
            const auto [force, by_slip, by_bound] =
                law_of(law).force({before, stiffness, bound, breakaway}, slip);
            return py::make_tuple(force, by_slip, by_bound);
        },
        "law"_a, "before"_a, "slip"_a, "stiffness"_a, "bound"_a, "breakaway"_a);
}

void bind_cable(py::module_& core) {
    core.def(
        "crept",
        [](double share, double time, double flow_time, double strain, double delayed, double dt) {
            const auto [after, growth] = crept({share, time, flow_time}, strain, delayed, dt);
            return py::make_tuple(after, growth);
        },
        "share"_a, "time"_a, "flow_time"_a, "strain"_a, "delayed"_a, "dt"_a);
    py::class_<Drum>(core, "Drum")
        .def(
            py::init([](double angle, double material, double rate) {
                Drum drum{};
                start_drum(drum, angle, material, rate);
                return drum;
            }),
            "angle"_a, "material"_a, "rate"_a)
        .def("turn", turn_drum, "angle"_a, "rate"_a)
        .def_property_readonly("held", material_held)
        .def_property_readonly("points", [](const Drum& d) { return static_cast<int>(d.points); })
        .def_readonly("spacing", &Drum::spacing);
    core.def(
        "tolerance", [](const Numbers3& elastic) { return tolerance(elasticity_of(elastic)); },
        "elastic"_a);
    core.def(
        "acceptable", [](const Numbers3& elastic) { return acceptable(elasticity_of(elastic)); },
        "elastic"_a);
    core.def(
        "element_tension",
        [](const Numbers3& elastic, double length, double material) {
            return tension_of(elasticity_of(elastic), length, material);
        },
        "elastic"_a, "length"_a, "material"_a);
}

/// The records as structured types of NumPy, by their names: `Contact`, `PulleyConstants`.
void bind_records(py::module_& core) {
    PYBIND11_NUMPY_DTYPE(Vector3, x, y, z);
    PYBIND11_NUMPY_DTYPE(Matrix3, row);
    PYBIND11_NUMPY_DTYPE(
        CableTopology, first_element, elements, first_pulley, pulleys, first_contact, contacts,
        first_node, law, routed);
    PYBIND11_NUMPY_DTYPE(EndTopology, motor, drum);
    PYBIND11_NUMPY_DTYPE(
        PulleyTopology, element, first_contact, cells, surface, wrap_changes, stribeck);
    PYBIND11_NUMPY_DTYPE(TermTopology, adds_to_wrap, target, joint);
    PYBIND11_NUMPY_DTYPE(FrameTopology, parent, motion, joint);
    PYBIND11_NUMPY_DTYPE(NodeTopology, kind, frame, exit_frame);
    PYBIND11_NUMPY_DTYPE(
        CableConstants, axial_stiffness, bedding_strain, bedding_tension, creep_share, creep_time,
        flow_time, preload, maximum_tension, wound_tension, slack_tension);
    PYBIND11_NUMPY_DTYPE(EndConstants, radius, winding);
    PYBIND11_NUMPY_DTYPE(
        PulleyConstants, radius, rho, mu_c, mu_s, stribeck_speed, stribeck_lag, bearing_ratio, drag,
        bristle_stiffness, bristle_damping, viscous, breakaway, wrap, moved_after, cell_width,
        kinetic_loss, static_loss, half_sine, half_cosine);
    PYBIND11_NUMPY_DTYPE(ElementConstants, span);
    PYBIND11_NUMPY_DTYPE(SegmentConstants, material);
    PYBIND11_NUMPY_DTYPE(MotorConstants, reference_angle);
    PYBIND11_NUMPY_DTYPE(JointConstants, lower, interval);
    PYBIND11_NUMPY_DTYPE(
        AxisConstants, effort_sign, bearing_torque, bearing_stiffness, spring_stiffness, spring_rest);
    PYBIND11_NUMPY_DTYPE(Cubic, c0, c1, c2, c3);
    PYBIND11_NUMPY_DTYPE(
        FrameConstants, origin, rotation, axis, rolling_radius, multiplier, offset);
    PYBIND11_NUMPY_DTYPE(
        NodeConstants, centre, basis, exit, sided, ignored_inside, radius, turn, inside, turns,
        lead, reel, length, arc_reference, turn_reference);
    PYBIND11_NUMPY_DTYPE(Drum, points, spacing, rate_below, angle, material);
    PYBIND11_NUMPY_DTYPE(ArcMiddle, normal, tangent, height);
    PYBIND11_NUMPY_DTYPE(Segment, length_before, length, material_before, material, tension);
    PYBIND11_NUMPY_DTYPE(
        Contact, share, stiffness, damping, viscous, drag, breakaway, shift, flux, bristle_before,
        bristle, loss, static_share, bound, trial, step, residual, by_slip, by_pull, upper);
    PYBIND11_NUMPY_DTYPE(Pose, rotation, origin);
    PYBIND11_NUMPY_DTYPE(Twist, angular, linear);
    PYBIND11_NUMPY_DTYPE(
        Touch, centre, basis, entry, exit, before, after, side, normal, entry_normal, exit_normal,
        before_length, after_length, sense, touching, angle, wrap, arc, share, twisted, wound,
        lever);

    py::dict records;
    records["CableTopology"] = py::dtype::of<CableTopology>();
    records["EndTopology"] = py::dtype::of<EndTopology>();
    records["PulleyTopology"] = py::dtype::of<PulleyTopology>();
    records["TermTopology"] = py::dtype::of<TermTopology>();
    records["FrameTopology"] = py::dtype::of<FrameTopology>();
    records["NodeTopology"] = py::dtype::of<NodeTopology>();
    records["CableConstants"] = py::dtype::of<CableConstants>();
    records["EndConstants"] = py::dtype::of<EndConstants>();
    records["PulleyConstants"] = py::dtype::of<PulleyConstants>();
    records["ElementConstants"] = py::dtype::of<ElementConstants>();
    records["SegmentConstants"] = py::dtype::of<SegmentConstants>();
    records["MotorConstants"] = py::dtype::of<MotorConstants>();
    records["JointConstants"] = py::dtype::of<JointConstants>();
    records["AxisConstants"] = py::dtype::of<AxisConstants>();
    records["Cubic"] = py::dtype::of<Cubic>();
    records["FrameConstants"] = py::dtype::of<FrameConstants>();
    records["NodeConstants"] = py::dtype::of<NodeConstants>();
    records["Drum"] = py::dtype::of<Drum>();
    records["ArcMiddle"] = py::dtype::of<ArcMiddle>();
    records["Segment"] = py::dtype::of<Segment>();
    records["Contact"] = py::dtype::of<Contact>();
    records["Pose"] = py::dtype::of<Pose>();
    records["Twist"] = py::dtype::of<Twist>();
    records["Touch"] = py::dtype::of<Touch>();
    core.attr("RECORDS") = records;
}

bool step(
    const HeldRobot& held, const py::object& before, const py::object& motor_angle,
    const py::object& joint_angle, double dt, const py::object& out) {
    const Robot& robot = held.robot;
    const Given state = quickly(before), motor = quickly(motor_angle), joint = quickly(joint_angle);
    Vector result = written(out, "out is not a contiguous array of floats");
    held.require_angles(motor.size(), joint.size());
    require(state.size() >= py::ssize_t(robot.state_size()), "before is too short");
    require(result.size() >= py::ssize_t(robot.out_size()), "out is too short");
    return robot.advance(
        state.data(), span_of(motor), span_of(joint), dt, result.mutable_data());
}

/// Advance a state by many samples; `slipping`: the cables slip on their drums.
void run(
    const HeldRobot& held, Vector& state, const Given& motor_angle, const Given& joint_angle,
    const Given& dt, Matrix& estimates, bool slipping) {
    const Robot& robot = held.robot;
    const py::ssize_t samples = dt.size();
    require(
        motor_angle.ndim() == 2 && joint_angle.ndim() == 2 && estimates.ndim() == 2,
        "motor_angle, joint_angle and estimates need two axes");
    const std::size_t size = robot.state_size(), wanted = robot.estimate_size();
    require(state.size() == py::ssize_t(size), "state has not the size of this robot's");
    held.require_angles(motor_angle.shape(1), joint_angle.shape(1));
    require(
        motor_angle.shape(0) == samples && joint_angle.shape(0) == samples &&
            estimates.shape(0) == samples && estimates.shape(1) == py::ssize_t(wanted),
        "motor_angle, joint_angle, dt and estimates differ in their numbers of samples");
    std::vector<double> out(robot.out_size());
    double* now = state.mutable_data();
    for_samples(samples, [&](py::ssize_t k) {
        const bool solved = robot.advance(
            now, row_of(motor_angle, k), row_of(joint_angle, k), dt.data()[k], out.data());
        std::copy_n(out.data(), size, now);
        std::copy_n(out.data() + size, wanted, begin_of_row(estimates, k));
        if (slipping && solved) robot.forget_drums(now);
        return true;
    });
}

bool shape(
    const HeldRobot& held, const Given& motor_angle, const Given& joint_angle, Vector& scratch) {
    const Sizes& sizes = held.robot.topology.sizes;
    held.require_angles(motor_angle.size() ? motor_angle.size() : sizes.motors, joint_angle.size());
    require(
        scratch.size() == py::ssize_t(Workspace::size(sizes)),
        "scratch has not the size of this robot's");
    Workspace work(sizes, scratch.mutable_data());
    return held.robot.shape(span_of(motor_angle), span_of(joint_angle), work);
}

/// Geometry of poses that follow each other; returns the first impossible one, or their number.
py::ssize_t course(
    const HeldRobot& held, const Given& joint_angle, Matrix& length, Matrix& lever_arm,
    Matrix& wrap, Matrix& arc, Matrix& track) {
    const Robot& robot = held.robot;
    const Sizes& sizes = robot.topology.sizes;
    require(joint_angle.ndim() == 2, "joint_angle needs two axes");
    held.require_angles(sizes.motors, joint_angle.shape(1));
    const py::ssize_t poses = joint_angle.shape(0);
    const auto fits = [poses](const Matrix& one, Index width) {
        return one.ndim() == 2 && one.shape(0) == poses && one.shape(1) == width;
    };
    require(
        fits(length, sizes.elements) && fits(lever_arm, sizes.elements * sizes.joints) &&
            fits(wrap, sizes.pulleys) && fits(arc, sizes.pulleys) && fits(track, sizes.pulleys),
        "the results have not the shapes of this robot's");
    std::vector<double> one(robot.state_size(), 0.0), other(robot.state_size(), 0.0);
    std::vector<double> scratch(Workspace::size(sizes), 0.0);
    State before(sizes, one.data()), after(sizes, other.data());
    Workspace work(sizes, scratch.data());
    return for_samples(poses, [&](py::ssize_t k) {
        if (!robot.shape({}, row_of(joint_angle, k), work)) return false;
        robot.follow_arcs(before, after, work);
        std::ranges::copy(work.middles, before.middles.begin());
        std::ranges::copy(after.track, before.track.begin());
        std::ranges::copy(after.track, begin_of_row(track, k));
        std::ranges::copy(work.element_length, begin_of_row(length, k));
        std::ranges::copy(work.wrap, begin_of_row(wrap, k));
        std::ranges::copy(work.arc, begin_of_row(arc, k));
        std::copy_n(work.lever_arm.data, sizes.elements * sizes.joints, begin_of_row(lever_arm, k));
        return true;
    });
}

void impose_friction(const HeldRobot& held, const Given& share, Vector& out) {
    require(
        share.size() == held.robot.topology.sizes.pulleys, "share has not one entry per pulley");
    require(out.size() >= py::ssize_t(held.robot.out_size()), "out is too short");
    held.robot.impose_friction(span_of(share), out.mutable_data());
}

void forget_drums(const HeldRobot& held, Vector& state) {
    require(state.size() >= py::ssize_t(held.robot.state_size()), "state is too short");
    held.robot.forget_drums(state.mutable_data());
}

void bind_robot(py::module_& core) {
    bind_kinds<Guide>(core, "Guide", GUIDE_NAMES);
    bind_kinds<FrameMotion>(core, "FrameMotion", FRAME_MOTION_NAMES);
    py::class_<HeldRobot>(core, "Robot", "A robot as ``cdrj_ros.model.packing`` packs it.")
        .def(
            py::init<Indices, Vector>(), "plan"_a.noconvert(), "numbers"_a.noconvert(),
            "``plan``: connections of its parts; ``numbers``: their constants.")
        .def(py::pickle(
            [](const HeldRobot& held) { return py::make_tuple(held.plan, held.numbers); },
            [](const py::tuple& parts) {
                return HeldRobot(parts[0].cast<Indices>(), parts[1].cast<Vector>());
            }))
        .def(
            "is_state",
            [](const HeldRobot& held, const Given& numbers) {
                return held.robot.is_state(span_of(numbers));
            },
            "numbers"_a)
        .def_property_readonly(
            "state_size", [](const HeldRobot& h) { return h.robot.state_size(); })
        .def_property_readonly(
            "estimate_size", [](const HeldRobot& h) { return h.robot.estimate_size(); })
        .def_property_readonly("out_size", [](const HeldRobot& h) { return h.robot.out_size(); })
        .def(
            "step", step, "before"_a, "motor_angle"_a, "joint_angle"_a,
            "dt"_a, "out"_a,
            "One sample: (state, angles) -> (state, estimate, workspace) in ``out``.\n\n"
            "Angles in rad, of prismatic joints in m; ``dt``: time since the state [s], 0 for the\n"
            "first sample. Returns False where the geometry is impossible (the state is kept) or a\n"
            "cable could not be solved; the elements concerned are ``INVALID``.")
        .def(
            "run", run, "state"_a.noconvert(), "motor_angle"_a,
            "joint_angle"_a, "dt"_a,
            "estimates"_a.noconvert(), "slipping"_a = false,
            "``step`` for many samples, one a row; ``state`` is replaced by the last one's.\n\n"
            "``slipping``: the cables slip on their drums.")
        .def(
            "shape", shape, "motor_angle"_a, "joint_angle"_a,
            "scratch"_a.noconvert(),
            "Geometry in a pose, written to the workspace; False if a cable's path is impossible.")
        .def(
            "course", course, "joint_angle"_a, "length"_a.noconvert(),
            "lever_arm"_a.noconvert(), "wrap"_a.noconvert(),
            "arc"_a.noconvert(), "track"_a.noconvert(),
            "Geometry along a motion; returns the first impossible pose, or their number.")
        .def(
            "impose_friction", impose_friction, "share"_a,
            "out"_a.noconvert(),
            "Impose shares in [-1, 1] of the friction bounds after the first sample.")
        .def(
            "forget_drums", forget_drums, "state"_a.noconvert(),
            "Give all cable on the drums the present strain, as of a cable that slips on its drum.");
}

}  // namespace

py::array_t<double> copy_of(std::span<const double> numbers) {
    py::array_t<double> array(static_cast<py::ssize_t>(numbers.size()));
    std::copy(numbers.begin(), numbers.end(), array.mutable_data());
    return array;
}

}  // namespace cdrj

PYBIND11_MODULE(_core, core) {
    core.doc() = "The compiled core; its types are in _core.pyi.";
    cdrj::bind_records(core);
    cdrj::bind_messages(core);
    cdrj::bind_conditioning(core);
    cdrj::bind_ensemble(core);
    cdrj::bind_friction(core);
    cdrj::bind_cable(core);
    cdrj::bind_robot(core);
    cdrj::bind_simulation(core);
}

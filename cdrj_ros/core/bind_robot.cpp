// A robot and its samples, as `cdrj_ros.model` and `cdrj_ros.estimation` use them.
#include <pybind11/numpy.h>

#include <algorithm>
#include <vector>

#include "arrays.hpp"
#include "bind.hpp"
#include "bind_robot.hpp"
#include "guide.hpp"
#include "robot.hpp"

namespace py = pybind11;

namespace cdrj {
namespace {

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

/// Geometry of many poses that follow each other; returns the first impossible one, or their number.
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
    require(share.size() == held.robot.topology.sizes.pulleys, "share has not one entry per pulley");
    require(out.size() >= py::ssize_t(held.robot.out_size()), "out is too short");
    held.robot.impose_friction(span_of(share), out.mutable_data());
}

void forget_drums(const HeldRobot& held, Vector& state) {
    require(state.size() >= py::ssize_t(held.robot.state_size()), "state is too short");
    held.robot.forget_drums(state.mutable_data());
}

}  // namespace

void bind_robot(py::module_& core) {
    bind_kinds<Guide>(core, "Guide", GUIDE_NAMES);
    bind_kinds<FrameMotion>(core, "FrameMotion", FRAME_MOTION_NAMES);
    py::class_<HeldRobot>(core, "Robot", "A robot as ``cdrj_ros.model.packing`` packs it.")
        .def(
            py::init<Indices, Vector>(), py::arg("plan").noconvert(), py::arg("numbers").noconvert(),
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
            py::arg("numbers"))
        .def_property_readonly("state_size", [](const HeldRobot& h) { return h.robot.state_size(); })
        .def_property_readonly(
            "estimate_size", [](const HeldRobot& h) { return h.robot.estimate_size(); })
        .def_property_readonly("out_size", [](const HeldRobot& h) { return h.robot.out_size(); })
        .def(
            "step", step, py::arg("before"), py::arg("motor_angle"), py::arg("joint_angle"),
            py::arg("dt"), py::arg("out"),
            "One sample: (state, angles) -> (state, estimate, workspace) in ``out``.\n\n"
            "Angles in rad, of prismatic joints in m; ``dt``: time since the state [s], 0 for the\n"
            "first sample. Returns False where the geometry is impossible (the state is kept) or a\n"
            "cable could not be solved; the elements concerned are ``INVALID``.")
        .def(
            "run", run, py::arg("state").noconvert(), py::arg("motor_angle"),
            py::arg("joint_angle"), py::arg("dt"),
            py::arg("estimates").noconvert(), py::arg("slipping") = false,
            "``step`` for many samples, one a row; ``state`` is replaced by the last one's.\n\n"
            "``slipping``: the cables slip on their drums.")
        .def(
            "shape", shape, py::arg("motor_angle"), py::arg("joint_angle"),
            py::arg("scratch").noconvert(),
            "Geometry in a pose, written to the workspace; False if a cable's path is impossible.")
        .def(
            "course", course, py::arg("joint_angle"), py::arg("length").noconvert(),
            py::arg("lever_arm").noconvert(), py::arg("wrap").noconvert(),
            py::arg("arc").noconvert(), py::arg("track").noconvert(),
            "Geometry along a motion; returns the first impossible pose, or their number.")
        .def(
            "impose_friction", impose_friction, py::arg("share"),
            py::arg("out").noconvert(),
            "Impose shares in [-1, 1] of the friction bounds after the first sample.")
        .def(
            "forget_drums", forget_drums, py::arg("state").noconvert(),
            "Give all cable on the drums the present strain, as of a cable that slips on its drum.");
}

}  // namespace cdrj

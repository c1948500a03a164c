// The records as structured types of NumPy, by their names: `Contact`, `PulleyConstants`.
#include "bind.hpp"
#include "friction_law.hpp"
#include "guide.hpp"
#include "robot_records.hpp"
#include "state_records.hpp"

namespace py = pybind11;

namespace cdrj {

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

}  // namespace cdrj

// The columns of the rows of records, by the names of these: `Contact`, `PulleyConstants`.
#include <string>
#include <type_traits>

#include "bind.hpp"
#include "state_records.hpp"

namespace cdrj {
namespace {

/// Type of a field for NumPy: `f8`, `i8`, or `3f8` for three numbers.
template <typename Field>
std::string type_of() {
    const std::string one = std::is_same_v<Field, Index> || std::is_enum_v<Field> ? "i8" : "f8";
    const std::size_t numbers = sizeof(Field) / sizeof(Index);
    return numbers == 1 ? one : std::to_string(numbers) + one;
}

/// Names and types of all fields of a record, in the order of the record.
template <typename Record, typename... Fields>
nb::list columns_of(const char* names, const Fields&...) {
    static_assert((sizeof(Fields) + ...) == sizeof(Record), "not all fields");
    const nb::object name = nb::str(names).attr("split")(", ");
    nb::list columns;
    int k = 0;
    (columns.append(nb::make_tuple(name[k++], type_of<Fields>())), ...);
    return columns;
}

/// In a scope of the record its fields are variables, which are named once: for the compiler and as text.
#define ADD_RECORD(Record, ...)                                                                  \
    struct Record##Scope : Record {                                                              \
        nb::list columns() const { return columns_of<Record>(#__VA_ARGS__, __VA_ARGS__); }       \
    };                                                                                           \
    records[#Record] = Record##Scope{}.columns()

}  // namespace

void bind_records(nb::module_& core) {
    nb::dict records;
    ADD_RECORD(
        CableTopology, first_element, elements, first_pulley, pulleys, first_contact, contacts,
        first_node, law, routed);
    ADD_RECORD(EndTopology, motor, drum);
    ADD_RECORD(PulleyTopology, element, first_contact, cells, surface, wrap_changes, stribeck);
    ADD_RECORD(TermTopology, adds_to_wrap, target, joint);
    ADD_RECORD(FrameTopology, parent, motion, joint);
    ADD_RECORD(NodeTopology, kind, frame, exit_frame);
    ADD_RECORD(
        CableConstants, axial_stiffness, bedding_strain, bedding_tension, creep_share, creep_time,
        flow_time, preload, maximum_tension, wound_tension, slack_tension);
    ADD_RECORD(EndConstants, radius, winding);
    ADD_RECORD(
        PulleyConstants, radius, rho, mu_c, mu_s, stribeck_speed, stribeck_lag, bearing_ratio, drag,
        bristle_stiffness, bristle_damping, viscous, breakaway, wrap, moved_after, cell_width,
        kinetic_loss, static_loss, half_sine, half_cosine);
    ADD_RECORD(ElementConstants, span);
    ADD_RECORD(SegmentConstants, material);
    ADD_RECORD(MotorConstants, reference_angle);
    ADD_RECORD(JointConstants, lower, interval);
    ADD_RECORD(
        AxisConstants, effort_sign, bearing_torque, bearing_stiffness, spring_stiffness, spring_rest);
    ADD_RECORD(Cubic, c0, c1, c2, c3);
    ADD_RECORD(FrameConstants, origin, rotation, axis, rolling_radius, multiplier, offset);
    ADD_RECORD(
        NodeConstants, centre, basis, exit, sided, ignored_inside, radius, turn, inside, turns, lead,
        reel, length, arc_reference, turn_reference);
    ADD_RECORD(ResidualTopology, column, cable, first_input, inputs, first_weight);
    ADD_RECORD(ResidualInputTopology, axis, column);
    ADD_RECORD(ResidualRange, lower, upper);
    ADD_RECORD(ResidualConstants, bound, variance);
    ADD_RECORD(ResidualInput, place, stop, motion);
    ADD_RECORD(Drum, points, spacing, rate_below, angle, material);
    ADD_RECORD(ArcMiddle, normal, tangent, height);
    ADD_RECORD(Segment, length_before, length, material_before, material, tension);
    ADD_RECORD(
        Contact, share, stiffness, damping, viscous, drag, breakaway, shift, flux, bristle_before,
        bristle, loss, static_share, bound, trial, step, residual, by_slip, by_pull, upper);
    ADD_RECORD(Pose, rotation, origin);
    ADD_RECORD(Twist, angular, linear);
    ADD_RECORD(
        Touch, centre, basis, entry, exit, before, after, side, normal, entry_normal, exit_normal,
        before_length, after_length, sense, touching, angle, wrap, arc, share, twisted, wound, lever);
    core.attr("RECORDS") = records;
}

}  // namespace cdrj

// Where the parts of a robot, its state, its estimate and its workspace lie in flat arrays.
//
// A list of parts has one line for each: its name, what it holds, and how many of these, by the
// `sizes` of the robot. The members, the order in the array, its size, and the views that
// `cdrj_ros.model.packing` makes all follow from these lists.
#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "robot_records.hpp"

namespace cdrj {

/// Numbers of the parts of a robot; its topology begins with them.
struct Sizes {
    Index motors;
    Index joints;
    Index cables;
    Index elements;
    Index pulleys;
    Index contacts;        // contact cells of all pulleys
    Index frames;          // 0 for a robot without positions
    Index nodes;           // of all cables; 0 for a robot without positions
    Index terms;           // tabulated functions of a joint angle that are added to a span or a wrap
    Index drums;           // ends of cables that take up cable: drums and sectors
    Index turns;           // of drums by motors, several where several motors turn one drum
    Index surfaces;        // pulleys whose contact cells are fixed to their surface; 0 but for the
                           // simulated rig
    Index residuals;       // outputs with a learned correction; 0 but for robots that have one
    Index residual_inputs; // of all of them
    Index residual_weights;

    Index segments() const { return contacts + cables; }
    Index axes() const { return motors + joints; }
};

/// A table of records by rows.
template <typename Record>
struct Grid {
    Record* data;
    Index width;

    Record& operator()(Index row, Index column) const { return data[row * width + column]; }
};

/// A table of numbers by rows.
using Table = Grid<double>;

#define SPAN(name, Record, count) std::span<Record> name;
#define CONSTANT_SPAN(name, Record, count) std::span<const Record> name;
#define GRID(name, Record, rows, width) Grid<Record> name;

/// What a cable depends on; all lists are increasing.
struct CablePath {
    std::vector<Index> terms;   // that are added to its spans and wraps
    std::vector<Index> frames;  // that move its nodes
    std::vector<Index> joints;  // that move these frames, or of these terms
    std::vector<Index> axes;    // its motors, then these joints, among all motors and joints
};

/// Some cables, and axes and frames that are computed with them; all lists are increasing.
struct CableSet {
    std::vector<Index> cables, axes, frames;
};

/// Add numbers to an increasing list without repetition.
void join(std::vector<Index>& list, std::span<const Index> more);

/// What follows from the connections of a robot.
struct Paths {
    std::vector<CablePath> of_cable;
    std::vector<std::vector<Index>> joints_of_frame;  // that move it, increasing
    std::vector<std::vector<Index>> cables_of_axis;   // that depend on it, of motors, then joints
    CableSet all;
};

#define TOPOLOGY_PARTS(PART) \
    PART(cables, CableTopology, sizes.cables) \
    PART(ends, EndTopology, 2 * sizes.cables) /* the first of cable c at 2 c, its last at 2 c + 1 */ \
    PART(turns, TurnTopology, sizes.turns) \
    PART(pulleys, PulleyTopology, sizes.pulleys) \
    PART(terms, TermTopology, sizes.terms) \
    PART(frames, FrameTopology, sizes.frames) \
    PART(nodes, NodeTopology, sizes.nodes) \
    PART(residuals, ResidualTopology, sizes.residuals) \
    PART(residual_inputs, ResidualInputTopology, sizes.residual_inputs)

/// Connections of a robot; the parts follow its sizes.
struct Topology {
    explicit Topology(const Index* packed);

    Sizes sizes;
    TOPOLOGY_PARTS(CONSTANT_SPAN)
    std::shared_ptr<const Paths> paths;

    /// The first of some parts, and the one after the last.
    struct Range {
        Index first, beyond;
    };

    /// Turns of the drum at an end.
    Range turns_of(Index end) const {
        return {ends[end].first_turn, ends[end].first_turn + ends[end].turns};
    }

    /// Segments of a cable.
    Range segments_of(Index cable) const {
        const Index first = cables[cable].first_contact + cable;
        return {first, first + cables[cable].contacts + 1};
    }

    /// The segment that holds the free span of a cable's element `k`.
    Index span_segment(Index cable, Index k) const {
        if (k == 0) return cables[cable].first_contact + cable;
        const PulleyTopology& before = pulleys[cables[cable].first_pulley + k - 1];
        return before.first_contact + before.cells + cable;
    }
};

#define CONSTANT_PARTS(PART) \
    PART(cables, CableConstants, sizes.cables) \
    PART(ends, EndConstants, 2 * sizes.cables) \
    PART(turns, TurnConstants, sizes.turns) \
    PART(pulleys, PulleyConstants, sizes.pulleys) \
    PART(elements, ElementConstants, sizes.elements) \
    PART(segments, SegmentConstants, sizes.segments()) \
    PART(motors, MotorConstants, sizes.motors) \
    PART(joints, JointConstants, sizes.joints) \
    PART(axes, AxisConstants, sizes.axes()) /* all motors, then all joints */ \
    PART(tables, Cubic, sizes.terms * TABLE_INTERVALS) /* TABLE_INTERVALS cubics for every term */ \
    PART(frames, FrameConstants, sizes.frames) \
    PART(nodes, NodeConstants, sizes.nodes) \
    PART(residuals, ResidualConstants, sizes.residuals) \
    PART(residual_ranges, ResidualRange, sizes.residual_inputs) /* of their inputs */ \
    PART(residual_weights, double, sizes.residual_weights)

/// Constants of a robot.
struct Constants {
    Constants(const Sizes& sizes, const double* packed);

    CONSTANT_PARTS(CONSTANT_SPAN)
};

/// Angle by which motors have wound cable in at an end since the reference pose [rad], (E3).
inline double turned_by_motors(
    const Topology& topology, const Constants& constants, Index end,
    std::span<const double> motor_angle) {
    double turned = 0.0;
    const auto [first, beyond] = topology.turns_of(end);
    for (Index t = first; t < beyond; ++t) {
        const Index motor = topology.turns[t].motor;
        turned += constants.turns[t].winding *
                  (motor_angle[motor] - constants.motors[motor].reference_angle);
    }
    return turned;
}

#define STATE_PARTS(PART) \
    /* 0 before the first sample, then 1; a cable starts in the first pose that is possible for */ \
    /* it, and holds no material before */ \
    PART(started, double, 1) \
    PART(length, double, sizes.segments()) /* geometric, with its share of the arcs [m] */ \
    PART(material, double, sizes.segments()) /* unstretched length [m] */ \
    PART(delayed, double, sizes.segments()) /* delayed strain [-], (E24) */ \
    PART(bristle, double, sizes.contacts) /* bristle force [N] */ \
    PART(slip_speed, double, sizes.contacts) /* on the body, to the last node [m/s], (E25) */ \
    PART(lagged_speed, double, sizes.contacts) /* delayed, for static friction [m/s], (E10) */ \
    PART(place, double, sizes.contacts) /* along the cable's path on the body [m], (E26) */ \
    PART(track, double, sizes.pulleys) /* of the middle of the arc on that path [m] */ \
    PART(covered, double, sizes.surfaces) /* length of cable on the pulley [m] */ \
    PART(angle, double, sizes.axes()) /* of motors, then joints [rad] or [m] */ \
    PART(bearing_friction, double, sizes.axes()) /* torques of motors, then joints [N m] or [N] */ \
    PART(drums, Drum, sizes.drums) \
    PART(middles, ArcMiddle, sizes.nodes) \
    PART(residual_inputs, ResidualInput, sizes.residual_inputs)

/// State of a robot between two samples.
struct State {
    State(const Sizes& sizes, double* state);

    static std::size_t size(const Sizes& sizes);

    STATE_PARTS(SPAN)

    /// Whether a cable has a history, by its first segment.
    bool holds(Index first_segment) const { return material[first_segment] > 0.0; }

    /// Copy all that belongs to one cable.
    void take_cable(const Topology& topology, Index cable, const State& from) const;

    /// 1 + strain of a segment; 1 where it is slack.
    double stretch(Index segment) const {
        return std::max(length[segment] / material[segment], 1.0);
    }

    /// 1 + mean strain of the two segments at a contact of a cable.
    double stretch_at(Index contact, Index cable) const {
        return 0.5 * (stretch(contact + cable) + stretch(contact + cable + 1));
    }
};

/// Bit flags of an element's status, as in `cdrj_ros.model.packing`.
enum Status { OK = 0, SLACK = 1, OVERLOAD = 2, UNSURE = 4, STALE = 8, INVALID = 16 };

/// In this order the standard deviations lie too. What joints have follows what motors have, so that
/// both are one part of all axes.
#define ESTIMATE_PARTS(PART) \
    PART(tension, elements, true) /* [N] */ \
    PART(status, elements, false) /* `Status` */ \
    PART(force_x, pulleys, false) /* of the cable on the pulley [N] */ \
    PART(force_y, pulleys, false) \
    PART(force_z, pulleys, false) \
    PART(magnitude, pulleys, true) /* of that force [N], (38) */ \
    PART(friction, pulleys, false) /* tension after less tension before the pulley [N] */ \
    PART(slip_speed, pulleys, false) /* towards the last node [m/s] */ \
    PART(motor_effort, motors, true) /* [N m] */ \
    PART(joint_effort, joints, true) /* [N m], of a prismatic joint [N] */ \
    PART(iterations, cables, false) /* of Newton's method */ \
    PART(residual, cables, false) /* largest force imbalance [N] */ \
    PART(correction, residuals, false) /* learned, part of the output [N] or [N m] */ \
    PART(trust, residuals, false) /* share of it that applies there, (R3) */
#define NUMBERS(name, count, uncertain) std::span<double> name;

/// Results of a sample.
struct Estimate {
    Estimate(const Sizes& sizes, double* estimate);

    static std::size_t size(const Sizes& sizes);

    ESTIMATE_PARTS(NUMBERS)
};

/// A part of an estimate.
struct EstimatePart {
    const char* name;
    std::span<double> Estimate::*numbers;
    Index Sizes::*count;
    bool uncertain;  // whether its numbers have standard deviations
};

#define ESTIMATE_PART(name, count, uncertain) {#name, &Estimate::name, &Sizes::count, uncertain},
inline constexpr EstimatePart ESTIMATE[] = {ESTIMATE_PARTS(ESTIMATE_PART)};

/// Index of the first number of a part among all numbers of an estimate, or among the uncertain ones.
Index first_of(const Sizes& sizes, std::span<double> Estimate::*part, bool among_uncertain = false);

#define WORKSPACE_PARTS(PART, GRID) \
    PART(element_length, double, sizes.elements) /* geometric, with its share of the arcs [m] */ \
    GRID(lever_arm, double, sizes.elements, sizes.joints) /* about every joint [m], (E27) */ \
    PART(direction, Vector3, sizes.elements) /* unit vectors of routed elements in the base */ \
    PART(wrap, double, sizes.pulleys) /* [rad] */ \
    PART(arc, double, sizes.pulleys) /* length of cable on the pulley [m] */ \
    /* cable that a turn of its frame or of its tangent has laid onto every end since the */ \
    /* reference pose [m] */ \
    PART(laid, double, 2 * sizes.cables) \
    /* place of the middle of every arc along its body, up to a constant and whole turns [m]; */ \
    /* only where it is given by tables */ \
    PART(middle, double, sizes.pulleys) \
    PART(segments, Segment, sizes.segments()) \
    PART(contacts, Contact, sizes.contacts) \
    PART(pose, Pose, sizes.frames) \
    GRID(twist, Twist, sizes.frames, sizes.joints) /* by every joint; written if it moves them */ \
    PART(touches, Touch, sizes.nodes) \
    PART(middles, ArcMiddle, sizes.nodes) \
    PART(products, double, sizes.residual_weights) /* of rows and columns of (R1), as the weights */ \
    /* the state before the sample, by the contact cells of this sample; only where some are */ \
    /* fixed to a surface */ \
    PART(history, double, sizes.surfaces > 0 ? Index(State::size(sizes)) : 0)

/// Intermediate values of a sample. The memory begins with zeros, as what no path leads over stays zero.
struct Workspace {
    Workspace(const Sizes& sizes, double* scratch);

    static std::size_t size(const Sizes& sizes);

    WORKSPACE_PARTS(SPAN, GRID)
};

#undef SPAN
#undef CONSTANT_SPAN
#undef GRID
#undef NUMBERS
#undef ESTIMATE_PART

/// A part of one of these arrays, by its name and that of what it holds.
struct ArrayPart {
    const char* name;
    const char* record;
    Index words;  // of 8 bytes in all of it
    std::vector<Index> shape;
};

/// All parts of an array of a robot: "Topology", "Constants", "State" or "Workspace"; none for another name.
std::vector<ArrayPart> parts_of(std::string_view array, const Sizes& sizes);

}  // namespace cdrj

// Where the parts of a robot, its state, its estimate and its workspace lie in flat arrays.
//
// `cdrj_ros.model` makes the arrays; packing.py has views of them by the names that `parts` gives here.
#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <span>
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

/// What the rows of a part are, by the member that has them.
template <typename Whole, typename Record>
Record record_of(std::span<Record> Whole::*);
template <typename Whole, typename Record>
Record record_of(Grid<Record> Whole::*);

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

    /// Some cables, one flag for each, with their axes and frames.
    CableSet some(std::span<const bool> chosen) const;
};

/// Connections of a robot.
struct Topology {
    explicit Topology(const Index* packed);

    Sizes sizes;
    std::span<const CableTopology> cables;
    std::span<const EndTopology> ends;  // cable c has its first end at 2 c and its last at 2 c + 1
    std::span<const TurnTopology> turns;
    std::span<const PulleyTopology> pulleys;
    std::span<const TermTopology> terms;
    std::span<const FrameTopology> frames;
    std::span<const NodeTopology> nodes;
    std::span<const ResidualTopology> residuals;
    std::span<const ResidualInputTopology> residual_inputs;
    std::shared_ptr<const Paths> paths;

    /// Every part in its order: its name, its member, and its rows, of a `Grid` with the width.
    template <typename Visit>
    static void parts([[maybe_unused]] const Sizes& sizes, Visit visit) {
        visit("cables", &Topology::cables, sizes.cables);
        visit("ends", &Topology::ends, 2 * sizes.cables);
        visit("turns", &Topology::turns, sizes.turns);
        visit("pulleys", &Topology::pulleys, sizes.pulleys);
        visit("terms", &Topology::terms, sizes.terms);
        visit("frames", &Topology::frames, sizes.frames);
        visit("nodes", &Topology::nodes, sizes.nodes);
        visit("residuals", &Topology::residuals, sizes.residuals);
        visit("residual_inputs", &Topology::residual_inputs, sizes.residual_inputs);
    }

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

/// Constants of a robot.
struct Constants {
    Constants(const Sizes& sizes, const double* packed);

    std::span<const CableConstants> cables;
    std::span<const EndConstants> ends;
    std::span<const TurnConstants> turns;
    std::span<const PulleyConstants> pulleys;
    std::span<const ElementConstants> elements;
    std::span<const SegmentConstants> segments;
    std::span<const MotorConstants> motors;
    std::span<const JointConstants> joints;
    std::span<const AxisConstants> axes;  // all motors, then all joints
    std::span<const Cubic> tables;        // TABLE_INTERVALS cubics for every term
    std::span<const FrameConstants> frames;
    std::span<const NodeConstants> nodes;
    std::span<const ResidualConstants> residuals;
    std::span<const ResidualRange> residual_ranges;  // of their inputs
    std::span<const double> residual_weights;

    /// Every part in its order: its name, its member, and its rows, of a `Grid` with the width.
    template <typename Visit>
    static void parts([[maybe_unused]] const Sizes& sizes, Visit visit) {
        visit("cables", &Constants::cables, sizes.cables);
        visit("ends", &Constants::ends, 2 * sizes.cables);
        visit("turns", &Constants::turns, sizes.turns);
        visit("pulleys", &Constants::pulleys, sizes.pulleys);
        visit("elements", &Constants::elements, sizes.elements);
        visit("segments", &Constants::segments, sizes.segments());
        visit("motors", &Constants::motors, sizes.motors);
        visit("joints", &Constants::joints, sizes.joints);
        visit("axes", &Constants::axes, sizes.axes());
        visit("tables", &Constants::tables, sizes.terms * TABLE_INTERVALS);
        visit("frames", &Constants::frames, sizes.frames);
        visit("nodes", &Constants::nodes, sizes.nodes);
        visit("residuals", &Constants::residuals, sizes.residuals);
        visit("residual_ranges", &Constants::residual_ranges, sizes.residual_inputs);
        visit("residual_weights", &Constants::residual_weights, sizes.residual_weights);
    }
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

/// State of a robot between two samples.
struct State {
    State(const Sizes& sizes, double* state);

    static std::size_t size(const Sizes& sizes);

    std::span<double> started;      // 0 before the first sample, then 1; a cable starts in the first
                                    // pose that is possible for it, and holds no material before
    std::span<double> length;       // geometric, of every segment with its share of the arcs [m]
    std::span<double> material;     // unstretched length of every segment [m]
    std::span<double> delayed;      // delayed strain of every segment [-], (E24)
    std::span<double> bristle;      // bristle force of every contact [N]
    std::span<double> slip_speed;   // against the body, towards the last node [m/s], (E25)
    std::span<double> lagged_speed; // delayed slip speed, for static friction [m/s], (E10)
    std::span<double> place;        // of every contact along the cable's path on the body [m], (E26)
    std::span<double> track;        // of the middle of every pulley's arc on that path [m]
    std::span<double> covered;      // length of cable on every pulley whose cells are fixed to its
                                    // surface [m]
    std::span<double> angle;        // of motors, then joints [rad] or [m]
    std::span<double> bearing_friction;  // torques of motors, then joints [N m] or [N]
    std::span<Drum> drums;          // of every end that takes up cable
    std::span<ArcMiddle> middles;   // of every node
    std::span<ResidualInput> residual_inputs;

    /// Every part in its order: its name, its member, and its rows, of a `Grid` with the width.
    template <typename Visit>
    static void parts([[maybe_unused]] const Sizes& sizes, Visit visit) {
        visit("started", &State::started, Index{1});
        visit("length", &State::length, sizes.segments());
        visit("material", &State::material, sizes.segments());
        visit("delayed", &State::delayed, sizes.segments());
        visit("bristle", &State::bristle, sizes.contacts);
        visit("slip_speed", &State::slip_speed, sizes.contacts);
        visit("lagged_speed", &State::lagged_speed, sizes.contacts);
        visit("place", &State::place, sizes.contacts);
        visit("track", &State::track, sizes.pulleys);
        visit("covered", &State::covered, sizes.surfaces);
        visit("angle", &State::angle, sizes.axes());
        visit("bearing_friction", &State::bearing_friction, sizes.axes());
        visit("drums", &State::drums, sizes.drums);
        visit("middles", &State::middles, sizes.nodes);
        visit("residual_inputs", &State::residual_inputs, sizes.residual_inputs);
    }

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

/// Results of a sample.
struct Estimate {
    Estimate(const Sizes& sizes, double* estimate);

    static std::size_t size(const Sizes& sizes);

    std::span<double> tension;       // of every element [N]
    std::span<double> status;        // `Status` of every element
    std::span<double> force_x;       // of the cable on every pulley [N]
    std::span<double> force_y;
    std::span<double> force_z;
    std::span<double> magnitude;     // of that force [N], (38)
    std::span<double> friction;      // tension after less tension before every pulley [N]
    std::span<double> slip_speed;    // of every pulley, towards the last node [m/s]
    std::span<double> motor_effort;  // [N m]
    std::span<double> joint_effort;  // [N m], of prismatic joints [N]
    std::span<double> iterations;    // of Newton's method, of every cable
    std::span<double> residual;      // largest force imbalance of every cable [N]
    std::span<double> correction;    // that is part of every output with a learned one [N] or [N m]
    std::span<double> trust;         // share of it that applies there, (R3)

    /// Every part in its order: its name, its member, and its rows. What joints have follows what motors have,
    /// so that both are one part of all axes.
    template <typename Visit>
    static void parts([[maybe_unused]] const Sizes& sizes, Visit visit) {
        visit("tension", &Estimate::tension, sizes.elements);
        visit("status", &Estimate::status, sizes.elements);
        visit("force_x", &Estimate::force_x, sizes.pulleys);
        visit("force_y", &Estimate::force_y, sizes.pulleys);
        visit("force_z", &Estimate::force_z, sizes.pulleys);
        visit("magnitude", &Estimate::magnitude, sizes.pulleys);
        visit("friction", &Estimate::friction, sizes.pulleys);
        visit("slip_speed", &Estimate::slip_speed, sizes.pulleys);
        visit("motor_effort", &Estimate::motor_effort, sizes.motors);
        visit("joint_effort", &Estimate::joint_effort, sizes.joints);
        visit("iterations", &Estimate::iterations, sizes.cables);
        visit("residual", &Estimate::residual, sizes.cables);
        visit("correction", &Estimate::correction, sizes.residuals);
        visit("trust", &Estimate::trust, sizes.residuals);
    }
};

/// The parts with standard deviations, in the order in which these lie.
inline constexpr std::span<double> Estimate::*UNCERTAIN[] = {
    &Estimate::tension, &Estimate::magnitude, &Estimate::motor_effort, &Estimate::joint_effort};

/// Index of the first number of a part among all numbers of an estimate, or among the uncertain ones.
Index first_of(const Sizes& sizes, std::span<double> Estimate::*part, bool among_uncertain = false);

/// Intermediate values of a sample. The memory begins with zeros, as what no path leads over stays zero.
struct Workspace {
    Workspace(const Sizes& sizes, double* scratch);

    static std::size_t size(const Sizes& sizes);

    std::span<double> element_length;  // geometric, with its share of the arcs [m]
    Table lever_arm;                   // of every element about every joint [m], (E27); written for
                                       // those of its path
    std::span<Vector3> direction;      // unit vectors of routed elements in the base
    std::span<double> wrap;            // of every pulley [rad]
    std::span<double> arc;             // length of cable on every pulley [m]
    std::span<double> laid;            // cable that a turn of its frame or of its tangent has laid onto
                                       // every end since the reference pose [m], two a cable
    std::span<double> middle;          // place of the middle of every arc along its body, up to a
                                       // constant and whole turns [m]; only where it is given by tables
    std::span<Segment> segments;
    std::span<Contact> contacts;
    std::span<Pose> pose;              // of every frame
    Grid<Twist> twist;                 // of every frame by every joint; written for those that move it
    std::span<Touch> touches;          // of every node
    std::span<ArcMiddle> middles;      // of every node
    std::span<double> products;        // of rows and columns of (R1), as the weights
    double* history;                   // the state before the sample, by the contact cells of this
                                       // sample; only where some are fixed to a surface

    /// Every part in its order: its name, its member, and its rows, of a `Grid` with the width.
    template <typename Visit>
    static void parts([[maybe_unused]] const Sizes& sizes, Visit visit) {
        visit("element_length", &Workspace::element_length, sizes.elements);
        visit("lever_arm", &Workspace::lever_arm, sizes.elements, sizes.joints);
        visit("direction", &Workspace::direction, sizes.elements);
        visit("wrap", &Workspace::wrap, sizes.pulleys);
        visit("arc", &Workspace::arc, sizes.pulleys);
        visit("laid", &Workspace::laid, 2 * sizes.cables);
        visit("middle", &Workspace::middle, sizes.pulleys);
        visit("segments", &Workspace::segments, sizes.segments());
        visit("contacts", &Workspace::contacts, sizes.contacts);
        visit("pose", &Workspace::pose, sizes.frames);
        visit("twist", &Workspace::twist, sizes.frames, sizes.joints);
        visit("touches", &Workspace::touches, sizes.nodes);
        visit("middles", &Workspace::middles, sizes.nodes);
        visit("products", &Workspace::products, sizes.residual_weights);
    }
};

}  // namespace cdrj

// A robot as the core reads it, its parts' connections and constants; what a sample keeps for the next one, and
// what it works with.
//
// Every field is 8 bytes long or made of such: the records are rows of NumPy arrays, whose types
// `bind_model.cpp` makes of all fields. SI units.
#pragma once

#include <array>
#include <cstdint>

#include "vectors.hpp"

namespace cdrj {

using Index = std::int64_t;

/// How the lengths of a cable are given.
enum class Route : std::int64_t { tables, positions };

enum class Law : std::int64_t;  // friction.hpp

/// How static friction enters: (35) as printed, or the capstan equation with mu_s.
enum class Stribeck : std::int64_t { printed, capstan };
inline constexpr const char* STRIBECK_NAMES[]{"printed", "capstan"};

/// Motion of a frame relative to its parent.
enum class FrameMotion : std::int64_t { fixed, revolute, prismatic, rolling };
inline constexpr const char* FRAME_MOTION_NAMES[]{"fixed", "revolute", "prismatic", "rolling"};

enum class Guide : std::int64_t;  // guide.hpp

/// Intervals of a tabulated function over its joint's range.
inline constexpr std::int64_t TABLE_INTERVALS = 256;

/// Parts of a cable; its elements, pulleys, contacts, segments and nodes are consecutive.
struct CableTopology {
    Index first_element;
    Index elements;
    Index first_pulley;
    Index pulleys;
    Index first_contact;
    // of all its pulleys. Contact k of the robot's cable c lies before segment k + c + 1
    Index contacts;
    Index first_node;
    Law law;  // of all its pulleys
    Route routed;
};

/// One end of a cable.
struct EndTopology {
    Index first_turn;
    Index turns;  // number of motors that turn its drum; 0 for an anchor
    Index drum;  // its memory among those of the state; -1 for an anchor
};

/// A motor that turns a drum.
struct TurnTopology {
    Index motor;
};

/// Place of a pulley in its cable, its contact cells, and the form of its friction.
struct PulleyTopology {
    Index element;  // the element before it
    Index first_contact;
    Index cells;  // number of its contact cells
    // its number among the pulleys whose cells are fixed to their surface; -1 where they are equal
    // parts of the arc and move with it
    Index surface;
    Index wrap_changes;  // 0 where the wrap is the same in every pose
    Stribeck stribeck;  // form of static friction
};

/// A tabulated function of one joint angle, added to a span or a wrap.
struct TermTopology {
    // 1: `target` is a pulley, whose wrap it changes; 0: an element, whose span it changes
    Index adds_to_wrap;
    Index target;
    Index joint;
};

/// Place of a frame in the tree of frames; parents come first.
struct FrameTopology {
    Index parent;  // index of the parent frame; -1 for the base
    FrameMotion motion;
    Index joint;  // index of the joint that moves the frame; -1 for a fixed frame
};

/// Shape of a node and the frames that carry it.
struct NodeTopology {
    Guide kind;
    Index frame;  // -1 where the node has no position
    // frame of the far end of a sheath, or of the side point of a round body
    Index exit_frame;
};

/// Constants of a cable.
struct CableConstants {
    double axial_stiffness;  // EA [N]
    // strain that the strands' bedding adds at high load [-], (E21); 0 for a linear cable
    double bedding_strain;
    double bedding_tension;  // tension at which half of it is taken up [N]
    double creep_share;  // delayed strain as a share of the elastic one [-], (E24); 0 for none
    double creep_time;  // its time constant [s]
    double flow_time;  // time in which the flow equals the elastic strain [s]; infinite for none
    double preload;  // tension in the reference pose [N]
    double maximum_tension;  // an element with a higher tension is overloaded [N]
    double credible_tension;  // an element with a higher tension is rather misread than loaded [N]
    double wound_tension;  // tension at which the cable was wound onto its drums [N]
    double slack_tension;  // an element with this tension or a lower one is slack [N]
};

/// Constants of one end of a cable; 0 for an anchor.
struct EndConstants {
    double radius;  // of the drum, from its axis to the cable's centre line [m]
};

/// Constants of a motor that turns a drum.
struct TurnConstants {
    double winding;  // angle by which the drum winds cable in per angle of the motor [-], (E3)
};

/// One pulley of the robot: friction constants, and the wrap where it never changes.
struct PulleyConstants {
    double radius;  // from the axis to the cable's centre line [m]
    double rho;  // share of sliding friction in the blend (42) [-]
    double mu_c;  // Coulomb coefficient [-]
    double mu_s;  // static coefficient [-]
    double stribeck_speed;  // v_s of (33) [m/s]
    double stribeck_lag;  // time by which static friction lags behind the slip speed [s], (E10)
    double bearing_ratio;  // 1 / alpha of (41) [-]
    double drag;  // friction force of the bearing without load [N]
    double bristle_stiffness;  // sigma0 [N/m]
    double bristle_damping;  // sigma1 [N s/m]
    double viscous;  // sigma2 [N s/m]
    double breakaway;  // fraction of the bound up to which pre-sliding is elastic [-]
    double wrap;  // Constant part of the wrap angle [rad]
    // motion of the middle of the arc towards the last node as a share of the arc's growth [-]:
    // 1/2 where the end after it moves, -1/2 where that before it does, 0 where both do. Only used
    // where the wrap is given by tables
    double moved_after;
    double cell_width;  // of contact cells that are fixed to the surface [m]
    double kinetic_loss;  // loss 1 - eta at high slip speed where the wrap never changes [-]
    double static_loss;  // further loss at rest where the wrap never changes [-]
    double half_sine;  // sin(wrap / 2) where the wrap never changes
    double half_cosine;  // cos(wrap / 2) where the wrap never changes
};

/// Constants of an element.
struct ElementConstants {
    // Constant part of the length between tangent points [m]; 0 where it follows from positions
    double span;
};

/// Constants of a segment.
struct SegmentConstants {
    double material;  // unstretched length in the reference pose [m]
};

/// Constants of a motor.
struct MotorConstants {
    double reference_angle;  // reading in the pose in which the preload was measured [rad]
};

/// The grid of a joint's tables.
struct JointConstants {
    double lower;  // lower end of the joint's range [rad] or [m]
    double interval;  // width of an interval of the tables [rad] or [m]
};

/// Constants of the passive torque of a motor or joint, (E13); N for N m at prismatic joints.
struct AxisConstants {
    double effort_sign;  // +1 or -1, see `cdrj_ros.robot.description.Motor`
    double bearing_torque;  // Coulomb friction [N m]
    double bearing_stiffness;  // slope of the friction where the motion reverses [N m/rad]
    double spring_stiffness;  // [N m/rad]
    double spring_rest;  // angle at which the spring's torque vanishes [rad]
};

/// c0 + c1 u + c2 u^2 + c3 u^3, u in [0, 1] over one interval of a table.
struct Cubic {
    double c0;
    double c1;
    double c2;
    double c3;
};

/// Pose of a frame in its parent, and its motion.
struct FrameConstants {
    Vector3 origin;  // [m]
    Matrix3 rotation;  // orientation in the parent without motion, by rows
    Vector3 axis;  // unit vector of its motion, in the frame
    double rolling_radius;  // radius of both circles of a rolling joint [m]
    double multiplier;  // its motion per motion of its joint [-]
    double offset;  // its motion at joint angle 0 [rad] or [m]
};

/// A node in its frame.  The z axis of its own axes is the axis of a round body.
struct NodeConstants {
    Vector3 centre;  // Centre, point or entry [m]
    Matrix3 basis;  // unit vectors of its own axes, one by row
    // far end of a sheath, or the point on the side that the cable passes, in `exit_frame` [m]
    Vector3 exit;
    double sided;  // 1 where a side is given, otherwise 0
    // 1 where a body does not touch the cable while a neighbouring point lies inside it; 0 where
    // such a pose is impossible
    double ignored_inside;
    double radius;  // [m]
    // +1 counter-clockwise about the axis, -1 clockwise, 0 where it follows from the position
    double turn;
    double inside;  // 1 where the cable runs through the inside of a round body, as through a ring
    double turns;  // whole turns in addition to the wrap
    // rise of a drum's groove along its axis per radian of cable wound in [m/rad]; 0 in the
    // reference pose, and for all other nodes
    double lead;
    double effective_radius;  // Cable on a drum or a sector per radian [m/rad]
    double length;  // length of a sheath [m]
    // for a pulley: wrap in the reference pose [rad]; the wrap is continuous within half a turn of
    // it. For an end that winds cable: angle of its tangent point in the reference pose, plus
    // `turn_reference` [rad]
    double arc_reference;
    // for an end: turn of its frame about its axis in the reference pose [rad]
    double turn_reference;
};

/// An output with a learned correction, (R1).
struct ResidualTopology {
    Index column;  // in the estimate; that of a tension is the number of its element
    Index cable;  // of that element; -1 for an effort
    Index first_input;  // its inputs are consecutive among those of all such outputs
    Index inputs;  // the first is the output itself
    Index first_weight;
};

/// What an output's correction depends on: an angle, or an output of the model.
struct ResidualInputTopology {
    Index axis;  // among motors, then joints; -1 for an output
    Index column;  // of that output in the estimate
};

/// Lowest and highest value of an input that was seen when the correction was fitted.
struct ResidualRange {
    double lower;
    double upper;
};

/// Constants of an output with a learned correction, beside its weights.
struct ResidualConstants {
    double bound;  // largest correction [N] or [N m]; 0 for none
    double variance;  // of the error that is left in that range
};

// -------------------------------------------------------------------------------------------------
// What a sample keeps for the next one, and what it works with

/// Break points that a drum remembers.
inline constexpr int CAPACITY = 64;

/// What a drum holds: a piecewise linear map from the wound angle to the material on it.
struct Drum {
    double points;  // break points in use, a whole number
    double spacing;  // distance of break points [rad]
    double rate_below;  // unstretched material per radian below the first break point [m/rad]
    std::array<double, CAPACITY> angle;  // wound angle of every break point, increasing [rad]
    std::array<double, CAPACITY> material;  // unstretched material up to every break point [m]
};

/// Middle of an arc in the axes of its body, from which its motion along the cable follows.
struct ArcMiddle {
    Vector3 normal;  // unit vector from the axis, of a sphere from the centre, to the middle
    // direction of the cable there: a unit vector, on a ring the mean of both units; 0 where the cable
    // does not touch the body
    Vector3 tangent;
    double height;  // along the axis of a cylinder [m]; 0 for other bodies
};

/// An input of a learned correction, (R2); every number is from -1 to 1 in the range seen.
struct ResidualInput {
    double place;  // in the range seen
    std::array<double, 3> stop;  // stop operators, each as a fraction of its bound
    double motion;  // time since its last motion, with the sign of that motion
};

/// The cable between two neighbouring contacts, or between a contact and an end.
struct Segment {
    double length_before;  // geometric length at the sample before [m]
    double length;  // geometric length now [m]
    double material_before;  // unstretched length at the sample before [m]
    double material;  // unstretched length now [m]
    double tension;  // [N]
};

/// One contact: its unknown flux, its friction and its row of the linear system.
struct Contact {
    double share;  // share of its pulley's wrap [-]
    double stiffness;  // its part of sigma0 [N/m]
    double damping;  // its part of sigma1 [N s/m]
    double viscous;  // its part of sigma2 [N s/m]
    double drag;  // its part of the bearing's friction force without load [N]
    double breakaway;  // fraction of the bound up to which pre-sliding is elastic [-]
    // material by which its middle has moved on the body, towards the last node, in this sample
    // [m]: the second term of (E25)
    double shift;
    double flux;  // material that moves past its middle towards the last node in this sample [m]
    double bristle_before;  // bristle force at the sample before [N]
    double bristle;  // bristle force now [N]
    double loss;  // 1 - eta at the lagged slip speed [-]
    double static_share;  // share of static friction that remains at the lagged slip speed [-]
    double bound;  // largest friction force, g of (34) [N]
    double trial;  // flux at which the imbalance is evaluated [m]
    double step;  // newton step of the flux [m]
    double residual;  // force imbalance at `trial` [N]
    double by_slip;  // derivative of friction by the slip at constant bound [N/m]
    double by_pull;  // derivative of friction by the tension on the pull side [-]
    double upper;  // eliminated system: coefficient of the next contact's step [-]
};

/// Pose of a frame in the base.
struct Pose {
    Matrix3 rotation;  // by rows
    Vector3 origin;  // [m]
};

/// Velocity of a frame per unit of a joint's velocity.
struct Twist {
    Vector3 angular;  // [-]
    Vector3 linear;  // velocity of the base's origin, as if it moved with the frame [m]
};

/// Contact of a cable with a node in one pose.
struct Touch {
    Vector3 centre;  // in the base [m]
    Matrix3 basis;  // unit vectors of the node's own axes in the base, one by row
    Vector3 entry;  // first point of contact in the base [m]
    Vector3 exit;  // last point of contact in the base [m]
    Vector3 before;  // point from which the cable comes, in the node's own axes [m]
    Vector3 after;  // point to which the cable goes, in the node's own axes [m]
    Vector3 side;  // point on the side that the cable passes, in the node's own axes [m]
    Vector3 normal;  // axis of the arc in the node's own axes
    // unit vector to the first point of contact, normal to the axis of the arc
    Vector3 entry_normal;
    // unit vector to the last point of contact, normal to the axis of the arc; for a
    // swivel pulley, the direction of its plane
    Vector3 exit_normal;
    double before_length;  // free length before the contact, in the plane of the arc [m]
    double after_length;  // free length after the contact, in the plane of the arc [m]
    double sense;  // +1: the cable goes round `normal` counter-clockwise, -1: clockwise
    double touching;  // 1 where the cable touches the node, otherwise 0
    double angle;  // angle of the arc about its axis [rad]
    double wrap;  // angle through which the cable turns at the node [rad]
    double arc;  // length of cable on the node [m]
    // if the cable does not touch: position of the node along the straight line past it [-]
    double share;
    double twisted;  // turn of the frame of an end about its axis by all joints [rad]
    // angle of cable that the motor of an end has wound in since the reference pose [rad]
    double wound;
    // of an end that winds cable: moment of the cable about its axis per newton [m], (E27)
    double lever;
};

}  // namespace cdrj

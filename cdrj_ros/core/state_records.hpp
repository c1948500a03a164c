// What a sample keeps for the next one, and what it works with.
//
// Every field is 8 bytes long or made of such: the records are rows of NumPy arrays, whose types
// `bind_records.cpp` makes of all fields. SI units.
#pragma once

#include <array>
#include <cstdint>

#include "vectors.hpp"

namespace cdrj {

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

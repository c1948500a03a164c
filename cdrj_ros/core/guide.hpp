// What guides a cable in space: a small interface, one file per kind.
//
// All vectors are in the guide's own axes: z is the axis of a round body and the origin its centre.
// `touch.before` is the point a from which the cable comes, `touch.after` the point b to which it
// goes. docs/model.md, section 13.2.
#pragma once

#include "robot_records.hpp"
#include "state_records.hpp"

namespace cdrj {

/// Where a cable touches a guide.
struct Meeting {
    bool possible;
    Vector3 entry;  // first point of contact
    Vector3 exit;   // last point of contact
};

/// A kind of guide.
struct GuideKind {
    /// Find where the cable touches the guide, from `before` and `after`.
    Meeting (*meet)(const NodeConstants& node, Touch& touch);

    /// Write angle, length and wrap of the arc from the points of contact.
    void (*measure)(const NodeConstants& node, Touch& touch);

    /// Middle of the arc, from which its motion along the body follows (E26).
    ArcMiddle (*middle)(const NodeConstants& node, const Touch& touch);
};

/// An eyelet or a sheath: the cable passes at points of its frame, which never move in it.
extern const GuideKind POINT, SHEATH;
/// A pulley with a groove, a pulley that swivels about the entering cable, bodies on which cable lies.
extern const GuideKind PULLEY, SWIVEL, CYLINDER, SPHERE;

/// The kind of a guide; a new kind adds its name to `Guide`, a file and a line here.
inline const GuideKind& kind_of(Guide guide) {
    static constexpr const GuideKind* KINDS[]{&POINT, &PULLEY, &SWIVEL, &CYLINDER, &SPHERE, &SHEATH};
    return *KINDS[static_cast<Index>(guide)];
}

/// Whether a guide's points of contact do not depend on its neighbours.
inline bool is_fixed(Guide guide) { return guide == Guide::point || guide == Guide::sheath; }

}  // namespace cdrj

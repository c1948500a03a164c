// A sheath: it keeps the length of the cable between two points.
#include "guide.hpp"

namespace cdrj {
namespace {

Meeting meet(const NodeConstants&, Touch& touch) { return {true, touch.entry, touch.exit}; }

/// The middle never moves in the body.
ArcMiddle measure(const NodeConstants& node, const Passing& cable, Touch& touch) {
    touch.wrap = cable.wrap;
    touch.arc = node.length;
    return {Z_AXIS, Z_AXIS, 0.0};
}

}  // namespace

const GuideKind SHEATH{
    .fixed = true, .bridges = true, .grooved = false, .meet = meet, .measure = measure};

}  // namespace cdrj

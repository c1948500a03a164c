// A point: an eyelet, or an anchor at an end.
#include "guide.hpp"

namespace cdrj {
namespace {

Meeting meet(const NodeConstants&, Touch& touch) { return {true, touch.entry, touch.exit}; }

/// The middle never moves in the body.
ArcMiddle measure(const NodeConstants&, const Passing& cable, Touch& touch) {
    touch.wrap = cable.bend();
    return {Z_AXIS, Z_AXIS, 0.0};
}

}  // namespace

const GuideKind POINT{
    .fixed = true, .bridges = false, .grooved = false, .meet = meet, .measure = measure};

}  // namespace cdrj

// A point: an eyelet, or an anchor at an end.
#include "guide.hpp"

namespace cdrj {
namespace {

/// The middle never moves in the body.
ArcMiddle measure(const NodeConstants&, const Passing& cable, Touch& touch) {
    touch.wrap = cable.bend();
    return {Z_AXIS, Z_AXIS, 0.0};
}

}  // namespace

const GuideKind POINT{
    .bridges = false, .grooved = false, .meet = nullptr, .measure = measure, .tangent = nullptr};

}  // namespace cdrj

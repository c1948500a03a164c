// A sheath: it keeps the length of the cable between two points.
#include "guide.hpp"

namespace cdrj {
namespace {

/// The middle never moves in the body.
ArcMiddle measure(const NodeConstants& node, const Passing& cable, Touch& touch) {
    touch.wrap = cable.wrap;
    touch.arc = node.length;
    return {Z_AXIS, Z_AXIS, 0.0};
}

}  // namespace

const GuideKind SHEATH{
    .bridges = true, .grooved = false, .meet = nullptr, .measure = measure, .tangent = nullptr};

}  // namespace cdrj

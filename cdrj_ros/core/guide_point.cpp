// An eyelet, and a sheath whose cable keeps its length between two points.
#include "guide.hpp"

namespace cdrj {
namespace {

Meeting meet(const NodeConstants&, Touch& touch) { return {true, touch.entry, touch.exit}; }

void measure(const NodeConstants&, Touch&) {}

/// A point of the body, which never moves in it.
ArcMiddle middle(const NodeConstants&, const Touch&) { return {Z_AXIS, Z_AXIS, 0.0}; }

}  // namespace

const GuideKind POINT{meet, measure, middle};
const GuideKind SHEATH{meet, measure, middle};

}  // namespace cdrj

// No friction.
#include "friction.hpp"

namespace cdrj {
namespace {

Friction force(const Bristles&, double) { return {0.0, 0.0, 0.0}; }

bool shorten(const Bristles&, double, double&) { return false; }

}  // namespace

const FrictionLaw FRICTIONLESS{force, shorten};

}  // namespace cdrj

#include "units.hpp"

#include <algorithm>
#include <cmath>

namespace cdrj {
namespace {

constexpr double STRETCH = 0.3;  // a load stretches a cable by no more than this share of an axis's motion
constexpr double SHARE = 0.1;    // one that has moved less than this share of others is judged by these
constexpr double MEMORY = 10.0;  // time constant with which a stretch is forgotten [s], that of (C2)

}  // namespace

Units::Units(std::size_t axes, std::span<const double> gains, std::span<const double> loads)
    : errors(axes),
      cables_(gains.size() / axes),
      greatest_gain_(axes),
      furthest_(axes),
      before_(axes),
      doubtful_(axes) {
    for (std::size_t k = 0; k < gains.size(); ++k) {
        if (gains[k] > 0.0) cables_[k / axes].ends.push_back({k % axes, gains[k], loads[k]});
        greatest_gain_[k % axes] = std::max(greatest_gain_[k % axes], gains[k]);
    }
}

void Units::begin() {
    for (Cable& cable : cables_) cable.stretch = 0.0;
    first_angle_.clear();
    first_tension_.clear();
    std::ranges::fill(furthest_, 0.0);
    std::ranges::fill(errors, 0.0);
    last_ns_ = NEVER_NS;
}

bool Units::take(
    Nanoseconds stamp_ns, std::span<const double> angles, std::span<const double> tensions,
    std::span<const double> unread) {
    if (first_angle_.empty()) {
        first_angle_.assign(angles.size(), UNREAD);
        first_tension_.assign(tensions.size(), UNREAD);
        last_ns_ = stamp_ns;
    }
    for (std::size_t a = 0; a < angles.size(); ++a) {
        if (std::isnan(first_angle_[a])) first_angle_[a] = angles[a];
    }
    for (std::size_t c = 0; c < tensions.size(); ++c) {
        if (std::isnan(first_tension_[c]) && unread[c] < INFINITE) first_tension_[c] = tensions[c];
    }
    const Nanoseconds since_ns = std::max<Nanoseconds>(stamp_ns - last_ns_, 0);  // or a clock was set
    const double kept = std::exp(-since_ns * 1e-9 / MEMORY);
    last_ns_ = stamp_ns;
    for (std::size_t a = 0; a < furthest_.size(); ++a) {
        furthest_[a] = std::max(furthest_[a], std::abs(angles[a] - first_angle_[a]));
    }
    std::ranges::fill(doubtful_, 0);
    for (std::size_t c = 0; c < cables_.size(); ++c) {
        Cable& cable = cables_[c];
        const double stretch = std::abs(tensions[c] - first_tension_[c]) - unread[c];
        cable.stretch = std::max(kept * cable.stretch, stretch);  // that so far if it is not known
        doubt(cable);
    }
    before_.swap(errors);
    std::ranges::fill(errors, 0.0);
    for (const Cable& cable : cables_) {
        for (const End& end : cable.ends) {
            if (doubtful_[end.axis] == 0) continue;
            errors[end.axis] = std::max(errors[end.axis], cable.stretch / greatest_gain_[end.axis]);
        }
    }
    return errors != before_;
}

/// Notes the axes of a cable that its stretch leaves in doubt.
void Units::doubt(const Cable& cable) {
    double greatest = 0.0, loads = 0.0, free = 0.0;
    for (const End& end : cable.ends) {
        const double part = end.gain * furthest_[end.axis];
        (end.load < 1.0 ? loads : free) += end.load * part;
        if (end.load < 1.0) greatest = std::max(greatest, part);
    }
    for (const End& end : cable.ends) {
        if (end.load >= 1.0) continue;
        const double part = end.gain * furthest_[end.axis];
        const double most = part > SHARE * greatest ? std::min(loads, STRETCH * part) : loads;
        if (cable.stretch > most + free) doubtful_[end.axis] = 1;
    }
}

}  // namespace cdrj

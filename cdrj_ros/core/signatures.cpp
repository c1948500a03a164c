#include "signatures.hpp"

#include <algorithm>
#include <utility>

namespace cdrj {

Signatures::Signatures(
    const Topology& topology, std::vector<double> constants, std::vector<double> shift,
    std::vector<bool> slipping, std::vector<Ends> unknowns)
    : topology_(topology),
      sizes_(topology.sizes),
      tensions_at_(first_of(sizes_, &Estimate::tension, true)),
      forces_at_(first_of(sizes_, &Estimate::magnitude, true)),
      efforts_at_(first_of(sizes_, &Estimate::motor_effort, true)),
      robots_(topology, shift.size() / topology.sizes.axes(), std::move(constants)),
      shift_(std::move(shift)),
      slipping_(std::move(slipping)),
      unknowns_(std::move(unknowns)),
      angle_(sizes_.axes()),
      values_(robots_.size() * quantities()),
      efforts_(robots_.size() * sizes_.cables * sizes_.axes()) {
    if (robots_.size() > 0) out_.resize(robots_[0].out_size());
}

void Signatures::follow(
    std::span<const double> motor_angle, std::span<const double> joint_angle, double dt,
    std::span<double> slopes) {
    for (Index k = 0; k < robots_.size(); ++k) step(k, motor_angle, joint_angle, dt);
    std::ranges::fill(slopes, 0.0);
    for (Index u = 0; u < unknowns(); ++u) {
        const auto own = slopes.subspan(u * quantities(), quantities());
        const Ends& ends = unknowns_[u];
        if (ends.only < 0) {
            compare(ends, 0, quantities(), own);
        } else if (ends.only < sizes_.cables) {
            compare_cable(ends, own);
        } else {
            compare(ends, efforts_at_ + ends.only - sizes_.cables, 1, own);
        }
    }
}

/// Step a robot, and note its quantities and the efforts of each of its cables.
void Signatures::step(
    Index k, std::span<const double> motor_angle, std::span<const double> joint_angle, double dt) {
    const auto joints = std::ranges::copy(motor_angle, angle_.begin()).out;
    std::ranges::copy(joint_angle, joints);
    for (Index a = 0; a < sizes_.axes(); ++a) angle_[a] += shift_[k * sizes_.axes() + a];
    const std::span<const double> angles(angle_);
    const bool solved =
        robots_.advance(k, angles.first(sizes_.motors), angles.last(sizes_.joints), dt, out_.data());
    if (slipping_[k] && solved) robots_[k].forget_drums(robots_.state(k).data());
    const Step done(robots_[k], robots_.state(k).data(), out_.data());
    auto value = values_.begin() + k * quantities();
    for (const auto part : UNCERTAIN) value = std::ranges::copy(done.estimate.*part, value).out;
    for (Index c = 0; c < sizes_.cables; ++c) {
        for (const Index a : topology_.paths->of_cable[c].axes) {
            const double sign = robots_[k].constants.axes[a].effort_sign;
            efforts_[(k * sizes_.cables + c) * sizes_.axes() + a] = sign * effort_of_cable(done, a, c);
        }
    }
}

/// Compare some quantities.
void Signatures::compare(
    const Ends& ends, Index first, Index count, std::span<double> slopes) const {
    const double* const more = values_.data() + ends.more * quantities();
    const double* const less = values_.data() + ends.less * quantities();
    for (Index q = first; q < first + count; ++q) slopes[q] = 0.5 * (more[q] - less[q]);
}

/// Compare the quantities of the cable that an unknown changes, and its part in the efforts.
void Signatures::compare_cable(const Ends& ends, std::span<double> slopes) const {
    const CableTopology& cable = topology_.cables[ends.only];
    compare(ends, tensions_at_ + cable.first_element, cable.elements, slopes);
    compare(ends, forces_at_ + cable.first_pulley, cable.pulleys, slopes);
    for (const Index a : topology_.paths->of_cable[ends.only].axes) {
        if (topology_.paths->cables_of_axis[a].size() == 1) {  // with friction and spring of the axis
            compare(ends, efforts_at_ + a, 1, slopes);
        } else {
            slopes[efforts_at_ + a] =
                0.5 * (effort(ends.more, ends.only, a) - effort(ends.less, ends.only, a));
        }
    }
}

double Signatures::effort(Index robot, Index cable, Index axis) const {
    return efforts_[(robot * sizes_.cables + cable) * sizes_.axes() + axis];
}

}  // namespace cdrj

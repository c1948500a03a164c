#include "units.hpp"

#include <algorithm>
#include <cmath>

namespace cdrj {
namespace {

constexpr double STRETCH = 0.3;  // loads stretch a cable by no more than this share of an axis's motion
constexpr double SHARE = 0.1;    // one that has moved less than this share of others is judged by these
constexpr double MEMORY = 10.0;  // time constant with which motion and stretch are forgotten [s], that of (C2)
constexpr double BOUNDS = 3.0;   // standard deviations within which unread angles are

}  // namespace

Units::Units(std::span<const Axis> axes, std::span<const double> bends) : error_(axes.size()) {
    std::size_t cables = 0;
    for (const Axis& axis : axes) cables = std::max(cables, axis.pull.size());
    for (std::size_t c = 0; c < cables; ++c) {
        Cable cable{.bend = c < bends.size() ? bends[c] : 0.0};
        for (std::size_t a = 0; a < axes.size(); ++a) {
            const double pull = axes[a].pull.empty() ? 0.0 : axes[a].pull[c];
            if (pull != 0.0) cable.ends.push_back({.axis = a, .pull = pull, .free = axes[a].free});
        }
        if (cable.ends.size() > 1) all_.push_back(std::move(cable));
    }
    begin();
}

void Units::begin() {
    cables_ = all_;
    first_.clear();
    std::ranges::fill(error_, 0.0);
    doubts_ = 0;
    last_ns_ = -1;
}

void Units::take(
    Nanoseconds stamp_ns, std::span<const double> angles, std::span<const double> unseen) {
    if (first_.empty()) first_.assign(angles.begin(), angles.end());
    if (cables_.empty()) return;
    std::ranges::fill(error_, 0.0);
    doubts_ = 0;
    kept_ = last_ns_ < 0 ? 1.0 : std::exp(-(stamp_ns - last_ns_) * 1e-9 / MEMORY);
    last_ns_ = stamp_ns;
    for (Cable& cable : cables_) take(cable, angles, unseen);
    std::erase_if(cables_, [](const Cable& cable) {
        return std::ranges::all_of(cable.ends, [](const End& end) { return end.known || end.free; });
    });
}

void Units::take(Cable& cable, std::span<const double> angles, std::span<const double> unseen) {
    double stretch = 0.0, unread = 0.0;
    cable.furthest = 0.0;
    for (End& end : cable.ends) {
        const double part = end.pull * (angles[end.axis] - first_[end.axis]);
        if (!unseen.empty()) unread += BOUNDS * std::abs(end.pull) * unseen[end.axis];
        if (end.free) {
            unread += std::abs(part);
            continue;
        }
        stretch += part;
        end.furthest = std::max(kept_ * end.furthest, std::abs(part));
        cable.furthest = std::max(cable.furthest, end.furthest);
    }
    stretch = std::abs(stretch);
    cable.stretch = std::max(kept_ * cable.stretch, stretch - unread);
    for (End& end : cable.ends) {
        if (end.known || end.free) continue;
        const bool is_shown = end.furthest > SHARE * cable.furthest;
        const double furthest = is_shown ? end.furthest : cable.furthest;
        const double most = STRETCH * furthest + cable.bend * cable.furthest;
        const bool is_explained = cable.stretch <= most;
        end.doubtful = !is_explained && cable.stretch > 1.0;
        doubts_ += end.doubtful;
        if (!is_explained) {
            error_[end.axis] = std::max(error_[end.axis], stretch / std::abs(end.pull));
        } else if (is_shown && end.furthest > 1.0) {
            end.known = stretch + unread <= most;
        }
    }
}

bool Units::doubts(std::size_t axis) const {
    return std::ranges::any_of(cables_, [&](const Cable& cable) {
        return std::ranges::any_of(
            cable.ends, [&](const End& end) { return end.axis == axis && end.doubtful; });
    });
}

}  // namespace cdrj

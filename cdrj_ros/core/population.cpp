#include "population.hpp"

#include <algorithm>
#include <utility>

namespace cdrj {

Population::Population(
    const Topology& topology, std::size_t robots, std::vector<double> of_robots)
    : constants(std::move(of_robots)), states(robots * State::size(topology.sizes)) {
    robots_.reserve(robots);
    for (std::size_t k = 0; k < robots; ++k) {
        robots_.emplace_back(topology, constants.data() + k * (constants.size() / robots));
    }
}

bool Population::advance(
    Index k, std::span<const double> motor_angle, std::span<const double> joint_angle, double dt,
    double* out) {
    const std::span<double> own = state(k);
    const bool solved = robots_[k].advance(own.data(), motor_angle, joint_angle, dt, out);
    std::copy_n(out, own.size(), own.begin());
    return solved;
}

}  // namespace cdrj

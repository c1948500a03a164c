// A robot as the bound functions hold it.
#pragma once

#include <pybind11/numpy.h>

#include <utility>

#include "arrays.hpp"
#include "robot.hpp"

namespace cdrj {

/// A robot whose arrays stay alive with it.
struct HeldRobot {
    HeldRobot(Indices plan, Vector numbers)
        : plan(std::move(plan)),
          numbers(std::move(numbers)),
          robot(this->plan.data(), this->numbers.data()) {
        require(this->plan.size() >= Index{sizeof(Sizes) / sizeof(Index)}, "plan is too short");
    }

    /// Angles of all motors and of all joints in one sample.
    void require_angles(pybind11::ssize_t motors, pybind11::ssize_t joints) const {
        require(
            motors == robot.topology.sizes.motors && joints == robot.topology.sizes.joints,
            "the angles are not those of this robot");
    }

    Indices plan;
    Vector numbers;
    Robot robot;
};

}  // namespace cdrj

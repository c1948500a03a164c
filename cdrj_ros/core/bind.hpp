// What the files of the Python module `cdrj_ros._core` share.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cstddef>
#include <utility>

#include "bind_array.hpp"
#include "robot.hpp"

namespace cdrj {

using namespace nb::literals;

/// Samples between two looks at Ctrl-C.
inline constexpr Index PIECE = 4096;

/// Call `each` with 0, 1, ... until it returns false, without the interpreter's lock; returns how often it
/// returned true. Ctrl-C ends this between two pieces.
template <typename Each>
Index for_samples(Index samples, Each each, Index piece = PIECE) {
    for (Index k = 0; k < samples;) {
        if (PyErr_CheckSignals() != 0) nb::raise_python_error();
        const nb::gil_scoped_release free;
        for (const Index end = std::min(k + piece, samples); k < end; ++k) {
            if (!each(k)) return k;
        }
    }
    return samples;
}

/// Refuse arguments that do not fit.
inline void require(bool fits, const char* otherwise) {
    if (!fits) throw nb::value_error(otherwise);
}

/// A robot whose arrays stay alive with it.
struct HeldRobot {
    HeldRobot(GivenIntegers topology, Given constants)
        : topology(std::move(topology)),
          constants(std::move(constants)),
          robot(this->topology.data(), this->constants.data()) {
        require(this->topology.size() >= Index{sizeof(Sizes) / sizeof(Index)}, "topology is too short");
    }

    /// Angles of all motors and of all joints in one sample.
    void require_angles(Index motors, Index joints) const {
        require(
            motors == robot.topology.sizes.motors && joints == robot.topology.sizes.joints,
            "the angles are not those of this robot");
    }

    GivenIntegers topology;
    Given constants;
    Robot robot;
};

/// Kinds as an enumeration, by their names in the order of their codes.
template <typename Kind, std::size_t n>
void bind_kinds(nb::module_& core, const char* name, const char* const (&names)[n]) {
    nb::enum_<Kind> kinds(core, name);
    for (std::size_t k = 0; k < n; ++k) kinds.value(names[k], static_cast<Kind>(k));
}

void bind_records(nb::module_& core);
void bind_messages(nb::module_& core);
void bind_conditioning(nb::module_& core);
void bind_ensemble(nb::module_& core);
void bind_simulation(nb::module_& core);

}  // namespace cdrj

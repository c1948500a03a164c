// What the files of the Python module `cdrj_ros._core` share.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cstddef>
#include <utility>

#include "bind_array.hpp"
#include "records.hpp"
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

/// State of a robot after a sample; Python does not see its parts.
struct HeldState {
    Nanoseconds stamp_ns;
    std::vector<double> numbers;

    /// Time from this state to a sample [s]; 0 before the first one.
    double seconds_until(Nanoseconds sample_ns) const {
        return stamp_ns == NEVER_NS ? 0.0 : static_cast<double>(sample_ns - stamp_ns) * 1e-9;
    }
};

/// A robot whose arrays stay alive with it, and the memory in which it computes a sample.
struct HeldRobot {
    HeldRobot(GivenIntegers topology, Given constants)
        : topology(std::move(topology)),
          constants(std::move(constants)),
          robot(this->topology.data(), this->constants.data()),
          out(robot.out_size()) {
        require(this->topology.size() >= Index{sizeof(Sizes) / sizeof(Index)}, "topology is too short");
    }

    /// The state in `out`.
    std::vector<double> state() const { return {out.begin(), out.begin() + robot.state_size()}; }

    /// The estimate in `out`.
    Written estimate() const {
        return copy_of(std::span(out).subspan(robot.state_size(), robot.estimate_size()));
    }

    /// Angles of all motors and of all joints in one sample.
    void require_angles(Index motors, Index joints) const {
        require(
            motors == robot.topology.sizes.motors && joints == robot.topology.sizes.joints,
            "the angles are not those of this robot");
    }

    /// A state of such a robot.
    void require_state(const HeldState& state) const {
        require(
            state.numbers.size() == robot.state_size(), "state has not the size of this robot's");
    }

    GivenIntegers topology;
    Given constants;
    Robot robot;
    std::vector<double> out;  // of `Robot::advance`
};

/// Kinds as an enumeration, by their names in the order of their codes.
template <typename Kind, std::size_t n>
void bind_kinds(nb::module_& core, const char* name, const char* const (&names)[n]) {
    nb::enum_<Kind> kinds(core, name);
    for (std::size_t k = 0; k < n; ++k) kinds.value(names[k], static_cast<Kind>(k));
}

void bind_messages(nb::module_& core);
void bind_conditioning(nb::module_& core);
void bind_ensemble(nb::module_& core);
void bind_simulation(nb::module_& core);

}  // namespace cdrj

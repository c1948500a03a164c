// What the files of the Python module `cdrj_ros._core` share. They are few: each takes the compiler seconds
// for the headers of pybind11 alone.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <cstddef>
#include <span>
#include <utility>

#include "robot.hpp"

namespace cdrj {

/// A contiguous array of numbers, of one or two axes; bind it with `noconvert`.
using Vector = pybind11::array_t<double, pybind11::array::c_style>;
using Matrix = pybind11::array_t<double, pybind11::array::c_style>;
using Indices = pybind11::array_t<Index, pybind11::array::c_style>;

/// Numbers that are read only: other types and layouts are copied to a contiguous array.
using Given = pybind11::array_t<double, pybind11::array::c_style | pybind11::array::forcecast>;

/// An array of numbers as an argument of a function that is called for every sample.
///
/// Where type and layout fit, which is only looked at, this takes a third of the time of `Given` and
/// `Vector`.
inline Given quickly(const pybind11::object& given) {
    if (Given::check_(given)) return pybind11::reinterpret_borrow<Given>(given);
    return given.cast<Given>();
}

/// The same for an array that is written, which cannot be of another type or layout.
inline Vector written(const pybind11::object& given, const char* otherwise) {
    if (!Vector::check_(given)) throw pybind11::type_error(otherwise);
    return pybind11::reinterpret_borrow<Vector>(given);
}

template <typename T, int flags>
std::span<const T> span_of(const pybind11::array_t<T, flags>& array) {
    return {array.data(), static_cast<std::size_t>(array.size())};
}

/// Row `k` of a table, which may have no columns: pybind11 refuses to index such a row.
template <typename Array>
std::span<const double> row_of(const Array& table, pybind11::ssize_t k) {
    const pybind11::ssize_t width = table.shape(1);
    return {table.data() + k * width, static_cast<std::size_t>(width)};
}

/// Where row `k` of a table begins; the table may have no columns.
inline double* begin_of_row(Matrix& table, pybind11::ssize_t k) {
    return table.mutable_data() + k * table.shape(1);
}

/// Row `k` of a table, to be written.
inline std::span<double> written_row(Matrix& table, pybind11::ssize_t k) {
    return {begin_of_row(table, k), static_cast<std::size_t>(table.shape(1))};
}

/// Samples between two looks at Ctrl-C.
inline constexpr pybind11::ssize_t PIECE = 4096;

/// Call `each` with 0, 1, ... until it returns false, without the interpreter's lock; returns how often it
/// returned true. Ctrl-C ends this between two pieces.
template <typename Each>
pybind11::ssize_t for_samples(
    pybind11::ssize_t samples, Each each, pybind11::ssize_t piece = PIECE) {
    for (pybind11::ssize_t k = 0; k < samples;) {
        if (PyErr_CheckSignals() != 0) throw pybind11::error_already_set();
        const pybind11::gil_scoped_release free;
        for (const pybind11::ssize_t end = std::min(k + piece, samples); k < end; ++k) {
            if (!each(k)) return k;
        }
    }
    return samples;
}

/// Refuse arguments that do not fit.
inline void require(bool fits, const char* otherwise) {
    if (!fits) throw pybind11::value_error(otherwise);
}

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

/// A new array with these numbers.
pybind11::array_t<double> copy_of(std::span<const double> numbers);

/// Kinds as an enumeration, by their names in the order of their codes.
template <typename Kind, std::size_t n>
void bind_kinds(pybind11::module_& core, const char* name, const char* const (&names)[n]) {
    pybind11::enum_<Kind> kinds(core, name);
    for (std::size_t k = 0; k < n; ++k) kinds.value(names[k], static_cast<Kind>(k));
}

void bind_messages(pybind11::module_& core);
void bind_conditioning(pybind11::module_& core);
void bind_ensemble(pybind11::module_& core);
void bind_simulation(pybind11::module_& core);

}  // namespace cdrj

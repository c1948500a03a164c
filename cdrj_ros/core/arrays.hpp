// Arrays as arguments of the bound functions.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <cstddef>
#include <span>

#include "robot_records.hpp"

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

template <typename Array>
std::span<const double> span_of(const Array& array) {
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

}  // namespace cdrj

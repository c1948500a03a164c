// Arrays as arguments of the bound functions.
#pragma once

#include <pybind11/numpy.h>

#include <cstddef>
#include <span>

#include "robot_records.hpp"

namespace cdrj {

/// A contiguous array of numbers, of one or two axes; bind it with `noconvert`.
using Vector = pybind11::array_t<double, pybind11::array::c_style>;
using Matrix = pybind11::array_t<double, pybind11::array::c_style>;
using Indices = pybind11::array_t<Index, pybind11::array::c_style>;

inline std::span<const double> span_of(const Vector& vector) {
    return {vector.data(), static_cast<std::size_t>(vector.size())};
}

/// Refuse arguments that do not fit.
inline void require(bool fits, const char* otherwise) {
    if (!fits) throw pybind11::value_error(otherwise);
}

}  // namespace cdrj

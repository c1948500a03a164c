// The parts of the Python module `cdrj_ros._core`; bound in a few files: each takes the compiler
// seconds for the headers of pybind11 alone.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <span>

namespace cdrj {

/// A new array with these numbers.
pybind11::array_t<double> copy_of(std::span<const double> numbers);

/// Kinds as an enumeration, by their names in the order of their codes.
template <typename Kind, std::size_t n>
void bind_kinds(pybind11::module_& core, const char* name, const char* const (&names)[n]) {
    pybind11::enum_<Kind> kinds(core, name);
    for (std::size_t k = 0; k < n; ++k) kinds.value(names[k], static_cast<Kind>(k));
}

void bind_records(pybind11::module_& core);
void bind_messages(pybind11::module_& core);
void bind_conditioning(pybind11::module_& core);
void bind_ensemble(pybind11::module_& core);
void bind_simulation(pybind11::module_& core);
void bind_encoderless(pybind11::module_& core);

}  // namespace cdrj

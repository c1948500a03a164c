// The parts of the Python module `cdrj_ros._core`; each is bound in a file of its own.
#pragma once

#include <pybind11/pybind11.h>

namespace cdrj {

void bind_messages(pybind11::module_& core);
void bind_conditioning(pybind11::module_& core);
void bind_laws(pybind11::module_& core);
void bind_robot(pybind11::module_& core);
void bind_sliding(pybind11::module_& core);

}  // namespace cdrj

#include "bind.hpp"

#include <algorithm>

namespace py = pybind11;

py::array_t<double> cdrj::copy_of(std::span<const double> numbers) {
    py::array_t<double> array(static_cast<py::ssize_t>(numbers.size()));
    std::copy(numbers.begin(), numbers.end(), array.mutable_data());
    return array;
}

PYBIND11_MODULE(_core, core) {
    core.doc() = "The compiled core; its types are in _core.pyi.";
    cdrj::bind_messages(core);
    cdrj::bind_conditioning(core);
    cdrj::bind_ensemble(core);
    cdrj::bind_laws(core);
    cdrj::bind_robot(core);
    cdrj::bind_simulation(core);
    cdrj::bind_encoderless(core);
}

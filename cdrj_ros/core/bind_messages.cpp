// Decoding of messages, as nodes and `cdrj_ros.replay` use it.
#include "bind.hpp"
#include "messages.hpp"

namespace py = pybind11;

namespace cdrj {
namespace {

py::tuple names_of(const JointStateDecoder& decoder) {
    const std::vector<std::string>& names = decoder.last().names;
    py::tuple found(names.size());
    for (std::size_t i = 0; i < names.size(); ++i) found[i] = py::str(names[i]);
    return found;
}

}  // namespace

void bind_messages(py::module_& core) {
    py::class_<JointStateDecoder>(core, "JointStateDecoder")
        .def(py::init<bool>(), py::arg("efforts") = false)
        .def(
            "decode",
            [](JointStateDecoder& decoder, const py::bytes& payload) {
                return decoder.decode(std::string_view(payload));
            },
            py::arg("payload"))
        .def_property_readonly(
            "stamp_ns", [](const JointStateDecoder& d) { return d.last().stamp_ns; })
        .def_property_readonly("names", &names_of)
        .def_property_readonly(
            "positions", [](const JointStateDecoder& d) { return copy_of(d.last().positions); })
        .def_property_readonly(
            "efforts", [](const JointStateDecoder& d) { return copy_of(d.last().efforts); });
}

}  // namespace cdrj

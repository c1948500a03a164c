// Decoding and encoding of messages, as nodes and `cdrj_ros.recordings` use them.
#include "arrays.hpp"
#include "bind.hpp"
#include "message_encoder.hpp"
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

using Numbers = std::vector<std::array<std::size_t, 3>>;

std::vector<CopiedNumbers> copied(const Numbers& numbers) {
    std::vector<CopiedNumbers> found;
    for (const auto& [offset, first, count] : numbers) found.push_back({offset, first, count});
    return found;
}

MessageEncoder encoder_of(
    const py::bytes& blank, const Numbers& values, const Numbers& stddevs, const Numbers& flags) {
    MessageContent content{copied(values), copied(stddevs), {}};
    for (const auto& [offset, before, after] : flags) {
        content.flags.push_back({offset, before, after});
    }
    return {std::string(blank), std::move(content)};
}

py::bytes encode(
    MessageEncoder& encoder, Nanoseconds stamp_ns, const py::object& values,
    const py::object& stddevs) {
    const Given value = quickly(values), stddev = quickly(stddevs);
    require(
        stamp_ns >= 0 && stamp_ns < END_OF_TIME_NS,
        "the stamp does not fit a ROS header");
    require(
        encoder.takes(
            static_cast<std::size_t>(value.size()), static_cast<std::size_t>(stddev.size())),
        "the message needs more values or standard deviations");
    return encoder.encode(stamp_ns, span_of(value), span_of(stddev));
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
    py::class_<MessageEncoder>(core, "MessageEncoder")
        .def(
            py::init(&encoder_of), py::arg("blank"), py::arg("values"), py::arg("stddevs"),
            py::arg("flags"))
        .def("encode", &encode, py::arg("stamp_ns"), py::arg("values"), py::arg("stddevs"));
    core.attr("END_OF_TIME_NS") = END_OF_TIME_NS;
}

}  // namespace cdrj

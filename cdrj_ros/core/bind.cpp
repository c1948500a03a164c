#include "bind.hpp"

PYBIND11_MODULE(_core, core) {
    core.doc() = "The compiled core; its types are in _core.pyi.";
    cdrj::bind_messages(core);
    cdrj::bind_conditioning(core);
    cdrj::bind_laws(core);
    cdrj::bind_robot(core);
    cdrj::bind_sliding(core);
}

// The laws of a cable, each by itself: friction, creep, drums and the solution of one cable.
#include <pybind11/numpy.h>

#include "arrays.hpp"
#include "bind.hpp"
#include "cable.hpp"
#include "drum.hpp"
#include "friction.hpp"
#include "friction_law.hpp"
#include "laws.hpp"

namespace py = pybind11;
using namespace py::literals;

namespace cdrj {
namespace {

constexpr Index SEGMENT_WORDS = sizeof(Segment) / 8, CONTACT_WORDS = sizeof(Contact) / 8;

using Numbers3 = std::array<double, 3>;

Elasticity elasticity_of(const Numbers3& elastic) { return {elastic[0], elastic[1], elastic[2]}; }

py::tuple pair(const Loss& loss) { return py::make_tuple(loss.kinetic, loss.fading); }

/// A cable whose arrays stay alive with it.
struct HeldCable {
    HeldCable(
        const Numbers3& elastic, Law law, Matrix segments, Matrix contacts,
        double first_flux, double last_flux, double dt)
        : segments(std::move(segments)), contacts(std::move(contacts)) {
        require(
            this->segments.ndim() == 2 && this->segments.shape(1) == SEGMENT_WORDS &&
                this->contacts.ndim() == 2 && this->contacts.shape(1) == CONTACT_WORDS &&
                this->segments.shape(0) == this->contacts.shape(0) + 1,
            "segments and contacts have not the shapes of their records");
        cable = {
            elasticity_of(elastic),
            law,
            first_flux,
            last_flux,
            dt,
            {reinterpret_cast<Segment*>(this->segments.mutable_data()),
             std::size_t(this->segments.shape(0))},
            {reinterpret_cast<Contact*>(this->contacts.mutable_data()),
             std::size_t(this->contacts.shape(0))},
        };
    }

    py::tuple matrix_row_at(py::ssize_t i) const {
        require(0 <= i && i < contacts.shape(0), "there is no such contact");
        const Segment &left = cable.segments[i], &right = cable.segments[i + 1];
        const MatrixRow row = matrix_row(
            cable.contacts[i], segment_stiffness(cable.elastic, left),
            segment_stiffness(cable.elastic, right), right.tension >= left.tension, 0.0);
        return py::make_tuple(row.lower, row.diagonal, row.upper);
    }

    Matrix segments, contacts;
    Cable cable{};
};

void bind_friction(py::module_& core) {
    bind_kinds<Law>(core, "Law", LAW_NAMES);
    bind_kinds<Stribeck>(core, "Stribeck", STRIBECK_NAMES);
    core.attr("MINIMUM_TRANSMISSION") = MINIMUM_TRANSMISSION;
    core.attr("BOUND_FLOOR") = BOUND_FLOOR;
    core.def("capstan_transmission", capstan_transmission, "mu"_a, "wrap_angle"_a);
    core.def("stribeck_share", stribeck_share, "slip_speed"_a, "stribeck_speed"_a);
    core.def(
        "sliding_loss",
        [](double mu_c, double mu_s, double wrap_angle, Stribeck stribeck) {
            return pair(sliding_loss(mu_c, mu_s, wrap_angle, stribeck));
        },
        "mu_c"_a, "mu_s"_a, "wrap_angle"_a, "stribeck"_a);
    core.def(
        "sliding_transmission",
        [](double slip_speed, double mu_c, double mu_s, double stribeck_speed, double wrap_angle,
           Stribeck stribeck) {
            return sliding_transmission(
                slip_speed, mu_c, mu_s, stribeck_speed, wrap_angle, stribeck);
        },
        "slip_speed"_a, "mu_c"_a, "mu_s"_a, "stribeck_speed"_a, "wrap_angle"_a, "stribeck"_a);
    core.def("bearing_transmission", bearing_transmission, "wrap_angle"_a, "bearing_ratio"_a);
    core.def(
        "blended_loss",
        [](double rho, double mu_c, double mu_s, double wrap_angle, double bearing_ratio,
           Stribeck stribeck) {
            return pair(
                blended_loss(rho, mu_c, mu_s, wrap_angle, bearing_ratio, stribeck));
        },
        "rho"_a, "mu_c"_a, "mu_s"_a, "wrap_angle"_a, "bearing_ratio"_a, "stribeck"_a);
    core.def(
        "cell_loss",
        [](double kinetic, double static_, double share) {
            return pair(cell_loss({kinetic, static_}, share));
        },
        "kinetic"_a, "static"_a, "share"_a);
    core.def(
        "friction_force",
        [](Law law, double before, double slip, double stiffness, double bound, double breakaway) {
            const auto [force, by_slip, by_bound] =
                law_of(law).force({before, stiffness, bound, breakaway}, slip);
            return py::make_tuple(force, by_slip, by_bound);
        },
        "law"_a, "before"_a, "slip"_a, "stiffness"_a, "bound"_a, "breakaway"_a);
}

void bind_cable(py::module_& core) {
    core.def(
        "crept",
        [](double share, double time, double flow_time, double strain, double delayed, double dt) {
            const auto [after, growth] = crept({share, time, flow_time}, strain, delayed, dt);
            return py::make_tuple(after, growth);
        },
        "share"_a, "time"_a, "flow_time"_a, "strain"_a, "delayed"_a, "dt"_a);
    py::class_<Drum>(core, "Drum")
        .def(
            py::init([](double angle, double material, double rate) {
                Drum drum{};
                start_drum(drum, angle, material, rate);
                return drum;
            }),
            "angle"_a, "material"_a, "rate"_a)
        .def("turn", turn_drum, "angle"_a, "rate"_a)
        .def_property_readonly("held", material_held)
        .def_property_readonly("points", [](const Drum& d) { return static_cast<int>(d.points); })
        .def_readonly("spacing", &Drum::spacing);
    py::class_<HeldCable>(core, "Cable")
        .def(
            py::init<
                const Numbers3&, Law, Matrix, Matrix, double, double, double>(),
            "elastic"_a, "law"_a, "segments"_a.noconvert(), "contacts"_a.noconvert(),
            "first_flux"_a, "last_flux"_a, "dt"_a)
        .def(
            "balance", [](HeldCable& held, double hardness) { return held.cable.balance(hardness); },
            "hardness"_a = 1.0)
        .def("matrix_row", &HeldCable::matrix_row_at, "contact"_a)
        .def("solve", [](HeldCable& held) {
            const Effort effort = held.cable.solve();
            return py::make_tuple(effort.iterations, effort.imbalance);
        });
    core.def(
        "tolerance", [](const Numbers3& elastic) { return tolerance(elasticity_of(elastic)); },
        "elastic"_a);
    core.def(
        "acceptable", [](const Numbers3& elastic) { return acceptable(elasticity_of(elastic)); },
        "elastic"_a);
    core.def(
        "element_tension",
        [](const Numbers3& elastic, double length, double material) {
            return tension_of(elasticity_of(elastic), length, material);
        },
        "elastic"_a, "length"_a, "material"_a);
}

}  // namespace

void bind_laws(py::module_& core) {
    bind_friction(core);
    bind_cable(core);
}

}  // namespace cdrj

// The laws of a cable, each by itself, as `cdrj_ros.model` and `cdrj_ros.inspection` use them.
#include <utility>

#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>

#include "bind.hpp"
#include "cable.hpp"
#include "friction.hpp"
#include "laws.hpp"

namespace cdrj {
namespace {

using Numbers3 = std::array<double, 3>;

Elasticity elasticity_of(const Numbers3& elastic) { return {elastic[0], elastic[1], elastic[2]}; }

std::pair<double, double> pair(const Loss& loss) { return {loss.kinetic, loss.fading}; }

void bind_friction(nb::module_& core) {
    bind_kinds<Law>(core, "Law", LAW_NAMES, "Friction laws, by the words of a robot file.");
    bind_kinds<Stribeck>(
        core, "Stribeck", STRIBECK_NAMES,
        "How static friction enters: (35) as printed, or the capstan equation with mu_s.");
    core.def(
        "blended_loss",
        [](double rho, double mu_c, double mu_s, double wrap_angle, double bearing_ratio,
           Stribeck stribeck) {
            return pair(
                blended_loss(rho, mu_c, mu_s, wrap_angle, bearing_ratio, stribeck));
        },
        "rho"_a, "mu_c"_a, "mu_s"_a, "wrap_angle"_a, "bearing_ratio"_a, "stribeck"_a, R"(
        (42), (43): ``1 - eta = kinetic + static * share`` of a pulley; share: the last factor of (33).

        The transmission is eta = rho eta_d + (1 - rho) eta_r.  Returns (kinetic, static); their sum is
        kept below 0.999.

        ``printed`` scales the kinetic loss by mu_s / mu_c as in (35); ``capstan`` lets the loss at
        rest be 1 - exp(-mu_s beta).)");
    core.def(
        "cell_loss",
        [](double kinetic, double static_, double share) {
            return pair(cell_loss({kinetic, static_}, share));
        },
        "kinetic"_a, "static"_a, "share"_a,
        "(E28): losses of a contact cell that has a share of its pulley's wrap.");
    core.def(
        "friction_force",
        [](Law law, double before, double slip, double stiffness, double bound, double breakaway) {
            const auto [force, by_slip, by_bound] =
                bristle_force(law, {before, stiffness, bound, breakaway}, slip);
            return std::tuple(force, by_slip, by_bound);
        },
        "law"_a, "before"_a, "slip"_a, "stiffness"_a, "bound"_a, "breakaway"_a, R"(
        (33), (E9): bristle force after a slip, exact over the slip for a constant bound.

        Args:
            law: code of the friction law, its place in ``cdrj_ros.robot.description.LAWS``.
            before: bristle force sigma0 z before the slip [N].
            slip: material that has moved past the body's surface [m].
            stiffness: sigma0 [N/m].
            bound: g = (1 - eta) T_pull [N], positive.
            breakaway: share of the bound up to which pre-sliding is purely elastic, in [0, 1].

        Returns:
            Force [N], its derivative by the slip [N/m] and by the bound [-].)");
}

void bind_cable(nb::module_& core) {
    nb::class_<Drum>(core, "Drum",
        "What a winch drum holds (E3): cable comes off at the strain at which it went on.")
        .def(
            "__init__",
            [](Drum* drum, double angle, double material, double rate) {
                start_drum(*new (drum) Drum{}, angle, material, rate);
            },
            "angle"_a, "material"_a, "rate"_a,
            "Below ``angle`` [rad] the drum holds ``rate`` [m/rad]; ``material`` [m] is on it.")
        .def("turn", turn_drum, "angle"_a, "rate"_a,
            "Turn to a wound angle [rad], new layers at ``rate`` [m/rad]; material on it [m].")
        .def_prop_ro("held", material_held,
            "Unstretched material on the drum since the reference [m].")
        .def_prop_ro("points", [](const Drum& d) { return static_cast<int>(d.points); },
            "Break points in use.")
        .def_ro("spacing", &Drum::spacing,
            "Distance of break points [rad].");
    core.def(
        "tolerance", [](const Numbers3& elastic) { return tolerance(elasticity_of(elastic)); },
        "elastic"_a,
        "Largest force imbalance of a solved contact [N].");
    core.def(
        "acceptable", [](const Numbers3& elastic) { return acceptable(elasticity_of(elastic)); },
        "elastic"_a,
        "Largest force imbalance of a usable sample; with a larger one it counts as unsolved [N].");
}

}  // namespace

void bind_laws(nb::module_& core) {
    bind_friction(core);
    bind_cable(core);
}

}  // namespace cdrj

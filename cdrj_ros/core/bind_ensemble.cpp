// The ensemble behind the standard deviations, as `cdrj_ros.estimation` uses it.
#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>

#include "bind.hpp"
#include "ensemble.hpp"

namespace cdrj {
namespace {

/// Contents of an array of a given shape.
template <typename T>
std::vector<std::remove_const_t<T>> taken(
    const Array<T>& array, Shape shape, const char* name) {
    require(
        array.has(shape), (std::string(name) + " has not the shape of this robot's ensemble").c_str());
    return {array.data(), array.data() + array.size()};
}

void make_ensemble(
    Ensemble* made, const HeldRobot& robot, const Given& constants, const Given& friction_share,
    const GivenFlags& slipping, const Given& effort_error, const Given& reading_error,
    const Given& zero_error, const Given& unseen_share, const Given& offset_gain, const Given& length_share,
    const Given& load_share, const Given& span, const Given& unmodelled) {
    const Sizes& sizes = robot.robot.topology.sizes;
    const Index members = constants.shape(0), axes = sizes.axes();
    const Index quantities = unmodelled.shape(1);
    const Index errors = reading_error.shape(0), paths = unseen_share.shape(0);
    require(slipping.has({members, sizes.cables}), "slipping is not by members and cables");
    require(errors > 0 && paths > 0, "reading_error and unseen_share need at least one row");
    const std::vector<double> lower_upper = taken(span, {2, axes}, "span");
    Draws draws{
        .friction_share = taken(friction_share, {members, sizes.pulleys}, "friction_share"),
        .slipping = {slipping.data(), slipping.data() + slipping.size()},
        .effort_error = taken(effort_error, {members, sizes.motors}, "effort_error"),
        .reading_error = taken(reading_error, {errors, axes}, "reading_error"),
        .zero_error = taken(zero_error, {members, axes}, "zero_error"),
        .unseen_share = taken(unseen_share, {paths, members, axes}, "unseen_share"),
        .gains = std::vector<std::vector<Gain>>(quantities),
        .length_share = taken(length_share, {sizes.elements}, "length_share"),
        .load_share = taken(load_share, {sizes.cables, axes}, "load_share"),
        .lower = {lower_upper.begin(), lower_upper.begin() + axes},
        .upper = {lower_upper.begin() + axes, lower_upper.end()},
        .reading_rows = errors,
        .unseen_rows = paths,
    };
    const std::vector<double> gains = taken(offset_gain, {quantities, axes}, "offset_gain");
    for (std::size_t k = 0; k < gains.size(); ++k) {
        if (gains[k] != 0.0) draws.gains[k / axes].push_back({Index(k) % axes, gains[k]});
    }
    new (made) Ensemble(
        taken(robot.topology, {robot.topology.size()}, "topology"),
        taken(robot.constants, {robot.constants.size()}, "constants"),
        taken(constants, {members, robot.constants.size()}, "constants"),
        taken(unmodelled, {2, quantities}, "unmodelled"), std::move(draws));
}

/// A sample of this ensemble's robot.
SampleView view_of(
    const Ensemble& ensemble, Nanoseconds stamp_ns, const Given& motor_angle,
    const Given& joint_angle, const Given& unseen, const Given& offset) {
    const Sizes& sizes = ensemble.robot().topology.sizes;
    require(
        motor_angle.size() == sizes.motors && joint_angle.size() == sizes.joints &&
            (unseen.size() == 0 || unseen.size() == 2 * sizes.axes()) &&
            (offset.size() == 0 || offset.size() == 2 * sizes.axes()),
        "the angles are not those of this robot");
    return {stamp_ns, span_of(motor_angle), span_of(joint_angle), span_of(unseen), span_of(offset)};
}

/// Standard deviations, to be written.
Written stddev_of(const Ensemble& ensemble) { return Written({Index(ensemble.quantities.size())}); }

std::span<double> estimate_of(const Ensemble& ensemble, const Written& estimate) {
    require(
        estimate.size() == Index(ensemble.robot().estimate_size()),
        "the estimate is not one of this robot");
    return span_of(estimate);
}

std::tuple<HeldState, Written, bool, Written> step(
    Ensemble& ensemble, const HeldState& before, Nanoseconds stamp_ns, const Given& motor_angle,
    const Given& joint_angle, const Given& unseen, const Given& offset) {
    const Robot& robot = ensemble.robot();
    require(
        before.numbers.size() == robot.state_size(), "state has not the size of this robot's");
    HeldState after{stamp_ns, std::vector<double>(robot.state_size())};
    const Written estimate({Index(robot.estimate_size())}), stddev = stddev_of(ensemble);
    const bool solved = ensemble.step(
        before.numbers.data(), view_of(ensemble, stamp_ns, motor_angle, joint_angle, unseen, offset),
        before.seconds_until(stamp_ns), after.numbers, span_of(estimate), span_of(stddev));
    return {std::move(after), estimate, solved, stddev};
}

Written predict(
    Ensemble& ensemble, Nanoseconds stamp_ns, const Given& motor_angle, const Given& joint_angle,
    const Given& unseen, const Given& offset, const Written& estimate) {
    const Written stddev = stddev_of(ensemble);
    ensemble.predict(
        view_of(ensemble, stamp_ns, motor_angle, joint_angle, unseen, offset),
        estimate_of(ensemble, estimate), span_of(stddev));
    return stddev;
}

/// `Ensemble::update` for many samples and their estimates.
void follow(
    Ensemble& ensemble, const GivenIntegers& stamp_ns, const Given& motor_angle,
    const Given& joint_angle, const Given& unseen, const GivenIntegers& offset_rows, const Given& offset,
    const Written& estimates, const Written& stddev) {
    const Sizes& sizes = ensemble.robot().topology.sizes;
    const Index samples = stamp_ns.size();
    const std::size_t lasting = 2 * ensemble.axes();
    const std::size_t hidden = unseen.size() == 0 ? 0 : 2 * ensemble.axes();
    const auto fits = [samples](const auto& one, std::size_t width) {
        return one.has({samples, Index(width)});
    };
    require(
        fits(motor_angle, sizes.motors) && fits(joint_angle, sizes.joints) &&
            fits(estimates, ensemble.robot().estimate_size()) &&
            fits(stddev, ensemble.quantities.size()) &&
            unseen.size() == samples * Index(hidden) &&
            offset.size() == offset_rows.size() * Index(lasting),
        "samples, estimates and stddev have not the shapes of this robot's");
    const std::span<const double> deviations = span_of(unseen), offsets = span_of(offset);
    const std::span<const Index> changes = span_of(offset_rows);
    std::size_t change = 0;
    for_samples(samples, [&](Index k) {
        SampleView sample{
            stamp_ns.data()[k], row_of(motor_angle, k), row_of(joint_angle, k),
            deviations.subspan(k * hidden, hidden)};
        if (change < changes.size() && changes[change] == k) {
            sample.offset = offsets.subspan(change++ * lasting, lasting);
        }
        ensemble.update(sample, row_of(estimates, k), row_of(stddev, k));
        return true;
    });
}

/// Continue with what another ensemble of the same robot knows of errors that last.
void continue_lags(Ensemble& ensemble, const Ensemble& before) {
    require(
        ensemble.lags.numbers.size() == before.lags.numbers.size(), "the ensembles are of different robots");
    std::ranges::copy(before.lags.numbers, ensemble.lags.numbers.begin());
    ensemble.units = before.units;
    ensemble.renew_lasting();
}

/// Mean and standard deviation of the lags of all axes, (2, axes) [s].
Written lag_of(const Ensemble& ensemble) {
    const auto axes = static_cast<Index>(ensemble.axes());
    Written found({2, axes});
    for (Index a = 0; a < axes; ++a) {
        const auto [mean, stddev] = ensemble.lags.lag(a);
        found.data()[a] = mean;
        found.data()[axes + a] = stddev;
    }
    return found;
}

/// Memory of the ensemble as an array, which keeps the ensemble alive; by rows unless `rows` is 0.
template <typename T>
Array<T> view(nb::handle ensemble, std::vector<T>& memory, Index rows = 0) {
    const auto size = static_cast<Index>(memory.size());
    if (rows > 0) return Array<T>({rows, size / rows}, memory.data(), ensemble);
    return Array<T>({size}, memory.data(), ensemble);
}

/// A property that is a view of a vector in a part of an ensemble.
template <typename Whole, typename T>
auto part(Whole Ensemble::*whole, std::vector<T> Whole::*vector, bool by_members = false) {
    return [=](nb::handle self) {
        auto& ensemble = nb::cast<Ensemble&>(self);
        return view(self, (ensemble.*whole).*vector, by_members ? ensemble.members() : 0);
    };
}

Written view_of_reading_error(nb::handle self) {
    Draws& draws = nb::cast<Ensemble&>(self).draws;
    return view(self, draws.reading_error, draws.reading_rows);
}

/// Views of all that outlasts a restart, by the names of a state file; members by rows.
ByName<nb::any> memory_of(nb::handle self) {
    auto& ensemble = nb::cast<Ensemble&>(self);
    EnsembleMemory& memory = ensemble.memory;
    static_assert(sizeof(Progress) == 3 * sizeof(Index));
    ByName<nb::any> found;
    found["members"] = view(self, ensemble.population.states, ensemble.members());
    found["member_stamps"] = view(self, memory.stamps, ensemble.members());
    found["member_constants"] = view(self, ensemble.population.constants, ensemble.members());
    found["progress"] = Array<Index>({3}, &memory.progress.updates, self);
    found["unsolved"] = view(self, memory.unsolved);
    found["last_angle"] = view(self, memory.angle);
    found["intervals"] = view(self, memory.intervals);
    found["last_unseen"] = view(self, memory.unseen);
    found["heading"] = view(self, memory.heading);
    found["furthest"] = view(self, memory.furthest);
    found["turn_stamps"] = view(self, memory.turn_stamps);
    found["turn_angles"] = view(self, memory.turn_angles);
    found["sudden_stamps"] = view(self, memory.sudden_stamps);
    found["deviation"] = view(self, memory.deviation, ensemble.members());
    found["lags"] = view(self, ensemble.lags.numbers);
    found["least_variance"] = view(self, memory.least_variance);
    return found;
}

/// Mark one estimate, or the rows of a table.
void mark_estimates(
    const HeldRobot& robot, const Written& estimates, const Given& stddev, double share,
    const GivenFlags& doubted) {
    require(
        estimates.ndim() > 0 && (stddev.size() == 0 || stddev.ndim() == estimates.ndim()),
        "estimates and stddev are not both of one time or both tables");
    const bool single = estimates.ndim() == 1;
    const Sizes& sizes = robot.robot.topology.sizes;
    const Index samples = single ? 1 : estimates.shape(0);
    const Index size = estimates.shape(estimates.ndim() - 1);
    const Index columns = stddev.size() > 0 ? stddev.shape(stddev.ndim() - 1) : 0;
    require(
        size == Index(robot.robot.estimate_size()) &&
            (columns == 0 || (stddev.size() == samples * columns && columns >= sizes.elements)) &&
            (doubted.size() == 0 || doubted.size() == samples * sizes.elements),
        "estimates, stddev and doubted differ in their numbers of samples or are not of this robot");
    const Index first = first_of(sizes, &Estimate::tension, true);
    const auto mark = [&](Index k) {
        const Estimate estimate(sizes, estimates.data() + k * size);
        const auto of_tensions = columns > 0 ? span_of(stddev).subspan(k * columns + first, sizes.elements)
                                             : std::span<const double>();
        mark_unsure(robot.robot, estimate, of_tensions, share);
        for (Index e = 0; doubted.size() > 0 && e < sizes.elements; ++e) {
            if (doubted.data()[k * sizes.elements + e]) doubt(estimate.status[e]);
        }
        return true;
    };
    if (single) {
        mark(0);
    } else {
        for_samples(samples, mark);
    }
}

}  // namespace

void bind_ensemble(nb::module_& core) {
    nb::class_<Ensemble>(core, "Ensemble", R"(
        Robots that differ in all that is unknown, stepped along with the estimate.

        Where not stated otherwise, functions take samples as ``Sample`` holds them, in any layout, and
        raise ValueError if an array is of another robot.)")
        .def(
            "__init__", make_ensemble, "robot"_a, "constants"_a, "friction_share"_a, "slipping"_a,
            "effort_error"_a, "reading_error"_a, "zero_error"_a, "unseen_share"_a, "offset_gain"_a, "length_share"_a,
            "load_share"_a, "span"_a, "unmodelled"_a, R"(
            Copy all arrays.

            Args:
                robot: of the estimate.
                constants: of every member, shape (members, constants).
                friction_share: initial friction as a share of its bound, shape (members, pulleys).
                slipping: whether cables slip on their drums, shape (members, cables).
                effort_error: lasting errors of the efforts [N m], shape (members, motors).
                reading_error: rows used in turn [rad], shape (rows, axes).
                zero_error: of every member's zeros [rad], shape (members, axes).
                unseen_share: xi of (U3), rows used in turn, shape (rows, members, axes).
                offset_gain: change per offset of an axis (U12), shape (quantities, axes).
                length_share: of every element in the length of its cable, shape (elements,).
                load_share: by what share of an axis's motion a load stretches a cable, (C15), shape
                    (cables, axes).
                span: range of all axes [rad], shape (2, axes).
                unmodelled: variance that no member shows, (U5), and magnitude where cables are slack,
                    (U6), shape (2, quantities).

            Raises:
                TypeError: an array is not contiguous or of another type.
                ValueError: an array has not the shape of this robot's ensemble.)")
        .def(
            "step", step, "before"_a, "stamp_ns"_a, "motor_angle"_a, "joint_angle"_a, "unseen"_a,
            "offset"_a,
            R"(
            ``Robot.step`` and an update of members: (state, estimate, solved, standard deviations).

            The standard deviations are those before the update of the member in turn.)")
        .def(
            "predict", predict, "stamp_ns"_a, "motor_angle"_a, "joint_angle"_a,
            "unseen"_a, "offset"_a, "estimate"_a, R"(
            The standard deviations at a predicted sample, which the ensemble forgets at the next other one.

            Args:
                stamp_ns, motor_angle, joint_angle, unseen, offset: the sample.
                estimate: shape (estimate_size,); tensions that have changed suddenly become ``UNSURE``.)")
        .def(
            "follow", follow, "stamp_ns"_a, "motor_angle"_a, "joint_angle"_a, "unseen"_a,
            "offset_rows"_a, "offset"_a, "estimates"_a, "stddev"_a, R"(
            ``step`` for many samples as ``Samples`` holds them, bit for bit, from their estimates.

            Raises:
                KeyboardInterrupt: between some thousand samples.)")
        .def("roll_back", &Ensemble::roll_back,
            "Forget what has been predicted.")
        .def("reset", &Ensemble::reset,
            "Discard the history of all members; the next sample starts them anew.")
        .def("begin_units", [](Ensemble& ensemble) { ensemble.units.begin(); },
            "Forget what motions have shown of units, (C15).")
        .def("continue_lags", continue_lags, "before"_a,
            "Continue with what another ensemble of the robot knows of errors that last, (C15) and (U13).")
        .def("renew_lasting", &Ensemble::renew_lasting,
            "Compute what follows from ``lags``, after changes of it.")
        .def_prop_ro("lag", lag_of, R"(
            Mean and standard deviation of the age of an axis's values, (U18) [s], shape (2, axes).

            It is relative to the first axis of its cables; infinite where nothing shows it.)")
        .def_prop_ro(
            "constants", part(&Ensemble::population, &Population::constants, true))
        .def_prop_ro(
            "friction_share", part(&Ensemble::draws, &Draws::friction_share, true))
        .def_prop_ro("reading_error", view_of_reading_error)
        .def_prop_ro("zero_error", part(&Ensemble::draws, &Draws::zero_error, true))
        .def_prop_ro("states", part(&Ensemble::population, &Population::states, true),
            "Shape (members, state_size).")
        .def_prop_ro("stamps", part(&Ensemble::memory, &EnsembleMemory::stamps, true),
            "Of the last update of every member's cables [ns], shape (members, cables).")
        .def_ro("cable_steps", &Ensemble::cable_steps,
            "Steps of all cables of all members so far: what the standard deviations have cost.")
        .def_prop_ro("least_variance", part(&Ensemble::memory, &EnsembleMemory::least_variance),
            "Least variance of every quantity that is shown, (U15), shape (quantities,).")
        .def_prop_ro("unit_error", [](const Ensemble& ensemble) {
            Written found({Index(ensemble.axes())});
            std::ranges::copy(ensemble.units.errors, found.data());
            return found;
        },
            "What every axis may be wrong by because of its unit, (C15) [rad], shape (axes,).")
        .def_prop_ro("late", [](const Ensemble& ensemble) {
            const std::vector<double> found = ensemble.late();
            Written copied({Index(found.size())});
            std::ranges::copy(found, copied.data());
            return copied;
        },
            "Variances by lags of a cable's axes, (U13), shape (quantities,).")
        .def_prop_ro(
            "deviation", part(&Ensemble::memory, &EnsembleMemory::deviation, true),
            "Of the members' quantities from the estimate's, shape (members, quantities).")
        .def_prop_ro("variance", part(&Ensemble::memory, &EnsembleMemory::variance),
            "Mean squares of these deviations (U1), shape (quantities,).")
        .def("memory", memory_of, "Views of all that outlasts a restart, by name.");
    core.attr("MOVED") = MOVED;
    core.attr("BOUNDS") = BOUNDS;
    core.def(
        "mark_unsure", mark_estimates, "robot"_a, "estimates"_a, "stddev"_a, "share"_a, "doubted"_a, R"(
        Set ``UNSURE`` where tensions are not credible, known too badly for them and the preload, or in doubt.

        Args:
            robot: of the estimates.
            estimates: shape (estimate_size,) or (n, estimate_size); changed.
            stddev: of all uncertain quantities, shape (columns,) or (n, columns); with a size of
                0, none is known.
            share: see ``cdrj_ros.estimation.ensemble.UNSURE_SHARE``.
            doubted: elements to mark as well, shape (elements,) or (n, elements); with a size of 0,
                none is.)");
}

}  // namespace cdrj

// The ensemble behind the standard deviations, and joints without encoder, as `cdrj_ros.estimation`
// uses them.
#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "bind.hpp"
#include "encoderless.hpp"
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
    const Given& span, const Given& unmodelled) {
    const Sizes& sizes = robot.robot.topology.sizes;
    const Index members = slipping.size(), axes = sizes.axes();
    const Index quantities = sizes.elements + sizes.pulleys + axes;
    const Index errors = reading_error.shape(0), paths = unseen_share.shape(0);
    require(errors > 0 && paths > 0, "reading_error and unseen_share need at least one row");
    const std::vector<double> lower_upper = taken(span, {2, axes}, "span");
    Draws draws{
        .friction_share = taken(friction_share, {members, sizes.pulleys}, "friction_share"),
        .slipping = {slipping.data(), slipping.data() + members},
        .effort_error = taken(effort_error, {members, sizes.motors}, "effort_error"),
        .reading_error = taken(reading_error, {errors, axes}, "reading_error"),
        .zero_error = taken(zero_error, {members, axes}, "zero_error"),
        .unseen_share = taken(unseen_share, {paths, members, axes}, "unseen_share"),
        .gains = std::vector<std::vector<Gain>>(quantities),
        .length_share = taken(length_share, {sizes.elements}, "length_share"),
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

std::span<const double> estimate_of(const Ensemble& ensemble, const Given& estimate) {
    require(
        estimate.size() == Index(ensemble.robot().estimate_size()),
        "the estimate is not one of this robot");
    return span_of(estimate);
}

nb::tuple step(
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
    return nb::make_tuple(std::move(after), estimate, solved, stddev);
}

Written update(
    Ensemble& ensemble, Nanoseconds stamp_ns, const Given& motor_angle, const Given& joint_angle,
    const Given& unseen, const Given& offset, const Given& estimate, Index least) {
    const Written stddev = stddev_of(ensemble);
    ensemble.update(
        view_of(ensemble, stamp_ns, motor_angle, joint_angle, unseen, offset),
        estimate_of(ensemble, estimate), least, span_of(stddev));
    return stddev;
}

Written predict(
    Ensemble& ensemble, Nanoseconds stamp_ns, const Given& motor_angle, const Given& joint_angle,
    const Given& unseen, const Given& offset, const Given& estimate) {
    const Written stddev = stddev_of(ensemble);
    ensemble.predict(
        view_of(ensemble, stamp_ns, motor_angle, joint_angle, unseen, offset),
        estimate_of(ensemble, estimate), span_of(stddev));
    return stddev;
}

/// `update` for many samples and their estimates.
void follow(
    Ensemble& ensemble, const GivenIntegers& stamp_ns, const Given& motor_angle,
    const Given& joint_angle, const Given& unseen, const GivenIntegers& offset_rows, const Given& offset,
    const Given& estimates, const Written& stddev) {
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
        ensemble.update(sample, row_of(estimates, k), 1, row_of(stddev, k));
        return true;
    });
}

/// Continue with what another ensemble of the same robot knows of errors that last.
void continue_lags(Ensemble& ensemble, const Ensemble& before) {
    require(
        ensemble.lags.numbers.size() == before.lags.numbers.size(), "the ensembles are of different robots");
    std::ranges::copy(before.lags.numbers, ensemble.lags.numbers.begin());
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

Array<Index> view_of_progress(nb::handle self) {
    Progress& progress = nb::cast<Ensemble&>(self).memory.progress;
    static_assert(sizeof(Progress) == 3 * sizeof(Index));
    return Array<Index>({3}, &progress.updates, self);
}

/// A population whose topology stays alive with it.
struct HeldPopulation {
    HeldPopulation(const HeldRobot& robot, const Given& constants)
        : robot(robot),
          population(
              this->robot.robot.topology, constants.shape(0),
              taken(constants, {constants.shape(0), robot.constants.size()}, "constants")) {}

    HeldRobot robot;
    Population population;
};

nb::tuple advance(
    HeldPopulation& held, Index k, const Given& motor_angle, const Given& joint_angle, double dt) {
    held.robot.require_angles(motor_angle.size(), joint_angle.size());
    require(k >= 0 && k < held.population.size(), "there is no such robot");
    const bool solved = held.population.advance(
        k, span_of(motor_angle), span_of(joint_angle), dt, held.robot.out.data());
    return nb::make_tuple(solved, held.robot.estimate());
}

/// Mark one estimate, or the rows of a table.
void mark_estimates(
    const Written& estimates, const Given& preload, const Given& stddev, double share,
    const GivenFlags& doubtful) {
    require(
        estimates.ndim() > 0 && (stddev.size() == 0 || stddev.ndim() == estimates.ndim()),
        "estimates and stddev are not both of one time or both tables");
    const bool single = estimates.ndim() == 1;
    const Index samples = single ? 1 : estimates.shape(0), elements = preload.size();
    const Index size = estimates.shape(estimates.ndim() - 1);
    const Index columns = stddev.size() > 0 ? stddev.shape(stddev.ndim() - 1) : 0;
    require(
        size >= 2 * elements &&
            (columns == 0 || (stddev.size() == samples * columns && columns >= elements)) &&
            (doubtful.size() == 0 || doubtful.size() == samples),
        "estimates, stddev and doubtful differ in their numbers of samples or have too few elements");
    double* first = estimates.data();
    const auto mark = [&](Index k) {
        const auto estimate = std::span(first + k * size, static_cast<std::size_t>(size));
        if (columns > 0) {
            const auto width = static_cast<std::size_t>(columns);
            mark_unsure(estimate, span_of(preload), {stddev.data() + k * columns, width}, share);
        }
        if (doubtful.size() > 0 && doubtful.data()[k]) {
            for (double& status : estimate.subspan(elements, elements)) doubt(status);
        }
        return true;
    };
    if (single) {
        mark(0);
    } else {
        for_samples(samples, mark);
    }
}

/// Samples between two looks at Ctrl-C; each takes long.
constexpr Index FEW = 256;

void run_encoderless(
    EncoderlessEstimator& estimator, const GivenIntegers& stamp_ns, const Given& motor_angle,
    const Given& measured_angle, const Given& effort, const Written& estimates, const Written& stddevs,
    const Written& angles, const Written& angle_stddevs) {
    const Sizes& sizes = estimator.ensemble().robot().topology.sizes;
    const Index samples = stamp_ns.size();
    const auto fits = [samples](const auto& one, std::size_t width) {
        return one.has({samples, Index(width)});
    };
    require(
        fits(motor_angle, sizes.motors) && fits(effort, sizes.motors) &&
            fits(measured_angle, estimator.measured_joints()),
        "the readings have not the shapes of this robot's");
    require(
        fits(estimates, Estimate::size(sizes)) && fits(stddevs, estimator.ensemble().quantities.size()) &&
            fits(angles, estimator.joints()) && fits(angle_stddevs, estimator.joints()),
        "the results have not the shapes of this robot's");
    const auto take = [&](Index k) {
        estimator.take(
            {stamp_ns.data()[k], row_of(motor_angle, k), row_of(measured_angle, k),
             row_of(effort, k)},
            {row_of(estimates, k), row_of(stddevs, k), row_of(angles, k), row_of(angle_stddevs, k)});
        return true;
    };
    for_samples(samples, take, FEW);
}

void bind_encoderless(nb::module_& core) {
    nb::class_<EncoderlessJoint>(core, "EncoderlessJoint")
        .def(
            "__init__",
            [](EncoderlessJoint* made, Index joint, double lower, double upper, double start,
               double load_drift) {
                new (made) EncoderlessJoint{joint, lower, upper, start, load_drift};
            },
            nb::kw_only(), "joint"_a, "lower"_a, "upper"_a, "start"_a, "load_drift"_a);
    nb::class_<EncoderlessEstimator>(core, "EncoderlessEstimator")
        .def(
            nb::init<Ensemble&, std::vector<EncoderlessJoint>, std::vector<double>>(), nb::kw_only(),
            "ensemble"_a, "joints"_a, "effort_noise"_a, nb::keep_alive<1, 2>())
        .def(
            "run", run_encoderless, "stamp_ns"_a, "motor_angle"_a, "measured_angle"_a, "effort"_a,
            "estimates"_a, "stddevs"_a, "angles"_a, "angle_stddevs"_a)
        .def("reset", &EncoderlessEstimator::reset)
        .def("keep", &EncoderlessEstimator::keep)
        .def("roll_back", &EncoderlessEstimator::roll_back)
        .def_prop_ro("state", [](const EncoderlessEstimator& estimator) {
            return copy_of(estimator.state());
        });
}

}  // namespace

void bind_ensemble(nb::module_& core) {
    nb::class_<HeldPopulation>(core, "Population")
        .def(
            nb::init<const HeldRobot&, const Given&>(), "robot"_a, "constants"_a)
        .def(
            "advance", advance, "k"_a, "motor_angle"_a, "joint_angle"_a, "dt"_a)
        .def("reset", [](HeldPopulation& held) {
            std::ranges::fill(held.population.states, 0.0);
        });
    nb::class_<Ensemble>(core, "Ensemble")
        .def(
            "__init__", make_ensemble, "robot"_a, "constants"_a, "friction_share"_a, "slipping"_a,
            "effort_error"_a, "reading_error"_a, "zero_error"_a, "unseen_share"_a, "offset_gain"_a, "length_share"_a,
            "span"_a, "unmodelled"_a)
        .def(
            "step", step, "before"_a, "stamp_ns"_a, "motor_angle"_a, "joint_angle"_a, "unseen"_a,
            "offset"_a)
        .def(
            "update", update, "stamp_ns"_a, "motor_angle"_a, "joint_angle"_a, "unseen"_a, "offset"_a,
            "estimate"_a, "least"_a)
        .def(
            "predict", predict, "stamp_ns"_a, "motor_angle"_a, "joint_angle"_a, "unseen"_a, "offset"_a,
            "estimate"_a)
        .def(
            "follow", follow, "stamp_ns"_a, "motor_angle"_a, "joint_angle"_a, "unseen"_a,
            "offset_rows"_a, "offset"_a, "estimates"_a, "stddev"_a)
        .def("roll_back", &Ensemble::roll_back)
        .def("reset", &Ensemble::reset)
        .def("continue_lags", continue_lags, "before"_a)
        .def("renew_lasting", &Ensemble::renew_lasting)
        .def_prop_ro("lag", lag_of)
        .def_prop_ro(
            "constants", part(&Ensemble::population, &Population::constants, true))
        .def_prop_ro(
            "friction_share", part(&Ensemble::draws, &Draws::friction_share, true))
        .def_prop_ro("reading_error", view_of_reading_error)
        .def_prop_ro("zero_error", part(&Ensemble::draws, &Draws::zero_error, true))
        .def_prop_ro("states", part(&Ensemble::population, &Population::states, true))
        .def_prop_ro("stamps", part(&Ensemble::memory, &EnsembleMemory::stamps, true))
        .def_prop_ro("unsolved", part(&Ensemble::memory, &EnsembleMemory::unsolved))
        .def_ro("cable_steps", &Ensemble::cable_steps)
        .def_prop_ro("angle", part(&Ensemble::memory, &EnsembleMemory::angle))
        .def_prop_ro("unseen", part(&Ensemble::memory, &EnsembleMemory::unseen))
        .def_prop_ro("least_variance", part(&Ensemble::memory, &EnsembleMemory::least_variance))
        .def_prop_ro("lags", part(&Ensemble::lags, &Lags::numbers))
        .def_prop_ro("intervals", part(&Ensemble::memory, &EnsembleMemory::intervals))
        .def_prop_ro(
            "deviation", part(&Ensemble::memory, &EnsembleMemory::deviation, true))
        .def_prop_ro("variance", part(&Ensemble::memory, &EnsembleMemory::variance))
        .def_prop_ro("progress", view_of_progress);
    core.attr("MOVED") = MOVED;
    core.def(
        "mark_unsure", mark_estimates, "estimates"_a, "preload"_a, "stddev"_a, "share"_a, "doubtful"_a);
    bind_encoderless(core);
}

}  // namespace cdrj

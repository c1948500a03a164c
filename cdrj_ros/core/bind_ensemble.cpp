// The ensemble behind the standard deviations, and joints without encoder, as `cdrj_ros.estimation`
// uses them.
#include <algorithm>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "bind.hpp"
#include "encoderless.hpp"
#include "ensemble.hpp"
#include "report.hpp"

namespace py = pybind11;

namespace cdrj {
namespace {

using Stamps = py::array_t<Nanoseconds, py::array::c_style | py::array::forcecast>;

/// Flags; bind them with `noconvert`.
using Flags = py::array_t<bool, py::array::c_style>;
using GivenFlags = py::array_t<bool, py::array::c_style | py::array::forcecast>;

/// Contents of an array of a given shape.
template <typename T>
std::vector<T> taken(
    const py::array_t<T, py::array::c_style>& array, std::vector<py::ssize_t> shape,
    const char* name) {
    if (!std::equal(shape.begin(), shape.end(), array.shape(), array.shape() + array.ndim())) {
        throw py::value_error(std::string(name) + " has not the shape of this robot's ensemble");
    }
    return {array.data(), array.data() + array.size()};
}

std::unique_ptr<Ensemble> make_ensemble(
    const HeldRobot& robot, const Matrix& numbers, const Matrix& friction_share,
    const Flags& slipping, const Matrix& effort_error, const Matrix& reading_error,
    const Matrix& unseen_share, const Matrix& offset_gain, const Matrix& length_share,
    const Matrix& span, const Indices& index,
    const Indices& element, const Matrix& unmodelled) {
    const Sizes& sizes = robot.robot.topology.sizes;
    const py::ssize_t members = slipping.size(), axes = sizes.axes(), quantities = index.size();
    require(
        numbers.ndim() == 2 && reading_error.ndim() == 2 && unseen_share.ndim() == 3 &&
            span.ndim() == 2 && unmodelled.ndim() == 2,
        "an array has not the axes of an ensemble's");
    const py::ssize_t errors = reading_error.shape(0), paths = unseen_share.shape(0);
    require(errors > 0 && paths > 0, "reading_error and unseen_share need at least one row");
    const std::vector<double> lower_upper = taken(span, {2, axes}, "span");
    Draws draws{
        .friction_share = taken(friction_share, {members, sizes.pulleys}, "friction_share"),
        .slipping = {slipping.data(), slipping.data() + members},
        .effort_error = taken(effort_error, {members, sizes.motors}, "effort_error"),
        .reading_error = taken(reading_error, {errors, axes}, "reading_error"),
        .unseen_share = taken(unseen_share, {paths, members, axes}, "unseen_share"),
        .offset_gain = taken(offset_gain, {quantities, axes}, "offset_gain"),
        .length_share = taken(length_share, {sizes.elements}, "length_share"),
        .lower = {lower_upper.begin(), lower_upper.begin() + axes},
        .upper = {lower_upper.begin() + axes, lower_upper.end()},
        .reading_rows = errors,
        .unseen_rows = paths,
    };
    const std::vector<Index> indices = taken(index, {quantities}, "index");
    const std::vector<Index> elements = taken(element, {quantities}, "element");
    const std::vector<double> more = taken(unmodelled, {2, quantities}, "unmodelled");
    const auto size = static_cast<Index>(Estimate::size(sizes));
    std::vector<Quantity> rows;
    for (py::ssize_t q = 0; q < quantities; ++q) {
        require(
            indices[q] >= 0 && indices[q] < size && elements[q] < sizes.elements,
            "a quantity is not one of this robot's estimate");
        rows.push_back({indices[q], elements[q], more[q], more[quantities + q]});
    }
    return std::make_unique<Ensemble>(
        taken(robot.plan, {robot.plan.size()}, "plan"),
        taken(robot.numbers, {robot.numbers.size()}, "numbers"),
        taken(numbers, {members, robot.numbers.size()}, "numbers"), std::move(rows),
        std::move(draws));
}

/// A sample of this ensemble's robot.
SampleView view_of(
    const Ensemble& ensemble, Nanoseconds stamp_ns, const Given& motor_angle,
    const Given& joint_angle, const Given& unseen, const Given& offset) {
    const Sizes& sizes = ensemble.robot().topology.sizes;
    require(
        motor_angle.size() == sizes.motors && joint_angle.size() == sizes.joints &&
            (unseen.size() == 0 || unseen.size() == 2 * sizes.axes()) &&
            (offset.size() == 0 || offset.size() == 3 * sizes.axes()),
        "the angles are not those of this robot");
    return {stamp_ns, span_of(motor_angle), span_of(joint_angle), span_of(unseen), span_of(offset)};
}

std::span<double> row_of_stddev(const Ensemble& ensemble, Vector& stddev) {
    const auto quantities = ensemble.quantities.size();
    require(
        stddev.size() == py::ssize_t(quantities), "stddev has not one entry per quantity");
    return {stddev.mutable_data(), quantities};
}

std::span<const double> estimate_of(const Ensemble& ensemble, const Given& estimate) {
    require(
        estimate.size() == py::ssize_t(ensemble.robot().estimate_size()),
        "the estimate is not one of this robot");
    return span_of(estimate);
}

bool step(
    Ensemble& ensemble, const py::object& before, Nanoseconds stamp_ns,
    const py::object& motor_angle, const py::object& joint_angle, const py::object& unseen,
    const py::object& offset, double dt, bool at_once, const py::object& out, const py::object& stddev) {
    const Robot& robot = ensemble.robot();
    const Given state = quickly(before), motor = quickly(motor_angle),
                joint = quickly(joint_angle), deviation = quickly(unseen),
                lasting = quickly(offset);
    Vector result = written(out, "out is not a contiguous array of floats");
    Vector spread = written(stddev, "stddev is not a contiguous array of floats");
    require(state.size() >= py::ssize_t(robot.state_size()), "before is too short");
    require(result.size() >= py::ssize_t(robot.out_size()), "out is too short");
    return ensemble.step(
        state.data(), view_of(ensemble, stamp_ns, motor, joint, deviation, lasting), dt, at_once,
        result.mutable_data(), row_of_stddev(ensemble, spread));
}

void update(
    Ensemble& ensemble, Nanoseconds stamp_ns, const Given& motor_angle, const Given& joint_angle,
    const Given& unseen, const Given& offset, const Given& estimate, Index least, bool at_once,
    Vector& stddev) {
    ensemble.update(
        view_of(ensemble, stamp_ns, motor_angle, joint_angle, unseen, offset),
        estimate_of(ensemble, estimate), least, at_once, row_of_stddev(ensemble, stddev));
}

void predict(
    Ensemble& ensemble, Nanoseconds stamp_ns, const Given& motor_angle, const Given& joint_angle,
    const Given& unseen, const Given& offset, const Given& estimate, Vector& stddev) {
    ensemble.predict(
        view_of(ensemble, stamp_ns, motor_angle, joint_angle, unseen, offset),
        estimate_of(ensemble, estimate), row_of_stddev(ensemble, stddev));
}

/// `update` for many samples and their estimates.
void follow(
    Ensemble& ensemble, const Stamps& stamp_ns, const Given& motor_angle,
    const Given& joint_angle, const Given& unseen, const Stamps& offset_rows, const Given& offset,
    const Given& estimates, Matrix& stddev) {
    const Sizes& sizes = ensemble.robot().topology.sizes;
    const py::ssize_t samples = stamp_ns.size();
    const auto fits = [samples](const auto& one, std::size_t width) {
        return one.size() == samples * py::ssize_t(width) && one.shape(0) == samples;
    };
    const std::size_t quantities = ensemble.quantities.size(), size = ensemble.robot().estimate_size();
    const std::size_t motors = sizes.motors, joints = sizes.joints;
    const std::size_t hidden = unseen.size() == 0 ? 0 : 2 * ensemble.axes();
    require(
        fits(motor_angle, motors) && fits(joint_angle, joints) && fits(estimates, size) &&
            fits(stddev, quantities) && (hidden == 0 || fits(unseen, hidden)) &&
            offset.size() == offset_rows.size() * py::ssize_t(3 * ensemble.axes()),
        "samples, estimates and stddev have not the shapes of this robot's");
    const Nanoseconds* stamps = stamp_ns.data();
    const double *motor = motor_angle.data(), *joint = joint_angle.data(), *deviation = unseen.data();
    const double* estimate = estimates.data();
    double* written = stddev.mutable_data();
    const std::span<const Nanoseconds> changes(offset_rows.data(), offset_rows.size());
    std::size_t change = 0;
    for_samples(samples, [&](py::ssize_t k) {
        SampleView sample{
            stamps[k], {motor + k * motors, motors}, {joint + k * joints, joints},
            {deviation + k * hidden, hidden}};
        if (change < changes.size() && changes[change] == k) {
            const std::size_t width = 3 * ensemble.axes();
            sample.offset = {offset.data() + change++ * width, width};
        }
        ensemble.update(
            sample, {estimate + k * size, size}, 1, true, {written + k * quantities, quantities});
        return true;
    });
}

/// Memory of the ensemble as an array, which keeps the ensemble alive; by rows unless `rows` is 0.
template <typename T>
py::array_t<T> view(const py::object& ensemble, std::vector<T>& memory, Index rows = 0) {
    const auto size = static_cast<py::ssize_t>(memory.size());
    std::vector<py::ssize_t> shape{size};
    if (rows > 0) shape = {rows, size / rows};
    return py::array_t<T>(std::move(shape), memory.data(), ensemble);
}

/// A property that is a view of a vector in a part of an ensemble.
template <typename Whole, typename T>
auto part(Whole Ensemble::*whole, std::vector<T> Whole::*vector, bool by_members = false) {
    return [=](const py::object& self) {
        auto& ensemble = self.cast<Ensemble&>();
        return view(self, (ensemble.*whole).*vector, by_members ? ensemble.members() : 0);
    };
}

py::array_t<double> view_of_reading_error(const py::object& self) {
    Draws& draws = self.cast<Ensemble&>().draws;
    return view(self, draws.reading_error, draws.reading_rows);
}

py::array_t<Index> view_of_progress(const py::object& self) {
    Progress& progress = self.cast<Ensemble&>().memory.progress;
    static_assert(sizeof(Progress) == 3 * sizeof(Index));
    return py::array_t<Index>(3, &progress.updates, self);
}

/// A population whose topology stays alive with it.
struct HeldPopulation {
    HeldPopulation(const HeldRobot& robot, const Matrix& constants)
        : robot(robot),
          population(
              this->robot.robot.topology, constants.shape(0),
              taken(constants, {constants.shape(0), robot.numbers.size()}, "constants")) {}

    HeldRobot robot;
    Population population;
};

bool advance(
    HeldPopulation& held, Index k, const Given& motor_angle, const Given& joint_angle, double dt,
    Vector& out) {
    held.robot.require_angles(motor_angle.size(), joint_angle.size());
    require(k >= 0 && k < held.population.size(), "there is no such robot");
    require(out.size() >= py::ssize_t(held.robot.robot.out_size()), "out is too short");
    return held.population.advance(
        k, span_of(motor_angle), span_of(joint_angle), dt, out.mutable_data());
}

/// Mark one estimate, or the rows of a table.
void mark_estimates(
    const py::object& estimates, const py::object& of_cables, const py::object& deviations,
    double share, const GivenFlags& doubtful) {
    Vector marked = written(estimates, "estimates is not a contiguous array of floats");
    const Given preload = quickly(of_cables), stddev = quickly(deviations);
    require(
        marked.ndim() > 0 && (stddev.size() == 0 || stddev.ndim() == marked.ndim()),
        "estimates and stddev are not both of one time or both tables");
    const bool single = marked.ndim() == 1;
    const py::ssize_t samples = single ? 1 : marked.shape(0), elements = preload.size();
    const py::ssize_t size = marked.shape(marked.ndim() - 1);
    const py::ssize_t columns = stddev.size() > 0 ? stddev.shape(stddev.ndim() - 1) : 0;
    require(
        size >= 2 * elements &&
            (columns == 0 || (stddev.size() == samples * columns && columns >= elements)) &&
            (doubtful.size() == 0 || doubtful.size() == samples),
        "estimates, stddev and doubtful differ in their numbers of samples or have too few elements");
    double* first = marked.mutable_data();
    const auto mark = [&](py::ssize_t k) {
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
constexpr py::ssize_t FEW = 256;

void run_encoderless(
    EncoderlessEstimator& estimator, const Stamps& stamp_ns, const Matrix& motor_angle,
    const Matrix& measured_angle, const Matrix& effort, Matrix& estimates, Matrix& stddevs,
    Matrix& angles, Matrix& angle_stddevs) {
    const Sizes& sizes = estimator.ensemble().robot().topology.sizes;
    const py::ssize_t samples = stamp_ns.size();
    const auto fits = [samples](const Matrix& one, std::size_t width) {
        return one.shape(0) == samples && one.shape(1) == py::ssize_t(width);
    };
    require(
        fits(motor_angle, sizes.motors) && fits(effort, sizes.motors) &&
            fits(measured_angle, estimator.measured_joints()),
        "the readings have not the shapes of this robot's");
    require(
        fits(estimates, Estimate::size(sizes)) && fits(stddevs, estimator.ensemble().quantities.size()) &&
            fits(angles, estimator.joints()) && fits(angle_stddevs, estimator.joints()),
        "the results have not the shapes of this robot's");
    const auto take = [&](py::ssize_t k) {
        estimator.take(
            {stamp_ns.data()[k], row_of(motor_angle, k), row_of(measured_angle, k),
             row_of(effort, k)},
            {written_row(estimates, k), written_row(stddevs, k), written_row(angles, k),
             written_row(angle_stddevs, k)});
        return true;
    };
    for_samples(samples, take, FEW);
}

void bind_encoderless(py::module_& core) {
    py::class_<EncoderlessJoint>(core, "EncoderlessJoint", "A joint without encoder.")
        .def(
            py::init([](Index joint, double lower, double upper, double start, double load_drift) {
                return EncoderlessJoint{joint, lower, upper, start, load_drift};
            }),
            py::kw_only(), py::arg("joint"), py::arg("lower"), py::arg("upper"), py::arg("start"),
            py::arg("load_drift"));
    py::class_<EncoderlessEstimator>(
        core, "EncoderlessEstimator", "The estimate of a robot with joints without encoder.")
        .def(
            py::init<Ensemble&, std::vector<EncoderlessJoint>, std::vector<double>>(),
            py::kw_only(), py::arg("ensemble"), py::arg("joints"), py::arg("effort_noise"),
            py::keep_alive<1, 2>())
        .def(
            "run", run_encoderless, py::arg("stamp_ns").noconvert(), py::arg("motor_angle").noconvert(),
            py::arg("measured_angle").noconvert(), py::arg("effort").noconvert(),
            py::arg("estimates").noconvert(), py::arg("stddevs").noconvert(),
            py::arg("angles").noconvert(), py::arg("angle_stddevs").noconvert())
        .def("reset", &EncoderlessEstimator::reset)
        .def("keep", &EncoderlessEstimator::keep)
        .def("roll_back", &EncoderlessEstimator::roll_back)
        .def_property_readonly("state", [](const EncoderlessEstimator& estimator) {
            return copy_of(estimator.state());
        });
}

}  // namespace

void bind_ensemble(py::module_& core) {
    const auto stamp_ns = py::arg("stamp_ns");
    const auto array = [](const char* name) { return py::arg(name).noconvert(); };
    py::class_<HeldPopulation>(core, "Population", "Robots with constants of their own.")
        .def(
            py::init<const HeldRobot&, const Matrix&>(), py::arg("robot"), array("constants"),
            "Copies all arrays.")
        .def(
            "advance", advance, py::arg("k"), py::arg("motor_angle"), py::arg("joint_angle"),
            py::arg("dt"), array("out"), "One sample of robot k.")
        .def("reset", [](HeldPopulation& held) {
            std::ranges::fill(held.population.states, 0.0);
        }, "Discard the history of all robots.");
    py::class_<Ensemble>(core, "Ensemble", "Robots that differ in all that is unknown.")
        .def(
            py::init(&make_ensemble), py::arg("robot"), array("numbers"), array("friction_share"),
            array("slipping"), array("effort_error"), array("reading_error"), array("unseen_share"),
            array("offset_gain"), array("length_share"), array("span"), array("index"), array("element"),
            array("unmodelled"),
            "Copies all arrays.")
        .def(
            "step", step, py::arg("before"), stamp_ns, py::arg("motor_angle"),
            py::arg("joint_angle"), py::arg("unseen"), py::arg("offset"), py::arg("dt"), py::arg("at_once"),
            py::arg("out"), py::arg("stddev"), "``Robot.step`` and ``update`` in one call.")
        .def(
            "update", update, stamp_ns, py::arg("motor_angle"), py::arg("joint_angle"),
            py::arg("unseen"), py::arg("offset"), py::arg("estimate"), py::arg("least"), py::arg("at_once"),
            array("stddev"), "Write the standard deviations at a sample and its estimate.")
        .def(
            "predict", predict, stamp_ns, py::arg("motor_angle"), py::arg("joint_angle"),
            py::arg("unseen"), py::arg("offset"), py::arg("estimate"), array("stddev"),
            "``update`` at a predicted sample, which the next call of another function forgets.")
        .def(
            "follow", follow, stamp_ns, py::arg("motor_angle"), py::arg("joint_angle"),
            py::arg("unseen"), py::arg("offset_rows"), py::arg("offset"), py::arg("estimates"), array("stddev"),
            "``update``, at once, for many samples and their estimates, one a row.")
        .def("roll_back", &Ensemble::roll_back, "Forget what has been predicted.")
        .def("finish", &Ensemble::finish, "Update the member that waits, if there is one.")
        .def("reset", &Ensemble::reset, "Discard the history of all members.")
        .def_property_readonly(
            "numbers", part(&Ensemble::population, &Population::constants, true))
        .def_property_readonly(
            "friction_share", part(&Ensemble::draws, &Draws::friction_share, true))
        .def_property_readonly("reading_error", view_of_reading_error)
        .def_property_readonly("states", part(&Ensemble::population, &Population::states, true))
        .def_property_readonly("stamps", part(&Ensemble::memory, &EnsembleMemory::stamps))
        .def_property_readonly("angle", part(&Ensemble::memory, &EnsembleMemory::angle))
        .def_property_readonly("unseen", part(&Ensemble::memory, &EnsembleMemory::unseen))
        .def_property_readonly("offset", part(&Ensemble::memory, &EnsembleMemory::offset))
        .def_property_readonly("swing", part(&Ensemble::memory, &EnsembleMemory::swing))
        .def_property_readonly("intervals", part(&Ensemble::memory, &EnsembleMemory::intervals))
        .def_property_readonly(
            "deviation", part(&Ensemble::memory, &EnsembleMemory::deviation, true))
        .def_property_readonly("variance", part(&Ensemble::memory, &EnsembleMemory::variance))
        .def_property_readonly("progress", view_of_progress);
    core.attr("MOVED") = MOVED;
    core.def(
        "mark_unsure", mark_estimates, py::arg("estimates"), py::arg("preload"), py::arg("stddev"),
        py::arg("share"), py::arg("doubtful"),
        "Set ``UNSURE`` where the standard deviation is too large for tension and preload, and on all\n"
        "elements where an estimate is doubtful.");
    bind_encoderless(core);
}

}  // namespace cdrj

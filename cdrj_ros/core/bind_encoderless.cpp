// Joints without encoder, as `cdrj_ros.estimation.encoderless` uses them.
#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <vector>

#include "arrays.hpp"
#include "bind.hpp"
#include "encoderless_estimator.hpp"

namespace py = pybind11;

namespace cdrj {
namespace {

using Stamps = py::array_t<Nanoseconds, py::array::c_style>;

/// Samples between two checks for an interruption.
constexpr py::ssize_t PIECE = 256;

std::span<const double> row_of(const Matrix& matrix, py::ssize_t row) {
    const auto width = static_cast<std::size_t>(matrix.shape(1));
    return {matrix.data() + row * width, width};
}

std::span<double> row_of(Matrix& matrix, py::ssize_t row) {
    const auto width = static_cast<std::size_t>(matrix.shape(1));
    return {matrix.mutable_data() + row * width, width};
}

std::vector<double> copy_of(std::span<const double> numbers) {
    return {numbers.begin(), numbers.end()};
}

DenseMatrix dense(const Matrix& matrix) {
    DenseMatrix copy(matrix.shape(0), matrix.shape(1));
    std::copy_n(matrix.data(), matrix.size(), copy.numbers().begin());
    return copy;
}

/// An estimator whose robots' arrays stay alive with it.
struct HeldEstimator {
    HeldEstimator(
        Indices plan, Matrix numbers, const Matrix& share, const Matrix& effort_error,
        const Matrix& reading_error, const Indices& columns, const Vector& slack,
        std::vector<EncoderlessJoint> joints, std::vector<double> effort_noise)
        : plan(std::move(plan)),
          numbers(std::move(numbers)),
          estimator(
              ensemble(share, effort_error, reading_error, columns, slack), std::move(joints),
              std::move(effort_noise)) {}

    EncoderlessEnsemble ensemble(
        const Matrix& share, const Matrix& effort_error, const Matrix& reading_error,
        const Indices& columns, const Vector& slack) const {
        const py::ssize_t robots = numbers.shape(0);
        require(plan.size() >= Index{sizeof(Sizes) / sizeof(Index)}, "plan is too short");
        require(
            robots > 0 && share.shape(0) == robots && effort_error.shape(0) == robots,
            "numbers, share and effort_error differ in their numbers of robots");
        require(slack.size() == columns.size(), "slack has not one entry per column");
        const Topology topology(plan.data());
        require(
            share.shape(1) == topology.sizes.pulleys && effort_error.shape(1) == topology.sizes.motors,
            "share or effort_error are not those of this robot");
        EncoderlessEnsemble drawn;
        for (py::ssize_t k = 0; k < robots; ++k) {
            drawn.robots.push_back(
                {Robot(topology, row_of(numbers, k).data()), copy_of(row_of(share, k)),
                 copy_of(row_of(effort_error, k))});
        }
        drawn.reading_errors = dense(reading_error);
        drawn.columns.assign(columns.data(), columns.data() + columns.size());
        drawn.slack = copy_of(span_of(slack));
        return drawn;
    }

    Indices plan;
    Matrix numbers;
    EncoderlessEstimator estimator;
};

void run(
    HeldEstimator& held, const Stamps& stamp_ns, const Matrix& motor_angle,
    const Matrix& measured_angle, const Matrix& effort, Matrix& estimates, Matrix& stddevs,
    Matrix& angles, Matrix& angle_stddevs) {
    EncoderlessEstimator& estimator = held.estimator;
    const Sizes& sizes = estimator.sizes();
    const py::ssize_t samples = stamp_ns.size();
    const auto fits = [samples](const Matrix& one, std::size_t width) {
        return one.shape(0) == samples && one.shape(1) == py::ssize_t(width);
    };
    require(
        fits(motor_angle, sizes.motors) && fits(effort, sizes.motors) &&
            fits(measured_angle, estimator.measured_joints()),
        "the readings have not the shapes of this robot's");
    require(
        fits(estimates, Estimate::size(sizes)) && fits(stddevs, estimator.columns()) &&
            fits(angles, estimator.joints()) && fits(angle_stddevs, estimator.joints()),
        "the results have not the shapes of this robot's");
    for (py::ssize_t begin = 0; begin < samples; begin += PIECE) {
        if (PyErr_CheckSignals() != 0) throw py::error_already_set();
        py::gil_scoped_release free;
        for (py::ssize_t k = begin; k < std::min(begin + PIECE, samples); ++k) {
            estimator.take(
                {stamp_ns.data()[k], row_of(motor_angle, k), row_of(measured_angle, k),
                 row_of(effort, k)},
                {row_of(estimates, k), row_of(stddevs, k), row_of(angles, k),
                 row_of(angle_stddevs, k)});
        }
    }
}

}  // namespace

void bind_encoderless(py::module_& core) {
    py::class_<EncoderlessJoint>(core, "EncoderlessJoint", "A joint without encoder.")
        .def(
            py::init([](Index joint, double lower, double upper, double start, double load_drift) {
                return EncoderlessJoint{joint, lower, upper, start, load_drift};
            }),
            py::kw_only(), py::arg("joint"), py::arg("lower"), py::arg("upper"), py::arg("start"),
            py::arg("load_drift"));
    py::class_<HeldEstimator>(
        core, "EncoderlessEstimator", "The estimate of a robot with joints without encoder.")
        .def(
            py::init<
                Indices, Matrix, const Matrix&, const Matrix&, const Matrix&, const Indices&,
                const Vector&, std::vector<EncoderlessJoint>, std::vector<double>>(),
            py::kw_only(), py::arg("plan").noconvert(), py::arg("numbers").noconvert(),
            py::arg("share").noconvert(), py::arg("effort_error").noconvert(),
            py::arg("reading_error").noconvert(), py::arg("columns").noconvert(),
            py::arg("slack").noconvert(), py::arg("joints"), py::arg("effort_noise"))
        .def(
            "run", run, py::arg("stamp_ns").noconvert(), py::arg("motor_angle").noconvert(),
            py::arg("measured_angle").noconvert(), py::arg("effort").noconvert(),
            py::arg("estimates").noconvert(), py::arg("stddevs").noconvert(),
            py::arg("angles").noconvert(), py::arg("angle_stddevs").noconvert())
        .def("forget", [](HeldEstimator& held) { held.estimator.forget(); })
        .def("look_ahead", [](HeldEstimator& held) { held.estimator.look_ahead(); })
        .def("look_back", [](HeldEstimator& held) { held.estimator.look_back(); })
        .def_property_readonly("state", [](const HeldEstimator& held) {
            const std::span<const double> state = held.estimator.state();
            return Vector(static_cast<py::ssize_t>(state.size()), state.data());
        });
}

}  // namespace cdrj

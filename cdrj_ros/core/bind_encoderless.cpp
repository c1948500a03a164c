// Joints without encoder, as `cdrj_ros.estimation.encoderless` uses them.
#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <vector>

#include "arrays.hpp"
#include "bind.hpp"
#include "encoderless.hpp"

namespace py = pybind11;

namespace cdrj {
namespace {

using Stamps = py::array_t<Nanoseconds, py::array::c_style>;

/// Samples between two looks at Ctrl-C; each takes long.
constexpr py::ssize_t FEW = 256;

std::span<double> writable_row(Matrix& matrix, py::ssize_t row) {
    return {begin_of_row(matrix, row), static_cast<std::size_t>(matrix.shape(1))};
}

void run(
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
            {writable_row(estimates, k), writable_row(stddevs, k), writable_row(angles, k),
             writable_row(angle_stddevs, k)});
        return true;
    };
    for_samples(samples, take, FEW);
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
    py::class_<EncoderlessEstimator>(
        core, "EncoderlessEstimator", "The estimate of a robot with joints without encoder.")
        .def(
            py::init<Ensemble&, std::vector<EncoderlessJoint>, std::vector<double>>(),
            py::kw_only(), py::arg("ensemble"), py::arg("joints"), py::arg("effort_noise"),
            py::keep_alive<1, 2>())
        .def(
            "run", run, py::arg("stamp_ns").noconvert(), py::arg("motor_angle").noconvert(),
            py::arg("measured_angle").noconvert(), py::arg("effort").noconvert(),
            py::arg("estimates").noconvert(), py::arg("stddevs").noconvert(),
            py::arg("angles").noconvert(), py::arg("angle_stddevs").noconvert())
        .def("reset", &EncoderlessEstimator::reset)
        .def("keep", &EncoderlessEstimator::keep)
        .def("roll_back", &EncoderlessEstimator::roll_back)
        .def_property_readonly("state", [](const EncoderlessEstimator& estimator) {
            const std::span<const double> state = estimator.state();
            return Vector(static_cast<py::ssize_t>(state.size()), state.data());
        });
}

}  // namespace cdrj

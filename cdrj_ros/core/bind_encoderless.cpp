// Joints without encoder, as `cdrj_ros.estimation` uses them.
#include "bind.hpp"
#include "encoderless.hpp"

namespace cdrj {
namespace {

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

}  // namespace

void bind_encoderless(nb::module_& core) {
    nb::class_<EncoderlessJoint>(core, "EncoderlessJoint",
        "A joint without encoder, and what is known of it.")
        .def(
            "__init__",
            [](EncoderlessJoint* made, Index joint, double lower, double upper, double start,
               double load_drift) {
                new (made) EncoderlessJoint{joint, lower, upper, start, load_drift};
            },
            nb::kw_only(), "joint"_a, "lower"_a, "upper"_a, "start"_a, "load_drift"_a, R"(
            Keep the numbers.

            Args:
                joint: its index among all joints of the robot.
                lower, upper: ends of its range [rad] or [m].
                start: angle from which the first search begins [rad] or [m].
                load_drift: standard deviation of the change of its load in 1 s [N m]; 0 where nothing
                    is known of it.)");
    nb::class_<EncoderlessEstimator>(core, "EncoderlessEstimator",
        "The estimate of a robot with u joints without encoder, and its ensemble.")
        .def(
            nb::init<Ensemble&, std::vector<EncoderlessJoint>, std::vector<double>>(), nb::kw_only(),
            "ensemble"_a, "joints"_a, "effort_noise"_a, nb::keep_alive<1, 2>(), R"(
            Take an ensemble, whose members this object alone advances.

            Args:
                ensemble: of the robot.
                joints: those without encoder, in the robot's order.
                effort_noise: standard deviation of the measured effort of every motor [N m].)")
        .def(
            "run", run_encoderless, "stamp_ns"_a, "motor_angle"_a, "measured_angle"_a, "effort"_a,
            "estimates"_a, "stddevs"_a, "angles"_a, "angle_stddevs"_a, R"(
            Estimate samples, one after the other; one or many at a time give the same bits.

            Args:
                stamp_ns: shape (n,).
                motor_angle: [rad], shape (n, motors).
                measured_angle: of the joints with encoder [rad] or [m], shape (n, joints - u).
                effort: of the motors [N m], shape (n, motors); NaN where none was heard.
                estimates: shape (n, estimate_size), written.
                stddevs: shape (n, columns), written.
                angles, angle_stddevs: of the joints without encoder [rad] or [m], (n, u), written.

            Raises:
                TypeError: an array is not contiguous or of another type.
                ValueError: the arrays are not those of this robot.
                KeyboardInterrupt: between some hundred samples.)")
        .def("reset", &EncoderlessEstimator::reset,
            "Discard everything that was heard; the next effort starts anew.")
        .def("keep", &EncoderlessEstimator::keep,
            "Keep the history, unless that has been done.")
        .def("roll_back", &EncoderlessEstimator::roll_back,
            "Return to the history that was kept; without effect if there is none.")
        .def_prop_ro("state", [](const EncoderlessEstimator& estimator) {
            return copy_of(estimator.state());
        },
            "The nominal robot's state after the last sample, shape (state_size,), a copy.");
}

}  // namespace cdrj

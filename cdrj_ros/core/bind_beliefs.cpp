// Signatures of unknowns, and what sensors tell about them, as `cdrj_ros.estimation` uses them.
#include <nanobind/stl/tuple.h>

#include <tuple>
#include <utility>
#include <vector>

#include "beliefs.hpp"
#include "bind.hpp"
#include "correction.hpp"
#include "signatures.hpp"

namespace cdrj {
namespace {

std::vector<double> numbers_of(const Given& array) {
    return {array.data(), array.data() + array.size()};
}

/// The robots of all unknowns.
std::vector<Ends> ends_of(const GivenIntegers& rows, Index robots, const Sizes& sizes) {
    std::vector<Ends> found;
    for (Index u = 0; u < rows.shape(0); ++u) {
        const auto own = row_of(rows, u);
        require(
            own.size() == 3 && 0 <= own[0] && own[0] < robots && 0 <= own[1] && own[1] < robots &&
                -1 <= own[2] && own[2] < sizes.cables + sizes.axes(),
            "there is no such robot, cable or axis");
        found.push_back({own[0], own[1], own[2]});
    }
    return found;
}

/// Signatures whose topology stays alive with them.
struct HeldSignatures {
    HeldSignatures(
        const HeldRobot& of, const Given& constants, const Given& shift, const GivenFlags& slipping,
        const GivenIntegers& unknowns)
        : robot(of),
          signatures(
              robot.robot.topology, numbers_of(constants), numbers_of(shift),
              std::vector<bool>(slipping.data(), slipping.data() + slipping.size()),
              ends_of(unknowns, constants.shape(0), robot.robot.topology.sizes)) {
        require(
            constants.has({constants.shape(0), robot.constants.size()}) &&
                shift.has({constants.shape(0), robot.robot.topology.sizes.axes()}) &&
                slipping.has({constants.shape(0)}),
            "constants, shift or slipping are not those of such robots");
    }

    HeldRobot robot;
    Signatures signatures;
};

Written follow(
    HeldSignatures& held, const Given& motor_angle, const Given& joint_angle, double dt) {
    held.robot.require_angles(motor_angle.size(), joint_angle.size());
    const Written slopes({held.signatures.unknowns(), held.signatures.quantities()});
    held.signatures.follow(span_of(motor_angle), span_of(joint_angle), dt, span_of(slopes));
    return slopes;
}

void make_beliefs(
    Beliefs* made, const Given& start, const Given& drift, const Given& jump, const Given& error) {
    require(
        drift.size() == start.size() && jump.size() == start.size() && error.size() == start.size(),
        "start, drift, jump and error differ in their numbers of unknowns");
    new (made) Beliefs(span_of(start), span_of(drift), span_of(jump), span_of(error));
}

void hear(
    Beliefs& beliefs, std::size_t quantity, const GivenFlags& contributes, double scale,
    double balance, const std::vector<double>& prior, double drift, const std::vector<double>& model, double faulty) {
    require(
        prior.size() == 2 && model.size() == 2 && Index(quantity) < contributes.size(),
        "prior, model or contributes have not the sizes of a sensor's");
    const std::vector<bool> of(contributes.data(), contributes.data() + contributes.size());
    beliefs.hear({quantity, of, scale, balance, prior[0], prior[1], drift, model[0], model[1], faulty});
}

void take(
    Beliefs& beliefs, std::size_t k, Nanoseconds stamp_ns, double value, double noise, double h,
    const Given& slopes, double history, const Given& parts) {
    require(
        k < beliefs.heard.size() && slopes.size() == Index(beliefs.count()),
        "there is no such sensor, or slopes are of other unknowns");
    beliefs.take(k, {stamp_ns, value, noise, h, span_of(slopes), history, span_of(parts)});
}

using Three = std::tuple<Written, Written, Written>;

Three present(
    const Beliefs& beliefs, Nanoseconds stamp_ns, const Given& h, const Given& slopes,
    const Given& deviation) {
    const Index size = h.size();
    require(
        slopes.has({Index(beliefs.count()), size}) && deviation.ndim() == 2 &&
            deviation.shape(1) == size && deviation.shape(0) > 0,
        "slopes or deviation are of other quantities");
    for (const Heard& one : beliefs.heard) {
        require(
            Index(one.sensor.contributes.size()) == size, "the sensors are of other quantities");
    }
    const Written shift({size}), known({size}), left({size});
    beliefs.present(
        stamp_ns, span_of(h), span_of(slopes), span_of(deviation),
        {span_of(shift), span_of(known), span_of(left)});
    return {shift, known, left};
}

void widen(Beliefs& beliefs, const Given& variances) {
    require(variances.size() == Index(beliefs.count()), "variances are of other unknowns");
    beliefs.widen(span_of(variances));
}

Written mean_of(const Beliefs& beliefs) {
    const Written found({Index(beliefs.hypotheses.size()), Index(beliefs.unknowns())});
    for (Index b = 0; b < found.shape(0); ++b) {
        std::ranges::copy(beliefs.hypotheses[b].mean, row_of(found, b).begin());
    }
    return found;
}

Written covariance_of(const Beliefs& beliefs) {
    const auto size = Index(beliefs.unknowns());
    const Written found({Index(beliefs.hypotheses.size()), size, size});
    double* to = found.data();
    for (const Hypothesis& own : beliefs.hypotheses) {
        to = std::ranges::copy(own.covariance.numbers(), to).out;
    }
    return found;
}

Written weight_of(const Beliefs& beliefs) {
    std::vector<double> found;
    for (const Hypothesis& own : beliefs.hypotheses) found.push_back(own.weight);
    return copy_of(found);
}

Array<bool> right_of(const Beliefs& beliefs) {
    const Array<bool> found({Index(beliefs.hypotheses.size()), Index(beliefs.heard.size())});
    bool* to = found.data();
    for (const Hypothesis& own : beliefs.hypotheses) to = std::ranges::copy(own.right, to).out;
    return found;
}

/// Take up means, covariances and weights of the same sensors.
void restore(
    Beliefs& beliefs, const GivenIntegers& stamp_ns, const Given& mean, const Given& covariance,
    const Given& weight) {
    const Index hypotheses = beliefs.hypotheses.size(), size = beliefs.unknowns();
    require(
        stamp_ns.size() == Index(beliefs.heard.size()) && mean.has({hypotheses, size}) &&
            covariance.has({hypotheses, size, size}) && weight.has({hypotheses}),
        "not the numbers of this robot's unknowns");
    for (std::size_t k = 0; k < beliefs.heard.size(); ++k) {
        beliefs.heard[k].stamp_ns = stamp_ns.data()[k];
    }
    for (Index b = 0; b < hypotheses; ++b) {
        Hypothesis& own = beliefs.hypotheses[b];
        std::ranges::copy(row_of(mean, b), own.mean.begin());
        std::copy_n(covariance.data() + b * size * size, size * size, own.covariance.numbers().begin());
        own.weight = weight.data()[b];
    }
}

/// What is known of a sensor: stamp of its last reading, number of readings, and whether it is frozen.
std::tuple<Nanoseconds, Index, bool> heard(const Beliefs& beliefs, std::size_t k) {
    require(k < beliefs.heard.size(), "there is no such sensor");
    const Heard& one = beliefs.heard[k];
    return {one.stamp_ns, one.used, one.frozen()};
}

/// (B5) of a sensor at a time: M with u and the sum of squares, the number of independent readings,
/// and what the last ones say of each cable; of no reading, nothing.
std::tuple<Written, double, Written> evidence(
    const Beliefs& beliefs, std::size_t k, Nanoseconds stamp_ns) {
    require(k < beliefs.heard.size(), "there is no such sensor");
    const Evidence& own = beliefs.heard[k].evidence;
    const auto size = Index(beliefs.count()) + 3;
    const Written sums({size, size});
    std::ranges::fill(span_of(sums), 0.0);
    if (own.stamp_ns == NEVER_NS) return {sums, 0.0, copy_of(own.recent)};
    const double passed = static_cast<double>(std::max(stamp_ns - own.stamp_ns, Nanoseconds{0}));
    const double kept = std::exp(-passed * 1e-9 / FADES_S);
    std::ranges::transform(
        own.sums.numbers(), sums.data(), [kept](double one) { return kept * one; });
    return {sums, kept * own.number, copy_of(own.recent)};
}

/// Standard deviations of an estimate with what sensors say, which it becomes.
Written correct_estimate(
    const HeldRobot& held, const Written& values, const Given& stddev, const Given& history,
    const Given& shift, const Given& known, const Given& left, const Given& least) {
    const Sizes& sizes = held.robot.topology.sizes;
    const Index size = first_of(sizes, &Estimate::joint_effort, true) + sizes.joints;
    require(
        values.size() == Index(held.robot.estimate_size()) && stddev.size() == size &&
            history.size() == size && shift.size() == size && known.size() == size && left.size() == size &&
            least.size() == size,
        "the numbers are not those of this robot");
    const Written found = copy_of(span_of(stddev));
    correct(
        held.robot, span_of(values), span_of(found), span_of(history),
        {span_of(shift), span_of(known), span_of(left)}, span_of(least));
    return found;
}

}  // namespace

void bind_beliefs(nb::module_& core) {
    nb::class_<HeldSignatures>(core, "Signatures",
        "What every unknown of a robot changes in its estimate, (B2).")
        .def(
            nb::init<
                const HeldRobot&, const Given&, const Given&, const GivenFlags&, const GivenIntegers&>(),
            "robot"_a, "constants"_a, "shift"_a, "slipping"_a, "unknowns"_a, R"(
            Copy all arrays.

            Args:
                robot: whose topology they have.
                constants: of all robots, shape (robots, constants).
                shift: their angles less those that are read [rad], shape (robots, axes).
                slipping: whether their cables slip on the drums, shape (robots,).
                unknowns: the robots at plus and at minus one unit, and the only cable that this
                    changes, or the only axis, counted after the cables; -1 for several cables;
                    shape (unknowns, 3).

            Raises:
                ValueError: the arrays are not those of such robots.)")
        .def("reset", [](HeldSignatures& held) { held.signatures.reset(); },
            "Discard the histories of all robots.")
        .def("follow", follow, "motor_angle"_a, "joint_angle"_a, "dt"_a, R"(
            Step all robots.

            Args:
                motor_angle: that is read [rad], shape (motors,).
                joint_angle: that is read [rad], shape (joints,).
                dt: time since the last call [s]; 0 if unknown.

            Returns:
                Change of every quantity that has a standard deviation per unit of every unknown,
                shape (unknowns, quantities).)");
    nb::class_<Beliefs>(core, "Beliefs",
        "Hypotheses about which sensors are right, with means and covariances of all unknowns.")
        .def("__init__", make_beliefs, "start"_a, "drift"_a, "jump"_a, "error"_a, R"(
            Begin without sensors.

            Args:
                start: standard deviations of the robot's unknowns, shape (unknowns,).
                drift: of their random walks after 1 s.
                jump: of their sudden changes.
                error: of corrections by each, as a share of them.)")
        .def(
            "hear", hear, nb::kw_only(), "quantity"_a, "contributes"_a, "scale"_a, "balance"_a, "prior"_a,
            "drift"_a, "model"_a, "faulty"_a, R"(
            Add a sensor, as ``Sensor`` describes it.

            Args:
                quantity: that it reads.
                contributes: whether its cables contribute to every quantity, shape (quantities,).
                scale: what the preloads contribute to its reading [N] or [N m].
                balance: the same with signs.
                prior: standard deviations of bias and gain.
                drift: random walk of the bias after 1 s.
                model: error of the model, as a share of the reading and at least.
                faulty: prior probability that it is wrong, and least weight of that in variances.)")
        .def(
            "take", take, "k"_a, "stamp_ns"_a, "value"_a, "noise"_a, "h"_a, "slopes"_a, "history"_a,
            "parts"_a, R"(
            Take a reading, (B3).

            Args:
                k: index of the sensor in the order of ``hear``.
                stamp_ns: its time [ns].
                value: [N] or [N m].
                noise: its standard deviation.
                h: what the model says [N] or [N m].
                slopes: signatures of the robot's unknowns, shape (unknowns,).
                history: standard deviation of h by its friction history.
                parts: what each cable of the sensor contributes to h, shape (cables,).)")
        .def("present", present, "stamp_ns"_a, "h"_a, "slopes"_a, "deviation"_a, R"(
            What the sensors say about the present, (B4).

            Args:
                stamp_ns: now [ns].
                h: the model's quantities now, shape (quantities,).
                slopes: their signatures, shape (unknowns, quantities).
                deviation: of the members from h by their histories, shape (members, quantities).

            Returns:
                Changes of all quantities; the shares of the variances of their histories that the
                readings take away; and the variances that the unknowns leave.)")
        .def("pause", &Beliefs::pause,
            "Forget the last readings: the estimates to come have another history.")
        .def("widen", widen, "variances"_a,
            "Add to the variances of the robot's unknowns, shape (unknowns,), in all hypotheses.")
        .def("restore", restore, "stamp_ns"_a, "mean"_a, "covariance"_a, "weight"_a, R"(
            Take up what was known of the same unknowns and sensors, see the properties.

            Raises:
                ValueError: an array has not the shape; nothing has changed then.)")
        .def("heard", heard, "k"_a,
            "Stamp of a sensor's last reading [ns], number of readings, and whether it is frozen.")
        .def("evidence", evidence, "k"_a, "stamp_ns"_a, R"(
            What the latest readings of a sensor show, (B5), as of a time [ns].

            Returns:
                M, u and the sum of squares as one symmetric matrix, of the robot's unknowns, bias,
                gain and z - h; the number of independent readings; and sums of squares of the last
                ones without each cable and with all, and their number, empty before the first.)")
        .def_prop_ro("mean", mean_of, "Shape (hypotheses, unknowns with two for every sensor).")
        .def_prop_ro("covariance", covariance_of)
        .def_prop_ro("weight", weight_of, "Probability of every hypothesis.")
        .def_prop_ro("right", right_of, "Which sensors each holds right, shape (hypotheses, sensors).")
        .def_prop_ro("least_weights",
            [](const Beliefs& beliefs) { return copy_of(beliefs.least_weights()); },
            "Weights of the hypotheses in variances: none less than what its sensors keep.");
    core.attr("NONLINEAR") = NONLINEAR;
    core.def("correct", correct_estimate, "robot"_a, "values"_a, "stddev"_a, "history"_a, "shift"_a,
        "known"_a, "left"_a, "least"_a, R"(
        Change an estimate of the model into that with what the sensors say.

        Args:
            robot: of which it is.
            values: the estimate; changed.
            stddev: of its uncertain quantities, as all that follows, shape (quantities,).
            history: their variances by the members.
            shift: their changes.
            known: shares of ``history`` that the sensors take away.
            left: variances that they leave.
            least: magnitudes where cables are slack: the least standard deviations there.

        Returns:
            The new standard deviations.)");
}

}  // namespace cdrj

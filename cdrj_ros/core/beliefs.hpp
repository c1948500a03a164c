// What sensors tell about a robot's unknowns, and which sensors are right. docs/estimation.md.
//
// Let h be the quantity that a sensor reads, by the model, and s the signatures (B2) of the unknowns x
// there. The sensor reads
//
//     z = (1 + g) (h + s x) + b + v,                                                           (B3)
//
// with a bias b and an error g of its gain: two more unknowns. The errors v of noise, model and
// friction history are no unknowns.
//
// A hypothesis says which sensors are right. For each there is one Kalman filter over all unknowns,
// which no sensor that it holds wrong has touched; there is one for all sensors, one for all but each,
// and one for none. The readings weigh them.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

#include "normal_equations.hpp"
#include "records.hpp"
#include "robot_records.hpp"

namespace cdrj {

/// Error of a correction by signatures, as a share of it.
inline constexpr double NONLINEAR = 0.1;

/// Time for which errors of the model and of the history last [s].
inline constexpr double LASTS_S = 0.2;

/// Time after which a reading weighs a third as evidence [s]: a few strokes of a slow joint.
inline constexpr double FADES_S = 5.0;

/// So many stray readings in a row are no evidence.
inline constexpr Index STRAYS = 2;

inline double square(double number) { return number * number; }

/// What is open about a sensor; see `cdrj_ros.estimation.sensors`.
struct Accuracy {
    std::size_t quantity;            // that it reads
    std::vector<bool> contributes;   // whether its cables contribute to every quantity
    double scale;                    // what the preloads contribute to its reading [N] or [N m],
    double balance;                  // and with signs
    double bias, gain;               // standard deviations of b and g
    double drift;                    // random walk of b after 1 s
    double model_share, model_least; // error of the model, as a share of the reading and at least
    double faulty;                   // least weight of its being wrong

    /// Variance of the model's error at a reading.
    double model_variance(double value) const {
        return square(std::max(model_share * std::abs(value), model_least));
    }
};

/// A reading, and what the model said at its time.
struct SensorReading {
    Nanoseconds stamp_ns;
    double value;
    double noise;                    // its standard deviation
    double h;
    std::span<const double> slopes;  // signatures of the robot's unknowns
    double history;                  // standard deviation of h by its friction history
    std::span<const double> parts;   // what each cable of the sensor contributes to h
};

/// What the latest readings of a sensor show, whatever was believed before: with the slopes a of (B3)
/// for the robot's unknowns, bias and gain, and the variance R of the errors v, the sums of
///
///     z - h = a x + v:     M = sum a a' / R,    u = sum a (z - h) / R,                         (B5)
///
/// in which older readings fade.
struct Evidence {
    DenseMatrix sums{0, 0};        // M, then u, and the sum of (z - h)^2 / R, symmetric
    double number = 0.0;           // of readings whose errors are independent
    std::vector<double> recent{};  // over the last readings: (z - h)^2 / R with what h would be
                                   // without each cable; how much more it would be with the
                                   // preloads; with all cables; the number of readings
    Nanoseconds stamp_ns = NEVER_NS;

    /// Add a reading of a sensor.
    void add(const SensorReading& reading, const Accuracy& sensor);
};

/// A sensor that has been heard, and its last reading.
struct Heard {
    Accuracy sensor;
    std::size_t first;             // its bias among the unknowns; the gain follows
    Nanoseconds stamp_ns = NEVER_NS;
    double value = 0.0;
    double h = 0.0;
    std::vector<double> slopes{};  // empty where the estimate has begun anew since
    double variance = INFINITE;    // of the errors v
    Index equal = 0;               // how many readings before the last were equal to it,
    double lowest = INFINITE;      // and the range of h since the first of them
    double highest = -INFINITE;
    Index used = 0;                // number of readings
    std::vector<double> rest{};    // last reading less what was expected, by hypotheses
    Index strays = 0;              // how many of the latest were stray if all sensors are right
    Evidence evidence{};

    /// Whether equal readings contradict the motion.
    bool frozen() const;
};

/// A hypothesis: which sensors are right, and what is known of all unknowns then.
struct Hypothesis {
    std::vector<bool> right;
    std::vector<double> mean;
    DenseMatrix covariance;
    double weight;  // its probability
};

/// What the readings say about every quantity now, to be written; as `Said`.
struct Presence {
    std::span<double> shift, known, left;
};

/// The hypotheses about one group of cables.
class Beliefs {
public:
    /// Begin without sensors. `start`, `drift` and `jump`: of the robot's unknowns, standard deviations
    /// at the start, of the random walk after 1 s, and of a sudden change; `error`: of a correction by
    /// each, as a share of it.
    Beliefs(
        std::span<const double> start, std::span<const double> drift, std::span<const double> jump,
        std::span<const double> error);

    /// Add a sensor: its errors become unknowns, and hypotheses extend those there are.
    void hear(Accuracy sensor);

    /// Take a reading of sensor `k`.
    void take(std::size_t k, const SensorReading& reading);

    /// Forget the last readings: the estimates to come have another history.
    void pause();

    /// Add to the variances of the robot's unknowns under all hypotheses.
    void widen(std::span<const double> variances);

    /// What the sensors say about the present.
    ///
    /// The unknowns shift all quantities by their signatures. No number that lasts explains a reading
    /// where the friction history is wide, or a pose badly known beside stiff cables; but the latest
    /// readings say where the tensions are now, through the covariance of the members:
    ///
    ///     t <- t + C_tz (C_zz + R)^-1 (z - expected).                                          (B4)
    ///
    /// Sensors change quantities to which they do not contribute by their unknowns alone: few members
    /// cannot tell more. `h`: the model's quantities now; `slopes`: their signatures, by unknowns;
    /// `deviation`: of the members from h by their histories, by members.
    ///
    /// A reading far from what is expected of a sensor that is right says where they are not: it leaves
    /// them open by the same share as it is off.
    void present(
        Nanoseconds stamp_ns, std::span<const double> h, std::span<const double> slopes,
        std::span<const double> deviation, const Presence& found) const;

    /// Weights of the hypotheses in variances: none less than what its sensors keep.
    std::vector<double> least_weights() const;

    std::size_t count() const { return drift_.size(); }  // of the robot's unknowns, which come first
    std::size_t unknowns() const { return count() + 2 * heard.size(); }

    std::vector<Heard> heard;
    std::vector<Hypothesis> hypotheses;

private:
    /// What a reading is under a hypothesis.
    struct Explanation {
        double rest;      // its difference from what was expected
        double right;     // log likelihood if the sensor is right,
        double anywhere;  // and if it may read anything
        double bent;      // variance of what signatures do not say of the correction
        bool used;        // whether it has corrected the unknowns
    };

    struct Latest;

    std::size_t nearest(const std::vector<bool>& right) const;
    void note(Heard& one, const SensorReading& reading);
    void pass_time(const Heard& one, double passed);
    double shift_of(const Hypothesis& own, const Heard& one) const;
    double expect(const Hypothesis& own, const Heard& one, std::span<double> change) const;
    Explanation explain(
        Hypothesis& own, const Heard& one, bool is_right, double noise, double passed, double sudden);
    double wrong(
        const Heard& one, std::size_t hypothesis, const Explanation& reading, double bent) const;
    void fail(std::size_t k, double passed);
    Latest latest(
        Nanoseconds stamp_ns, std::span<const double> h, std::span<const double> deviation) const;
    double noise_now(const Hypothesis& own, const Latest& latest, std::size_t sensor) const;
    void condition(
        const Hypothesis& own, const Latest& latest, std::span<const double> h,
        std::span<const double> slopes, std::span<const double> bent, const Presence& found) const;

    std::vector<double> drift_, jump_;              // variances of the robot's unknowns
    std::vector<double> error_;                     // of a correction by each, as a share of it
    std::vector<double> change_, across_, jumped_;  // of the reading in progress
};

}  // namespace cdrj

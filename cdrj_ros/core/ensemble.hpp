// Populations of robots: those that the health monitor compares, and the ensemble behind the standard
// deviations, with or without encoders at all joints. docs/uncertainty.md.
#pragma once

#include <algorithm>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "records.hpp"
#include "robot.hpp"

namespace cdrj {

/// Robots of one topology, each with constants and a history of its own.
class Population {
public:
    /// `constants`: of all robots, see `cdrj_ros.model.packing`, stored by rows.
    Population(const Topology& topology, std::size_t robots, std::vector<double> constants);

    // robots view arrays of this object
    Population(const Population&) = delete;
    Population& operator=(const Population&) = delete;

    Index size() const { return static_cast<Index>(robots_.size()); }
    const Robot& operator[](Index k) const { return robots_[k]; }

    /// State of robot `k`; zeros before its first sample.
    std::span<double> state(Index k) {
        const std::size_t size = states.size() / robots_.size();
        return std::span(states).subspan(static_cast<std::size_t>(k) * size, size);
    }

    /// One sample of robot `k`, whose state becomes the new one; `dt` and `out` as of
    /// `Robot::advance`. False: not solved.
    bool advance(
        Index k, std::span<const double> motor_angle, std::span<const double> joint_angle, double dt,
        double* out);

    std::vector<double> constants;  // Python holds views of both: they are never moved
    std::vector<double> states;

private:
    std::vector<Robot> robots_;
};

/// If an axis moves further than this in a gap, the friction history is unknown [rad].
inline constexpr double MOVED = 0.01;

/// A sample, as the ensemble takes it.
struct SampleView {
    Nanoseconds stamp_ns;
    std::span<const double> motor_angle;  // [rad], of prismatic joints [m]
    std::span<const double> joint_angle;
    std::span<const double> unseen;       // as `Sample::unseen`
    std::span<const double> offset{};     // as `Sample::offset`
};

/// A quantity of the estimate that has a standard deviation.
struct Quantity {
    Index index;                 // in the estimate
    Index element;               // an element of its cable; -1 for an effort, to which all contribute
    Index residual;              // its learned correction, which no member has; -1 for none
    double unmodelled_variance;  // what no member shows, (U5)
    double slack;                // its magnitude where every cable has its slack tension, (U6)
};

/// What distinguishes the members, as `cdrj_ros.estimation` draws it. Tables are stored by rows.
struct Draws {
    std::vector<double> friction_share;  // by members and pulleys, see `Robot::impose_friction`
    std::vector<char> slipping;          // whether a member's cables slip on their drums
    std::vector<double> effort_error;    // lasting errors of all motors, by members [N m]
    std::vector<double> reading_error;   // of all axes, one row for every update in turn [rad]
    std::vector<double> unseen_share;    // xi of (U3), by intervals in turn, members and axes
    std::vector<double> offset_gain;     // change per offset of an axis (U12), by quantities and axes
    std::vector<double> length_share;    // of every element in the length of its cable
    std::vector<double> lower;           // range of every axis [rad]
    std::vector<double> upper;
    Index reading_rows;                  // of `reading_error`
    Index unseen_rows;                   // of `unseen_share`
};

/// How far an ensemble has come. Every field takes 8 bytes: Python reads it as an array.
struct Progress {
    Index updates = 0;            // of all members, since they were last started
    Nanoseconds last_stamp = -1;  // of the last sample; -1 before the first
    Index last_unsolved = 0;      // 1 if its estimate was not solved, otherwise 0
};

/// What an ensemble remembers from one sample to the next, beside its members' states.
struct EnsembleMemory {
    std::vector<Nanoseconds> stamps;  // of every member's last update
    Progress progress;
    std::vector<double> angle;        // of all axes at the last sample [rad]
    std::vector<double> unseen;       // standard deviations of these angles [rad]
    std::vector<double> offset;       // as `Sample::offset` [rad]
    // what follows from `offset`, of every quantity: variance that no member shows, (U5) and (U12), and
    // that of errors of clocks if nothing excludes them, (U13)
    std::vector<double> lasting;
    std::vector<double> late;
    std::vector<double> least_variance;  // of every quantity, where more is open than members show, (U15)
    // of every axis, twice the number of its past intervals without readings, plus one during one
    std::vector<Index> intervals;
    std::vector<double> deviation;    // of every member's quantities from the estimate's
    std::vector<double> variance;     // of every quantity, (U1)
    std::vector<double> swing;        // of every cable's mean tension: lowest so far, and highest, (U13) [N]
};

/// Robots that differ in all that is unknown, and are stepped along with the estimate.
///
/// One member in turn is updated with a sample, in one step over all samples since its last update.
/// All are: with the first sample, after a gap in which an axis moved, after estimates that were not
/// solved, and where an axis may have moved unseen since the sample before (U3).
class Ensemble {
public:
    /// `topology` and `constants`: of the nominal robot, see `cdrj_ros.model.packing`.
    /// `of_members`: constants of every member.
    Ensemble(
        std::vector<Index> topology, std::vector<double> constants, std::vector<double> of_members,
        std::vector<Quantity> quantities, Draws draws);

    /// One sample of the estimate and of the ensemble: `Robot::advance`, then `update`.
    bool step(
        const double* before, const SampleView& sample, double dt, std::span<double> state,
        std::span<double> estimate, std::span<double> stddev);

    /// Write the standard deviations at a sample and its estimate.
    ///
    /// They are those after the sample before, unless more than one member is updated. One member
    /// is updated then, unless the last update is too recent. `least`: number of members to be
    /// updated at least.
    void update(
        const SampleView& sample, std::span<const double> estimate, Index least,
        std::span<double> stddev);

    /// As `update` at a predicted sample, which the ensemble forgets again at the next call.
    ///
    /// Members are updated only where the prediction adds to their deviations.
    void predict(
        const SampleView& sample, std::span<const double> estimate, std::span<double> stddev);

    /// Keep the history of all members, unless that has been done.
    void keep();

    /// Return to the history that was kept, as before a prediction; without effect if there is none.
    void roll_back();

    /// Discard the history of all members; the next sample starts them anew.
    void reset();

    /// Take the standard deviations of lasting errors, as `Sample::offset`.
    void take_offset(std::span<const double> offset);

    // What `EncoderlessEstimator` uses, which advances the members itself.

    /// Discard all that distinguishes members from an estimate, since their histories are unknown.
    void start_anew();

    /// Whether the last update of a member was long enough before a stamp.
    bool is_due(Nanoseconds stamp) const;

    /// The member whose turn it is.
    Index next_member() const { return memory.progress.updates % members(); }

    /// Errors of the next member's readings, of all axes [rad].
    std::span<const double> next_errors() const;

    /// Note a member's update: its differences from the nominal estimate, and its part of the
    /// variance (U1). Quantities that are not solved in either keep their last difference.
    void compare(
        Index member, std::span<const double> own, std::span<const double> nominal, bool all_solved);

    /// Add what no member shows to the spread (U5), (U12), and widen it where cables are slack (U6).
    void write_stddev(std::span<const double> nominal, std::span<double> stddev) const;

    Index members() const { return population.size(); }
    const Robot& robot() const { return robot_; }
    std::size_t axes() const { return angle_.size(); }

    const std::vector<Quantity> quantities;
    Draws draws;

private:
    std::vector<Index> topology_;
    std::vector<double> constants_;
    Robot robot_;  // of the estimate

public:
    Population population;  // the members
    EnsembleMemory memory;  // Python holds views of it: its vectors are never moved

private:
    bool begin(
        const SampleView& sample, std::span<const double> estimate, Index least,
        std::span<double> stddev);
    bool take_angles(const SampleView& sample);
    void bound_clocks();
    bool moved_in_a_gap(Nanoseconds stamp) const;
    std::pair<bool, bool> count_intervals();
    void update_members(Index count, double part_s);
    void update_member(double part_s);
    double walk(Index member, std::span<const double> errors, double dt, double part_s);
    void deviate(Index member, std::span<const double> deviation);
    bool advance(Index member, double dt);
    bool is_invalid(std::span<const double> estimate, Index element) const;

    /// The part of an estimate that learned corrections have; `part` 0: the corrections, 1: their trust.
    double learned(std::span<const double> estimate, Index residual, Index part) const;

    /// What samples change.
    struct Kept {
        std::vector<double> states;
        EnsembleMemory memory;
    };

    std::optional<Kept> kept_;

    // of the sample in progress, or of the last one
    std::vector<double> estimate_;
    // share of the variance of clocks' errors that the swings leave possible, (U13), for every element
    // that of its cable, then the greatest of all
    std::vector<double> possible_;
    std::vector<double> angle_before_;  // of the sample before [rad]
    std::vector<double> angle_;         // [rad]
    std::vector<double> unseen_;        // standard deviations of the angles [rad]
    std::vector<double> midway_;        // those midway between the sample before and this one [rad]

    // of the member in progress
    std::vector<double> between_;  // deviations on its path between two samples [rad]
    std::vector<double> reading_;  // its readings of all axes [rad]

    std::vector<double> out_;  // of `Robot::advance`, for the estimate and every member
};

/// Set UNSURE on an element's status, unless it is INVALID.
inline void doubt(double& status) {
    const int flags = static_cast<int>(status);
    if ((flags & INVALID) == 0) status = static_cast<double>(flags | UNSURE);
}

/// Set UNSURE where the standard deviation exceeds `share` of the tension or of the preload,
/// whichever is larger.
///
/// `estimate`: tensions, then status of all elements, then the rest. `preload`: of every element's
/// cable [N]. `stddev`: of the tensions, then the rest [N].
inline void mark_unsure(
    std::span<double> estimate, std::span<const double> preload, std::span<const double> stddev,
    double share) {
    const std::size_t elements = preload.size();
    for (std::size_t e = 0; e < elements; ++e) {
        if (stddev[e] > share * std::max(estimate[e], preload[e])) doubt(estimate[elements + e]);
    }
}

}  // namespace cdrj

// The ensemble behind the standard deviations, with or without encoders at all joints.
// docs/estimation.md.
#pragma once

#include <algorithm>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "population.hpp"
#include "lags.hpp"
#include "records.hpp"
#include "units.hpp"

namespace cdrj {

/// If an axis moves further than this in a gap, the friction history is unknown [rad].
inline constexpr double MOVED = 0.01;

/// Standard deviations within which unread angles are.
inline constexpr double BOUNDS = 3.0;

/// Unseen deviations of the angles are small where they change the tensions of a cable by at most this
/// share of their standard deviations (U17).
inline constexpr double SMALL = 0.3;

/// A sudden change of a mean tension by more standard deviations of an element's makes it UNSURE: other
/// errors may add two, and five are the law, (C16).
inline constexpr double SUDDEN = 3.0;

/// It does so for four blocks of `Lags`, after which the fit of lags contains the change.
inline constexpr Nanoseconds SUDDEN_NS = 80'000'000;

/// A sample, as the ensemble takes it.
struct SampleView {
    Nanoseconds stamp_ns;
    std::span<const double> motor_angle;  // [rad], of prismatic joints [m]
    std::span<const double> joint_angle;
    std::span<const double> unseen;       // as `Sample::unseen`
    std::span<const double> offset{};     // as `Sample::offset`
};

/// An output of the estimate that has a standard deviation.
struct UncertainOutput {
    Index index;                 // in the estimate
    Index cable;                 // -1 for an effort
    Index axis;                  // of an effort, among motors, then joints; otherwise -1
    Index residual;              // its learned correction, which no member has; -1 for none
    double unmodelled_variance;  // what no member shows, (U5)
    double slack;                // its magnitude where every cable has its slack tension, (U6)
};

/// Change of a quantity per change of the angle of an axis, without friction, (U12).
struct Gain {
    Index axis;
    double gain;
};

/// What distinguishes the members, as `cdrj_ros.estimation` draws it. Tables are stored by rows.
struct Draws {
    std::vector<double> friction_share;  // by members and pulleys, see `Robot::impose_friction`
    std::vector<char> slipping;          // whether cables slip on their drums, by members and cables
    std::vector<double> effort_error;    // lasting errors of all motors, by members [N m]
    std::vector<double> reading_error;   // of all axes, one row for every update in turn [rad]
    std::vector<double> zero_error;      // of all axes' zeros, by members [rad]
    std::vector<double> unseen_share;    // xi of (U3), by intervals in turn, members and axes
    std::vector<std::vector<Gain>> gains;  // of every quantity
    std::vector<double> length_share;    // of every element in the length of its cable
    std::vector<double> load_share;      // of cables by axes, see `Units`
    std::vector<double> lower;           // range of every axis [rad]
    std::vector<double> upper;
    Index reading_rows;                  // of `reading_error`
    Index unseen_rows;                   // of `unseen_share`
};

/// Turning points that are remembered of every axis: more are noise.
inline constexpr std::size_t TURNS = 2;

/// Why a cable was not solved.
enum Unsolved : Index {
    SOLVED = 0,
    FAILED = 1,
    UNREAD_AXIS = 2,  // an axis of it was not read
    MOVED_UNREAD = 3,  // and another one has moved meanwhile
};

/// How far an ensemble has come. Every field takes 8 bytes: Python reads it as an array.
struct Progress {
    Index updates = 0;             // of members in turn, since they were last started
    Nanoseconds last_stamp = -1;   // of the last sample; -1 before the first
    Nanoseconds last_update = -1;  // of the last update of a member in turn
};

/// What an ensemble remembers from one sample to the next, beside its members' states.
struct EnsembleMemory {
    std::vector<Nanoseconds> stamps;  // of the last update, by members and cables
    Progress progress;
    std::vector<Index> unsolved;      // `Unsolved` of every cable in the last sample
    std::vector<double> angle;        // of all axes at the last sample [rad]; NaN where it was unknown
    std::vector<double> known_angle;  // of all axes when they, and all axes of their cables, were last read [rad]
    std::vector<double> unseen;       // standard deviations of these angles [rad]
    std::vector<double> least_variance;  // of every quantity, where more is open than members show, (U15)
    // of every axis, beginnings and ends of intervals without readings so far; odd during one
    std::vector<Index> intervals;
    std::vector<double> heading;      // of every axis, 1 or -1; 0 before its first angle
    std::vector<double> furthest;     // its angle furthest in this direction [rad]
    std::vector<Nanoseconds> turn_stamps;  // of its last turning points, the older ones first; -1 for none
    std::vector<double> turn_angles;  // of all axes there [rad], by these points
    std::vector<Nanoseconds> sudden_stamps;  // of every element's last sudden change; -1 for none
    std::vector<double> deviation;    // of every member's quantities from the estimate's
    std::vector<double> variance;     // of every quantity, (U1)
};

/// Robots that differ in all that is unknown, and are stepped along with the estimate.
///
/// One member in turn is updated with a sample, in one step over all samples since its last update, or
/// in several with the turning points of the axes between them: friction depends on where an axis has
/// turned.
/// Beside that, all members update a cable: after a gap in which an axis on its path moved, after
/// samples that were not solved, and where such an axis may have moved unseen by more than what is small
/// beside the cable's standard deviation (U3), (U17).
class Ensemble {
public:
    /// `topology` and `constants`: of the nominal robot, see `cdrj_ros.model.packing`.
    /// `of_members`: constants of every member. `unmodelled`: variances, then magnitudes where cables
    /// are slack, of the tensions of all elements, the forces on all pulleys and the efforts of all axes.
    Ensemble(
        std::vector<Index> topology, std::vector<double> constants, std::vector<double> of_members,
        std::span<const double> unmodelled, Draws draws);

    /// One sample of the estimate and of the ensemble: `Robot::advance`, then `update`.
    bool step(
        const double* before, const SampleView& sample, double dt, std::span<double> state,
        std::span<double> estimate, std::span<double> stddev);

    /// Write the standard deviations at a sample and its estimate.
    ///
    /// They are those before the update of the member in turn, which follows unless the last one is
    /// too recent. Tensions that have changed suddenly become `UNSURE`.
    void update(const SampleView& sample, std::span<double> estimate, std::span<double> stddev);

    /// As `update` at a predicted sample, which the ensemble forgets again at the next call.
    ///
    /// Members are updated only where the prediction adds to their deviations.
    void predict(const SampleView& sample, std::span<double> estimate, std::span<double> stddev);

    /// Keep the history of all members, unless that has been done.
    void keep();

    /// Return to the history that was kept, as before a prediction; without effect if there is none.
    void roll_back();

    /// Discard the history of all members; the next sample starts them anew.
    void reset();

    /// Take the standard deviations of lasting errors, as `Sample::offset`.
    void take_offset(std::span<const double> offset);

    /// Compute what follows from `lags`, after changes of its numbers by others.
    void renew_lasting();

    // What `EncoderlessEstimator` uses, which advances the members itself.

    /// Discard all that distinguishes members from an estimate, since their histories are unknown.
    void start_anew();

    /// Whether the last update of a member in turn was long enough before a stamp.
    bool is_due(Nanoseconds stamp) const;

    /// The member whose turn it is.
    Index next_member() const { return memory.progress.updates % members(); }

    /// Errors of a member's readings, of all axes [rad]; others in every round. They are valid until
    /// the next call.
    std::span<const double> errors_of(Index member);

    /// Note the update of the member in turn at a stamp: its differences from the nominal estimate, and
    /// its part of the variance (U1). Quantities that are not solved in either keep their last difference.
    void compare(
        Nanoseconds stamp, std::span<const double> own, std::span<const double> nominal);

    /// Add what no member shows to the spread (U5), (U12), (U17), and widen it where cables are slack (U6).
    void write_stddev(std::span<const double> nominal, std::span<double> stddev) const;

    Index members() const { return population.size(); }
    Index cables() const { return robot_.topology.sizes.cables; }
    const Robot& robot() const { return robot_; }
    std::size_t axes() const { return angle_.size(); }

    /// Variances by which lags of its axes widen every quantity of one cable, (U13); 0 of efforts.
    std::vector<double> late() const;

private:
    std::vector<Index> topology_;
    std::vector<double> constants_;
    Robot robot_;  // of the estimate

    /// Where parts of an estimate begin, and those of quantities.
    struct Firsts {
        Index status;
        Index slip_speed;
        Index tension_quantity;
        Index force_quantity;
        Index effort_quantity;
        Index correction;
        Index trust;
    };

    const Firsts first_;

public:
    const std::vector<UncertainOutput> quantities;
    Draws draws;
    Population population;  // the members
    EnsembleMemory memory;  // Python holds views of it: its vectors are never moved
    Lags lags;              // and of its numbers; samples that are predicted do not change it
    Units units;            // nor this
    Index cable_steps = 0;  // of all cables of all members so far

private:
    /// Cables whose members are updated in the same way, with all that their paths lead over.
    struct Walk : CableSet {
        int parts;   // steps of every member from the sample before to this one
        bool round;  // only the members whose time it is, otherwise all
    };

    void keep_states();
    void begin(const SampleView& sample, std::span<const double> estimate);
    void finish(std::span<double> estimate, std::span<double> stddev);
    void doubt_changes(std::span<double> estimate, std::span<const double> stddev);
    void take_angles(const SampleView& sample);
    void count_intervals();
    void note_turns(Nanoseconds before);
    bool has_turned(Index axis) const;
    void choose(Nanoseconds before);
    Walk* walk_of(Index cable, Nanoseconds before);
    bool is_unknown(Index cable, double way, Nanoseconds before) const;
    bool is_read(Index cable) const;
    bool has_moved(Index cable) const;
    void note_unsolved(Index cable);
    void note_known();
    bool slips_on(Index cable, double way, Nanoseconds before) const;
    void walk(const Walk& walk, Nanoseconds before);
    bool takes_part(Index member, Nanoseconds before) const;
    void update_members(Index count);
    void pass_turns(Index member);
    void step_to_turn(Index member, std::size_t turn);
    void step_member(Index member, const Walk& walk, Nanoseconds before);
    bool step_cable(Step& step, Index member, Index cable, double dt);
    void deviate(Index member, Index axis, double deviation);
    void compare_cable(const Step& step, Index member, Index cable);
    void renew_variance(Index quantity);
    std::vector<double> gains_of_cables() const;
    void bound_errors();
    void renew_slipped();
    void renew_late();
    double shown(Index quantity, std::span<const double> nominal) const;
    double hidden(Index quantity) const;
    std::pair<Index, Index> tensions_of(Index cable) const;
    std::pair<Index, Index> forces_of(Index cable) const;
    Index effort_of(Index axis) const;
    bool is_invalid(std::span<const double> estimate, const UncertainOutput& quantity) const;
    bool is_invalid(std::span<const double> estimate, Index cable) const;

   /// What samples change.
    struct Kept {
        std::vector<double> states;  // empty where no member was advanced
        EnsembleMemory memory;
    };

    std::optional<Kept> kept_;
    const Walk everything_;     // of the member in turn
    Walk parts_, at_once_, in_turn_;  // of the sample in progress

    // of the sample in progress, or of the last one
    std::vector<double> estimate_;
    std::vector<double> mean_tensions_;  // of all cables [N]
    std::vector<double> unread_;  // what unread motion may change in these [N]
    // variances that no member shows of every quantity: of offsets, (U12), and of lags if nothing
    // excludes them, (U13)
    std::vector<double> slipped_;
    std::vector<double> late_;
    std::vector<double> angle_before_;  // of the sample before [rad]
    std::vector<double> angle_;         // [rad]
    std::vector<double> unseen_;        // standard deviations of the angles [rad]
    std::vector<double> midway_;        // those midway between the sample before and this one [rad]
    bool any_small_ = false;
    std::vector<double> small_;         // of every axis, the greater one's square, (U17) [rad^2]
    std::vector<char> walked_;          // whether members show the deviations, of every cable
    std::vector<char> walked_axis_;     // and of every axis

    std::vector<std::size_t> turns_;  // turning points that a member passes
    std::vector<double> errors_;   // of its readings of all axes [rad]
    std::vector<double> reading_;  // of all axes, of the member in progress [rad]
    std::vector<double> out_;      // of `Robot::advance`, for the estimate and every member
};

/// Set UNSURE on an element's status, unless it is INVALID.
inline void doubt(double& status) {
    const int flags = static_cast<int>(status);
    if ((flags & INVALID) == 0) status = static_cast<double>(flags | UNSURE);
}

/// Set UNSURE where a tension is not credible, or its standard deviation exceeds `share` of it or of
/// the preload, whichever is larger.
///
/// `stddev`: of the tensions [N]; empty if none is known.
inline void mark_unsure(
    const Robot& robot, const Estimate& estimate, std::span<const double> stddev, double share) {
    for (Index c = 0; c < robot.topology.sizes.cables; ++c) {
        const CableTopology& where = robot.topology.cables[c];
        const CableConstants& cable = robot.constants.cables[c];
        for (Index e = where.first_element; e < where.first_element + where.elements; ++e) {
            const double tension = estimate.tension[e];
            const bool unclear =
                !stddev.empty() && stddev[e] > share * std::max(tension, cable.preload);
            if (unclear || tension > cable.credible_tension) doubt(estimate.status[e]);
        }
    }
}

}  // namespace cdrj

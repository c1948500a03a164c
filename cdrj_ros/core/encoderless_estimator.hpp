// The estimate of a robot with joints without encoder, and its ensemble. docs/motor_alone.md.
//
// Every member has parameters, friction history and errors of efforts and readings of its own and
// solves the same problems as the estimate; their spread gives the standard deviations.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "encoderless.hpp"
#include "records.hpp"

namespace cdrj {

/// The nominal robot, or a member of its ensemble, with the numbers that are its own.
struct EncoderlessRobot {
    Robot robot;
    std::vector<double> share;         // friction before the start, see `Robot::impose_friction`
    std::vector<double> effort_error;  // lasting error of every motor's effort [N m]; 0 if nominal
};

/// What an ensemble has drawn, and which standard deviations it gives.
struct EncoderlessEnsemble {
    std::vector<EncoderlessRobot> robots;  // the nominal robot, then all members
    DenseMatrix reading_errors;            // of motors, then measured joints; used in turn [rad]
    std::vector<Index> columns;            // places in the estimate of quantities that have one
    std::vector<double> slack;             // (U6): the least one where it exceeds the quantity
};

/// Readings of a sample.
struct EncoderlessReadings {
    Nanoseconds stamp_ns;
    std::span<const double> motor_angle;     // [rad]
    std::span<const double> measured_angle;  // of the joints with encoder [rad] or [m]
    std::span<const double> effort;          // of the motors [N m]; NaN where none was heard
};

/// Where the results of a sample are written; without any effort all numbers are NaN.
struct EncoderlessResults {
    std::span<double> estimate;
    std::span<double> stddev;        // of the columns
    std::span<double> angle;         // of the joints without encoder [rad] or [m]
    std::span<double> angle_stddev;  // [rad] or [m]
};

class EncoderlessEstimator {
public:
    /// `effort_noise`: standard deviation of the measured effort of every motor [N m].
    EncoderlessEstimator(
        EncoderlessEnsemble ensemble, std::vector<EncoderlessJoint> joints,
        std::vector<double> effort_noise);

    /// Estimate a sample.
    ///
    /// At the first one all members are updated, later one in turn, at most every `APART_NS`.
    void take(const EncoderlessReadings& readings, const EncoderlessResults& results);

    /// Discard everything that was heard; the next effort starts anew.
    void forget();

    /// Note the history, unless that has been done.
    void look_ahead();

    /// Return to the history that `look_ahead` noted; without effect if there is none.
    void look_back();

    /// State of the nominal robot after the last sample.
    std::span<const double> state() const { return history_.robots[0].state; }

    const Sizes& sizes() const { return ensemble_.robots[0].robot.topology.sizes; }
    std::size_t joints() const { return solver_.joints(); }
    std::size_t measured_joints() const { return solver_.measured_joints(); }
    std::size_t columns() const { return ensemble_.columns.size(); }

private:
    /// One member is updated at most this often.
    static constexpr Nanoseconds APART_NS = 1'500'000;

    /// History of one robot.
    struct OfRobot {
        std::vector<double> state;
        EncoderlessMemory memory;
        Nanoseconds stamp_ns;  // of its last update
    };

    /// All that samples change.
    struct History {
        std::vector<OfRobot> robots;   // the nominal one, then all members
        std::size_t updates;           // of members, so far
        Nanoseconds updated_ns;        // stamp of the last of them
        DenseMatrix deviation;         // of every member from the estimate: columns, then angles
        std::vector<double> variance;  // of the same quantities
    };

    void solve(std::size_t robot, const EncoderlessReadings& readings);
    void update_member(const EncoderlessReadings& readings, const EncoderlessResults& results);
    void note_deviation(std::size_t member, const EncoderlessResults& results);
    void write_stddev(const EncoderlessResults& results) const;
    void write_unknown(const EncoderlessResults& results) const;

    EncoderlessEnsemble ensemble_;
    EncoderlessSolver solver_;
    History history_;
    std::optional<History> before_look_;
    std::vector<double> motor_angle_;     // readings with the errors of a member
    std::vector<double> measured_angle_;
    std::vector<double> effort_;
};

}  // namespace cdrj

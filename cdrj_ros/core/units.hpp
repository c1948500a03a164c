// Units and signs of the axes, as their motion together shows them.
//
// A cable keeps its length but for its stretch, so what motors wind in, joints give out. Where a motion
// leaves a stretch that is a large part of it, the angle of some axis has another unit, another sign,
// another factor, or another axis's name. (C15) of docs/estimation.md.
#pragma once

#include <span>
#include <vector>

#include "records.hpp"

namespace cdrj {

/// What the motions of one robot's axes since the first sample show of their units.
class Units {
public:
    /// gains: change of every cable's mean tension by every axis [N/rad], by rows.
    /// loads: by what share of an axis's motion a load stretches the cable, by rows: 0 for motors, 1 or
    ///     more where nothing tells the motion from a load.
    Units(std::size_t axes, std::span<const double> gains, std::span<const double> loads);

    /// Begins without samples.
    void begin();

    /// Takes the angles of the next sample and the mean tensions of all cables. Whether `errors` have
    /// changed.
    ///
    /// unread: what these may be off by because axes had not been read.
    bool take(
        Nanoseconds stamp_ns, std::span<const double> angles, std::span<const double> tensions,
        std::span<const double> unread);

    /// What every axis may be wrong by because of its unit, 0 where nothing says so.
    std::vector<double> errors;

private:
    /// A motor or joint that acts on a cable.
    struct End {
        std::size_t axis;
        double gain, load;
    };

    struct Cable {
        std::vector<End> ends;
        double stretch = 0.0;  // greatest change of its mean tension, of late [N]
    };

    void doubt(const Cable& cable);

    std::vector<Cable> cables_;
    std::vector<double> greatest_gain_;                // of every axis, by its cables [N/rad]
    std::vector<double> first_angle_, first_tension_;  // of the first sample; empty before it
    std::vector<double> furthest_;                     // greatest motion of every axis since
    std::vector<double> before_;                       // `errors` of the sample before
    std::vector<char> doubtful_;                       // whether an axis is
    Nanoseconds last_ns_ = NEVER_NS;                   // the last sample
};

}  // namespace cdrj

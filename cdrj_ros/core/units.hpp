// Units and signs of the axes, as their motion together shows them.
//
// A cable keeps its length but for its stretch, so what motors wind in, joints give out. Where a motion
// leaves a stretch that is a large part of it, the angle of some axis has another unit, another sign, or
// another axis's name. (C15) of docs/estimation.md.
#pragma once

#include <span>
#include <vector>

#include "records.hpp"

namespace cdrj {

/// What the motions of one robot's axes since the first sample show of their units.
class Units {
public:
    /// axes: with their `pull`.
    /// bends: by what share of the greatest motion every cable's length is not linear in the angles.
    Units(std::span<const Axis> axes, std::span<const double> bends);

    /// Begins without samples.
    void begin();

    /// Takes the angles of the next sample, and their standard deviations if one is not zero.
    void take(
        Nanoseconds stamp_ns, std::span<const double> angles, std::span<const double> unseen);

    /// Whether an axis may have another unit, because it has moved and some cable has not kept its length.
    bool doubtful() const { return doubts_ > 0; }

    /// Whether this one may.
    bool doubts(std::size_t axis) const;

    /// What an axis may be wrong by because of its unit.
    double error(std::size_t axis) const { return error_[axis]; }

private:
    /// A motor or joint that acts on a cable.
    struct End {
        std::size_t axis;
        double pull;            // as `Axis::pull`
        bool free;              // as `Axis::free`: its motion may stretch the cable or be taken up
        double furthest = 0.0;  // greatest part of it of late in what stretches the cable
        bool known = false;     // whether its unit is
        bool doubtful = false;
    };

    /// A cable, with its ends until all of them are known.
    struct Cable {
        double bend;
        std::vector<End> ends{};
        double furthest = 0.0;  // greatest of all
        double stretch = 0.0;   // greatest sum of all, of late
    };

    void take(Cable& cable, std::span<const double> angles, std::span<const double> unseen);

    std::vector<Cable> all_;     // at the beginning
    std::vector<Cable> cables_;  // those with an unknown axis
    std::vector<double> first_;  // angles of the first sample; empty before it
    std::vector<double> error_;
    Nanoseconds last_ns_ = -1;   // the last sample
    double kept_ = 1.0;          // share of what was known then that is not forgotten
    int doubts_ = 0;             // doubtful ends
};

}  // namespace cdrj

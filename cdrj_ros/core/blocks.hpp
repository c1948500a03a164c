// Means of some quantities over successive blocks of samples, of which the last few are remembered.
#pragma once

#include <span>

namespace cdrj {

/// Blocks are at least this long [s].
inline constexpr double SHORTEST = 0.02;

/// Samples further apart than this are not compared [s].
inline constexpr double LONGEST = 0.3;

/// Layout of the memory of blocks, of which number 0 is in progress, and those before it are whole.
class Blocks {
public:
    /// width: number of quantities. count: of blocks that are remembered.
    Blocks(std::size_t width, std::size_t count) : width_(HEAD + width), count_(count) {}

    std::size_t size() const { return count_ * width_; }

    /// Takes a sample of all quantities; whether a block has ended.
    bool take(std::span<double> memory, double now, std::span<const double> values) const;

    /// Whether a block has samples.
    bool has(std::span<const double> memory, std::size_t block) const {
        return memory[block * width_] > 0.0;
    }

    /// Mean time of its samples [s].
    double time(std::span<const double> memory, std::size_t block) const {
        return memory[block * width_ + 1] + memory[block * width_ + 2];
    }

    /// Mean of a quantity.
    double mean(std::span<const double> memory, std::size_t block, std::size_t quantity) const {
        return memory[block * width_ + HEAD + quantity];
    }

private:
    /// Number of samples, time of the first one, and mean time since then.
    static constexpr std::size_t HEAD = 3;

    std::size_t width_, count_;
};

}  // namespace cdrj

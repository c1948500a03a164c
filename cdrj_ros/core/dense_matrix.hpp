// Small matrices whose size is known when the program runs.
#pragma once

#include <algorithm>
#include <cstddef>
#include <span>
#include <vector>

namespace cdrj {

/// A matrix of numbers, by rows.
class DenseMatrix {
public:
    DenseMatrix() = default;
    DenseMatrix(std::size_t rows, std::size_t columns)
        : columns_(columns), numbers_(rows * columns, 0.0) {}

    double& operator()(std::size_t row, std::size_t column) {
        return numbers_[row * columns_ + column];
    }
    double operator()(std::size_t row, std::size_t column) const {
        return numbers_[row * columns_ + column];
    }
    std::span<const double> row(std::size_t row) const {
        return std::span(numbers_).subspan(row * columns_, columns_);
    }

    std::size_t rows() const { return columns_ == 0 ? 0 : numbers_.size() / columns_; }
    std::size_t columns() const { return columns_; }
    std::span<double> numbers() { return numbers_; }
    void fill(double number) { std::ranges::fill(numbers_, number); }

private:
    std::size_t columns_ = 0;
    std::vector<double> numbers_;
};

}  // namespace cdrj

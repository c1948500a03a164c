// Small matrices whose size is known when the program runs, and normal equations of least squares.
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

/// Invert a symmetric positive definite matrix by Cholesky's method; `matrix` is destroyed.
void invert(DenseMatrix& matrix, DenseMatrix& inverse);

/// `matrix` times change = `right`, of n unknowns.
struct NormalEquations {
    explicit NormalEquations(std::size_t unknowns)
        : matrix(unknowns, unknowns), inverse(unknowns, unknowns), right(unknowns, 0.0) {}

    /// Begin without any equation.
    void clear();

    /// Add the equation slope times change = difference.
    void weigh(std::span<const double> slope, double difference, double weight);

    /// Write `inverse`; `matrix` is destroyed.
    void invert() { cdrj::invert(matrix, inverse); }

    /// Change of an unknown, after `invert`.
    double change(std::size_t unknown) const;

    DenseMatrix matrix;         // shape (n, n)
    DenseMatrix inverse;        // shape (n, n)
    std::vector<double> right;  // n numbers
};

}  // namespace cdrj

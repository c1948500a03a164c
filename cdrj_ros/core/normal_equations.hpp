// Small matrices whose size is known when the program runs, and normal equations of least squares.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

namespace cdrj {

/// A matrix of numbers, by rows.
class DenseMatrix {
public:
    DenseMatrix(std::size_t rows, std::size_t columns)
        : columns_(columns), numbers_(rows * columns, 0.0) {}

    double& operator()(std::size_t row, std::size_t column) {
        return numbers_[row * columns_ + column];
    }
    double operator()(std::size_t row, std::size_t column) const {
        return numbers_[row * columns_ + column];
    }
    std::span<double> row(std::size_t row) {
        return std::span(numbers_).subspan(row * columns_, columns_);
    }
    std::span<const double> row(std::size_t row) const {
        return std::span(numbers_).subspan(row * columns_, columns_);
    }

    std::span<double> numbers() { return numbers_; }
    std::span<const double> numbers() const { return numbers_; }
    std::size_t rows() const { return columns_ == 0 ? 0 : numbers_.size() / columns_; }
    void fill(double number) { std::ranges::fill(numbers_, number); }

private:
    std::size_t columns_ = 0;
    std::vector<double> numbers_;
};

/// Invert a symmetric positive definite matrix by Cholesky's method; `matrix` is destroyed.
inline void invert(DenseMatrix& matrix, DenseMatrix& inverse) {
    const std::size_t n = matrix.rows();
    for (std::size_t i = 0; i < n; ++i) {
        for (std::size_t j = 0; j <= i; ++j) {
            double total = matrix(i, j);
            for (std::size_t k = 0; k < j; ++k) total -= matrix(i, k) * matrix(j, k);
            matrix(i, j) = i == j ? std::sqrt(std::max(total, 1e-300)) : total / matrix(j, j);
        }
    }
    for (std::size_t c = 0; c < n; ++c) {
        for (std::size_t i = 0; i < n; ++i) {
            double total = i == c ? 1.0 : 0.0;
            for (std::size_t k = 0; k < i; ++k) total -= matrix(i, k) * inverse(k, c);
            inverse(i, c) = total / matrix(i, i);
        }
        for (std::size_t i = n; i-- > 0;) {
            double total = inverse(i, c);
            for (std::size_t k = i + 1; k < n; ++k) total -= matrix(k, i) * inverse(k, c);
            inverse(i, c) = total / matrix(i, i);
        }
    }
}

/// `matrix` times change = `right`, of n unknowns.
struct NormalEquations {
    explicit NormalEquations(std::size_t unknowns)
        : matrix(unknowns, unknowns), inverse(unknowns, unknowns), right(unknowns, 0.0) {}

    /// Begin without any equation.
    void clear() {
        matrix.fill(0.0);
        std::ranges::fill(right, 0.0);
    }

    /// Add the equation slope times change = difference.
    void weigh(std::span<const double> slope, double difference, double weight) {
        for (std::size_t a = 0; a < slope.size(); ++a) {
            right[a] += weight * slope[a] * difference;
            for (std::size_t b = 0; b < slope.size(); ++b) matrix(a, b) += weight * slope[a] * slope[b];
        }
    }

    /// Write `inverse`; `matrix` is destroyed.
    void invert() { cdrj::invert(matrix, inverse); }

    /// Change of an unknown, after `invert`.
    double change(std::size_t unknown) const {
        double change = 0.0;
        for (std::size_t b = 0; b < right.size(); ++b) change += inverse(unknown, b) * right[b];
        return change;
    }

    DenseMatrix matrix;         // shape (n, n)
    DenseMatrix inverse;        // shape (n, n)
    std::vector<double> right;  // n numbers
};

}  // namespace cdrj

// Normal equations of a small least-squares problem.
#pragma once

#include <span>
#include <vector>

#include "dense_matrix.hpp"

namespace cdrj {

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

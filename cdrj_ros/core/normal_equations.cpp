#include "normal_equations.hpp"

#include <cmath>

namespace cdrj {

void invert(DenseMatrix& matrix, DenseMatrix& inverse) {
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

void NormalEquations::clear() {
    matrix.fill(0.0);
    std::ranges::fill(right, 0.0);
}

void NormalEquations::weigh(std::span<const double> slope, double difference, double weight) {
    for (std::size_t a = 0; a < slope.size(); ++a) {
        right[a] += weight * slope[a] * difference;
        for (std::size_t b = 0; b < slope.size(); ++b) matrix(a, b) += weight * slope[a] * slope[b];
    }
}

double NormalEquations::change(std::size_t unknown) const {
    double change = 0.0;
    for (std::size_t b = 0; b < right.size(); ++b) change += inverse(unknown, b) * right[b];
    return change;
}

}  // namespace cdrj

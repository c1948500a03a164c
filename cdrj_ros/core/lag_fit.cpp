#include "lag_fit.hpp"

#include <algorithm>
#include <cmath>

#include "records.hpp"

namespace cdrj {
namespace {

/// Terms of a lagging axis: its lag, and what a load on it does by the pose, its square, the acceleration.
constexpr std::size_t PER_AXIS = 4;

/// Further terms: a constant, and friction.
constexpr std::size_t FURTHER = 2;

/// Residuals closer together than this are alike, and count once [s].
constexpr double ALIKE = 0.1;

/// Time constant with which a motion at full speed is forgotten [s], that of (C2).
constexpr double MEMORY = 10.0;

/// Friction has reversed once the first axis has moved by what changes a tension by this share.
constexpr double REVERSED = 0.1;

/// Standard deviation of a residual before any has been seen, by the tension, and how many it counts for.
constexpr double FIRST_RESIDUAL = 0.02, FIRST_COUNT = 5.0;

/// The first mean tension, by which both are taken, counts as this at least [N].
constexpr double LEAST_TENSION = 0.1;

/// Lags are never known better than stamps tell [s].
constexpr double LEAST_LAG = 1e-9;

/// Smallest eigenvalue of the scaled normal matrix, against rounding errors.
constexpr double RIDGE = 1e-9;

}  // namespace

template <typename Number>
struct LagFit::Parts {
    std::span<Number> normal;      // matrix of the normal equations, by rows
    std::span<Number> right;       // their right side
    std::span<Number> estimate;    // of all terms
    std::span<Number> covariance;  // of the lags, by rows [s^2]
    std::span<Number> fastest;     // gain times velocity of every lagging axis, where their sum was largest
    Number& tension;   // mean tension at first [N]; 0 before that
    Number& friction;  // direction of the friction, -1 to 1
    Number& place;     // of the first axis at the last stretch, worth in tension [N]
    Number& squares;   // weighted sum of the squares of what is fitted [N^2]
    Number& weight;    // sum of all weights
    Number& noise;     // standard deviation of a residual [N]

    Parts(std::span<Number> memory, std::size_t terms, std::size_t lags)
        : normal(memory.subspan(0, terms * terms)),
          right(memory.subspan(terms * terms, terms)),
          estimate(memory.subspan(terms * (terms + 1), terms)),
          covariance(memory.subspan(terms * (terms + 2), lags * lags)),
          fastest(memory.subspan(terms * (terms + 2) + lags * lags, lags)),
          tension(memory[memory.size() - 6]),
          friction(memory[memory.size() - 5]),
          place(memory[memory.size() - 4]),
          squares(memory[memory.size() - 3]),
          weight(memory[memory.size() - 2]),
          noise(memory[memory.size() - 1]) {}
};

LagFit::LagFit(std::span<const double> gains) {
    for (std::size_t a = 0; a < gains.size(); ++a) {
        if (!(gains[a] > 0.0)) continue;
        axes_.push_back(a);
        gains_.push_back(gains[a]);
    }
    lags_ = axes_.empty() ? 0 : axes_.size() - 1;
    terms_ = PER_AXIS * lags_ + FURTHER;
}

std::size_t LagFit::size() const {
    return terms_ * (terms_ + 2) + lags_ * (lags_ + 1) + 6;
}

void LagFit::take(
    std::span<double> memory, const Stretch& stretch, std::span<const double> lag_stddev) const {
    if (lags_ == 0) return;
    Parts<double> parts(memory, terms_, lags_);
    std::vector<double> row(terms_);
    double speed = 0.0, fastest = 0.0;
    for (std::size_t k = 0; k < lags_; ++k) {
        row[k] = gains_[k + 1] * stretch.velocity[axes_[k + 1]];
        speed += std::abs(row[k]);
        fastest += std::abs(parts.fastest[k]);
    }
    if (speed > fastest) {
        std::copy_n(row.begin(), lags_, parts.fastest.begin());
        fastest = speed;
    }
    const double place = gains_[0] * stretch.angle[axes_[0]];
    if (parts.tension == 0.0) {
        parts.tension = std::max(stretch.mean_tension, LEAST_TENSION);
        parts.noise = FIRST_RESIDUAL * parts.tension;
        parts.place = place;
    }
    const double moved = (place - parts.place) / (REVERSED * parts.tension);
    parts.friction = std::clamp(parts.friction + moved, -1.0, 1.0);
    parts.place = place;
    for (std::size_t k = 0; k < lags_; ++k) {
        const double pose = gains_[k + 1] * stretch.angle[axes_[k + 1]];
        row[lags_ + 3 * k] = pose;
        row[lags_ + 3 * k + 1] = pose * pose;
        row[lags_ + 3 * k + 2] = gains_[k + 1] * stretch.acceleration[axes_[k + 1]];
    }
    row[terms_ - 2] = 1.0;
    row[terms_ - 1] = parts.friction;

    const double seen = stretch.mean_tension - parts.tension;
    const double share = fastest > 0.0 ? speed / fastest : 0.0;  // what is seen at rest says little
    const double kept = std::exp(-stretch.length / MEMORY * share);
    const double weight = share * stretch.length / ALIKE;
    for (std::size_t i = 0; i < terms_; ++i) {
        for (std::size_t j = 0; j < terms_; ++j) {
            double& one = parts.normal[i * terms_ + j];
            one = kept * one + weight * row[i] * row[j];
        }
        parts.right[i] = kept * parts.right[i] + weight * row[i] * seen;
    }
    parts.squares = kept * parts.squares + weight * seen * seen;
    parts.weight = kept * parts.weight + weight;
    solve(memory, lag_stddev);

    double left = parts.squares, residual = seen;
    for (std::size_t i = 0; i < terms_; ++i) {
        left -= 2.0 * parts.estimate[i] * parts.right[i];
        residual -= parts.estimate[i] * row[i];
        for (std::size_t j = 0; j < terms_; ++j) {
            left += parts.estimate[i] * parts.normal[i * terms_ + j] * parts.estimate[j];
        }
    }
    const double first = FIRST_RESIDUAL * parts.tension;
    const double mean = (std::max(left, 0.0) + FIRST_COUNT * first * first) / (parts.weight + FIRST_COUNT);
    parts.noise = std::max(std::sqrt(mean), DEVIATION * std::abs(residual));
}

/// Solves the normal equations with the lags' standard deviations, by Cholesky's decomposition of the
/// scaled matrix.
void LagFit::solve(std::span<double> memory, std::span<const double> lag_stddev) const {
    Parts<double> parts(memory, terms_, lags_);
    const std::size_t n = terms_;
    const double noise = parts.noise;
    std::vector<double> scale(n), lower(n * n), column(n);
    const auto precision = [&](std::size_t i, std::size_t j) {
        double one = parts.normal[i * n + j] / (noise * noise);
        if (i == j && i < lags_) one += 1.0 / prior(lag_stddev, i);
        return one;
    };
    for (std::size_t i = 0; i < n; ++i) {
        const double diagonal = precision(i, i);
        scale[i] = diagonal > 0.0 ? 1.0 / std::sqrt(diagonal) : 1.0;
    }
    for (std::size_t i = 0; i < n; ++i) {
        for (std::size_t j = 0; j <= i; ++j) {
            double sum = scale[i] * scale[j] * precision(i, j) + (i == j ? RIDGE : 0.0);
            for (std::size_t k = 0; k < j; ++k) sum -= lower[i * n + k] * lower[j * n + k];
            lower[i * n + j] = i == j ? std::sqrt(std::max(sum, RIDGE)) : sum / lower[j * n + j];
        }
    }
    const auto solved = [&](std::span<double> x) {
        for (std::size_t i = 0; i < n; ++i) {
            for (std::size_t k = 0; k < i; ++k) x[i] -= lower[i * n + k] * x[k];
            x[i] /= lower[i * n + i];
        }
        for (std::size_t i = n; i-- > 0;) {
            for (std::size_t k = i + 1; k < n; ++k) x[i] -= lower[k * n + i] * x[k];
            x[i] /= lower[i * n + i];
        }
    };
    for (std::size_t i = 0; i < n; ++i) {
        parts.estimate[i] = scale[i] * parts.right[i] / (noise * noise);
    }
    solved(parts.estimate);
    for (std::size_t i = 0; i < n; ++i) parts.estimate[i] *= scale[i];
    for (std::size_t k = 0; k < lags_; ++k) {
        std::fill(column.begin(), column.end(), 0.0);
        column[k] = scale[k];
        solved(column);
        for (std::size_t i = 0; i < lags_; ++i) {
            parts.covariance[i * lags_ + k] = scale[i] * column[i];
        }
    }
}

double LagFit::share(std::span<const double> memory, std::span<const double> lag_stddev) const {
    if (lags_ == 0) return 1.0;
    const Parts<const double> parts(memory, terms_, lags_);
    double mean = 0.0, spread = 0.0, open = 0.0;
    for (std::size_t i = 0; i < lags_; ++i) {
        mean += std::abs(parts.fastest[i] * parts.estimate[i]);  // other signs may follow
        open += parts.fastest[i] * parts.fastest[i] * prior(lag_stddev, i);
        for (std::size_t j = 0; j < lags_; ++j) {
            spread += parts.fastest[i] * parts.covariance[i * lags_ + j] * parts.fastest[j];
        }
    }
    const double found = mean * mean + spread + parts.noise * parts.noise;
    if (open > found) return found / open;
    return open > 0.0 ? std::max(mean * mean / open, 1.0) : 1.0;
}

/// Variance of a lag behind the first axis if the stretches showed nothing [s^2].
double LagFit::prior(std::span<const double> lag_stddev, std::size_t k) const {
    const double own = lag_stddev[axes_[k + 1]], first = lag_stddev[axes_[0]];
    return own * own + first * first + LEAST_LAG * LEAST_LAG;
}

LagFit::Lag LagFit::lag(std::span<const double> memory, std::size_t axis) const {
    const auto found = std::find(axes_.begin(), axes_.end(), axis);
    if (lags_ == 0 || found == axes_.begin() || found == axes_.end()) return {0.0, INFINITE};
    const Parts<const double> parts(memory, terms_, lags_);
    const auto k = static_cast<std::size_t>(found - axes_.begin()) - 1;
    if (parts.tension == 0.0) return {0.0, INFINITE};
    return {parts.estimate[k], std::sqrt(parts.covariance[k * lags_ + k])};
}

}  // namespace cdrj

#include "residual.hpp"

#include <algorithm>
#include <cmath>

namespace cdrj {
namespace {

/// What keeps the sign of a motion while there has been no time since; without effect otherwise.
constexpr double SIGN = 1e-9;

}  // namespace

ResidualAxis followed(const ResidualAxis* before, double place, double dt) {
    ResidualAxis axis{place, {}, 0.0};
    if (before == nullptr) return axis;
    const double moved = place - before->place;
    for (std::size_t k = 0; k < STOPS.size(); ++k) {
        axis.stop[k] = std::clamp(before->stop[k] + moved / STOPS[k], -1.0, 1.0);
    }
    if (moved != 0.0) {
        axis.motion = std::copysign(SIGN, moved);
    } else if (before->motion != 0.0) {  // otherwise it has not moved yet
        const double rest = std::abs(before->motion) + dt / LONGEST_REST;
        axis.motion = std::copysign(std::min(rest, 1.0), before->motion);
    }
    return axis;
}

void write_products(double load, std::span<const ResidualAxis> axes, std::span<double> products) {
    double* next = products.data();
    const auto write_row = [&](double row) {
        *next++ = row;
        *next++ = row * load;
        for (const ResidualAxis& axis : axes) *next++ = row * axis.place;
    };
    write_row(load);
    for (const ResidualAxis& axis : axes) {
        write_row(axis.place);
        for (const double stop : axis.stop) write_row(stop);
        write_row(axis.motion);
    }
}

double trust_in(double load, std::span<const ResidualAxis> axes) {
    double farthest = std::abs(load);
    for (const ResidualAxis& axis : axes) farthest = std::max(farthest, std::abs(axis.place));
    return std::clamp(1.0 - (farthest - 1.0) / FADED, 0.0, 1.0);
}

void correct_outputs(const Step& step, double dt, bool solved, double* values) {
    const auto& [topology, constants, before, after, estimate, work] = step;
    const bool started = *before.started != 0.0;
    for (Index r = 0; r < topology.sizes.residuals; ++r) {
        const auto [column, cable, first, axes, first_weight] = topology.residuals[r];
        const ResidualConstants& own = constants.residuals[r];
        for (Index k = first; k < first + axes; ++k) {
            const double place =
                place_in(constants.residual_ranges[k], after.angle[topology.residual_axes[k].axis]);
            after.residual_axes[k] =
                followed(started ? &before.residual_axes[k] : nullptr, place, dt);
        }
        estimate.correction[r] = estimate.trust[r] = 0.0;
        if (!solved || own.bound == 0.0) continue;
        double& value = values[column];
        const double load = place_in({own.load_lower, own.load_upper}, value);
        const std::span<const ResidualAxis> seen = after.residual_axes.subspan(first, axes);
        estimate.trust[r] = trust_in(load, seen);
        if (estimate.trust[r] == 0.0) continue;
        const std::size_t size = residual_rows(axes) * residual_columns(axes);
        const std::span<double> products = work.products.subspan(first_weight, size);
        write_products(load, seen, products);
        double sum = 0.0;
        for (std::size_t k = 0; k < size; ++k) {
            sum += constants.residual_weights[first_weight + k] * products[k];
        }
        double corrected = value + estimate.trust[r] * std::clamp(sum, -own.bound, own.bound);
        if (cable >= 0) {  // the tension of its element `column`
            corrected = std::max(corrected, 0.0);
            set_load(estimate.status[column], corrected, constants.cables[cable]);
        }
        estimate.correction[r] = corrected - value;
        value = corrected;
    }
}

}  // namespace cdrj

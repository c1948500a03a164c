// Standard deviations of an ensemble, from its members' deviations and from what no member shows.
// docs/estimation.md.
#include <algorithm>
#include <cmath>
#include <utility>

#include "ensemble.hpp"

namespace cdrj {
/// Compare all quantities of the member in turn.
void Ensemble::compare(
    Nanoseconds stamp, std::span<const double> own, std::span<const double> nominal) {
    const Index member = next_member();
    const auto count = static_cast<double>(members());
    for (std::size_t q = 0; q < quantities.size(); ++q) {
        const UncertainOutput& one = quantities[q];
        if (is_invalid(nominal, one) || is_invalid(own, one)) continue;
        double& deviation = memory.deviation[member * std::ssize(quantities) + q];
        double now = own[one.index] - nominal[one.index];
        if (one.residual >= 0) now += nominal[first_.correction + one.residual];
        memory.variance[q] += (now * now - deviation * deviation) / count;
        deviation = now;
    }
    ++memory.progress.updates;
    memory.progress.last_update = stamp;
    if (member + 1 < members()) return;
    for (std::size_t q = 0; q < quantities.size(); ++q) renew_variance(q);
}

/// Compare the quantities of one cable of a member that `step` holds; the efforts follow from the tensions.
void Ensemble::compare_cable(const Step& step, Index member, Index c) {
    const auto& [topology, constants, before, after, estimate, work] = step;
    const auto own = std::span<const double>(out_).subspan(robot_.state_size(), estimate_.size());
    if (is_invalid(own, c) || is_invalid(estimate_, c)) return;
    double* const deviation = memory.deviation.data() + member * std::ssize(quantities);
    const auto compared = [&](Index q) {
        const auto& [index, cable, axis, residual, unmodelled, slack] = quantities[q];
        const double now = own[index] - estimate_[index] +
                           (residual >= 0 ? estimate_[first_.correction + residual] : 0.0);
        return now - std::exchange(deviation[q], now);
    };
    const Index motors = topology.sizes.motors;
    const auto [first, beyond] = tensions_of(c);
    for (Index q = first; q < beyond; ++q) {
        const double change = compared(q);
        for (const Index j : topology.paths->of_cable[c].joints) {
            const double sign = constants.axes[motors + j].effort_sign;
            deviation[effort_of(motors + j)] -= sign * work.lever_arm(q, j) * change;
        }
        for (const Index end : {Index{0}, Index{1}}) {
            if (q != (end == 0 ? first : beyond - 1)) continue;
            const auto [first_turn, beyond_turns] = topology.turns_of(2 * c + end);
            for (Index t = first_turn; t < beyond_turns; ++t) {
                const Index motor = topology.turns[t].motor;
                const double sign = constants.axes[motor].effort_sign;
                deviation[effort_of(motor)] -= sign * motor_arm(step, c, end, t) * change;
            }
        }
    }
    const auto [force, after_forces] = forces_of(c);
    for (Index q = force; q < after_forces; ++q) compared(q);
}

/// Compute a variance (U1) from all deviations, so that rounding errors do not accumulate.
void Ensemble::renew_variance(Index q) {
    double total = 0.0;
    for (Index k = 0; k < members(); ++k) {
        const double deviation = memory.deviation[k * std::ssize(quantities) + q];
        total += deviation * deviation;
    }
    memory.variance[q] = total / static_cast<double>(members());
}

/// Change of every cable's mean tension by every axis [N/rad], by rows: that of its elements.
std::vector<double> Ensemble::gains_of_cables() const {
    const auto axes = static_cast<std::size_t>(robot_.topology.sizes.axes());
    std::vector<double> found(axes * static_cast<std::size_t>(cables()));
    for (Index c = 0; c < cables(); ++c) {
        for (const auto& [axis, gain] : draws.gains[tensions_of(c).first]) found[c * axes + axis] = gain;
    }
    return found;
}

/// Note the mean tensions of all cables, beyond what unread motion may change in them: they bound what
/// lags and units are worth, (U13), (C15), and their sudden changes are doubted, (C16).
void Ensemble::bound_errors() {
    for (Index c = 0; c < cables(); ++c) {
        const auto [first, beyond] = tensions_of(c);
        unread_[c] = 0.0;
        for (const auto& [axis, gain] : draws.gains[first]) unread_[c] += BOUNDS * gain * unseen_[axis];
        if (memory.unsolved[c] >= UNREAD_AXIS) unread_[c] = INFINITE;
        if (memory.unsolved[c] != SOLVED) continue;
        double& mean = mean_tensions_[c] = 0.0;
        for (Index e = first; e < beyond; ++e) mean += draws.length_share[e] * estimate_[e];
    }
    if (lags.take(memory.progress.last_stamp, angle_, mean_tensions_, unread_)) renew_late();
    if (units.take(memory.progress.last_stamp, angle_, mean_tensions_, unread_)) renew_slipped();
}

void Ensemble::take_offset(std::span<const double> offset) {
    lags.take_offset(offset);
    renew_lasting();
}

void Ensemble::renew_lasting() {
    lags.renew();
    renew_slipped();
    renew_late();
}

/// Compute the variances of offsets, (C9), and of what units may be wrong by, (C15).
void Ensemble::renew_slipped() {
    const std::span<const double> offset = lags.offset();
    for (std::size_t q = 0; q < quantities.size(); ++q) {
        slipped_[q] = 0.0;
        for (const auto& [axis, gain] : draws.gains[q]) {
            slipped_[q] += gain * offset[axis] * (gain * offset[axis]);
            slipped_[q] += gain * units.errors[axis] * (gain * units.errors[axis]);
        }
    }
}

/// Compute the variances of lags with the greatest speeds so far, (C10).
void Ensemble::renew_late() {
    for (std::size_t q = 0; q < quantities.size(); ++q) {
        late_[q] = 0.0;
        for (const auto& [axis, gain] : draws.gains[q]) {
            const double part = gain * lags.offset()[axes() + axis] * lags.fastest(axis);
            late_[q] += part * part;
        }
    }
}

std::vector<double> Ensemble::late() const {
    std::vector<double> found(quantities.size());
    for (std::size_t q = 0; q < found.size(); ++q) {
        const Index c = quantities[q].cable;
        if (c >= 0) found[q] = late_[q] * lags.late_share(c);
    }
    return found;
}

void Ensemble::write_stddev(std::span<const double> nominal, std::span<double> stddev) const {
    for (std::size_t q = 0; q < quantities.size(); ++q) {
        const double slack = quantities[q].slack;
        double total = std::max(shown(q, nominal) + hidden(q), memory.least_variance[q]);
        if (std::abs(nominal[quantities[q].index]) <= slack) total = std::max(total, slack * slack);
        stddev[q] = std::sqrt(total);
    }
}

/// Doubts tensions while the mean of their cable has changed suddenly, (C16).
void Ensemble::doubt_changes(std::span<double> estimate, std::span<const double> stddev) {
    const Nanoseconds now = memory.progress.last_stamp;
    for (std::size_t e = 0; e < memory.sudden_stamps.size(); ++e) {
        const Index q = first_.tension_quantity + static_cast<Index>(e);
        Nanoseconds& changed = memory.sudden_stamps[e];
        if (!kept_ && lags.sudden(quantities[q].cable) > SUDDEN * stddev[q]) changed = now;
        if (0 <= changed && changed <= now && now - changed <= SUDDEN_NS) {
            doubt(estimate[first_.status + e]);
        }
    }
}

/// Variance of a quantity, but for what is small between readings and for slack cables.
double Ensemble::shown(Index q, std::span<const double> nominal) const {
    const auto& [index, cable, axis, residual, unmodelled, slack] = quantities[q];
    double late = cable < 0 ? 0.0 : lags.late_share(cable);
    if (cable < 0) {
        for (const Index c : robot_.topology.paths->cables_of_axis[axis]) {
            late = std::max(late, lags.late_share(c));
        }
    }
    double total = std::max(memory.variance[q], 0.0) + unmodelled;
    total += slipped_[q] + late_[q] * late;  // (U12), (U13)
    if (residual >= 0) {  // (U14)
        const double more = robot_.constants.residuals[residual].variance - unmodelled;
        total += more > 0.0 ? more : more * nominal[first_.trust + residual];
    }
    return total;
}

/// Variance of what is small between readings (U17), which members do not show.
double Ensemble::hidden(Index q) const {
    const UncertainOutput& one = quantities[q];
    if (!any_small_ || (one.cable >= 0 && walked_[one.cable] != 0)) return 0.0;
    double total = 0.0;
    for (const auto& [axis, gain] : draws.gains[q]) {
        if (one.cable >= 0 || walked_axis_[axis] == 0) total += gain * gain * small_[axis];
    }
    return total;
}

/// Whether a cable that a quantity depends on is INVALID in an estimate.
bool Ensemble::is_invalid(std::span<const double> estimate, const UncertainOutput& quantity) const {
    if (quantity.cable >= 0) return is_invalid(estimate, quantity.cable);
    const auto& own = robot_.topology.paths->cables_of_axis[quantity.axis];
    return std::ranges::any_of(own, [&](Index c) { return is_invalid(estimate, c); });
}

bool Ensemble::is_invalid(std::span<const double> estimate, Index cable) const {
    const double status = estimate[first_.status + robot_.topology.cables[cable].first_element];
    return (static_cast<int>(status) & INVALID) != 0;
}

/// The quantities that are tensions of a cable: the first, and the one after the last.
std::pair<Index, Index> Ensemble::tensions_of(Index c) const {
    const CableTopology& cable = robot_.topology.cables[c];
    const Index first = first_.tension_quantity + cable.first_element;
    return {first, first + cable.elements};
}

/// Those that are forces of a cable on its pulleys.
std::pair<Index, Index> Ensemble::forces_of(Index c) const {
    const CableTopology& cable = robot_.topology.cables[c];
    const Index first = first_.force_quantity + cable.first_pulley;
    return {first, first + cable.pulleys};
}

/// The quantity that is the effort of an axis.
Index Ensemble::effort_of(Index axis) const { return first_.effort_quantity + axis; }

}  // namespace cdrj

#include "cable.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "friction.hpp"

namespace cdrj {
namespace {

/// Iterations from one first guess; a solution usually takes two to five.
constexpr int MOST_ITERATIONS = 20;

/// Iterations after which all contacts are balanced alone where a step has brought little.
constexpr int PATIENCE = 5;

/// Evaluations along one step, and of one contact that is balanced alone.
constexpr int MOST_TRIALS = 60;

/// A Newton step may not shorten a segment below this share of its material.
constexpr double SMALLEST_SHRINK = 0.25;

/// Stiffness beside a slack segment in the matrix, as a share of that of the next segment if it were taut.
constexpr double LEAST = 1e-9;

/// A step is good that passes the balance along itself by at most this share of the imbalance along it.
constexpr double OVER = 0.1;

/// It has brought enough where at most this share of the imbalance is left.
constexpr double LEFT = 0.5;

/// Factors of the bristles' stiffness with which a difficult sample is solved one after another (E23).
///
/// Where a long cable begins to slip on thousands of pulleys at once, Newton's method finds a few of
/// them per iteration. Soft bristles spread the transition from slip to stick over many pulleys, so
/// that a few iterations find it, and stiffening them narrows it.
constexpr std::array<double, 4> HARDNESS{1e-6, 1e-4, 1e-2, 1.0};

/// Friction of a contact [N], its derivative by the slip [N/m] and by the pull side's tension [-].
struct ContactFriction {
    double force, by_slip, by_pull;
};

Bristles bristles_of(const Contact& contact, double hardness) {
    return {
        contact.bristle_before, contact.stiffness * hardness, contact.bound, contact.breakaway};
}

/// Flux with which the bristles of a contact carry no force, about [m].
double flux_at_rest(const Contact& contact, double hardness) {
    const double kept = std::clamp(contact.bristle_before, -contact.bound, contact.bound);
    return -kept / (contact.stiffness * hardness) - contact.shift;
}

/// Friction of a contact after a slip [m]; bristle force and bound are written.
ContactFriction contact_friction(
    Contact& contact, double hardness, double slip, double pull, Law law, double dt) {
    contact.bound = contact.loss * pull + contact.drag + BOUND_FLOOR;
    const double before = contact.bristle_before;
    const Friction bristle = bristle_force(law, bristles_of(contact, hardness), slip);
    contact.bristle = bristle.force;
    double force = bristle.force, by_slip = bristle.by_slip;
    double by_pull = bristle.by_bound * contact.loss;
    if (dt > 0.0) {
        if (contact.damping != 0.0) {
            // sigma1 dz/dt; sigma1 fades with speed: with a constant one LuGre is not passive
            const double rate =
                contact.damping * contact.static_share / (contact.stiffness * dt);
            force += rate * (force - before);
            by_slip *= 1.0 + rate;
            by_pull *= 1.0 + rate;
        }
        const double viscous = contact.viscous / dt;
        force += viscous * slip;
        by_slip += viscous;
    }
    return {force, by_slip, by_pull};
}

/// -dt / dl of a segment [N/m]; 0 where it is slack.
inline double segment_stiffness(const Elasticity& elastic, const Segment& segment) {
    if (!(segment.tension > 0.0)) return 0.0;
    double modulus = elastic.axial_stiffness;
    if (elastic.bedding_strain != 0.0) modulus = modulus_at(elastic, segment.tension);
    return modulus * (segment.length / segment.material) / segment.material;
}

/// Derivatives of a residual by the fluxes of the contact before, this one and the next [N/m].
struct MatrixRow {
    double lower, diagonal, upper;
};

/// A row of the Newton matrix.
///
/// The bound of friction depends on the tension on the pull side, so its derivative also adds to the
/// column of a neighbouring contact. `k_left`, `k_right`: stiffness of the segments before and after
/// the contact [N/m]; `pulled_after`: whether the segment after it is on the pull side; `least`
/// keeps the system regular, in the matrix, not in the residual, where taut segments between slack ones
/// slide: friction at its bound has no slope.
MatrixRow matrix_row(
    const Contact& contact, double k_left, double k_right, bool pulled_after, double least) {
    MatrixRow row{k_left, -(k_left + k_right) - contact.by_slip - least, k_right};
    if (pulled_after) {
        row.diagonal += contact.by_pull * k_right;
        row.upper -= contact.by_pull * k_right;
    } else {
        row.diagonal -= contact.by_pull * k_left;
        row.lower += contact.by_pull * k_left;
    }
    return row;
}

/// Limit the fraction of a step so that a segment keeps some of its material [m].
///
/// `change` is that of the material by the whole step [m].
double shortened(double share, double change, double material) {
    const double most = (SMALLEST_SHRINK - 1.0) * material;
    return change < most ? std::min(share, most / change) : share;
}

/// Solve the tridiagonal system J step = -residual (Thomas), O(n).
///
/// Returns the fraction in (0, 1] of the step that leaves every segment some material.
double newton_step(const Cable& cable) {
    const auto& [elastic, law, first_flux, last_flux, dt, segments, contacts, hardness] = cable;
    const std::size_t n = contacts.size();
    double k_left = segment_stiffness(elastic, segments[0]);
    double upper_before = 0.0, step_before = 0.0;
    for (std::size_t i = 0; i < n; ++i) {
        const Segment& segment = segments[i + 1];
        Contact& contact = contacts[i];
        const double k_right = segment_stiffness(elastic, segment);
        const bool pulled_after = segment.tension >= segments[i].tension;
        // between slack segments a contact depends on no other: `settle` balances it
        if (k_left == 0.0 && k_right == 0.0) contact.residual = 0.0;
        const bool free = k_left == 0.0 || k_right == 0.0;
        const double least = free ? LEAST * elastic.axial_stiffness / segment.material : 0.0;
        const auto [lower, diagonal, upper] =
            matrix_row(contact, k_left, k_right, pulled_after, least);
        const double scale = 1.0 / (diagonal - lower * upper_before);
        step_before = (-contact.residual - lower * step_before) * scale;
        upper_before = upper * scale;
        contact.upper = upper_before;
        contact.step = step_before;
        k_left = k_right;
    }
    double share = 1.0, after = 0.0;
    for (std::size_t i = n; i-- > 0;) {
        double step = contacts[i].step;
        if (i + 1 < n) step -= contacts[i].upper * after;
        contacts[i].step = step;
        share = shortened(share, step - after, segments[i + 1].material);
        after = step;
    }
    return shortened(share, -after, segments[0].material);
}

/// Write flux + share * step into `trial`, or less where the law shortens the step.
void try_step(std::span<Contact> contacts, double hardness, Law law, double share) {
    for (Contact& contact : contacts) {
        const double shift = contact.shift;
        contact.trial = contact.flux + share * contact.step;
        double next_slip = contact.trial + shift;
        if (shorten_slip(law, bristles_of(contact, hardness), contact.flux + shift, next_slip)) {
            contact.trial = next_slip - shift;
        }
    }
}

/// Imbalance along the step of Newton's method [W per unit of it]; 0 at the best share of the step.
double along_step(std::span<const Contact> contacts) {
    double sum = 0.0;
    for (const Contact& contact : contacts) sum += contact.residual * contact.step;
    return sum;
}

/// Where an imbalance that falls from positive to negative is 0.
struct Bracket {
    double low, high;    // it is positive at one, negative at the other
    double above, below; // the imbalance there; infinite where it is unknown
    bool halve = false;

    void take(double at, double imbalance) {
        (imbalance > 0.0 ? low : high) = at;
        (imbalance > 0.0 ? above : below) = imbalance;
    }

    /// The next place to try: on the line between both ends and midway in turn.
    double next() {
        const double line = low + (high - low) * (above / (above - below));
        halve = !halve;
        return halve && line > low && line < high ? line : 0.5 * (low + high);
    }
};

/// Fluxes that scale the stretch L / l of every segment by one factor, which fits the material.
///
/// A start from the previous fluxes instead can shrink short segments to zero length.
void predict(Cable& cable) {
    double kept = 0.0, total = cable.first_flux - cable.last_flux;
    for (const Segment& segment : cable.segments) {
        kept += segment.material_before * (segment.length / segment.length_before);
        total += segment.material_before;
    }
    const double scale = total / kept;
    double passing = cable.first_flux;
    for (std::size_t i = 0; i < cable.contacts.size(); ++i) {
        const Segment& segment = cable.segments[i];
        passing +=
            segment.material_before * (1.0 - segment.length / segment.length_before * scale);
        cable.contacts[i].flux = passing;
    }
}

/// Whether the fluxes leave every segment half of its material.
bool guess_is_usable(const Cable& cable) {
    double incoming = cable.first_flux;
    for (std::size_t e = 0; e < cable.segments.size(); ++e) {
        const double outgoing =
            e < cable.contacts.size() ? cable.contacts[e].flux : cable.last_flux;
        if (incoming - outgoing < -0.5 * cable.segments[e].material_before) return false;
        incoming = outgoing;
    }
    return true;
}

/// Keep every other break point and the last one; returns how many are left.
int thin_out(Drum& drum) {
    const int n = static_cast<int>(drum.points);
    int kept = 0;
    for (int k = 0; k < n - 1; k += 2) {
        drum.angle[kept] = drum.angle[k];
        drum.material[kept] = drum.material[k];
        ++kept;
    }
    drum.angle[kept] = drum.angle[n - 1];
    drum.material[kept] = drum.material[n - 1];
    drum.spacing *= 2.0;
    return kept + 1;
}

}  // namespace

double Cable::balance(std::size_t first, std::size_t beyond) {
    const auto stretched = [&](std::size_t e, double entering, double leaving) {
        Segment& segment = segments[e];
        segment.material = segment.material_before + entering - leaving;
        segment.tension = tension_of(elastic, segment.length, segment.material);
        return segment.tension;
    };
    double worst = 0.0;
    double flux = contacts[first].trial;
    double t_left = stretched(first, first > 0 ? contacts[first - 1].trial : first_flux, flux);
    for (std::size_t i = first; i < beyond; ++i) {
        Contact& contact = contacts[i];
        const double following = i + 1 < contacts.size() ? contacts[i + 1].trial : last_flux;
        const double t_right = stretched(i + 1, flux, following);
        const auto [force, by_slip, by_pull] = contact_friction(
            contact, hardness, flux + contact.shift, std::max(t_left, t_right), law, dt);
        contact.by_slip = by_slip;
        contact.by_pull = by_pull;
        contact.residual = t_right - t_left - force;
        const double imbalance = std::abs(contact.residual);
        if (!(imbalance <= worst)) worst = imbalance;  // true for NaN too
        t_left = t_right;
        flux = following;
    }
    return worst;
}

void Cable::relax(std::size_t i) {
    Contact& contact = contacts[i];
    const Segment &left = segments[i], &right = segments[i + 1];
    const double entering = i > 0 ? contacts[i - 1].trial : first_flux;
    const double leaving = i + 1 < contacts.size() ? contacts[i + 1].trial : last_flux;
    Bracket bracket{
        leaving - right.material_before, entering + left.material_before, INFINITY, -INFINITY};
    const auto balances = [&](double flux) {
        if (!(flux > bracket.low && flux < bracket.high)) return false;
        contact.trial = flux;
        const double imbalance = balance(i, i + 1);
        bracket.take(flux, contact.residual);
        return imbalance <= 0.1 * tolerance(elastic);
    };
    const double left_taut = entering + left.material_before - left.length;
    const double right_taut = leaving + right.length - right.material_before;
    for (const double bend : {contact.trial, flux_at_rest(contact, hardness), left_taut, right_taut}) {
        if (balances(bend)) return;
    }
    for (int trial = 0; trial < MOST_TRIALS; ++trial) {
        if (balances(bracket.next())) return;
    }
}

double Cable::search(double share, double before) {
    const double first = along_step(contacts);
    Bracket bracket{0.0, share, first, 0.0};
    double worst = before;
    for (int trial = 0; trial < MOST_TRIALS; ++trial) {
        try_step(contacts, hardness, law, share);
        worst = balance(0, contacts.size());
        if (worst <= tolerance(elastic) || !(first > 0.0)) break;
        const double now = along_step(contacts);
        if (now >= -OVER * first && (trial == 0 || now <= LEFT * first)) break;
        bracket.take(share, now);
        share = bracket.next();
    }
    return worst;
}

double Cable::settle(bool all) {
    const auto moves = [&](std::size_t i) {
        return all || (!(segments[i].tension > 0.0) && !(segments[i + 1].tension > 0.0));
    };
    for (std::size_t i = 0; i < contacts.size(); ++i) {
        if (moves(i)) relax(i);
    }
    for (std::size_t i = contacts.size(); all && i-- > 0;) relax(i);
    return balance(0, contacts.size());
}

Effort Cable::newton(const Effort& before) {
    for (Contact& contact : contacts) contact.trial = contact.flux;
    double worst = balance(0, contacts.size());
    for (int iteration = 0; iteration < MOST_ITERATIONS; ++iteration) {
        if (worst <= tolerance(elastic)) return {before.iterations + iteration, worst};
        const double before_step = worst;
        worst = search(newton_step(*this), before_step);
        if (!(worst <= LEFT * before_step) && law != Law::none) worst = settle(iteration >= PATIENCE);
        for (Contact& contact : contacts) contact.flux = contact.trial;
    }
    return {before.iterations + MOST_ITERATIONS, worst};
}

Effort Cable::solve() {
    if (contacts.empty()) {
        Segment& only = segments[0];
        only.material = only.material_before + first_flux - last_flux;
        only.tension = tension_of(elastic, only.length, only.material);
        return {0, 0.0};
    }
    Effort effort{0, INFINITY};
    // In steady motion the given guess is better; in all other cases the predictor is.
    if (guess_is_usable(*this)) effort = newton(effort);
    if (effort.imbalance <= tolerance(elastic)) return effort;
    predict(*this);
    effort = newton(effort);
    if (effort.imbalance <= tolerance(elastic)) return effort;
    predict(*this);
    for (const double stage : HARDNESS) {
        hardness = stage;
        effort = newton(effort);
    }
    return effort;
}

double turn_drum(Drum& drum, double angle, double rate) {
    int n = static_cast<int>(drum.points);
    int top = n - 1;
    if (angle >= drum.angle[top]) {
        const double material = drum.material[top] + rate * (angle - drum.angle[top]);
        if (top > 0 && angle - drum.angle[top - 1] <= drum.spacing) {
            drum.angle[top] = angle;
            drum.material[top] = material;
            return material;
        }
        if (n == CAPACITY) n = thin_out(drum);
        drum.angle[n] = angle;
        drum.material[n] = material;
        drum.points = n + 1.0;
        return material;
    }
    while (top > 0 && angle <= drum.angle[top - 1]) --top;
    double material;
    if (top == 0) {
        material = drum.material[0] + drum.rate_below * (angle - drum.angle[0]);
    } else {
        const int below = top - 1;
        const double share = (angle - drum.angle[below]) / (drum.angle[top] - drum.angle[below]);
        material = drum.material[below] + share * (drum.material[top] - drum.material[below]);
    }
    drum.angle[top] = angle;
    drum.material[top] = material;
    drum.points = top + 1.0;
    return material;
}

}  // namespace cdrj

#include "cable.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "friction.hpp"

namespace cdrj {
namespace {

constexpr int MOST_ITERATIONS = 40;

/// A Newton step may not shorten a segment below this share of its material.
constexpr double SMALLEST_SHRINK = 0.25;

constexpr std::int64_t MOST_PIECES = 256;

/// Factors of the bristles' stiffness with which a difficult sample is solved one after another.
constexpr std::array<double, 4> HARDNESS{1e-6, 1e-4, 1e-2, 1.0};

/// Friction of a contact [N], its derivative by the slip [N/m] and by the pull side's tension [-].
struct ContactFriction {
    double force, by_slip, by_pull;
};

Bristles bristles_of(const Contact& contact, double hardness) {
    return {
        contact.bristle_before, contact.stiffness * hardness, contact.bound, contact.breakaway};
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
double segment_stiffness(const Elasticity& elastic, const Segment& segment) {
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
/// the contact [N/m]; `pulled_after`: whether the segment after it is on the pull side; `slack`
/// replaces the stiffness of a slack segment in the matrix, not in the residual: without it a taut
/// segment between slack ones makes the system singular.
MatrixRow matrix_row(
    const Contact& contact, double k_left, double k_right, bool pulled_after, double slack) {
    MatrixRow row{k_left, -(k_left + k_right) - contact.by_slip, k_right};
    if (k_left == 0.0) row.diagonal -= slack;
    if (k_right == 0.0) row.diagonal -= slack;
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
    const auto& [elastic, law, first_flux, last_flux, dt, segments, contacts] = cable;
    const std::size_t n = contacts.size();
    double k_left = segment_stiffness(elastic, segments[0]);
    double upper_before = 0.0, step_before = 0.0;
    for (std::size_t i = 0; i < n; ++i) {
        const Segment& segment = segments[i + 1];
        Contact& contact = contacts[i];
        const double k_right = segment_stiffness(elastic, segment);
        const bool pulled_after = segment.tension >= segments[i].tension;
        const double slack = 1e-3 * elastic.axial_stiffness / segment.material;
        const auto [lower, diagonal, upper] =
            matrix_row(contact, k_left, k_right, pulled_after, slack);
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

/// Solve a sample with soft bristles first, then with harder and harder ones (E23).
///
/// Where a long cable begins to slip on thousands of pulleys at once, Newton's method finds a few of
/// them per iteration. Soft bristles spread the transition from slip to stick over many pulleys, so
/// that a few iterations find it, and stiffening them narrows it.
Effort harden(Cable& cable) {
    Effort effort{0, 0.0};
    predict(cable);
    for (const double hardness : HARDNESS) {
        const auto [count, imbalance] = cable.newton(hardness);
        effort = {effort.iterations + count, imbalance};
    }
    return effort;
}

/// Solve a sample that is too large for one step in equal pieces along the straight path.
///
/// With an imbalance above `acceptable` the remaining pieces were not solved and the fluxes are not
/// those of the sample.
Effort walk(Cable& cable, std::int64_t pieces) {
    const std::vector<Segment> segments(cable.segments.begin(), cable.segments.end());
    const std::vector<Contact> contacts(cable.contacts.begin(), cable.contacts.end());
    std::vector<double> flux(contacts.size(), 0.0);
    const double count_of_pieces = static_cast<double>(pieces);
    Cable piece = cable;
    piece.first_flux = cable.first_flux / count_of_pieces;
    piece.last_flux = cable.last_flux / count_of_pieces;
    piece.dt = cable.dt / count_of_pieces;
    for (Contact& contact : cable.contacts) contact.shift /= count_of_pieces;
    Effort effort{0, 0.0};
    for (std::int64_t k = 0; k < pieces; ++k) {
        const double begin = static_cast<double>(k) / count_of_pieces;
        const double end = static_cast<double>(k + 1) / count_of_pieces;
        for (std::size_t e = 0; e < segments.size(); ++e) {
            const double start = segments[e].length_before, way = segments[e].length - start;
            cable.segments[e].length_before = start + way * begin;
            cable.segments[e].length = start + way * end;
        }
        predict(piece);
        const auto [count, left] = piece.newton(1.0);
        effort.iterations += count;
        if (!(left <= effort.imbalance)) effort.imbalance = left;  // true for NaN too
        if (!(left <= acceptable(cable.elastic))) break;  // leave out the remaining pieces
        for (Segment& segment : cable.segments) segment.material_before = segment.material;
        for (std::size_t i = 0; i < contacts.size(); ++i) {
            flux[i] += cable.contacts[i].flux;
            cable.contacts[i].bristle_before = cable.contacts[i].bristle;
        }
    }
    for (std::size_t e = 0; e < segments.size(); ++e) {
        cable.segments[e].length_before = segments[e].length_before;
        cable.segments[e].length = segments[e].length;
        cable.segments[e].material_before = segments[e].material_before;
    }
    for (std::size_t i = 0; i < contacts.size(); ++i) {
        cable.contacts[i].bristle_before = contacts[i].bristle_before;
        cable.contacts[i].shift = contacts[i].shift;
        cable.contacts[i].flux = flux[i];
    }
    return effort;
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

double Cable::balance(double hardness) {
    const std::size_t n = contacts.size();
    double worst = 0.0;
    double flux = contacts[0].trial;
    double material = segments[0].material_before + first_flux - flux;
    segments[0].material = material;
    double t_left = tension_of(elastic, segments[0].length, material);
    segments[0].tension = t_left;
    for (std::size_t i = 0; i < n; ++i) {
        Segment& right = segments[i + 1];
        Contact& contact = contacts[i];
        const double following = i + 1 < n ? contacts[i + 1].trial : last_flux;
        material = right.material_before + flux - following;
        right.material = material;
        const double t_right = tension_of(elastic, right.length, material);
        right.tension = t_right;
        const auto [force, by_slip, by_pull] = contact_friction(
            contact, hardness, flux + contact.shift, std::max(t_left, t_right), law, dt);
        contact.by_slip = by_slip;
        contact.by_pull = by_pull;
        contact.residual = t_right - t_left - force;
        if (!(std::abs(contact.residual) <= worst)) {  // true for NaN too
            worst = std::abs(contact.residual);
        }
        t_left = t_right;
        flux = following;
    }
    return worst;
}

Effort Cable::newton(double hardness) {
    const double enough = tolerance(elastic);
    for (Contact& contact : contacts) contact.trial = contact.flux;
    double worst = balance(hardness);
    for (int iteration = 0; iteration < MOST_ITERATIONS; ++iteration) {
        if (worst <= enough) return {iteration, worst};
        double share = newton_step(*this);
        const double best = worst;
        for (int halving = 0; halving < 6; ++halving) {
            try_step(contacts, hardness, law, share);
            worst = balance(hardness);
            if (worst < best) break;
            share *= 0.5;
        }
        for (Contact& contact : contacts) contact.flux = contact.trial;
    }
    return {MOST_ITERATIONS, worst};
}

Effort Cable::solve() {
    if (contacts.empty()) {
        Segment& only = segments[0];
        only.material = only.material_before + first_flux - last_flux;
        only.tension = tension_of(elastic, only.length, only.material);
        return {0, 0.0};
    }
    const double enough = tolerance(elastic);
    Effort effort{0, 0.0};
    // In steady motion the given guess is better; in all other cases the predictor is.
    if (guess_is_usable(*this)) {
        effort = newton(1.0);
        if (effort.imbalance <= enough) return effort;
    }
    const auto take = [&effort](const Effort& more) {
        effort = {effort.iterations + more.iterations, more.imbalance};
    };
    predict(*this);
    take(newton(1.0));
    for (std::int64_t pieces = 4; !(effort.imbalance <= enough) && pieces <= MOST_PIECES;
         pieces *= 4) {
        take(walk(*this, pieces));
    }
    if (!(effort.imbalance <= acceptable(elastic))) take(harden(*this));
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

// Histories that are assumed, not computed: friction before the start, and drums that slip.
#include <algorithm>
#include <cmath>
#include <vector>

#include "cable.hpp"
#include "friction.hpp"
#include "laws.hpp"
#include "robot.hpp"

namespace cdrj {
namespace {

/// Newton steps for the common factor of a stiffening cable's tensions; a linear one needs 3.
constexpr int MOST_ROUNDS = 12;

/// Greatest magnitude of any number of a state, in SI units.
constexpr double LARGEST_IN_STATE = 1e9;

}  // namespace

void Robot::impose_friction(std::span<const double> share, double* out) const {
    const Sizes& sizes = topology.sizes;
    State after(sizes, out);
    Workspace work(sizes, out + state_size() + estimate_size());
    for (Index c = 0; c < sizes.cables; ++c) {
        const CableTopology& cable = topology.cables[c];
        if (cable.law == Law::none) continue;
        const Elasticity elastic = elasticity_of(constants.cables[c]);
        const auto [first, beyond] = topology.segments_of(c);
        double total = 0.0, span = 0.0;
        for (Index e = first; e < beyond; ++e) {
            total += after.material[e];
            span += after.length[e];
        }
        const double mean = tension_of(elastic, span, total);
        if (!(mean > 0.0)) continue;
        // compute the ratios of the tensions, then the common factor that keeps the elongation
        double ratio = 1.0;
        work.segments[first].tension = ratio;
        double weighted = after.length[first];
        for (Index p = cable.first_pulley; p < cable.first_pulley + cable.pulleys; ++p) {
            const PulleyTopology& own = topology.pulleys[p];
            for (Index q = own.first_contact; q < own.first_contact + own.cells; ++q) {
                const Contact& contact = work.contacts[q];
                const double hold = 1.0 - contact.loss - contact.drag / (mean + contact.drag);
                ratio *= std::pow(std::max(hold, 1e-3), -share[p]);
                work.segments[q + c + 1].tension = ratio;
                weighted += after.length[q + c + 1] * ratio;
            }
        }
        double scale = mean * span / weighted;
        const int rounds = elastic.bedding_strain == 0.0 ? 3 : MOST_ROUNDS;
        for (int round = 0; round < rounds; ++round) {
            double held = 0.0, slope = 0.0;
            for (Index e = first; e < beyond; ++e) {
                ratio = work.segments[e].tension;
                const double stretch = 1.0 + strain_at(elastic, scale * ratio);
                const double modulus = modulus_at(elastic, scale * ratio);
                held += after.length[e] / stretch;
                slope -= after.length[e] * ratio / (modulus * stretch * stretch);
            }
            scale -= (held - total) / slope;
        }
        for (Index e = first; e < beyond; ++e) {
            ratio = work.segments[e].tension;
            after.material[e] = after.length[e] / (1.0 + strain_at(elastic, scale * ratio));
            if (e > first) {
                after.bristle[e - 1 - c] = scale * (ratio - work.segments[e - 1].tension);
            }
        }
    }
}

void Robot::forget_drums(double* state) const {
    State now(topology.sizes, state);
    for (Index c = 0; c < topology.sizes.cables; ++c) {
        const auto [first, beyond] = topology.segments_of(c);
        for (const Index end : {Index{0}, Index{1}}) {
            const Index number = topology.ends[2 * c + end].drum;
            if (number < 0) continue;
            Drum& drum = now.drums[number];
            const int top = static_cast<int>(drum.points) - 1;
            const double rate = constants.ends[2 * c + end].radius /
                                now.stretch(end == 0 ? first : beyond - 1);
            start_drum(drum, drum.angle[top], drum.material[top], rate);
        }
    }
}

bool Robot::is_state(std::span<const double> numbers) const {
    if (numbers.size() != state_size()) return false;
    for (const double number : numbers) {
        if (!(std::abs(number) <= LARGEST_IN_STATE)) return false;
    }
    std::vector<double> copy(numbers.begin(), numbers.end());
    const State state(topology.sizes, copy.data());
    if (*state.started == 0.0) return true;
    return std::ranges::all_of(state.drums, [](const Drum& drum) {
        return drum.points >= 1.0 && drum.points <= CAPACITY && drum.points == std::floor(drum.points);
    });
}

}  // namespace cdrj

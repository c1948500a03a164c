#include "layout.hpp"

#include <array>
#include <numeric>

namespace cdrj {
namespace {

/// Let a part be the next rows of a flat array of 8-byte words, which then begins after them.
template <typename Word, typename Record>
void take(std::span<Record>& part, Word*& next, Index count) {
    static_assert(sizeof(Record) % sizeof(Word) == 0 && alignof(Record) == alignof(Word));
    part = {reinterpret_cast<Record*>(next), static_cast<std::size_t>(count)};
    next += count * static_cast<Index>(sizeof(Record) / sizeof(Word));
}

template <typename Word, typename Record>
void take(Grid<Record>& part, Word*& next, Index rows, Index width) {
    std::span<Record> whole;
    take(whole, next, rows * width);
    part = {whole.data(), width};
}

/// Lay all parts over an array; returns where the last one ends.
template <typename Whole, typename Word>
Word* lay(Whole& whole, const Sizes& sizes, Word* next) {
    Whole::parts(sizes, [&](const char*, auto member, auto... shape) { take(whole.*member, next, shape...); });
    return next;
}

/// Words of all parts.
template <typename Whole>
std::size_t words_of(const Sizes& sizes) {
    Index words = 0;
    Whole::parts(sizes, [&](const char*, auto member, auto... shape) {
        words += Index{sizeof(decltype(record_of(member))) / 8} * (shape * ...);
    });
    return static_cast<std::size_t>(words);
}

constexpr Index SIZES = sizeof(Sizes) / sizeof(Index);

std::vector<Index> up_to(Index count) {
    std::vector<Index> numbers(count);
    std::iota(numbers.begin(), numbers.end(), Index{0});
    return numbers;
}

Paths paths_of(const Topology& topology) {
    const Sizes& sizes = topology.sizes;
    Paths paths;
    paths.cables_of_axis.resize(sizes.axes());
    paths.all = {up_to(sizes.cables), up_to(sizes.axes()), up_to(sizes.frames)};
    std::vector<std::vector<Index>> carriers;  // of every frame, and itself
    for (Index f = 0; f < sizes.frames; ++f) {
        const auto [parent, motion, joint] = topology.frames[f];
        std::vector<Index> joints, up;
        if (parent >= 0) {
            joints = paths.joints_of_frame[parent];
            up = carriers[parent];
        }
        up.push_back(f);
        if (joint >= 0) join(joints, std::array{joint});
        paths.joints_of_frame.push_back(joints);
        carriers.push_back(up);
    }
    for (Index c = 0; c < sizes.cables; ++c) {
        const CableTopology& cable = topology.cables[c];
        CablePath path;
        for (Index k = 0; cable.routed == Route::positions && k <= cable.elements; ++k) {
            const NodeTopology& node = topology.nodes[cable.first_node + k];
            join(path.frames, carriers[node.frame]);
            join(path.frames, carriers[node.exit_frame]);
        }
        for (const Index f : path.frames) join(path.joints, paths.joints_of_frame[f]);
        for (Index t = 0; t < sizes.terms; ++t) {
            const auto [adds_to_wrap, target, joint] = topology.terms[t];
            const Index first = adds_to_wrap == 0 ? cable.first_element : cable.first_pulley;
            const Index count = adds_to_wrap == 0 ? cable.elements : cable.pulleys;
            if (target < first || target >= first + count) continue;
            path.terms.push_back(t);
            join(path.joints, std::array{joint});
        }
        for (const Index end : {2 * c, 2 * c + 1}) {
            const auto [first, beyond] = topology.turns_of(end);
            for (Index t = first; t < beyond; ++t) {
                join(path.axes, std::array{topology.turns[t].motor});
            }
        }
        for (const Index j : path.joints) path.axes.push_back(sizes.motors + j);
        for (const Index a : path.axes) paths.cables_of_axis[a].push_back(c);
        paths.of_cable.push_back(path);
    }
    return paths;
}

}  // namespace

void join(std::vector<Index>& list, std::span<const Index> more) {
    for (const Index one : more) {
        const auto at = std::ranges::lower_bound(list, one);
        if (at == list.end() || *at != one) list.insert(at, one);
    }
}

CableSet Paths::some(std::span<const bool> chosen) const {
    CableSet found;
    for (std::size_t c = 0; c < chosen.size(); ++c) {
        if (!chosen[c]) continue;
        found.cables.push_back(static_cast<Index>(c));
        join(found.axes, of_cable[c].axes);
        join(found.frames, of_cable[c].frames);
    }
    return found;
}

Topology::Topology(const Index* packed) : sizes(*reinterpret_cast<const Sizes*>(packed)) {
    lay(*this, sizes, packed + SIZES);
    paths = std::make_shared<const Paths>(paths_of(*this));
}

Constants::Constants(const Sizes& sizes, const double* packed) { lay(*this, sizes, packed); }

State::State(const Sizes& sizes, double* state) { lay(*this, sizes, state); }

void State::take_cable(const Topology& topology, Index c, const State& from) const {
    const CableTopology& cable = topology.cables[c];
    const auto take = [](const auto& to, const auto& source, Index first, Index count) {
        std::copy_n(source.begin() + first, count, to.begin() + first);
    };
    const auto [first, beyond] = topology.segments_of(c);
    for (const auto part : {&State::length, &State::material, &State::delayed}) {
        take(this->*part, from.*part, first, beyond - first);
    }
    for (const auto part :
         {&State::bristle, &State::slip_speed, &State::lagged_speed, &State::place}) {
        take(this->*part, from.*part, cable.first_contact, cable.contacts);
    }
    take(track, from.track, cable.first_pulley, cable.pulleys);
    for (Index p = cable.first_pulley; p < cable.first_pulley + cable.pulleys; ++p) {
        const Index surface = topology.pulleys[p].surface;
        if (surface >= 0) covered[surface] = from.covered[surface];
    }
    for (const Index end : {2 * c, 2 * c + 1}) {
        const Index drum = topology.ends[end].drum;
        if (drum >= 0) drums[drum] = from.drums[drum];
    }
    if (!middles.empty()) take(middles, from.middles, cable.first_node, cable.elements + 1);
}

std::size_t State::size(const Sizes& sizes) { return words_of<State>(sizes); }

Estimate::Estimate(const Sizes& sizes, double* estimate) { lay(*this, sizes, estimate); }

std::size_t Estimate::size(const Sizes& sizes) { return words_of<Estimate>(sizes); }

Index first_of(const Sizes& sizes, std::span<double> Estimate::*part, bool among_uncertain) {
    Index first = 0;
    bool is_before = true;
    Estimate::parts(sizes, [&](const char*, auto member, Index count) {
        is_before = is_before && member != part;
        const bool counts = !among_uncertain || std::ranges::find(UNCERTAIN, member) != std::end(UNCERTAIN);
        if (is_before && counts) first += count;
    });
    return first;
}

Workspace::Workspace(const Sizes& sizes, double* scratch) { history = lay(*this, sizes, scratch); }

std::size_t Workspace::size(const Sizes& sizes) {
    return words_of<Workspace>(sizes) + (sizes.surfaces > 0 ? State::size(sizes) : 0);
}

}  // namespace cdrj

#include "layout.hpp"

#include <array>
#include <numeric>

namespace cdrj {
namespace {

/// Takes one part after another from a flat array of 8-byte words.
template <typename Word>
class Parts {
public:
    explicit Parts(Word* begin) : next_(begin) {}

    /// Let a part be the next `count` records, or rows of `width` records.
    template <typename Record>
    void take(std::span<Record>& part, Index count) {
        static_assert(sizeof(Record) % sizeof(Word) == 0 && alignof(Record) == alignof(Word));
        part = {reinterpret_cast<Record*>(next_), static_cast<std::size_t>(count)};
        next_ += count * static_cast<Index>(sizeof(Record) / sizeof(Word));
    }
    template <typename Record>
    void take(Grid<Record>& part, Index rows, Index width) {
        std::span<Record> all;
        take(all, rows * width);
        part = {all.data(), width};
    }

private:
    Word* next_;
};

/// Words of 8 bytes in a part of this shape.
template <typename Record>
std::size_t words_in(auto... shape) {
    return (static_cast<std::size_t>(shape) * ...) * (sizeof(Record) / 8);
}

#define TAKE(name, Record, ...) parts.take(name, __VA_ARGS__);
#define WORDS(name, Record, ...) +words_in<Record>(__VA_ARGS__)
#define NAME(name, Record, ...) {#name, #Record, Index(words_in<Record>(__VA_ARGS__)), {__VA_ARGS__}},

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

Topology::Topology(const Index* packed) : sizes(*reinterpret_cast<const Sizes*>(packed)) {
    Parts parts(packed + sizeof(Sizes) / 8);
    TOPOLOGY_PARTS(TAKE)
    paths = std::make_shared<const Paths>(paths_of(*this));
}

Constants::Constants(const Sizes& sizes, const double* packed) {
    Parts parts(packed);
    CONSTANT_PARTS(TAKE)
}

State::State(const Sizes& sizes, double* state) {
    Parts parts(state);
    STATE_PARTS(TAKE)
}

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

std::size_t State::size(const Sizes& sizes) { return STATE_PARTS(WORDS); }

Estimate::Estimate(const Sizes& sizes, double* estimate) {
    Parts parts(estimate);
    for (const EstimatePart& part : ESTIMATE) parts.take(this->*part.numbers, sizes.*part.count);
}

std::size_t Estimate::size(const Sizes& sizes) {
    Index words = 0;
    for (const EstimatePart& part : ESTIMATE) words += sizes.*part.count;
    return static_cast<std::size_t>(words);
}

Index first_of(const Sizes& sizes, std::span<double> Estimate::*part, bool among_uncertain) {
    Index first = 0;
    for (const EstimatePart& one : ESTIMATE) {
        if (one.numbers == part) break;
        if (one.uncertain || !among_uncertain) first += sizes.*one.count;
    }
    return first;
}

Workspace::Workspace(const Sizes& sizes, double* scratch) {
    Parts parts(scratch);
    WORKSPACE_PARTS(TAKE, TAKE)
}

std::size_t Workspace::size(const Sizes& sizes) { return WORKSPACE_PARTS(WORDS, WORDS); }

std::vector<ArrayPart> parts_of(std::string_view array, const Sizes& sizes) {
    if (array == "Topology") return {{"sizes", "Sizes", sizeof(Sizes) / 8, {1}}, TOPOLOGY_PARTS(NAME)};
    if (array == "Constants") return {CONSTANT_PARTS(NAME)};
    if (array == "State") return {STATE_PARTS(NAME)};
    if (array == "Workspace") return {WORKSPACE_PARTS(NAME, NAME)};
    return {};
}

}  // namespace cdrj

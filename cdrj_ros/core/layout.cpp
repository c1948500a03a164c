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

    /// The next `count` records.
    template <typename Record>
    std::span<Record> take(Index count) {
        static_assert(sizeof(Record) % sizeof(Word) == 0 && alignof(Record) == alignof(Word));
        auto* first = reinterpret_cast<Record*>(next_);
        next_ += count * static_cast<Index>(sizeof(Record) / sizeof(Word));
        return {first, static_cast<std::size_t>(count)};
    }

    Word* next() const { return next_; }

private:
    Word* next_;
};

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
    Parts parts(packed + SIZES);
    cables = parts.take<const CableTopology>(sizes.cables);
    ends = parts.take<const EndTopology>(2 * sizes.cables);
    turns = parts.take<const TurnTopology>(sizes.turns);
    pulleys = parts.take<const PulleyTopology>(sizes.pulleys);
    terms = parts.take<const TermTopology>(sizes.terms);
    frames = parts.take<const FrameTopology>(sizes.frames);
    nodes = parts.take<const NodeTopology>(sizes.nodes);
    residuals = parts.take<const ResidualTopology>(sizes.residuals);
    residual_inputs = parts.take<const ResidualInputTopology>(sizes.residual_inputs);
    paths = std::make_shared<const Paths>(paths_of(*this));
}

Constants::Constants(const Sizes& sizes, const double* packed) {
    Parts parts(packed);
    cables = parts.take<const CableConstants>(sizes.cables);
    ends = parts.take<const EndConstants>(2 * sizes.cables);
    turns = parts.take<const TurnConstants>(sizes.turns);
    pulleys = parts.take<const PulleyConstants>(sizes.pulleys);
    elements = parts.take<const ElementConstants>(sizes.elements);
    segments = parts.take<const SegmentConstants>(sizes.segments());
    motors = parts.take<const MotorConstants>(sizes.motors);
    joints = parts.take<const JointConstants>(sizes.joints);
    axes = parts.take<const AxisConstants>(sizes.axes());
    tables = parts.take<const Cubic>(sizes.terms * TABLE_INTERVALS);
    frames = parts.take<const FrameConstants>(sizes.frames);
    nodes = parts.take<const NodeConstants>(sizes.nodes);
    residuals = parts.take<const ResidualConstants>(sizes.residuals);
    residual_ranges = parts.take<const ResidualRange>(sizes.residual_inputs);
    residual_weights = parts.take<const double>(sizes.residual_weights);
}

State::State(const Sizes& sizes, double* state) : started(state) {
    Parts parts(state + 1);
    length = parts.take<double>(sizes.segments());
    material = parts.take<double>(sizes.segments());
    delayed = parts.take<double>(sizes.segments());
    bristle = parts.take<double>(sizes.contacts);
    slip_speed = parts.take<double>(sizes.contacts);
    lagged_speed = parts.take<double>(sizes.contacts);
    place = parts.take<double>(sizes.contacts);
    track = parts.take<double>(sizes.pulleys);
    covered = parts.take<double>(sizes.surfaces);
    angle = parts.take<double>(sizes.axes());
    bearing_friction = parts.take<double>(sizes.axes());
    drums = parts.take<Drum>(sizes.drums);
    middles = parts.take<ArcMiddle>(sizes.nodes);
    residual_inputs = parts.take<ResidualInput>(sizes.residual_inputs);
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

std::size_t State::size(const Sizes& sizes) {
    const Index words = 1 + 3 * sizes.segments() + 4 * sizes.contacts + sizes.pulleys + sizes.surfaces +
                        2 * sizes.axes() + sizes.drums * Index{sizeof(Drum) / 8} +
                        sizes.nodes * Index{sizeof(ArcMiddle) / 8} +
                        sizes.residual_inputs * Index{sizeof(ResidualInput) / 8};
    return static_cast<std::size_t>(words);
}

Estimate::Estimate(const Sizes& sizes, double* estimate) {
    Parts parts(estimate);
    for (const EstimatePart& part : ESTIMATE) this->*part.numbers = parts.take<double>(sizes.*part.count);
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
    element_length = parts.take<double>(sizes.elements);
    lever_arm = {parts.take<double>(sizes.elements * sizes.joints).data(), sizes.joints};
    direction = parts.take<Vector3>(sizes.elements);
    wrap = parts.take<double>(sizes.pulleys);
    arc = parts.take<double>(sizes.pulleys);
    laid = parts.take<double>(2 * sizes.cables);
    middle = parts.take<double>(sizes.pulleys);
    segments = parts.take<Segment>(sizes.segments());
    contacts = parts.take<Contact>(sizes.contacts);
    pose = parts.take<Pose>(sizes.frames);
    twist = {parts.take<Twist>(sizes.frames * sizes.joints).data(), sizes.joints};
    touches = parts.take<Touch>(sizes.nodes);
    middles = parts.take<ArcMiddle>(sizes.nodes);
    products = parts.take<double>(sizes.residual_weights);
    history = parts.next();
}

std::size_t Workspace::size(const Sizes& sizes) {
    const Index history = sizes.surfaces > 0 ? static_cast<Index>(State::size(sizes)) : 0;
    return static_cast<std::size_t>(
        history + (4 + sizes.joints) * sizes.elements + 3 * sizes.pulleys + 2 * sizes.cables +
        sizes.segments() * Index{sizeof(Segment) / 8} + sizes.contacts * Index{sizeof(Contact) / 8} +
        sizes.frames * Index{sizeof(Pose) / 8} +
        sizes.frames * sizes.joints * Index{sizeof(Twist) / 8} +
        sizes.nodes * Index{(sizeof(Touch) + sizeof(ArcMiddle)) / 8} + sizes.residual_weights);
}

}  // namespace cdrj

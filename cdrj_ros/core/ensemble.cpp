#include "ensemble.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <ranges>
#include <utility>

namespace cdrj {
namespace {

/// Steps in which a member takes a path of its own between two samples.
///
/// Nearly all motions turn back late on such a path; with two steps, members saw half of these
/// reversals.
constexpr int PARTS = 4;

/// A cable that slips by more than this multiple of its deviation midway does not slip back on (U3)'s
/// parabola, which is steepest at its ends: four times 2.5, beyond which a share hardly lies.
constexpr double STRAIGHT = 10.0;

/// A longer time between two samples counts as a gap.
constexpr Nanoseconds GAP_NS = 1'000'000'000;

/// The member in turn is updated at most this often: at 1 kHz at every second sample.
constexpr Nanoseconds APART_NS = 1'500'000;

/// Time within which all members are updated while an axis has no readings.
constexpr Nanoseconds ROUND_NS = 4'000'000;

/// An axis has turned where it has moved back by what changes the tension of a cable by this share.
constexpr double TURNED = 0.01;

/// Row `k` of a table of rows of `width` numbers.
std::span<const double> row(const std::vector<double>& table, Index k, std::size_t width) {
    return std::span(table).subspan(static_cast<std::size_t>(k) * width, width);
}

/// The quantities of a robot, in the order of `unmodelled`.
std::vector<UncertainOutput> quantities_of(const Robot& robot, std::span<const double> unmodelled) {
    const auto& [topology, constants] = robot;
    const Sizes& sizes = topology.sizes;
    std::vector<Index> of_elements, of_pulleys;  // their cables
    for (Index c = 0; c < sizes.cables; ++c) {
        of_elements.insert(of_elements.end(), topology.cables[c].elements, c);
        of_pulleys.insert(of_pulleys.end(), topology.cables[c].pulleys, c);
    }
    std::vector<UncertainOutput> found;
    std::vector<double> numbers(robot.estimate_size());
    const Estimate estimate(sizes, numbers.data());
    for (const auto part : UNCERTAIN) {
        const bool is_tension = part == &Estimate::tension;
        const bool on_cable = is_tension || part == &Estimate::magnitude;
        const auto& cables = is_tension ? of_elements : of_pulleys;
        const Index first = (estimate.*part).data() - numbers.data();
        const Index axis = first - first_of(sizes, &Estimate::motor_effort);
        for (Index k = 0; k < std::ssize(estimate.*part); ++k) {
            found.push_back({first + k, on_cable ? cables[k] : -1, on_cable ? -1 : axis + k, -1, 0.0, 0.0});
        }
    }
    for (std::size_t q = 0; q < found.size(); ++q) {
        found[q].unmodelled_variance = unmodelled[q];
        found[q].slack = unmodelled[found.size() + q];
        for (Index r = 0; r < sizes.residuals; ++r) {
            if (topology.residuals[r].column == found[q].index) found[q].residual = r;
        }
    }
    return found;
}

}  // namespace

Ensemble::Ensemble(
    std::vector<Index> topology, std::vector<double> constants, std::vector<double> of_members,
    std::span<const double> unmodelled, Draws of_draws)
    : topology_(std::move(topology)),
      constants_(std::move(constants)),
      robot_(topology_.data(), constants_.data()),
      first_{
          first_of(robot_.topology.sizes, &Estimate::status),
          first_of(robot_.topology.sizes, &Estimate::slip_speed),
          first_of(robot_.topology.sizes, &Estimate::tension, true),
          first_of(robot_.topology.sizes, &Estimate::magnitude, true),
          first_of(robot_.topology.sizes, &Estimate::motor_effort, true),
          first_of(robot_.topology.sizes, &Estimate::correction),
          first_of(robot_.topology.sizes, &Estimate::trust)},
      quantities(quantities_of(robot_, unmodelled)),
      draws(std::move(of_draws)),
      population(robot_.topology, draws.slipping.size() / cables(), std::move(of_members)),
      lags(robot_.topology.sizes.axes(), gains_of_cables()),
      units(robot_.topology.sizes.axes(), gains_of_cables(), draws.load_share),
      everything_{robot_.topology.paths->all, 1, false},
      parts_{{}, PARTS, false},
      at_once_{{}, 1, false},
      in_turn_{{}, 1, true},
      estimate_(robot_.estimate_size()),
      mean_tensions_(cables()),
      unread_(cables()),
      walked_(cables()),
      out_(robot_.out_size()) {
    const auto members = static_cast<std::size_t>(population.size());
    const auto axes = static_cast<std::size_t>(robot_.topology.sizes.axes());
    memory.stamps.resize(members * cables());
    memory.unsolved.resize(cables());
    memory.deviation.resize(members * quantities.size());
    memory.variance.resize(quantities.size());
    memory.intervals.resize(axes);
    memory.heading.resize(axes);
    memory.furthest.resize(axes);
    memory.turn_stamps.resize(axes * TURNS);
    memory.turn_angles.resize(axes * TURNS * axes);
    memory.sudden_stamps.resize(robot_.topology.sizes.elements);
    for (std::vector<double>* one :
         {&memory.angle, &memory.known_angle, &memory.unseen, &angle_before_, &angle_, &unseen_, &midway_, &small_,
          &errors_, &reading_}) {
        one->resize(axes);
    }
    walked_axis_.resize(axes);
    memory.least_variance.resize(quantities.size());
    slipped_.resize(quantities.size());
    late_.resize(quantities.size());
    start_anew();
}

// -------------------------------------------------------------------------------------------------
// A sample

bool Ensemble::step(
    const double* before, const SampleView& sample, double dt, std::span<double> state,
    std::span<double> estimate, std::span<double> stddev) {
    const bool solved =
        robot_.advance(before, sample.motor_angle, sample.joint_angle, dt, out_.data());
    std::copy_n(out_.begin(), state.size(), state.begin());
    std::copy_n(out_.begin() + robot_.state_size(), estimate.size(), estimate.begin());
    update(sample, estimate, stddev);
    return solved;
}

void Ensemble::update(
    const SampleView& sample, std::span<double> estimate, std::span<double> stddev) {
    roll_back();
    begin(sample, estimate);
    finish(estimate, stddev);
    if (is_due(sample.stamp_ns)) update_members(1);
}

void Ensemble::predict(
    const SampleView& sample, std::span<double> estimate, std::span<double> stddev) {
    if (!kept_) kept_ = {{}, memory};
    begin(sample, estimate);
    finish(estimate, stddev);
}

void Ensemble::keep() {
    if (!kept_) kept_ = {population.states, memory};
}

/// Before members are advanced for a prediction.
void Ensemble::keep_states() {
    if (kept_ && kept_->states.empty()) kept_->states = population.states;
}

void Ensemble::roll_back() {
    if (!kept_) return;
    if (!kept_->states.empty()) population.states = kept_->states;  // of the same size: does not move
    memory = kept_->memory;
    kept_.reset();
}

void Ensemble::reset() {
    kept_.reset();
    start_anew();
    memory.progress.last_stamp = -1;
    std::ranges::fill(memory.unsolved, 0);
    std::ranges::fill(memory.unseen, 0.0);
}

void Ensemble::start_anew() {
    memory.progress.updates = 0;
    for (std::vector<double>* one : {&population.states, &memory.deviation, &memory.variance}) {
        std::ranges::fill(*one, 0.0);
    }
    std::ranges::fill(memory.intervals, 0);
    std::ranges::fill(memory.heading, 0.0);
    std::ranges::fill(memory.turn_stamps, -1);
    std::ranges::fill(memory.sudden_stamps, -1);
}

/// Take a sample, and update all members of cables whose motion since the last one is not small.
void Ensemble::begin(const SampleView& sample, std::span<const double> estimate) {
    std::ranges::copy(estimate, estimate_.begin());
    take_angles(sample);
    if (!sample.offset.empty()) take_offset(sample.offset);
    const Nanoseconds before = std::exchange(memory.progress.last_stamp, sample.stamp_ns);
    for (Walk* one : {&parts_, &at_once_, &in_turn_}) {
        for (std::vector<Index>* list : {&one->cables, &one->axes, &one->frames}) list->clear();
    }
    if (before != sample.stamp_ns) {
        count_intervals();
        note_turns(before);
        choose(before);
    }
    if (memory.progress.updates == 0) {
        update_members(members());
    } else {
        for (const Walk* one : {&parts_, &at_once_, &in_turn_}) walk(*one, before);
    }
    std::ranges::copy(angle_, memory.angle.begin());
    note_known();
    std::ranges::copy(unseen_, memory.unseen.begin());
}

/// Write the standard deviations at the sample that was taken, and what they leave in doubt.
void Ensemble::finish(std::span<double> estimate, std::span<double> stddev) {
    if (!kept_) bound_errors();
    write_stddev(estimate_, stddev);
    doubt_changes(estimate, stddev);
}

void Ensemble::take_angles(const SampleView& sample) {
    std::ranges::copy(memory.angle, angle_before_.begin());
    const auto end = std::ranges::copy(sample.motor_angle, angle_.begin()).out;
    std::ranges::copy(sample.joint_angle, end);
    std::ranges::fill(unseen_, 0.0);
    std::ranges::fill(midway_, 0.0);
    if (sample.unseen.empty()) return;
    std::ranges::copy(sample.unseen.first(axes()), unseen_.begin());
    std::ranges::copy(sample.unseen.last(axes()), midway_.begin());
}

/// Remember the angles of axes that are read with all other axes of their cables.
void Ensemble::note_known() {
    const auto is_known = [&](Index c) { return memory.unsolved[c] < UNREAD_AXIS; };
    const bool whole = std::ranges::all_of(std::views::iota(Index{0}, cables()), is_known);
    for (std::size_t a = 0; a < axes(); ++a) {
        if (std::isnan(angle_[a])) continue;
        if (whole || std::ranges::all_of(robot_.topology.paths->cables_of_axis[a], is_known)) {
            memory.known_angle[a] = angle_[a];
        }
    }
}

/// Count every axis's intervals without readings.
void Ensemble::count_intervals() {
    for (std::size_t a = 0; a < axes(); ++a) {
        Index& intervals = memory.intervals[a];
        if (unseen_[a] > 0.0) {
            intervals |= 1;
        } else {
            intervals += intervals & 1;
            if (midway_[a] > 0.0 && midway_[a] < INFINITE) intervals += 2;
        }
    }
}

/// Remember the sample before, where an axis has turned since.
void Ensemble::note_turns(Nanoseconds before) {
    for (std::size_t a = 0; a < axes(); ++a) {
        if (std::isnan(angle_[a])) continue;
        double &heading = memory.heading[a], &furthest = memory.furthest[a];
        if (heading == 0.0) {
            heading = 1.0;
            furthest = angle_[a];
        } else if (heading * (angle_[a] - furthest) >= 0.0) {
            furthest = angle_[a];
        } else if (has_turned(static_cast<Index>(a))) {
            const auto stamps = memory.turn_stamps.begin() + static_cast<Index>(a * TURNS);
            const auto angles = memory.turn_angles.begin() + static_cast<Index>(a * TURNS * axes());
            const auto last = static_cast<Index>((TURNS - 1) * axes());
            std::shift_left(stamps, stamps + TURNS, 1);
            stamps[TURNS - 1] = before;
            std::shift_left(angles, angles + last + std::ssize(angle_), std::ssize(angle_));
            std::ranges::copy(angle_before_, angles + last);
            heading = -heading;
            furthest = angle_[a];
        }
    }
}

/// Whether an axis has moved back by enough to change the friction of a cable.
bool Ensemble::has_turned(Index axis) const {
    const double back = std::abs(angle_[axis] - memory.furthest[axis]);
    return std::ranges::any_of(robot_.topology.paths->cables_of_axis[axis], [&](Index c) {
        if (is_invalid(estimate_, c)) return false;
        const UncertainOutput& tension = quantities[tensions_of(c).first];
        const double most = std::max(estimate_[tension.index], tension.slack);
        const auto& gains = draws.gains[tensions_of(c).first];
        return std::ranges::any_of(gains, [&](const Gain& one) {
            return one.axis == axis && one.gain * back > TURNED * most;
        });
    });
}

/// Choose the cables of which more members than the one in turn are updated at this sample.
///
/// `before`: stamp of the sample before; -1 if there is none.
void Ensemble::choose(Nanoseconds before) {
    const Paths& paths = *robot_.topology.paths;
    any_small_ = false;
    for (Index c = 0; c < cables(); ++c) {
        walked_[c] = 0;
        Walk* const chosen = walk_of(c, before);
        note_unsolved(c);
        if (chosen == nullptr) continue;
        walked_[c] = 1;
        chosen->cables.push_back(c);
        join(chosen->axes, paths.of_cable[c].axes);
        join(chosen->frames, paths.of_cable[c].frames);
    }
    for (std::size_t a = 0; a < axes(); ++a) {
        if (midway_[a] == INFINITE) midway_[a] = 0.0;
        const auto& own = paths.cables_of_axis[a];
        walked_axis_[a] = std::ranges::any_of(own, [&](Index c) { return walked_[c] != 0; });
        const double most = std::max(unseen_[a], midway_[a]);
        small_[a] = most * most;
        any_small_ = any_small_ || most > 0.0;
    }
}

/// How the members of a cable are updated beside the one in turn; null where they are not.
Ensemble::Walk* Ensemble::walk_of(Index c, Nanoseconds before) {
    if (memory.progress.updates == 0) return nullptr;
    const auto [first, beyond] = tensions_of(c);
    double here = 0.0, way = 0.0;
    for (const auto& [axis, gain] : draws.gains[first]) {
        here += gain * unseen_[axis] * (gain * unseen_[axis]);
        way += gain * midway_[axis] * (gain * midway_[axis]);
    }
    if (is_unknown(c, std::sqrt(way), before)) {
        keep_states();
        const auto first_segment = robot_.topology.segments_of(c).first;
        for (Index k = 0; k < members(); ++k) {  // without material a member starts anew
            State(robot_.topology.sizes, population.state(k).data()).material[first_segment] = 0.0;
        }
        return &at_once_;
    }
    if (memory.unsolved[c] != 0 && !is_invalid(estimate_, c)) return &at_once_;
    if (here == 0.0 && way == 0.0) return nullptr;
    double least = INFINITE;
    for (Index q = first; q < beyond; ++q) least = std::min(least, shown(q, estimate_));
    if (std::max(here, way) <= SMALL * SMALL * least) return nullptr;
    walked_[c] = 1;
    if (slips_on(c, std::sqrt(way), before)) return nullptr;  // members show all that there is
    return way > 0.0 ? &parts_ : &in_turn_;
}

/// Whether a cable has slipped over all its pulleys since the sample before, by more than a path
/// between two readings of all its axes may bend: friction then follows from the ends of the path.
///
/// `way`: standard deviation of its tension midway [N].
bool Ensemble::slips_on(Index c, double way, Nanoseconds before) const {
    const Topology& topology = robot_.topology;
    const bool read = std::ranges::all_of(topology.paths->of_cable[c].axes, [&](Index a) {
        return unseen_[a] == 0.0 && memory.unseen[a] == 0.0;
    });
    if (!read) return false;
    const auto [first, beyond] = topology.segments_of(c);
    double length = 0.0;
    for (Index e = first; e < beyond; ++e) length += robot_.constants.segments[e].material;
    const double stiffness = robot_.constants.cables[c].axial_stiffness / length;
    const double time = static_cast<double>(memory.progress.last_stamp - before) * 1e-9;
    const CableTopology& cable = topology.cables[c];
    const auto speeds = std::span(estimate_).subspan(first_.slip_speed + cable.first_pulley);
    return std::ranges::all_of(speeds.first(cable.pulleys), [&](double speed) {
        return stiffness * time * std::abs(speed) > STRAIGHT * way;
    });
}

/// Whether the motion of an axis of a cable since the sample before is unknown.
///
/// `way`: standard deviation of its tension midway [N]. Paths of motors and joints are drawn apart from each
/// other; where they stretch the cable by more than what it carries, they are none that it allows.
bool Ensemble::is_unknown(Index c, double way, Nanoseconds before) const {
    const UncertainOutput& tension = quantities[tensions_of(c).first];
    const double preload = robot_.constants.cables[c].preload;
    if (way > std::max({preload, estimate_[tension.index], tension.slack})) return true;
    const bool gap = before >= 0 && memory.progress.last_stamp - before > GAP_NS;
    const bool unread = memory.unsolved[c] == UNREAD_AXIS && is_read(c);
    if (memory.unsolved[c] == MOVED_UNREAD && is_read(c)) return true;
    if ((gap || unread) && has_moved(c)) return true;
    return std::ranges::any_of(
        robot_.topology.paths->of_cable[c].axes, [&](Index a) { return midway_[a] == INFINITE; });
}

/// Whether all axes of a cable are read.
bool Ensemble::is_read(Index c) const {
    const Sizes& sizes = robot_.topology.sizes;
    const std::span<const double> angles(angle_);
    return cdrj::is_read(
        robot_.topology, c, {angles.first(sizes.motors), angles.last(sizes.joints), 0.0});
}

/// Whether an axis of a cable has moved since all were known.
bool Ensemble::has_moved(Index c) const {
    return std::ranges::any_of(robot_.topology.paths->of_cable[c].axes, [&](Index a) {
        return std::abs(angle_[a] - memory.known_angle[a]) > MOVED;
    });
}

/// Note whether a cable is solved in this sample, or why it is not.
void Ensemble::note_unsolved(Index c) {
    Index& unsolved = memory.unsolved[c];
    if (!is_invalid(estimate_, c)) {
        unsolved = SOLVED;
    } else if (is_read(c)) {
        unsolved = FAILED;
    } else {
        unsolved = unsolved == MOVED_UNREAD || has_moved(c) ? MOVED_UNREAD : UNREAD_AXIS;
    }
}

bool Ensemble::is_due(Nanoseconds stamp) const {
    return memory.progress.updates == 0 || stamp - memory.progress.last_update >= APART_NS;
}

// -------------------------------------------------------------------------------------------------
// Members

std::span<const double> Ensemble::errors_of(Index member) {
    const Index turn = memory.progress.updates / members() * members() + member;
    const auto read = row(draws.reading_error, turn % draws.reading_rows, axes());
    const auto zero = row(draws.zero_error, member, axes());
    std::ranges::transform(read, zero, errors_.begin(), std::plus());
    return errors_;
}

void Ensemble::update_members(Index count) {
    keep_states();
    for (Index k = 0; k < count; ++k) {
        const Index member = next_member();
        pass_turns(member);
        step_member(member, everything_, memory.progress.last_stamp);
        const auto own = std::span<const double>(out_).subspan(robot_.state_size(), estimate_.size());
        compare(memory.progress.last_stamp, own, estimate_);
    }
}

/// Update the members of the cables of a walk.
void Ensemble::walk(const Walk& walk, Nanoseconds before) {
    if (walk.cables.empty()) return;
    keep_states();
    for (Index k = 0; k < members(); ++k) {
        if (walk.round && !takes_part(k, before)) continue;
        step_member(k, walk, before);
        const Step step(population[k], population.state(k).data(), out_.data());
        for (const Index c : walk.cables) compare_cable(step, k, c);
    }
    for (const Index c : walk.cables) {
        for (const auto& [first, beyond] : {tensions_of(c), forces_of(c)}) {
            for (Index q = first; q < beyond; ++q) renew_variance(q);
        }
    }
    for (const Index a : walk.axes) renew_variance(effort_of(a));
}

/// Whether it is the time of a member in the round that takes `ROUND_NS`.
bool Ensemble::takes_part(Index member, Nanoseconds before) const {
    const Nanoseconds each = ROUND_NS / members();
    const Index first = before / each + 1, count = memory.progress.last_stamp / each + 1 - first;
    return ((member - first) % members() + members()) % members() < count;
}

/// Advance a member to the turning points since its last update, in their order.
void Ensemble::pass_turns(Index member) {
    const std::vector<Nanoseconds>& stamps = memory.turn_stamps;
    turns_.clear();
    for (std::size_t turn = 0; turn < stamps.size(); ++turn) {
        const auto& own = robot_.topology.paths->cables_of_axis[turn / TURNS];
        const bool is_new = std::ranges::any_of(own, [&](Index c) {
            return memory.stamps[member * cables() + c] < stamps[turn];
        });
        if (is_new) turns_.push_back(turn);
    }
    std::ranges::stable_sort(turns_, {}, [&](std::size_t turn) { return stamps[turn]; });
    for (const std::size_t turn : turns_) step_to_turn(member, turn);
}

/// Advance the cables of an axis to where it has turned, unless they have passed that.
void Ensemble::step_to_turn(Index member, std::size_t turn) {
    const Topology& topology = robot_.topology;
    const Paths& paths = *topology.paths;
    const Nanoseconds stamp = memory.turn_stamps[turn];
    const std::span<const double> errors = errors_of(member), readings(reading_);
    const auto angles = row(memory.turn_angles, static_cast<Index>(turn), axes());
    std::ranges::transform(angles, errors, reading_.begin(), std::plus());
    Step step(population[member], population.state(member).data(), out_.data());
    for (const Index c : paths.cables_of_axis[turn / TURNS]) {
        Nanoseconds& last = memory.stamps[member * cables() + c];
        if (last >= stamp) continue;
        place_frames(
            topology, population[member].constants, paths.of_cable[c].frames,
            readings.last(topology.sizes.joints), step.work);
        const bool solved =
            step_cable(step, member, c, static_cast<double>(stamp - last) * 1e-9);
        if (draws.slipping[member * cables() + c] && solved) {
            forget_drums(population[member], c, step.before);
        }
        last = stamp;
    }
}

/// Advance some cables of a member to the sample; all that it computes is in `out_`.
///
/// With several parts the angles follow a straight line from the sample before, the deviations the
/// parabola through those of both samples and the one midway between them, which is (C3) if all three
/// lie in the same interval.
void Ensemble::step_member(Index member, const Walk& walk, Nanoseconds before) {
    const Robot& robot = population[member];
    const Sizes& sizes = robot.topology.sizes;
    const std::span<const double> errors = errors_of(member), readings(reading_);
    const Nanoseconds stamp = memory.progress.last_stamp;
    const double part_s = static_cast<double>(stamp - before) * 1e-9 / walk.parts;
    Step step(robot, population.state(member).data(), out_.data());
    for (int p = 1; p <= walk.parts; ++p) {
        const double share = static_cast<double>(p) / walk.parts;
        const double start = (1.0 - share) * (1.0 - 2.0 * share);
        const double middle = 4.0 * share * (1.0 - share);
        const double end = share * (2.0 * share - 1.0);
        for (const Index a : walk.axes) {
            const double angle = (1.0 - share) * angle_before_[a] + share * angle_[a];
            reading_[a] = (p < walk.parts ? angle : angle_[a]) + errors[a];
            if (walked_axis_[a] == 0) continue;  // what is small moves no member
            deviate(
                member, a, start * memory.unseen[a] + middle * midway_[a] + end * unseen_[a]);
        }
        place_frames(
            robot.topology, robot.constants, walk.frames, readings.last(sizes.joints), step.work);
        for (const Index c : walk.cables) {
            const Nanoseconds since = stamp - memory.stamps[member * cables() + c];
            const double passed = static_cast<double>(since) * 1e-9;
            const bool solved = step_cable(
                step, member, c, p == 1 ? passed - (walk.parts - 1) * part_s : part_s);
            if (p < walk.parts) continue;
            if (draws.slipping[member * cables() + c] && solved) forget_drums(robot, c, step.before);
            memory.stamps[member * cables() + c] = stamp;
        }
    }
    if (&walk != &everything_) return;
    report_efforts(
        step, walk.axes, {readings.first(sizes.motors), readings.last(sizes.joints), 0.0});
    std::ranges::copy(step.after.angle, step.before.angle.begin());
    std::ranges::copy(step.after.bearing_friction, step.before.bearing_friction.begin());
    step.before.started[0] = 1.0;
}

/// Shift a member's reading by its share of the angle's deviation (U3), within the axis's range.
///
/// A member keeps sign and size of its share throughout an interval between readings, so its path is
/// smooth and cables slip along it as they would in a real motion.
void Ensemble::deviate(Index member, Index a, double deviation) {
    if (!(deviation > 0.0)) return;
    const Index interval = (memory.intervals[a] >> 1) % draws.unseen_rows;
    const double own = draws.unseen_share[(interval * members() + member) * std::ssize(reading_) + a];
    const double low = std::min(draws.lower[a], reading_[a]);
    const double high = std::max(draws.upper[a], reading_[a]);
    reading_[a] = std::min(std::max(reading_[a] + deviation * own, low), high);
}

/// Advance one cable of a member to its readings, or start it with its friction history; false: not
/// solved. `step.before`, the member's state, becomes the new one.
bool Ensemble::step_cable(Step& step, Index member, Index c, double dt) {
    const Sizes& sizes = step.topology.sizes;
    const std::span<const double> readings(reading_);
    SampleAngles angles{readings.first(sizes.motors), readings.last(sizes.joints), dt};
    const Index first = step.topology.segments_of(c).first;
    if (!step.before.holds(first)) {
        advance_cable(step, c, angles);
        if (!step.after.holds(first)) return false;  // no such pose
        const auto pulleys = static_cast<std::size_t>(sizes.pulleys);
        impose_friction(step, c, row(draws.friction_share, member, pulleys));
        step.before.take_cable(step.topology, c, step.after);
        angles.dt = 0.0;
    }
    ++cable_steps;
    const bool solved = advance_cable(step, c, angles);
    step.before.take_cable(step.topology, c, step.after);
    return solved;
}

}  // namespace cdrj

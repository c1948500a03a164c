#include "ensemble.hpp"

#include <algorithm>
#include <cmath>

namespace cdrj {
namespace {

/// Steps in which a member takes a path of its own between two samples.
///
/// Nearly all motions turn back late on such a path; with two steps, members saw half of these
/// reversals.
constexpr int PARTS = 4;

/// A longer time between two samples counts as a gap.
constexpr Nanoseconds GAP_NS = 1'000'000'000;

/// A member is updated at most this often: at 1 kHz at every second sample.
constexpr Nanoseconds APART_NS = 1'500'000;

/// Time within which all members are updated while an axis has no readings.
constexpr Nanoseconds ROUND_NS = 4'000'000;

/// Row `k` of a table of rows of `width` numbers.
std::span<const double> row(const std::vector<double>& table, Index k, std::size_t width) {
    return std::span(table).subspan(static_cast<std::size_t>(k) * width, width);
}

}  // namespace

Population::Population(
    const Topology& topology, std::size_t robots, std::vector<double> of_robots)
    : constants(std::move(of_robots)), states(robots * State::size(topology.sizes)) {
    robots_.reserve(robots);
    for (std::size_t k = 0; k < robots; ++k) {
        robots_.emplace_back(topology, constants.data() + k * (constants.size() / robots));
    }
}

bool Population::advance(
    Index k, std::span<const double> motor_angle, std::span<const double> joint_angle, double dt,
    double* out) {
    const std::span<double> own = state(k);
    const bool solved = robots_[k].advance(own.data(), motor_angle, joint_angle, dt, out);
    std::copy_n(out, own.size(), own.begin());
    return solved;
}

Ensemble::Ensemble(
    std::vector<Index> topology, std::vector<double> constants, std::vector<double> of_members,
    std::vector<Quantity> of_quantities, Draws of_draws)
    : quantities(std::move(of_quantities)),
      draws(std::move(of_draws)),
      topology_(std::move(topology)),
      constants_(std::move(constants)),
      robot_(topology_.data(), constants_.data()),
      population(robot_.topology, draws.slipping.size(), std::move(of_members)),
      estimate_(robot_.estimate_size()),
      possible_(robot_.topology.sizes.elements + 1, 1.0),
      out_(robot_.out_size()) {
    const auto members = static_cast<std::size_t>(population.size());
    const auto axes = static_cast<std::size_t>(robot_.topology.sizes.axes());
    memory.stamps.resize(members);
    memory.deviation.resize(members * quantities.size());
    memory.variance.resize(quantities.size());
    for (Index c = 0; c < robot_.topology.sizes.cables; ++c) {
        memory.swing.insert(memory.swing.end(), {INFINITE, -INFINITE});
    }
    memory.intervals.resize(axes);
    for (std::vector<double>* one :
         {&memory.angle, &memory.unseen, &angle_before_, &angle_, &unseen_, &midway_,
          &between_, &reading_}) {
        one->resize(axes);
    }
    memory.offset.resize(3 * axes);
    memory.least_variance.resize(quantities.size());
    memory.lasting.resize(quantities.size());
    memory.late.resize(quantities.size());
    take_offset(std::vector<double>(3 * axes));
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
    update(sample, estimate, 1, stddev);
    return solved;
}

void Ensemble::update(
    const SampleView& sample, std::span<const double> estimate, Index least,
    std::span<double> stddev) {
    roll_back();
    if (begin(sample, estimate, least, stddev)) update_members(1, 0.0);
}

void Ensemble::predict(
    const SampleView& sample, std::span<const double> estimate, std::span<double> stddev) {
    keep();
    begin(sample, estimate, 1, stddev);
}

void Ensemble::keep() {
    if (!kept_) kept_ = {population.states, memory};
}

void Ensemble::roll_back() {
    if (!kept_) return;
    population.states = kept_->states;  // of the same sizes: they stay where they are
    memory = kept_->memory;
    kept_.reset();
}

void Ensemble::reset() {
    kept_.reset();
    start_anew();
    memory.progress.last_stamp = -1;
    memory.progress.last_unsolved = 0;
    std::ranges::fill(memory.unseen, 0.0);
}

/// Take a sample, update members where more than one is due, and write the standard deviations;
/// returns whether one is due now.
bool Ensemble::begin(
    const SampleView& sample, std::span<const double> estimate, Index least,
    std::span<double> stddev) {
    std::ranges::copy(estimate, estimate_.begin());
    const bool unknown = take_angles(sample);
    if (!sample.offset.empty()) take_offset(sample.offset);
    if (unknown || moved_in_a_gap(sample.stamp_ns)) start_anew();
    std::ranges::copy(angle_, memory.angle.begin());

    const Nanoseconds passed = sample.stamp_ns - memory.progress.last_stamp;
    const bool started = memory.progress.updates > 0;
    Index count = std::min(least, members());
    double part_s = 0.0;
    if (passed != 0) {
        const auto [inside, on_the_way] = count_intervals();
        if (inside && started) {
            const double share = static_cast<double>(passed) / static_cast<double>(ROUND_NS);
            const double due = std::ceil(static_cast<double>(members()) * share);
            count = std::max(count, std::min(members(), static_cast<Index>(due)));
        }
        if (on_the_way && started) {
            count = members();
            part_s = static_cast<double>(passed) * 1e-9 / PARTS;
        }
    }
    const bool unsolved = is_invalid(estimate_, -1);
    if (!started || (memory.progress.last_unsolved != 0 && !unsolved)) count = members();
    memory.progress.last_stamp = sample.stamp_ns;
    memory.progress.last_unsolved = unsolved ? 1 : 0;

    if (count > 1) update_members(count, part_s);
    std::ranges::copy(unseen_, memory.unseen.begin());
    if (!unsolved) bound_clocks();
    write_stddev(estimate_, stddev);
    return count == 1 && is_due(sample.stamp_ns);
}

/// Take the angles of a sample and their deviations; whether the motion of an axis before it is
/// unknown, which then counts as zero.
bool Ensemble::take_angles(const SampleView& sample) {
    const std::size_t axes = angle_.size();
    std::ranges::copy(memory.angle, angle_before_.begin());
    const auto end = std::ranges::copy(sample.motor_angle, angle_.begin()).out;
    std::ranges::copy(sample.joint_angle, end);
    bool unknown = false;
    for (std::size_t a = 0; a < axes; ++a) {
        unseen_[a] = sample.unseen.empty() ? 0.0 : sample.unseen[a];
        midway_[a] = sample.unseen.empty() ? 0.0 : sample.unseen[axes + a];
        if (midway_[a] == INFINITE) {
            midway_[a] = 0.0;
            unknown = true;
        }
    }
    return unknown;
}

/// Whether a gap precedes this sample during which an axis moved.
bool Ensemble::moved_in_a_gap(Nanoseconds stamp) const {
    if (memory.progress.last_stamp < 0 || stamp - memory.progress.last_stamp <= GAP_NS) return false;
    for (std::size_t a = 0; a < angle_.size(); ++a) {
        if (std::abs(angle_[a] - angle_before_[a]) > MOVED) return true;
    }
    return false;
}

/// Count every axis's intervals without readings.
///
/// Returns whether an axis is in an interval now, and whether one may have moved unseen since the
/// sample before.
std::pair<bool, bool> Ensemble::count_intervals() {
    bool inside = false, on_the_way = false;
    for (std::size_t a = 0; a < unseen_.size(); ++a) {
        Index& intervals = memory.intervals[a];
        const bool moved = midway_[a] > 0.0;
        on_the_way = on_the_way || moved;
        if (unseen_[a] > 0.0) {
            intervals |= 1;
            inside = true;
        } else {
            intervals += intervals & 1;
            if (moved) intervals += 2;
        }
    }
    return {inside, on_the_way};
}

bool Ensemble::is_due(Nanoseconds stamp) const {
    if (memory.progress.updates == 0) return true;
    return stamp - memory.stamps[(memory.progress.updates - 1) % members()] >= APART_NS;
}

void Ensemble::start_anew() {
    memory.progress.updates = 0;
    for (std::vector<double>* one : {&population.states, &memory.deviation, &memory.variance}) {
        std::ranges::fill(*one, 0.0);
    }
    std::ranges::fill(memory.intervals, 0);
}

// -------------------------------------------------------------------------------------------------
// Members

std::span<const double> Ensemble::next_errors() const {
    return row(draws.reading_error, memory.progress.updates % draws.reading_rows, angle_.size());
}

void Ensemble::update_members(Index count, double part_s) {
    for (Index k = 0; k < count; ++k) update_member(part_s);
}

/// Update the next member to the sample.
///
/// `part_s`: if an axis may have moved unseen since the sample before, the time since then divided
/// by `PARTS` [s]: the member then takes a path of its own; otherwise 0.
void Ensemble::update_member(double part_s) {
    const Index member = next_member();
    const std::span<const double> errors = next_errors();
    ++memory.progress.updates;
    double* state = population.state(member).data();
    double dt = static_cast<double>(memory.progress.last_stamp - memory.stamps[member]) * 1e-9;
    if (part_s > 0.0 && *State(robot_.topology.sizes, state).started != 0.0) {
        dt = walk(member, errors, dt, part_s);
    }
    for (std::size_t a = 0; a < angle_.size(); ++a) reading_[a] = angle_[a] + errors[a];
    deviate(member, unseen_);
    const bool solved = advance(member, dt);
    if (draws.slipping[member] && solved) population[member].forget_drums(state);
    memory.stamps[member] = memory.progress.last_stamp;
    const auto own = std::span<const double>(out_).subspan(robot_.state_size(), estimate_.size());
    compare(member, own, estimate_, solved && memory.progress.last_unsolved == 0);
}

/// Take a member along its path between two samples, but for the last of `PARTS`.
///
/// The angles follow a straight line, the deviations the parabola through those of both samples and
/// the one midway between them, which is (C3) if all three lie in the same interval. Returns the time
/// that is left until the sample [s].
double Ensemble::walk(Index member, std::span<const double> errors, double dt, double part_s) {
    dt -= (PARTS - 1) * part_s;
    for (int p = 1; p < PARTS; ++p) {
        const double share = static_cast<double>(p) / PARTS;
        const double start = (1.0 - share) * (1.0 - 2.0 * share);
        const double middle = 4.0 * share * (1.0 - share);
        const double end = share * (2.0 * share - 1.0);
        for (std::size_t a = 0; a < angle_.size(); ++a) {
            const double angle = (1.0 - share) * angle_before_[a] + share * angle_[a];
            const double deviation =
                start * memory.unseen[a] + middle * midway_[a] + end * unseen_[a];
            between_[a] = std::max(deviation, 0.0);
            reading_[a] = angle + errors[a];
        }
        deviate(member, between_);
        advance(member, dt);
        dt = part_s;
    }
    return dt;
}

/// Shift a member's readings by its share of the angles' deviation (U3), within the axes' ranges.
///
/// A member keeps sign and size of its share throughout an interval between readings, so its path is
/// smooth and cables slip along it as they would in a real motion.
void Ensemble::deviate(Index member, std::span<const double> deviation) {
    const auto axes = static_cast<Index>(reading_.size());
    for (Index a = 0; a < axes; ++a) {
        if (!(deviation[a] > 0.0)) continue;
        const Index interval = (memory.intervals[a] >> 1) % draws.unseen_rows;
        const double own = draws.unseen_share[(interval * members() + member) * axes + a];
        const double low = std::min(draws.lower[a], reading_[a]);
        const double high = std::max(draws.upper[a], reading_[a]);
        reading_[a] = std::min(std::max(reading_[a] + deviation[a] * own, low), high);
    }
}

/// Advance a member to its readings, or start it with its friction history; false: not solved.
bool Ensemble::advance(Index member, double dt) {
    const Sizes& sizes = robot_.topology.sizes;
    const std::span<double> state = population.state(member);
    const std::span<const double> readings(reading_);
    const auto motor_angle = readings.first(sizes.motors), joint_angle = readings.last(sizes.joints);
    if (*State(sizes, state.data()).started == 0.0) {
        population[member].advance(state.data(), motor_angle, joint_angle, 0.0, out_.data());
        if (*State(sizes, out_.data()).started == 0.0) return false;  // no such pose
        const auto pulleys = static_cast<std::size_t>(sizes.pulleys);
        population[member].impose_friction(row(draws.friction_share, member, pulleys), out_.data());
        std::copy_n(out_.data(), state.size(), state.begin());
        dt = 0.0;
    }
    return population.advance(member, motor_angle, joint_angle, dt, out_.data());
}

// -------------------------------------------------------------------------------------------------
// Standard deviations

void Ensemble::compare(
    Index member, std::span<const double> own, std::span<const double> nominal, bool all_solved) {
    const std::size_t width = quantities.size();
    const auto count = static_cast<double>(members());
    for (std::size_t q = 0; q < width; ++q) {
        const auto& [index, element, residual, unmodelled, slack] = quantities[q];
        if (!all_solved && (is_invalid(nominal, element) || is_invalid(own, element))) continue;
        double& deviation = memory.deviation[member * width + q];
        double now = own[index] - nominal[index];
        if (residual >= 0) now += learned(nominal, residual, 0);
        memory.variance[q] += (now * now - deviation * deviation) / count;
        deviation = now;
    }
    if (member + 1 < members()) return;
    for (std::size_t q = 0; q < width; ++q) {  // so that rounding errors do not accumulate
        double total = 0.0;
        for (Index k = 0; k < members(); ++k) {
            const double deviation = memory.deviation[k * width + q];
            total += deviation * deviation;
        }
        memory.variance[q] = total / count;
    }
}

/// Note the mean tensions of all cables, and what errors of clocks may add to each of them, (U13).
void Ensemble::bound_clocks() {
    const auto of_all = robot_.topology.sizes.elements;
    possible_[of_all] = 0.0;
    for (Index c = 0; c < robot_.topology.sizes.cables; ++c) {
        const auto [first, count] = std::pair(
            robot_.topology.cables[c].first_element, robot_.topology.cables[c].elements);
        double mean = 0.0, swung = 0.0;
        for (Index e = first; e < first + count; ++e) mean += draws.length_share[e] * estimate_[e];
        double &lowest = memory.swing[2 * c], &highest = memory.swing[2 * c + 1];
        lowest = std::min(lowest, mean);
        highest = std::max(highest, mean);
        const std::span<const double> gains = row(draws.offset_gain, first, axes());
        for (std::size_t a = 0; a < axes(); ++a) {
            const double part = gains[a] * memory.offset[2 * axes() + a];
            swung += part * part;
        }
        const double seen = DEVIATION * (highest - lowest);
        const double share = swung > seen * seen ? seen * seen / swung : 1.0;
        std::fill_n(possible_.begin() + first, count, share);
        possible_[of_all] = std::max(possible_[of_all], share);
    }
}

void Ensemble::take_offset(std::span<const double> offset) {
    std::ranges::copy(offset, memory.offset.begin());
    for (std::size_t q = 0; q < quantities.size(); ++q) {
        const std::span<const double> gains = row(draws.offset_gain, q, axes());
        memory.lasting[q] = quantities[q].unmodelled_variance;
        memory.late[q] = 0.0;
        for (std::size_t a = 0; a < gains.size(); ++a) {
            const double slipped_part = gains[a] * memory.offset[a];
            const double late_part = gains[a] * memory.offset[axes() + a];
            memory.lasting[q] += slipped_part * slipped_part;  // (U12)
            memory.late[q] += late_part * late_part;
        }
    }
}

void Ensemble::write_stddev(std::span<const double> nominal, std::span<double> stddev) const {
    for (std::size_t q = 0; q < quantities.size(); ++q) {
        const auto& [index, element, residual, unmodelled, slack] = quantities[q];
        const double possible = element < 0 ? possible_.back() : possible_[element];
        double total = std::max(memory.variance[q], 0.0) + memory.lasting[q];
        total += memory.late[q] * possible;  // (U13)
        if (residual >= 0) {  // (U14)
            const double more = robot_.constants.residuals[residual].variance - unmodelled;
            total += more > 0.0 ? more : more * learned(nominal, residual, 1);
        }
        total = std::max(total, memory.least_variance[q]);
        if (std::abs(nominal[index]) <= slack) total = std::max(total, slack * slack);
        stddev[q] = std::sqrt(total);
    }
}

double Ensemble::learned(std::span<const double> estimate, Index residual, Index part) const {
    const Index residuals = robot_.topology.sizes.residuals;
    return estimate.last(2 * residuals)[part * residuals + residual];
}

/// Whether an element of an estimate is INVALID; for -1, whether any element is.
bool Ensemble::is_invalid(std::span<const double> estimate, Index element) const {
    const auto elements = static_cast<std::size_t>(robot_.topology.sizes.elements);
    const std::span status = estimate.subspan(elements, elements);
    const auto invalid = [](double flags) { return (static_cast<int>(flags) & INVALID) != 0; };
    return element < 0 ? std::ranges::any_of(status, invalid) : invalid(status[element]);
}

}  // namespace cdrj

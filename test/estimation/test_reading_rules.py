"""The rules for readings of docs/estimation.md, in cases small enough to compute by hand."""

from math import exp, hypot

import numpy as np
import pytest
from support.reading_streams import take
from support.wound import robot_of

from cdrj_ros.estimation.conditioner import Conditioner
from cdrj_ros.estimation.estimator import Sample

START = 1_700_000_000_000_000_000
MS = 1_000_000
B = 0.001
"""Greatest error of a reading of every axis with a resolution [rad]."""
W = 0.001
"""Angle of the motor that changes the tension by a tenth of the preload [rad]: 1 N / 100 N/rad."""
COUNTED = robot_of(
    """
name: counted
motors: [{name: m, resolution: 0.002}]
joints: [{name: q, range: [-900, 900], resolution: 0.002, max_speed: 50}]
""",
    "m",
)

UNSTATED = robot_of(
    """
name: unstated
motors: [{name: m}]
joints: [{name: q, range: [-900, 900], max_speed: 50}]
""",
    "m",
)


class Heard:
    """A conditioner, its samples, and the stamp of the next reading."""

    def __init__(self, robot=COUNTED, mode="wait"):
        self.gate, self.samples, self.at_ms = Conditioner(robot, mode), list[Sample](), 0.0

    def hear(self, name, angle, at_ms, by_arrival=False):
        stamp = START + round(at_ms * MS)
        found = take(self.gate, "both", stamp, (name,), (angle,), by_arrival)
        self.samples += found
        return found

    def both(self, angles, every_ms=10.0):
        """Readings of the motor, with the joint at rest."""
        for angle in angles:
            take(self.gate, "both", START + round(self.at_ms * MS), ("q",), (0.0,))
            self.hear("m", angle, self.at_ms)
            self.at_ms += every_ms
        return self

    def offset(self, axis=0):
        """The standard deviation of an offset last told [rad]."""
        return [float(one.offset[0][axis]) for one in self.samples if one.offset.size][-1]

    def lag(self, axis=0):
        """The same of the lag [s]."""
        return [float(one.offset[1][axis]) for one in self.samples if one.offset.size][-1]


def level(value):
    """The next of values that are a quarter apart."""
    powers = np.exp(0.22 * np.arange(-100, 40))
    return float(powers[powers >= value * (1.0 - 1e-12)].min())


def moving(count, step=0.01, begin=0.0):
    return [begin + step * k for k in range(1, count + 1)]


# --- steps ----------------------------------------------------------------------------------------


def test_an_axis_at_rest_has_a_third_of_two_reading_errors_as_offset():
    assert Heard().both([0.0] * 30).offset() == pytest.approx(level(0.35 * 2.0 * B))


@pytest.mark.parametrize(("by", "is_step"), [(0.0102, True), (0.0098, False), (-0.0301, True)])
def test_a_displacement_is_a_step_if_no_motion_of_its_neighbours_explains_it(by, is_step):
    """At 1 rad/s the velocities before and after explain 10 mrad, (C7); what is left is in (C9)."""
    heard = Heard().both(moving(150))
    assert heard.offset() == pytest.approx(level(0.35 * 2.0 * B))
    heard.both(moving(60, begin=1.5 + by))
    assert heard.gate.displaced == ({"m": pytest.approx(by)} if is_step else {})
    # a step of more than w takes all status 0 away, from the first sample that has it
    doubtful = [bool(one.doubtful.any()) for one in heard.samples]
    assert doubtful[1:] == [False] * 149 + [is_step] * 60
    # a smaller one raises U, by 4 u / n with n = 4
    wanted = hypot(0.35 * 2.0 * B, by) if is_step else 0.35 * abs(by)
    assert heard.offset() == pytest.approx(level(wanted))


def test_a_step_exceeds_what_was_unexplained_before_by_2_5_and_counts_once_per_direction():
    heard = Heard().both(moving(150)).both(moving(50, begin=1.5 + 0.0095))
    largest = 2.5 * 0.0095
    heard.both(moving(50, begin=2.0 + 0.0095 + 0.98 * largest))
    assert heard.gate.displaced == {}
    heard = Heard().both(moving(150)).both(moving(50, begin=1.5 + 0.0095))
    heard.both(moving(50, begin=2.0 + 0.0095 + 1.02 * largest))
    assert heard.gate.displaced == {"m": pytest.approx(1.02 * largest)}
    heard.both(moving(50, begin=2.5 + 0.0095))
    assert heard.gate.displaced == {"m": pytest.approx(0.0, abs=1e-9)}
    doubtful = [bool(one.doubtful.any()) for one in heard.samples]
    assert doubtful[1:] == [False] * 199 + [True] * 51 + [False] * 49, "until both steps cancel"
    assert np.isinf(heard.samples[-49].unseen).any(), "what friction did meanwhile is unknown"


def test_before_a_radian_of_travel_a_step_is_part_of_the_offset():
    heard = Heard().both(moving(50)).both(moving(50, begin=0.5 + 0.009))
    assert heard.gate.displaced == {}
    assert heard.offset() == pytest.approx(level(0.35 * 0.009))


def test_in_longer_intervals_less_of_a_displacement_is_unexplained():
    """At rest, in an interval of 40 ms between ones of 10 ms: n = 10, so u counts 0.4 times."""
    slowing, flicker = np.cumsum([0.008, 0.006, 0.004, 0.002]), np.tile([0.0, 1e-5], 25)
    for by, is_step in ((9.7e-3, False), (10.3e-3, True)):
        heard = Heard().both(moving(150)).both(1.5 + slowing).both(1.52 + flicker)
        heard.at_ms += 30.0
        heard.both(1.52 + by + flicker)
        assert (heard.gate.displaced != {}) == is_step


def test_intervals_above_a_tenth_of_a_second_are_not_judged():
    for every_ms, found in ((99.0, True), (101.0, False)):
        heard = Heard().both(moving(150, 0.1), every_ms).both(moving(20, 0.1, 15.5), every_ms)
        assert (heard.gate.displaced != {}) == found


@pytest.mark.parametrize(("by", "refused", "is_step"), [(0.45, 4, False), (0.55, 5, True)])
def test_five_readings_that_max_speed_refuses_and_that_agree_are_a_step(by, refused, is_step):
    """At 40 rad/s the limit of 50 rad/s wins 0.1 rad on the displacement per reading."""
    heard = Heard()
    for k in range(90):
        heard.hear("m", 0.0, 10.0 * k)
        heard.hear("q", 0.4 * k + (by if k >= 50 else 0.0), 10.0 * k)
    assert heard.gate.refused["implausible"] == refused
    assert heard.gate.displaced == ({"q": pytest.approx(by)} if is_step else {})


def test_fewer_are_a_step_if_the_axis_was_never_half_as_fast():
    heard = Heard()
    for k in range(90):
        heard.hear("m", 0.0, 10.0 * k)
        heard.hear("q", 1.4 * (k >= 50), 10.0 * k)
    assert heard.gate.refused["implausible"] == 2, "1.4 rad take three intervals at 50 rad/s"
    assert heard.gate.displaced == {"q": pytest.approx(1.4)}


# --- wrong and foreign readings -------------------------------------------------------------------


def test_a_single_reading_off_the_line_is_refused_and_no_sample_has_it():
    for off, is_refused in ((0.0041, True), (0.0039, False)):
        heard = Heard().both(moving(150)).both([1.51 + off]).both(moving(50, begin=1.51))
        assert heard.gate.refused["implausible"] == is_refused
        ahead = max(
            float(one.motor_angle[0]) - 1e-9 * (one.stamp_ns - START) for one in heard.samples
        )
        assert (ahead > 0.012) == (not is_refused)


@pytest.mark.parametrize(("share", "is_refused"), [(0.4, True), (0.6, False)])
def test_the_next_reading_decides_by_half_of_the_deviation(share, is_refused):
    heard = Heard().both(moving(150)).both([1.51 + 0.05, 1.52 + share * 0.05])
    heard.both(moving(50, begin=1.52 + share * 0.05))
    assert heard.gate.refused["implausible"] == is_refused


@pytest.mark.parametrize(("count", "is_doubted"), [(6, False), (7, True)])
def test_seven_readings_out_of_range_are_foreign(count, is_doubted):
    """1 - (63/64)^7 = 0.104."""
    heard = Heard().both([0.0] * 20)
    for k in range(count):
        heard.hear("q", 1000.0, heard.at_ms + 10.0 * k)
    assert heard.gate.refused["out_of_range"] == count
    assert heard.gate.alternating == (["q"] if is_doubted else [])


def test_before_a_radian_of_travel_only_ten_errors_are_off():
    """The left side of (C8) is half the deviation in even intervals."""
    for off, every_ms, is_refused in (
        (0.021, 10.0, True),
        (0.019, 10.0, False),
        (0.021, 31.0, False),
    ):
        heard = Heard().both([0.0] * 20, every_ms).both([off], every_ms).both([0.0] * 20, every_ms)
        assert heard.gate.refused["implausible"] == is_refused


def test_a_tenth_of_foreign_readings_leaves_an_axis_in_doubt():
    """Every second reading is refused; weights fall by 1/64 per reading."""
    share, pairs = 0.0, 0
    while share <= 0.1:
        share, pairs = (share * 63.0 + 1.0) / 64.0, pairs + 1
        if share <= 0.1:
            share *= 63.0 / 64.0
    for foreign, is_doubted in ((pairs - 1, False), (pairs, True)):
        heard = Heard().both([0.0] * 20).both([0.05, 0.0] * foreign)
        assert heard.gate.refused["implausible"] == foreign
        assert heard.gate.alternating == (["m"] if is_doubted else [])


@pytest.mark.parametrize(("count", "is_doubted"), [(0.3, False), (0.8, False), (1.2, True)])
def test_counts_that_the_file_does_not_state_are_foreign_where_they_are_worth_w(count, is_doubted):
    """They make zigzags of up to one count, as two publishers that differ by so little do."""
    motion = 0.8 * np.sin(2.0 * np.pi * 0.7 * 0.005 * np.arange(1200))
    heard = Heard(UNSTATED).both((np.round(motion / (count * W)) * count * W).tolist(), 5.0)
    assert heard.gate.alternating == (["m"] if is_doubted else [])


def test_two_values_for_one_time_leave_a_doubt_that_a_hundred_good_readings_end():
    """It ends after the 103rd, as 0.1 (63/64)^102 is above a fiftieth."""
    heard = Heard().both(moving(150))
    heard.hear("m", 1.6, heard.at_ms - 10.0)
    assert heard.gate.refused["contradictory"] == 1
    heard.both(moving(102, begin=1.5))
    assert heard.gate.alternating == ["m"]
    heard.both(moving(1, begin=2.52))
    assert heard.gate.alternating == []
    doubtful = [bool(one.doubtful.any()) for one in heard.samples[1:]]
    assert sum(doubtful) == 102
    assert not doubtful[-1]
    assert np.isinf(heard.samples[-1].unseen[1][0]), "the friction history is unknown"


@pytest.mark.parametrize(("by", "cause"), [(0.0021, "contradictory"), (0.0019, "repeated")])
def test_two_values_for_one_time_differ_by_more_than_two_errors(by, cause):
    heard = Heard().both(moving(150))
    heard.hear("m", 1.5 + by, heard.at_ms - 10.0)
    assert heard.gate.refused[cause] == 1


# --- old readings ---------------------------------------------------------------------------------


@pytest.mark.parametrize("noise", [0.0, 1e-5, B])
@pytest.mark.parametrize(("count", "is_old"), [(1, False), (2, True)])
def test_readings_that_stay_where_the_axis_should_have_moved_are_old(count, is_old, noise):
    """After steps of 10 mrad, two intervals exceed 1.5 of them, 10 q = 15 mrad and 10 b, (C12)."""
    course = [0.0, *moving(61, begin=-0.0085)]
    heard = Heard().both(course).both([course[-1] - noise, course[-1]][:count])
    assert heard.gate.stuck == (["m"] if is_old else [])
    heard.both(moving(30, begin=course[-1] + 0.05))
    assert heard.gate.stuck == []
    unknown = [one for one in heard.samples if one.unseen.size and np.isinf(one.unseen).any()]
    assert len(unknown) == is_old, "moved by more than w meanwhile"
    assert heard.gate.displaced == {}


# --- motion between readings ----------------------------------------------------------------------

PLAIN = robot_of("name: plain\nmotors: [{name: m}]\njoints: [{name: q, range: [-900, 900]}]", "m")


def test_half_way_between_readings_the_deviation_follows_from_speed_and_acceleration():
    """At 0.5 rad/s and 4 Hz: A = 1.5 · 0.5 / 0.25 s after the first window, then fades in 10 s."""
    heard = Heard(PLAIN)
    for k in range(401):
        heard.hear("q", 0.0, 5.0 * k)
        if k % 50 == 0:
            heard.hear("m", 0.0025 * k, 5.0 * k)
    at = {one.stamp_ns: one.unseen for one in heard.samples}
    acceleration = 3.0 * exp(-0.5 * 7 * 0.25 / 10.0)
    stretch = acceleration * 0.25 / 0.5
    assert stretch > 1.0
    wanted = acceleration * 0.25**2 / 8.0 * stretch**2
    assert at[START + 1875 * MS][0][0] == pytest.approx(wanted, rel=1e-9)
    assert at[START + 1800 * MS][0][0] == pytest.approx(0.64 * wanted, rel=1e-9)


def test_the_motion_of_an_axis_read_too_seldom_is_what_others_show_of_it():
    """The motor goes to and fro at 1 rad/s within 0.4 s, and is worth ten of the joint, (C13)."""
    robot = robot_of(
        "name: two\nmotors: [{name: m}]\njoints: [{name: q, range: [-9, 9]}]", "m",
        "[1, {joint: q, slope: 0.01}]",
    )  # fmt: skip
    heard = Heard(robot)
    ratio = heard.gate.worth[1] / heard.gate.worth[0]
    assert ratio == pytest.approx(10.0)
    for k in range(4000):
        heard.hear("m", 0.001 * abs(k % 400 - 200), float(k))
        if k % 300 == 0:
            heard.hear("q", 0.0, float(k))
    middle = next(one for one in heard.samples if one.stamp_ns == START + 3450 * MS)
    # parts of 20 ms on both sides of a turn: A = 2 / 0.02 s, so max(V, A T) T / 3 is less
    assert middle.unseen[0][1] == pytest.approx(ratio * 100.0 * 0.3**2 / 3.0, rel=0.02)


def test_a_predicted_angle_has_the_deviation_of_the_motion_so_far():
    """At 1 rad/s in one direction, A is V / 0.1 s; 10 ms ahead, with 20 ms of velocity, (C4)."""
    heard = Heard(mode="predict")
    for k in range(40):
        heard.hear("q", 0.01 * k, 10.0 * k)
        heard.hear("m", 0.01 * k, 10.0 * k)
    heard.hear("m", 0.4, 400.0)
    (ahead,) = [one for one in heard.samples if one.stamp_ns == START + 400 * MS]
    assert ahead.predicted
    assert ahead.joint_angle[0] == pytest.approx(0.4)
    speed = (0.1 - 2.0 * B) / 0.1
    drift, noise = 0.5 * speed / 0.1 * 0.01 * 0.03, (2.0 / 3.0) ** 0.5 * B * 0.5
    assert ahead.unseen[0][1] == pytest.approx(hypot(drift, noise), rel=1e-3)


def test_a_gap_is_not_the_rate_of_a_channel():
    heard = Heard().both([0.0] * 20)
    for _ in range(2):
        heard.at_ms += 60_000.0
        heard.both([0.0] * 20)
    assert heard.gate.gaps == 4, "two for each of both axes"
    assert heard.gate.refused["future"] == 0


# --- clocks ---------------------------------------------------------------------------------------

STATED = robot_of(
    """
name: stated
uncertainty:
  others: exact
  parameters: [motors.m.clock_offset, joints.q.clock_offset]
  stddev: [0.001, 0.001]
motors: [{name: m}]
joints: [{name: q, range: [-900, 900]}]
""",
    "m",
)


@pytest.mark.parametrize(
    ("robot", "motor", "joint"),
    [(STATED, (4e-3, 1e-3), (6e-3, 1e-3)), (PLAIN, (45e-3, 0.0), (45e-3, 0.0))],
)
def test_a_clock_is_behind_by_at_most_the_wait_for_the_next_stamp_of_others(robot, motor, joint):
    """The joint is read 4 ms after the motor; values may be 45 ms old where nothing is stated."""
    heard = Heard(robot)
    for k in range(120):
        heard.hear("m", 0.0, 10.0 * k)
        heard.hear("q", 0.0, 10.0 * k + 4.0)
    for axis, (most, stated) in enumerate((motor, joint)):
        assert heard.lag(axis) == pytest.approx(level(hypot(0.35 * most, stated)))


def test_axes_of_one_message_have_one_clock():
    heard = Heard(STATED)
    for k in range(120):
        take(heard.gate, "both", START + k * 10 * MS, ("m",), (0.0,))
        heard.hear("q", 0.0, 10.0 * k)
    assert heard.lag() == pytest.approx(level(1e-3))


def test_times_of_arrival_are_as_certain_as_they_are_even():
    """One message comes 6 ms late: intervals of 10, 16 and 4 ms differ by 12 ms, (C14)."""
    for late, uneven in ((0.0, 0.0), (6.0, 12e-3)):
        heard = Heard(STATED)
        for k in range(60):
            heard.hear("m", 0.0, 10.0 * k + late * (k == 57), by_arrival=True)
            heard.hear("q", 0.0, 10.0 * k + 8.0)
        arrival = hypot(1e-3, 0.35 * uneven)
        most = 8e-3 if late == 0.0 else 2e-3
        wanted = [hypot(1e-3, 0.35 * one, arrival) for one in (8e-3, most)]
        assert any(heard.lag() == pytest.approx(level(one)) for one in wanted)


# --- what lasts -----------------------------------------------------------------------------------


def test_steps_and_motion_outlast_a_restart_and_a_tare_ends_them():
    heard = Heard().both(moving(150)).both(moving(60, begin=1.55))
    again = Heard()
    again.gate.recall(heard.gate.memory())
    again.gate.expect(np.array([2.15, 0.0]), START + round((heard.at_ms - 10.0) * MS))
    again.at_ms = heard.at_ms
    again.both(moving(20, begin=2.15))
    assert again.gate.displaced == heard.gate.displaced == {"m": pytest.approx(0.05)}
    assert again.samples[-1].doubtful.any()
    assert again.offset() == heard.offset()
    again.gate.reset(keep_turns=True)
    again.both(moving(20, begin=2.35))
    assert again.gate.displaced == {}
    assert not again.samples[-1].doubtful.any()

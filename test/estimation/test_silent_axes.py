"""An axis that is not read takes the estimates of its cables away, and no others."""

from collections import deque
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml
from support.campaign import MS, SECOND, START, course_of, judge
from support.driver_faults import Message, feed, messages_of
from support.fingers import finger, hand
from support.reading_streams import take

from cdrj_ros.estimation.changes import RestWatch
from cdrj_ros.estimation.conditioner import Conditioner, condition
from cdrj_ros.estimation.ensemble import Ensemble
from cdrj_ros.estimation.estimator import Sample, initial_state, step
from cdrj_ros.estimation.session import LiveEstimator, Options
from cdrj_ros.estimation.state_file import read_state, write_state
from cdrj_ros.evaluation.estimating import estimate, pieces_of
from cdrj_ros.evaluation.inputs import condition_recording, doubts_of, read_inputs
from cdrj_ros.evaluation.validation import Validation
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.foundation.errors import BagError, UsageError
from cdrj_ros.model.following import following_motors
from cdrj_ros.model.packing import INVALID, STALE
from cdrj_ros.model.prepared import prepare
from cdrj_ros.recordings.recording import Recording, Topics
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.simulation import motion

LAW = 0.001
"""Greatest share of tensions with status 0 beyond five standard deviations."""
CEASES, RETURNS = 2.0, 3.5
"""When the axes are read no longer, and when they are again [s]."""
SILENT = 0.25
"""Longest silence in which the others wait [s]."""
UNREAD = {
    "a joint": ["c_mcp"],
    "the last joint": ["c_pip"],
    "a motor": ["c_motor0"],
    "a driver": ["c_mcp", "c_pip", "c_motor0", "c_motor1"],
}


@pytest.fixture(scope="module")
def five():
    """Five fingers that are exactly known."""
    document = dict(hand(*(finger(name) for name in "abcde")).document)
    known = {**document, "uncertainty": {"others": "exact"}}
    return prepare(parse_robot(yaml.safe_dump(known, sort_keys=False)))


@pytest.fixture(scope="module")
def courses(five):
    """Each joint moves at a frequency of its own; by the least of them [Hz]."""

    def angle(hertz, time):
        return np.column_stack(
            [0.5 + motion.sine(0.3, hertz * (1.0 + 0.05 * k))(time) for k in range(10)]
        )

    return cache(lambda hertz: course_of(five, 6.0, lambda time: angle(hertz, time)))


def without(axes, begin_s, end_s=np.inf):
    """Messages that do not name some axes for a while."""

    def spoil(messages):
        found = []
        for message in messages:
            kept = [
                (name, value)
                for name, value in zip(message.names, message.positions, strict=True)
                if name not in axes or not begin_s <= (message.stamp_ns - START) * 1e-9 < end_s
            ]
            found.append(Message(message.stamp_ns, *map(tuple, zip(*kept, strict=True))))
        return found

    return spoil


def over(five, axes):
    """Elements of the cables that lead over some axes."""
    return five.touched[[axis.name in axes for axis in five.robot.axes]].any(axis=0)


def digits(output, elements):
    """All that is said of some elements."""
    numbers = (output.status, output.tension, output.stddev[: len(elements)])
    return [part[elements].tobytes() for part in numbers]


def status_of(outputs):
    """Of all outputs, as flags, and their times [s]."""
    flags = np.array([one.status for one in outputs]).astype(int)
    return flags, np.array([(one.stamp_ns - START) * 1e-9 for one in outputs])


@pytest.mark.parametrize("what", UNREAD)
@pytest.mark.parametrize("hertz", [50, 1000])
@pytest.mark.parametrize("moves", [0.3, 3.0])
def test_cables_over_an_axis_that_ceases_are_stale_and_others_keep_every_digit(
    moves, hertz, what, five, courses
):
    course, own = courses(moves), over(five, UNREAD[what])
    messages = messages_of(five, course, hertz)
    clean = feed(five, messages)
    outputs = feed(five, without(UNREAD[what], CEASES, RETURNS)(messages))
    assert [one.stamp_ns for one in outputs] == [one.stamp_ns for one in clean]
    assert [digits(one, ~own) for one in outputs] == [digits(one, ~own) for one in clean]
    flags, time = status_of(outputs)
    gone = (time >= CEASES) & (time < RETURNS)
    assert np.all(flags[gone][:, own] & STALE)
    assert not np.any(flags[~gone] & (STALE | INVALID) * (time < CEASES)[~gone, None])
    held = np.array([one.tension for one in outputs])[:, own]
    assert np.all(held[gone] == held[gone][0])
    verdict = judge(course, outputs)
    assert np.mean(verdict.ratio > 5.0) <= LAW
    if (moves, hertz) != (3.0, 50):  # where nothing has status 0 in any case
        assert np.mean(flags[time > RETURNS + 0.5][:, own] == 0) > 0.9


@pytest.mark.parametrize("what", UNREAD)
def test_cables_over_an_axis_that_is_never_read_have_no_number(what, five, courses):
    """The others do not wait for it for more than a second; then it may still come."""
    own, messages = over(five, UNREAD[what]), messages_of(five, courses(0.3), 200)
    clean = feed(five, messages)
    outputs = feed(five, without(UNREAD[what], 0.0)(messages))
    others = ~over(five, UNREAD["a driver"])
    assert [digits(one, others) for one in outputs] == [digits(one, others) for one in clean]
    assert [digits(one, ~own)[:2] for one in outputs] == [digits(one, ~own)[:2] for one in clean]
    assert all(np.all(one.status[own] == INVALID) for one in outputs)
    assert all(np.all(one.tension[own] == 0.0) for one in outputs)
    late = feed(five, without(UNREAD[what], 0.0, CEASES)(messages))
    assert np.mean(judge(courses(0.3), late).ratio > 5.0) <= LAW
    assert np.mean([one.status[own] == 0 for one in late[-200:]]) > 0.9


def test_others_wait_for_a_quarter_of_a_second_once(five, courses):
    live, lags = LiveEstimator(five), []
    for message in without(UNREAD["a joint"], CEASES)(messages_of(five, courses(0.3), 200)):
        live.feed("both", message.stamp_ns, message.names, message.positions)
        lags.append((message.stamp_ns - live.last_ns) * 1e-9)
    assert SILENT - 0.01 < max(lags) <= SILENT
    assert lags[-1] == 0.0
    assert list(live.conditioner.silent) == ["c_mcp"]
    silent = 6.0 - 0.005 - (CEASES - 0.005)
    assert live.conditioner.silent["c_mcp"] * 1e-9 == pytest.approx(silent, abs=0.011)
    with pytest.raises(UsageError, match="no reading of c_mcp arrives"):
        live.tare()


def test_a_driver_whose_clock_lags_is_waited_for(five, courses):
    """It is read all the time, only its stamps are behind; or its messages come late."""
    messages = messages_of(five, courses(0.3), 200)
    own = [k for k, name in enumerate(messages[0].names) if name.startswith("c_")]
    late = 100  # messages, half a second
    live, outputs = LiveEstimator(five), []
    for k, message in enumerate(messages):
        others = [k for k in range(20) if k not in own]
        parts = [(message, others)] + ([(messages[k - late], own)] if k >= late else [])
        for one, chosen in parts:
            names = [one.names[i] for i in chosen]
            values = [one.positions[i] for i in chosen]
            outputs += live.feed("both", one.stamp_ns, names, values)[1]
    assert not live.conditioner.silent
    flags, _ = status_of(outputs)
    assert not np.any(flags & (STALE | INVALID))


def recorded(five, messages):
    """Readings of motors and of joints, by name."""
    found = []
    for names in (five.layout.motors, five.layout.joints):
        read = {}
        for name in names:
            there = [one for one in messages if name in one.names]
            stamps = np.array([one.stamp_ns for one in there])
            values = np.array([one.positions[one.names.index(name)] for one in there])
            read |= {name: Series(stamps, stamps, values)} if there else {}
        found.append(read)
    return found


def test_a_recording_gives_what_the_node_gave(five, courses):
    messages = without(UNREAD["a driver"], CEASES, RETURNS)(messages_of(five, courses(0.3), 200))
    live = feed(five, messages)
    found = estimate(five, condition(five.robot, *recorded(five, messages)), uncertainty=True)
    assert found.stamp_ns.tolist() == [one.stamp_ns for one in live]
    assert found.values.tobytes() == np.array([one.values for one in live]).tobytes()
    assert found.stddev.tobytes() == np.array([one.stddev for one in live]).tobytes()


@pytest.mark.parametrize("begin", [0.0, CEASES])
def test_a_validation_compares_what_is_known(begin, five, courses):
    course, own = courses(0.3), over(five, UNREAD["a driver"])
    messages = without(UNREAD["a driver"], begin)(messages_of(five, course, 200))
    motors, joints = recorded(five, messages)
    stamps = START + 5 * MS * np.arange(len(messages))
    references = {
        f"tension/{name}": Series(stamps, stamps, column)
        for name, column in zip(five.layout.elements, course.tension[::5].T, strict=True)
    }
    recording = Recording(
        Path("bag"), int(stamps[0]), int(stamps[-1]), motors, joints, references, {}, ()
    )
    if begin == 0.0:
        with pytest.raises(BagError, match="no motor named c_motor0, c_motor1"):
            read_inputs(recording, Topics(), five)
    read = read_inputs(recording, Topics(), five, whole=False)
    assert (begin == 0.0) == any("c_motor0" in note for note in read.notes)
    conditioned = condition_recording(five, read)
    assert not doubts_of(five, conditioned)
    validation = Validation(five, "bag", read, conditioned)
    for _ in validation.compare(pieces_of(five, conditioned.segments[0], uncertainty=True)):
        pass
    for k, channel in enumerate(validation.result({}).channels):
        known = round(200 * begin) if own[k] else len(messages)
        assert channel.estimate.size == known, channel.name
        assert np.abs(channel.estimate - channel.reference).max(initial=0.0) < 1.0


@pytest.mark.parametrize("what", ["a driver", "the last joint"])
def test_sensors_go_on_to_correct_the_other_fingers(what, five, courses):
    """What they last said of the finger is in doubt in all of its cables."""
    course, messages = courses(0.3), messages_of(five, courses(0.3), 200)
    own = over(five, UNREAD["a driver"])

    def heard(messages):
        live, found = LiveEstimator(five), []
        for k, message in enumerate(messages):
            live.feed_efforts(message.stamp_ns, five.layout.motors, course.effort[5 * k])
            found += live.feed("both", message.stamp_ns, message.names, message.positions)[1]
        return found

    right = heard(messages)
    wrong = heard(without(UNREAD[what], CEASES, RETURNS)(messages))
    flags, time = status_of(wrong)
    assert not np.any(flags[(time >= CEASES) & (time < RETURNS)][:, own] == 0)
    assert [digits(one, ~own) for one in wrong] == [digits(one, ~own) for one in right]
    assert np.mean(judge(course, wrong).ratio > 5.0) <= LAW
    assert np.mean([one.status[own] == 0 for one in wrong[-200:]]) > 0.9


@pytest.mark.parametrize("late_ms", [0, 60, 150])
@pytest.mark.parametrize("ends", [2.3, 3.0])
def test_readings_from_a_silence_say_nothing_after_it(ends, late_ms, five, courses):
    """Load cells are not compared with tensions that the model did not have then."""
    course, live, found = courses(0.3), LiveEstimator(five), []
    cells = [part.stop - 1 for part in five.robot.parts]
    names = [five.layout.elements[k] for k in cells]
    at_ms = range(2, 6000 - late_ms, 10)
    waiting = deque((START + (k + late_ms) * MS, k) for k in at_ms)
    for message in without(UNREAD["a joint"], CEASES, ends)(messages_of(five, course, 200)):
        while waiting and waiting[0][0] <= message.stamp_ns:
            _, k = waiting.popleft()
            live.feed_tensions(START + k * MS, names, course.tension[k][cells], [0.1] * len(cells))
        found += live.feed("both", message.stamp_ns, message.names, message.positions)[1]
    assert live.report().message.startswith("agrees with the robot file")
    assert np.mean(judge(course, found).ratio > 5.0) <= LAW
    own, last = over(five, UNREAD["a driver"]), found[-200:]
    assert np.mean([one.status[own] == 0 for one in last]) > 0.5


def test_a_tare_is_refused_where_an_axis_is_first_read_in_motion(five, courses):
    live = LiveEstimator(five)
    for message in without(UNREAD["a driver"], 0.0, RETURNS)(messages_of(five, courses(3.0), 200)):
        if message.stamp_ns > START + round((RETURNS + 0.06) * SECOND):
            break
        live.feed("both", message.stamp_ns, message.names, message.positions)
    with pytest.raises(UsageError, match=r"at rest for 0.3 s; so far there are readings of 0.06"):
        live.tare()


def test_what_is_not_a_number_is_not_at_rest(five):
    motor, joint = np.zeros(len(five.layout.motors)), np.zeros(len(five.layout.joints))
    unread = Sample(0, np.full(motor.shape, np.nan), joint)
    watch = RestWatch([unread, *(Sample(k * 10 * MS, motor, joint) for k in range(1, 31))])
    assert watch.in_motion(five.robot).startswith("not at rest: a_motor0 moved by nan rad")


def test_predictions_go_on_without_the_axis(five, courses):
    messages = without(UNREAD["a joint"], CEASES)(messages_of(five, courses(0.3), 200))
    own = over(five, UNREAD["a joint"])
    joints = [message.names[10:] for message in messages]
    live, outputs = LiveEstimator(five, Options(conditioning="predict")), []
    for message, names in zip(messages, joints, strict=True):
        count = len(message.names) - len(names)
        for chosen in (slice(0, count), slice(count, None)):
            part = message.names[chosen], message.positions[chosen]
            outputs += live.feed("both", message.stamp_ns, *part)[1]
    last = [one for one in outputs if one.stamp_ns > START + 3 * SECOND]
    assert len(last) > 590
    assert all(np.all(one.status[own].astype(int) & STALE) for one in last)
    assert np.mean(judge(courses(0.3), outputs).ratio > 5.0) <= LAW
    assert np.mean([one.status[~own] == 0 for one in last]) > 0.9


def test_no_prediction_knows_an_axis_that_the_sample_before_it_did_not(five, courses):
    """What an encoder did in its silence is in the standard deviations from that sample on."""
    conditioner, last, predicted = Conditioner(five.robot, "predict"), None, 0
    for message in without(UNREAD["a driver"], 0.5, RETURNS)(messages_of(five, courses(0.3), 200)):
        for letter, later_ns in zip("abdec", range(5), strict=True):
            chosen = [k for k, name in enumerate(message.names) if name[0] == letter]
            names, values = ([of[k] for k in chosen] for of in message[1:])
            for sample in take(conditioner, "both", message.stamp_ns + later_ns, names, values):
                if sample.predicted:
                    predicted += 1
                    assert not np.any(np.isnan(last.angles) & ~np.isnan(sample.angles))
                else:
                    last = sample
    assert predicted > 1000
    assert not np.isnan(last.angles).any()


def test_what_a_gap_leaves_open_outlasts_a_prediction_made_in_it(five, courses):
    ensemble, state, rows = Ensemble(five), initial_state(five), courses(0.3).angle[:60]
    samples = [Sample(START + k * MS, row[:10], row[10:]) for k, row in enumerate(rows)]
    for sample in samples[:-1]:
        state, _ = ensemble.step(state, sample)
    ensemble.predict(samples[-1], step(five, state, samples[-1])[1])
    ensemble.show_at_least(np.full(10, 3.0))
    _, found = ensemble.step(state, samples[-1])
    assert found.tension_stddev.min() > 2.5


def joints_later(messages, later_s):
    """Messages of motors and of joints; a finger ceases, and its joints return after its motors."""
    found = []
    for k, returns in enumerate((RETURNS, RETURNS + later_s)):
        gone = UNREAD["a driver"][2:] if k == 0 else UNREAD["a driver"][:2]
        for message in without(gone, CEASES, returns)(messages):
            chosen = [
                (name, value)
                for name, value in zip(message.names, message.positions, strict=True)
                if ("motor" in name) == (k == 0)
            ]
            found.append(Message(message.stamp_ns, *map(tuple, zip(*chosen, strict=True))))
    return sorted(found, key=lambda message: message.stamp_ns)


@pytest.mark.parametrize("later", [0.005, 0.5])
def test_axes_of_a_cable_that_return_one_after_another_leave_nothing_open(later, five, courses):
    """What was known before is compared once all are read, by a recording too."""
    own = over(five, UNREAD["a driver"])
    messages = joints_later(messages_of(five, courses(0.3), 200), later)
    live = feed(five, messages)
    assert np.mean(judge(courses(0.3), live).ratio > 5.0) <= LAW
    assert np.mean([one.status[own] == 0 for one in live[-200:]]) > 0.9
    found = estimate(five, condition(five.robot, *recorded(five, messages)), uncertainty=True)
    assert found.values.tobytes() == np.array([one.values for one in live]).tobytes()
    assert found.stddev.tobytes() == np.array([one.stddev for one in live]).tobytes()


@pytest.mark.parametrize("slip", [0.003, 0.006, -0.006])
def test_a_slip_in_a_gap_is_seen_although_other_axes_of_the_cable_are_late(slip, five, courses):
    """They are read all the time, but arrive at once, after the slipped axis has returned."""
    slipped, late, burst = "c_mcp", [*UNREAD["a driver"][1:]], 3.8
    arrivals = []
    for message in messages_of(five, courses(0.3), 200):
        time = (message.stamp_ns - START) * 1e-9
        read = dict(zip(message.names, message.positions, strict=True))
        if CEASES <= time < RETURNS:
            del read[slipped]
        elif time >= RETURNS:
            read[slipped] += slip
        delayed = {name: read.pop(name) for name in late}
        arrivals.append((time, message.stamp_ns, read))
        arrivals.append((burst if 3.0 <= time < burst else time, message.stamp_ns, delayed))
    live, outputs = LiveEstimator(five), []
    for _, stamp_ns, read in sorted(arrivals, key=lambda one: one[:2]):
        outputs += live.feed("both", stamp_ns, [*read], [*read.values()])[1]
    assert np.mean(judge(courses(0.3), outputs).ratio > 5.0) <= LAW


def test_slips_in_two_gaps_add_up_although_another_cable_waits_for_ever(five, courses):
    """One joint of a finger returns, the other never does; a joint of another slips twice."""

    def changes(*dead):
        messages = without(["a_mcp"], 0.5, 1.0)(messages_of(five, courses(0.3), 200))
        live = LiveEstimator(five)
        for message in without(dead, 0.5)(messages):
            time = (message.stamp_ns - START) * 1e-9
            read = dict(zip(message.names, message.positions, strict=True))
            read["c_mcp"] += 0.001 * ((time >= CEASES) + (time >= 4.0))
            if CEASES <= time < 2.5 or 4.0 <= time < 4.5:
                del read["c_mcp"]
            output = live.feed("both", message.stamp_ns, [*read], [*read.values()])[1]
        return output[-1].stddev[: len(five.layout.elements)]

    own = over(five, ["c_mcp"])
    assert changes("a_pip")[own].tobytes() == changes()[own].tobytes()


@pytest.mark.parametrize("slip", [0.0, 0.003, 0.006, -0.006])
@pytest.mark.parametrize("suspends", [False, True])
@pytest.mark.parametrize("what", ["a joint", "a driver"])
def test_a_restart_while_an_axis_is_silent_keeps_its_last_estimate_open(
    what, suspends, slip, tmp_path, five, courses
):
    """The encoder slips meanwhile; the difference is in the standard deviation.

    The new run waits for all axes for a second, then goes on without it.
    """
    messages, returns = messages_of(five, courses(0.3), 200), 4.2
    own, live, outputs = over(five, UNREAD[what]), LiveEstimator(five), []
    for k, message in enumerate(without(UNREAD[what], CEASES, returns)(messages)):
        if 500 <= k < 540:
            continue
        if k == 540 and suspends:
            live.suspend()
        elif k == 540:
            write_state(live, tmp_path / "state")
            live = LiveEstimator(five)
            read_state(live, tmp_path / "state")
        read = dict(zip(message.names, message.positions, strict=True))
        if message.stamp_ns >= START + returns * SECOND:
            read["c_mcp"] += slip
        outputs += live.feed("both", message.stamp_ns, [*read], [*read.values()])[1]
    assert np.mean(judge(courses(0.3), outputs).ratio > 5.0) <= LAW
    last = np.array([one.status for one in outputs[-200:]])
    assert np.mean(last[:, ~own] == 0) > 0.9
    assert slip or np.mean(last[:, own] == 0) > 0.9


def test_a_driver_that_hangs_leaves_no_axis_believed_that_rests_since(five):
    """It may publish every finger in a message of its own: those at rest may move unseen."""
    table = np.linspace(0.2, 0.8, 201)
    motors = following_motors(five, np.tile(table[:, None], 10))[:, :2]
    live, outputs = LiveEstimator(five), []
    for k in range(400):
        for name in "abcde":
            at = 0.5 + 0.3 * np.sin(0.02 * min(k, 200 if name == "a" else 70))
            followed = [float(np.interp(at, table, motor)) for motor in motors.T]
            names = [f"{name}_{one}" for one in ("motor0", "motor1", "mcp", "pip")]
            stamp = START + 5 * k * MS + ord(name)
            outputs += live.feed("both", stamp, names, [*followed, at, at])[1]
    assert live.conditioner.stuck
    flags, _ = status_of(outputs[-500:])
    assert not np.any(flags == 0)

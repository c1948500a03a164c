"""Motions without readings: gaps, turns, steps of a sensor, unsolved cables."""

from copy import deepcopy
from io import BytesIO
from math import pi
from pathlib import Path

import numpy as np
import pytest
from support.places import ROBOT

from cdrj_ros._core import MAX_GAP_NS
from cdrj_ros.estimation.conditioner import condition
from cdrj_ros.estimation.estimator import Sample, Samples
from cdrj_ros.estimation.session import LiveEstimator, Options
from cdrj_ros.estimation.state_file import (
    HEADER,
    StateFileError,
    read_state,
    with_checksum,
    write_state,
)
from cdrj_ros.evaluation.estimating import estimate
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.packing import INVALID, UNSURE
from cdrj_ros.model.prepared import load_model, prepare
from cdrj_ros.robot.reader import build_robot

START = 1_700_000_000 * 10**9
MS = 1_000_000
UNFILTERED = Options(tracking=0.0)
"""Without tracking filters, whose state is lost when a process restarts."""


@pytest.fixture(scope="module")
def readings():
    """Five seconds at 1 kHz: the joint by 0.6 rad, the winch by more than half a turn."""
    time = 0.001 * np.arange(5000)
    elbow = 0.6 * np.sin(2.0 * time)
    winch = 8.0 * np.sin(elbow) + 0.02 * (1.0 - np.cos(7.0 * time))
    return Samples(START + MS * np.arange(5000), winch[:, None], elbow[:, None])


def variant(model, change):
    """The robot with another document."""
    document = deepcopy(dict(model.robot.document))
    change(document)
    return prepare(build_robot(document, "test"))


def send(live, readings, k, begin=0):
    stamp = begin or int(readings.stamp_ns[k])
    outputs = live.feed("joints", stamp, ("elbow",), readings.joint_angle[k])[1]
    return outputs + live.feed("motors", stamp, ("winch",), readings.motor_angle[k])[1]


def paused(readings, at):
    """The same motion with a rest of 0.4 s before the reading ``at``, where a tare is possible."""
    k = np.arange(readings.stamp_ns.size)
    rest = np.where(k < at - 400, k, np.maximum(k - 400, at - 400))
    return Samples(readings.stamp_ns, readings.motor_angle[rest], readings.joint_angle[rest])


def all_unsure(output):
    return bool(np.all(output.status.astype(int) & UNSURE))


# -- gaps --------------------------------------------------------------------------------------


def test_there_are_no_estimates_for_the_silence_of_one_topic(model, readings):
    """The joint moves out and back while only the motor has readings."""
    live = LiveEstimator(model)
    before = [output for k in range(1000) for output in send(live, readings, k)]
    stamps = readings.stamp_ns
    for k in range(1000, 4000):
        assert not live.feed("motors", int(stamps[k]), ("winch",), readings.motor_angle[k])[1]
    outputs = [output for k in range(4000, 5000) for output in send(live, readings, k)]
    assert live.conditioner.gaps == 1
    assert live.conditioner.refused == dict.fromkeys(live.conditioner.refused, 0)
    first = outputs[0]
    assert first.stamp_ns == stamps[4000]
    assert len(before) + len(outputs) == 2000
    spread, before_it = (np.mean(np.square(one[:16])) for one in (first.stddev, before[-1].stddev))
    assert spread > 1.7 * before_it

    motors = {"winch": Series(stamps, stamps, readings.motor_angle[:, 0])}
    heard = np.r_[0:1000, 4000:5000]
    joints = {"elbow": Series(stamps[heard], stamps[heard] - 1, readings.joint_angle[heard, 0])}
    offline = estimate(model, condition(model.robot, motors, joints), uncertainty=True)
    assert np.array_equal(offline.stamp_ns, [o.stamp_ns for o in before + outputs])
    node = np.array([output.tension for output in before + outputs])
    assert np.array_equal(offline.values[:, model.layout.tension], node)
    assert np.array_equal(offline.stddev[:1000], [output.stddev for output in before])
    after = np.array([output.stddev for output in outputs])
    assert (after >= offline.stddev[1000:]).all(), "the node doubts what has changed unseen"


def test_a_gap_without_motion_keeps_the_history(model, readings):
    live = LiveEstimator(model)
    outputs = [output for k in range(1000) for output in send(live, readings, k)]
    known = outputs[-1].stddev
    late = int(readings.stamp_ns[999]) + 5 * MAX_GAP_NS
    for k in range(10):
        outputs += send(live, readings, 999, late + k * MS)
    assert len(outputs) == 1010
    assert np.mean(outputs[-1].stddev[:16]) < 1.2 * np.mean(known[:16])


# -- turns -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def turning(model):
    """A robot whose winch sensor wraps after one turn."""
    return variant(model, lambda document: document["motors"][0].update(period=2.0 * pi))


def wrapped(readings, by=0.0):
    """Winch readings wrapped to -pi to pi, of a motor that has turned further."""
    motor = readings.motor_angle + by
    return Samples(
        readings.stamp_ns, motor - 2.0 * pi * np.round(motor / (2.0 * pi)), readings.joint_angle
    )


ACTIONS = {
    "reset": lambda live: live.reset(),
    "set_preload": lambda live: live.set_preload({"upper": 30.0}),
    "tare": lambda live: live.tare(),
}


@pytest.mark.parametrize("action", ACTIONS)
def test_turns_are_still_counted_after_every_change(action, model, turning, readings):
    """The result equals that of a sensor without wrap, more than a turn from the reference."""
    far = 7.0
    here = {"motors": lambda d: d["motors"][0].update(reference_angle=far)}["motors"]
    plain, period = variant(model, here), variant(turning, here)
    resting = paused(readings, 1500)
    there = Samples(resting.stamp_ns, resting.motor_angle + far, resting.joint_angle)
    one, other = LiveEstimator(plain), LiveEstimator(period)
    wrapping, compared = wrapped(there), 0
    assert np.ptp(wrapping.motor_angle - there.motor_angle) > 0.0
    for k in range(3000):
        if k == 1500:
            ACTIONS[action](one)
            ACTIONS[action](other)
        for expected, got in zip(send(one, there, k), send(other, wrapping, k), strict=True):
            assert np.allclose(got.tension, expected.tension, atol=1e-6)
            compared += 1
    assert compared == 3000


# -- steps of a sensor -------------------------------------------------------------------------


def stepping(model):
    return variant(model, lambda document: document["motors"][0].update(max_speed=20.0))


def test_a_step_that_stays_is_followed_and_makes_everything_unsure(model, readings):
    """The sensor loses counts of half a radian, 25 ms of motion at the motor's maximum speed."""
    live = LiveEstimator(stepping(model))
    readings = paused(readings, 2200)
    for k in range(1500):
        outputs = send(live, readings, k)
    assert not all_unsure(outputs[0])
    jumped = Samples(readings.stamp_ns, readings.motor_angle + 0.5, readings.joint_angle)
    outputs = [output for k in range(1500, 2200) for output in send(live, jumped, k)]
    conditioner = live.conditioner
    assert conditioner.steps == 1
    assert 10 <= conditioner.refused["implausible"] <= 30
    assert conditioner.displaced == {"winch": pytest.approx(0.5, abs=0.05)}
    after = [o for o in outputs if o.stamp_ns > readings.stamp_ns[1530]]
    assert len(after) > 150
    assert all(map(all_unsure, after))
    live.tare()
    outputs = [output for k in range(2200, 4500) for output in send(live, jumped, k)]
    assert conditioner.displaced == {}
    assert not all_unsure(outputs[-1])


# -- unsolved cables ---------------------------------------------------------------------------


def test_an_unsolved_cable_does_not_affect_the_others(model):
    """The robot's two cables, each on its own motor, one of them wound in entirely."""

    def change(document):
        document["motors"].append({**document["motors"][0], "name": "second"})
        for cable, motor in zip(document["cables"], ("winch", "second"), strict=True):
            for node in cable["nodes"]:
                if "motor" in node:
                    node["motor"] = motor

    two = variant(model, change)
    elements = two.layout.elements
    upper = [k for k, name in enumerate(elements) if name.startswith("upper")]
    lower = [k for k, name in enumerate(elements) if name.startswith("lower")]
    good, bad = LiveEstimator(two), LiveEstimator(two)
    far = 500.0 * np.sign(_winding_in(two))
    for k in range(100):
        stamp, turn = START + k * MS, 0.002 * k
        sample = Sample(stamp, np.array([turn, turn]), np.array([0.0]))
        expected = good.take(sample)
        got = bad.take(sample._replace(motor_angle=np.array([turn, turn + far])))
        status = got.status.astype(int)
        assert not got.solved
        assert np.all(status[lower] & INVALID)
        assert not np.any(status[upper] & INVALID)
        assert np.allclose(got.stddev[upper], expected.stddev[upper], rtol=1e-6)
        assert got.stddev[upper].min() > 0.0
    back = bad.take(Sample(START + 100 * MS, np.array([0.2, 0.2]), np.array([0.0])))
    assert back.solved
    assert back.stddev[lower].min() > 0.0


def _winding_in(model):
    """Direction in which the second motor winds the second cable in."""
    live = LiveEstimator(model, Options(uncertainty=False))
    still = Sample(START, np.zeros(2), np.zeros(1))
    live.take(still)
    turned = Sample(START + MS, np.array([0.0, 0.01]), np.zeros(1))
    output = live.take(turned)
    last = len(model.layout.elements) // 2
    return 1.0 if output.tension[last] > model.robot.cables[1].preload else -1.0


# -- changes persist across processes ----------------------------------------------------------


def test_reference_and_preloads_that_were_set_are_in_the_state_file(turning, readings, tmp_path):
    """As is the turn of an encoder that wraps, in which the robot rests."""
    path, model = tmp_path / "state", turning
    live = LiveEstimator(model, UNFILTERED)
    assert np.abs(readings.motor_angle[:900]).max() > pi
    readings = wrapped(paused(readings, 500))
    for k in range(500):
        send(live, readings, k)
    live.tare()
    live.set_preload({"lower": 20.0})
    assert write_state(live, path)
    at_once = LiveEstimator(model, UNFILTERED)
    assert "cables.lower.preload = 20" in read_state(at_once, path)
    for k in range(500, 900):
        expected = send(live, readings, k)
    write_state(live, path)
    again = LiveEstimator(model, UNFILTERED)
    assert "cables.lower.preload = 20" in read_state(again, path)
    for k in range(900, 1000):
        expected, got = send(live, readings, k), send(again, readings, k)
        assert np.array_equal(got[0].tension, expected[0].tension)
    for one in (at_once, again):
        assert np.array_equal(one.model.constants, live.model.constants)
        assert one.model.robot.motors == live.model.robot.motors
    write_state(again, path)
    assert read_state(LiveEstimator(model, UNFILTERED), path)  # and the restart after that one


def test_the_state_file_takes_every_name_of_a_motor(tmp_path):
    """Names in messages may contain a slash, a dot and spaces."""
    path, text = tmp_path / "state", Path(ROBOT).read_text(encoding="utf-8")
    name = "left/winch no.1"
    named = text.replace("name: winch", f"name: {name}").replace("motor: winch", f"motor: {name}")
    (tmp_path / "robot.yaml").write_text(named, encoding="utf-8")
    model = load_model(str(tmp_path / "robot.yaml"))
    live = LiveEstimator(model)
    for k in range(400):
        live.feed("motors", START + k * MS, (name,), (0.8,))
        live.feed("joints", START + k * MS, ("elbow",), (0.1,))
    live.tare()
    assert write_state(live, path)
    again = LiveEstimator(model)
    assert f"motors.{name}.reference_angle = 0.8" in read_state(again, path)
    assert again.model.robot.motors[0].reference_angle == 0.8


def test_a_state_file_with_other_friction_restores_the_reference_but_not_the_state(
    model, readings, tmp_path
):
    path = tmp_path / "state"
    live = LiveEstimator(model)
    for k in range(200):
        send(live, readings, k)
    live.set_preload({"lower": 20.0})
    live.set_numbers({"friction.mu_c": 0.05})
    for k in range(200, 400):
        send(live, readings, k)
    write_state(live, path)
    again = LiveEstimator(model)
    with pytest.raises(StateFileError, match=r"lower.preload = 20 taken up; .* other friction"):
        read_state(again, path)
    assert again.model.robot.cables[1].preload == 20.0
    fresh = LiveEstimator(load_model(ROBOT, "36.85,20"))
    expected, got = send(fresh, readings, 400), send(again, readings, 400)
    assert np.array_equal(got[0].values, expected[0].values)


def arrays_in(path):
    with np.load(BytesIO(path.read_bytes().removeprefix(HEADER)[32:])) as file:
        return {name: file[name] for name in file.files}


def rewrite(path, arrays):
    """Write a state file with a checksum that fits."""
    buffer = BytesIO()
    np.savez(buffer, **arrays)
    path.write_bytes(with_checksum(buffer.getvalue()))


@pytest.mark.parametrize(
    "changes",
    [
        b"[1, 2]", b"nothing", b'{"friction.mu_c": 0.1}', b'{"cables.lower.preload": NaN}',
        b'{"cables.none.preload": 3}', b'{"cables.lower.preload": "x"}',
        b'{"motors.winch.reference_angle": 1e300}', b'{"name": "x"}', b"7", b"\xff",
        b"[" * 100_000 + b"]" * 100_000,
    ],
)  # fmt: skip
def test_changes_that_no_service_makes_are_refused(model, readings, tmp_path, changes):
    path = tmp_path / "state"
    live = LiveEstimator(model)
    for k in range(10):
        send(live, readings, k)
    write_state(live, path)
    rewrite(path, arrays_in(path) | {"changes": np.frombuffer(changes, np.uint8)})
    again = LiveEstimator(model)
    with pytest.raises(StateFileError, match="no usable changes"):
        read_state(again, path)
    assert again.model is again.started


@pytest.mark.usefixtures("few_members")
def test_a_state_file_with_other_arrays_is_refused_in_a_line_or_leaves_the_estimate_defined(
    model, readings, tmp_path
):
    path = tmp_path / "state"
    live = LiveEstimator(model)
    for k in range(50):
        live.feed_tensions(int(readings.stamp_ns[k]), ("upper/8",), (30.0 + 0.01 * k,), (0.1,))
        send(live, readings, k)
    write_state(live, path)
    arrays = arrays_in(path)
    lines = []
    for name, own in arrays.items():
        nested = np.frombuffer(b"[" * 100_000 + b"]" * 100_000, np.uint8)
        others = [np.float64(1.0), np.zeros((2, 2, 2)), np.array("x"), nested]
        others += [np.zeros(own.shape, "M8[ns]")]
        others += [np.full(own.shape, value, own.dtype) for value in (255, 2**62)[: own.itemsize]]
        others += [np.full(own.shape, value) for value in (-1.0, 1e308, np.nan)]
        for other in others:
            rewrite(path, arrays | {name: other})
            again = LiveEstimator(model)
            with np.errstate(all="ignore"):
                try:
                    read_state(again, path)
                except StateFileError as error:
                    lines.append(str(error))
                (output,) = send(again, readings, 50)
            assert np.isfinite(output.values).all(), name
    assert len(lines) > 70
    assert not any("\n" in line for line in lines)


# -- times -------------------------------------------------------------------------------------


@pytest.mark.parametrize("offset", [0.0, 0.3, -0.3])
def test_a_motors_efforts_are_moved_by_its_clock_offset(model, readings, offset):
    late = variant(model, lambda document: document["motors"][0].update(clock_offset=offset))
    live = LiveEstimator(late)
    for k in range(300):
        stamp = int(readings.stamp_ns[k])
        motor = stamp - round(offset * 1e9)
        live.feed("joints", stamp, ("elbow",), readings.joint_angle[k])
        live.feed_efforts(motor, ("winch",), (0.1,))
        live.feed("motors", motor, ("winch",), readings.motor_angle[k])
    (group,) = live.corrections.groups
    assert group.beliefs.core.heard(0)[1] >= 5
    assert live.corrections.refused == live.readings.overlooked == 0


# -- a tare is for a robot at rest -------------------------------------------------------------


def test_a_tare_is_refused_until_the_axes_have_rested_long_enough(model, readings):
    live = LiveEstimator(model)
    count = model.robot.motors[0].sensor.resolution
    for k in range(301):
        if k < 300:
            stamp = START + k * MS
            live.feed("joints", stamp, ("elbow",), (0.1,))
            live.feed("motors", stamp, ("winch",), (0.8 + count * (k % 2),))  # one count of jitter
            with pytest.raises(UsageError, match=r"at rest for 0\.3 s"):
                live.tare()
    live.feed("joints", START + 300 * MS, ("elbow",), (0.1,))
    live.feed("motors", START + 300 * MS, ("winch",), (0.8,))
    assert "winch 0.8" in live.tare()


# -- damage -----------------------------------------------------------------------------------


def begun(model, readings):
    live = LiveEstimator(model)
    for k in range(10):
        send(live, readings, k)
    return live


@pytest.mark.usefixtures("few_members")
def test_a_state_file_with_any_bit_flipped_is_refused_by_name(model, readings, tmp_path):
    path, live = tmp_path / "state", begun(model, readings)
    write_state(live, path)
    content = path.read_bytes()
    again = LiveEstimator(model)
    generator = np.random.default_rng(0)
    ends = range(8 * 120)
    for bit in (*ends, *generator.integers(0, 8 * len(content), 400).tolist()):
        with path.open("r+b") as file:
            file.seek(bit // 8)
            file.write(bytes([content[bit // 8] ^ 1 << bit % 8]))
        with pytest.raises(StateFileError, match=r"state is (damaged|not a state file)"):
            read_state(again, path)
        with path.open("r+b") as file:
            file.seek(bit // 8)
            file.write(content[bit // 8 : bit // 8 + 1])
    assert path.read_bytes() == content
    assert "continues from" in read_state(again, path)


@pytest.mark.usefixtures("few_members")
def test_a_file_that_is_no_state_file_is_not_replaced(model, readings, tmp_path):
    """As the robot file, given by mistake; an empty file and one of an earlier version are."""
    path, live = tmp_path / "state", begun(model, readings)
    path.write_text("name: arm\n")
    with pytest.raises(StateFileError, match="state is not a state file, and is not replaced"):
        write_state(live, path)
    assert path.read_text() == "name: arm\n"
    for content in (b"", b"cdrj_ros state 3\n"):
        path.write_bytes(content)
        assert write_state(live, path)
        assert path.stat().st_size > 1000

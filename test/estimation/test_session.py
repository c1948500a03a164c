"""The live estimator: other sensors, changes at run time, rest, and restarts."""

import os
from dataclasses import replace

import numpy as np
import pytest
from support.campaign import CELL
from support.places import ROBOT

from cdrj_ros.estimation import state_file
from cdrj_ros.estimation.changes import REST_STEP_NS, RestWatch, reference_at
from cdrj_ros.estimation.estimator import Sample, Samples, initial_state, run
from cdrj_ros.estimation.sensors import Reading
from cdrj_ros.estimation.session import LiveEstimator, Options
from cdrj_ros.estimation.state_file import StateFileError, read_state, write_state
from cdrj_ros.evaluation.estimating import pieces_of
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.packing import INVALID
from cdrj_ros.model.prepared import load_model, prepare
from cdrj_ros.robot.reader import parse_robot


@pytest.fixture(scope="module")
def readings(model, recorded):
    """Recorded angles of six cycles, at 100 Hz."""
    return recorded(model, 15)


def _sample(readings, k):
    return Sample(
        int(readings.stamp_ns[k]), readings.motor_angle[k].copy(), readings.joint_angle[k].copy()
    )


def test_positions_of_a_joint_that_slides_are_told_in_metres():
    hoist = load_model("hoist")
    samples = [Sample(k * REST_STEP_NS, np.zeros(1), np.array([0.001 * k])) for k in range(100)]
    words = reference_at(hoist, samples[9]).words
    assert words.startswith("reference is now motor winch 0 rad, joint load 0.009 m;")
    said = RestWatch(samples).in_motion(hoist.robot)
    assert said.startswith("not at rest: load moved by ")
    assert said.count(" m ") == 2
    assert " rad" not in said


def test_late_load_cell_readings_are_compared_with_the_estimate_of_their_time(model, readings):
    late, true = 5, load_model(ROBOT, "35,26.26")  # by 5 %: the file does not contradict the cell
    tension = run(true, initial_state(true), readings)[1].tension[:, 7]
    live = LiveEstimator(model)
    errors = []
    for k in range(2500):
        if k >= late:
            stamp, said = int(readings.stamp_ns[k - late]), float(tension[k - late])
            live.feed_tensions(stamp, [CELL], [said], [0.05])
        errors.append(live.take(_sample(readings, k)).tension[7] - tension[k])
    assert errors[0] > 1.5
    assert np.abs(errors[200:]).mean() < 0.3
    assert live.corrections.refused <= late, "only those from before the first sample"
    assert live.corrections.right[CELL] > 0.99


def test_a_sensor_that_is_ignored_changes_nothing(model, readings):
    live = LiveEstimator(model, Options(ignored_sensors=("winch",)))
    live.feed_efforts(int(readings.stamp_ns[0]), ["winch"], [1e6])
    output = live.take(_sample(readings, 0))
    plain = LiveEstimator(model).take(_sample(readings, 0))
    assert np.array_equal(output.values, plain.values)
    with pytest.raises(UsageError, match="ignored_sensors names no sensor of the robot: wnch"):
        LiveEstimator(model, Options(ignored_sensors=("wnch",)))


@pytest.mark.parametrize(("turn", "ok"), [(0.0, True), (0.1, True), (20.0, False)])
def test_a_tension_that_no_such_cable_carries_is_not_ok_without_a_max_tension(turn, ok):
    """A cable of EA 8000 N on a drum of 10 mm; 20 rad of it, a gear left out, make 4000 N."""
    anchor = "{type: anchor, position: [0.4, 0.0]}"
    winch = "{type: winch, motor: m, winding: 1, radius_mm: 10, position: [0, 0], turn: cw}"
    robot = parse_robot(
        f"""
        name: lift
        motors: [{{name: m}}]
        joints: []
        frames: []
        friction: {{mu_c: 0.1}}
        uncertainty: {{others: exact}}
        cables: [{{name: c, axial_stiffness: 8000, preload: 20, nodes: [{winch}, {anchor}]}}]
        """
    )
    model = prepare(robot)
    live, stamps = LiveEstimator(model), 10**9 + 10_000_000 * np.arange(100)
    for stamp in stamps.tolist():
        _, found = live.feed("both", stamp, ["m"], [turn])
    assert (found[-1].status == 0).all() == ok
    readings = Samples(stamps, np.full((100, 1), turn), np.empty((100, 0)))
    (recorded,) = pieces_of(model, readings, uncertainty=True)
    assert (recorded.values[-1, model.layout.status] == 0).all() == ok


def test_an_effort_counts_by_the_noise_of_its_motor_in_the_robot_file(model):
    (motor,) = model.robot.motors
    robot = replace(model.robot, motors=(replace(motor, effort_noise=0.5),))
    live, stamp = LiveEstimator(prepare(robot)), 10**9
    live.feed_efforts(stamp, ["winch"], [0.3])
    assert list(live.readings.due(stamp)) == [Reading(stamp, "winch", 0.3, 0.5)]


def test_without_standard_deviations_no_sensor_is_used(model, readings):
    live = LiveEstimator(model, Options(uncertainty=False))
    live.feed_tensions(int(readings.stamp_ns[0]), [CELL], [10.0], [0.05])
    live.take(_sample(readings, 0))
    assert live.corrections is None


def test_efforts_that_are_no_numbers_are_not_heard(model, readings):
    live = LiveEstimator(model)
    live.feed_efforts(int(readings.stamp_ns[0]), ["winch"], [float("nan")])
    live.take(_sample(readings, 0))
    assert live.corrections is None
    assert live.readings.refused == 1


def test_bad_load_cells_are_counted_and_change_nothing(model, readings):
    live, plain = LiveEstimator(model), LiveEstimator(model)
    for k in range(50):
        stamp = int(readings.stamp_ns[k])
        for one in (live, plain):  # both have heard a sensor
            one.feed_tensions(stamp - 10**12, ["lower/1"], [10.0], [])
        live.feed_tensions(stamp, ["upper/8"], [float("nan")], [])
        live.feed_tensions(stamp, ["upper/9"], [10.0], [])
        live.feed_tensions(stamp, ["upper/8"], [10.0, 11.0], [])
        live.feed_tensions(stamp - 10**12, ["upper/7"], [10.0], [])
        live.feed_tensions(stamp + 10**12, ["upper/6"], [10.0], [])
        assert np.array_equal(
            live.take(_sample(readings, k)).values,
            plain.take(_sample(readings, k)).values,
        )
    assert live.readings.unknown == live.readings.refused == 50
    assert live.conditioner.refused["malformed"] == 50
    assert live.corrections.right == {}


@pytest.mark.usefixtures("few_members")
def test_whatever_load_cells_say_every_tension_that_is_solved_is_a_number(model, readings):
    live, generator = LiveEstimator(model), np.random.default_rng(2)
    said = np.array([30.0, np.nan, np.inf, 1e308, -1e308, 5e-324, 0.0, -5.0])
    noises = np.array([0.5, np.nan, 1e-300, 1e300, -1.0, 0.0])
    times = np.array([-(10**9), -(10**7), 0, 10**9 // 3, 10**13])
    for k in range(1500):
        names = [str(generator.choice(["upper/8", "lower/3", "upper/99", ""]))] * (k % 3)
        stamp = int(readings.stamp_ns[k]) + int(generator.choice(times))
        tension = generator.choice(said, len(names))
        live.feed_tensions(stamp, names, tension, generator.choice(noises, len(names)))
        estimate = live.take(_sample(readings, k))
        assert (estimate.tension[estimate.status.astype(int) & INVALID == 0] >= 0.0).all()
    assert estimate.solved


def test_a_restart_with_a_state_file_continues_without_a_difference(
    model, readings, tmp_path, monkeypatch
):
    path = tmp_path / "state"
    live = LiveEstimator(model)
    for k in range(1500):
        live.take(_sample(readings, k))
    assert write_state(live, path)
    for days, said in ((1.2, "1 days before"), (-1.2, "1 days after"), (0.9, "")):
        now = live.state.stamp_ns + round(days * 86400e9)
        monkeypatch.setattr(state_file, "time_ns", lambda now=now: now)
        again = LiveEstimator(model)
        words = read_state(again, path)
        assert words.startswith(f"continues from {path}")
        assert said in words
        assert ("estimate is" in words) == bool(said)
    for k in range(1500, 1700):
        one, other = live.take(_sample(readings, k)), again.take(_sample(readings, k))
        assert np.array_equal(one.values, other.values)
        # the change of pose over the restart may be a slip
        assert np.allclose(one.stddev, other.stddev, rtol=1e-2)
    assert [p.name for p in tmp_path.iterdir()] == ["state"]  # no temporary file is left


def test_a_state_file_of_another_robot_is_refused_in_a_line(model, readings, tmp_path):
    path = tmp_path / "state"
    live = LiveEstimator(model)
    for k in range(10):
        live.take(_sample(readings, k))
    write_state(live, path)
    other = LiveEstimator(load_model(ROBOT, "30,20"))
    with pytest.raises(StateFileError) as caught:
        read_state(other, path)
    assert "\n" not in str(caught.value)
    fresh = LiveEstimator(other.model).take(_sample(readings, 10)).values
    assert np.array_equal(other.take(_sample(readings, 10)).values, fresh)


def test_a_pipe_is_neither_read_nor_written_as_a_state_file(model, readings, tmp_path):
    """Both would wait for ever."""
    os.mkfifo(tmp_path / "state")
    live = LiveEstimator(model)
    live.take(_sample(readings, 0))
    for use in (read_state, write_state):
        with pytest.raises(StateFileError, match="it is not a regular file"):
            use(live, tmp_path / "state")


def test_without_a_state_file_nothing_is_restored(model, tmp_path):
    assert read_state(LiveEstimator(model), tmp_path / "none") == ""
    assert not write_state(LiveEstimator(model), tmp_path / "none")


def test_set_preload_restarts_from_the_measured_angles(model, readings):
    live = LiveEstimator(model)
    for k in range(500):
        live.take(_sample(readings, k))
    words = live.set_preload({"upper": 30.0, "lower": 26.26})
    assert "upper: 36.85 N, now 30 N" in words
    assert "lower" not in words, "it does not change"
    expected = LiveEstimator(load_model(ROBOT, "30,26.26"))
    for k in range(500, 520):
        one, other = live.take(_sample(readings, k)), expected.take(_sample(readings, k))
        assert np.array_equal(one.values, other.values)


def test_a_reading_that_alternates_between_three_counts_is_at_rest(model):
    robot = model.robot
    count = robot.motors[0].sensor.resolution * abs(robot.motors[0].sensor.scale)
    assert count > 0.0
    for middle in range(1000, 1100):
        for most, is_at_rest in ((1, True), (2, False)):
            watch = RestWatch()
            for k in range(32):
                motor = np.array([count * (middle + (-1) ** k * most)])
                watch.add(Sample(k * REST_STEP_NS, motor, np.zeros(len(robot.joints))))
            assert (watch.in_motion(robot) == "") == is_at_rest

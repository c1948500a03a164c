"""Sensor errors of the requested size, and groups of sensors that read a truth as it comes."""

from dataclasses import replace

import numpy as np
import pytest
from support.reading_streams import take

from cdrj_ros.estimation.conditioner import Conditioner
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.description import Sensor
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.simulation.faults import Freeze
from cdrj_ros.simulation.sensors import (
    JOINT_ENCODER,
    CellGroup,
    Encoder,
    LoadCells,
    Messages,
    ReadingTimes,
    SensorSettings,
    counted,
    encoder_groups,
    truth_table,
)

ENCODER = Encoder(counts=16_384, rate=1000.0)
STEP = 2.0 * np.pi / ENCODER.counts
LONG = np.arange(20_001) / 1000.0
SWING = 0.5 * np.sin(LONG)


def _generator():
    return np.random.default_rng(5)


def _read(encoder):
    noise = _generator().normal(0.0, encoder.noise, SWING.size)
    return counted(encoder, SWING, noise, Sensor())


def schedule(sensor, end, seed=5):
    return ReadingTimes(sensor, [seed]).until(end)


def test_every_reading_is_a_whole_number_of_counts():
    for encoder in (ENCODER, replace(ENCODER, noise=3e-3, bias=0.01)):
        read = _read(encoder)
        counts = read / STEP
        np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)


def test_without_counts_of_their_own_encoders_count_as_the_robot_file_states():
    sensor = Sensor(scale=0.001, resolution=0.01)  # published in mm
    read = counted(JOINT_ENCODER, SWING, 0.0, sensor)
    np.testing.assert_allclose(read / 0.01, np.round(read / 0.01), atol=1e-6)
    assert np.diff(np.unique(read)).min() == pytest.approx(0.01)
    np.testing.assert_array_equal(
        counted(replace(JOINT_ENCODER, counts=100), SWING, 0.0, sensor),
        counted(replace(JOINT_ENCODER, counts=100), SWING, 0.0, Sensor(scale=0.001)),
    )


def test_noise_and_bias_have_the_requested_size():
    encoder = replace(ENCODER, noise=2e-3, bias=0.01)
    error = _read(encoder) - SWING
    assert error.mean() == pytest.approx(0.01, abs=1e-4)
    assert error.std() == pytest.approx(np.hypot(2e-3, STEP / np.sqrt(12.0)), rel=0.03)


def test_jitter_moves_stamps_and_keeps_their_order():
    for jitter in (1e-4, 1e-2):
        encoder = replace(ENCODER, jitter=jitter)
        plan = schedule(encoder, 20.0)
        np.testing.assert_array_equal(plan.times, LONG)
        assert np.all(np.diff(plan.stamps) > 0.0)
        off = plan.stamps - plan.times
        assert off.std() == pytest.approx(jitter, rel=0.03) if jitter < 1e-3 else off.std() > 2e-4


def test_the_requested_share_of_readings_is_lost_and_steps_lose_the_same_ones():
    encoder = replace(ENCODER, jitter=1e-4, dropout=0.1, phase=3e-4)
    plan = schedule(encoder, 100.0)
    assert plan.times.size == pytest.approx(90_000, rel=0.01)
    count = (plan.times - 3e-4) * 1000.0
    np.testing.assert_allclose(count, np.round(count), atol=1e-6)
    stepped = ReadingTimes(encoder, [5])
    parts = [stepped.until(k / 1000.0) for k in range(1001)]
    stamps = np.concatenate([part.stamps for part in parts])
    np.testing.assert_array_equal(stamps, plan.stamps[: stamps.size])
    assert np.any(schedule(encoder, 1.0, 6).stamps[:500] != stamps[:500])


def test_a_reading_with_a_period_starts_again_and_stays_within_it():
    sensor = Sensor(period=1.0)
    angle = 2.0 * LONG / LONG[-1]
    read = counted(ENCODER, angle, 0.0, sensor)
    assert np.abs(read).max() <= 0.5 + STEP
    assert np.count_nonzero(np.abs(np.diff(read)) > 0.5) == 2
    assert np.abs(np.unwrap(read, period=1.0) - angle).max() <= 0.5 * STEP + 1e-12


TIME = np.arange(4_001) / 1000.0
ANGLE = np.stack([np.sin(3.0 * TIME), 0.3 * TIME, 0.2 * TIME, np.cos(TIME)], axis=1)
"""Angles of two motors and two joints [rad]."""
SPEED = np.stack([3.0 * np.cos(3.0 * TIME), 0.3 + 0 * TIME, 0.2 + 0 * TIME, -np.sin(TIME)], axis=1)
EFFORT = 1.0 + ANGLE
TENSION = np.stack([30.0 + TIME, 20.0 - TIME, *(10.0 + 0 * TIME,) * 4], axis=1)
TRUTH = truth_table(ANGLE, SPEED, EFFORT, TENSION)

NOISY = Encoder(counts=2**22, rate=1000.0, noise=1e-3, jitter=1e-4, dropout=0.1)


def model_of(**motor):
    """A finger whose first motor has a sensor of its own."""
    cable = """
          - name: {name}
            axial_stiffness: 5000
            preload: 20
            nodes:
              - {{type: winch, motor: m{name}, radius_mm: 8, winding: 1}}
              - {{type: pulley, radius_mm: 8, wrap_angle_deg: 90}}
              - {{type: pulley, radius_mm: 8, wrap_angle_deg: 90}}
              - {{type: anchor}}
            spans: [0.1, [{{joint: j1, offset_mm: 50, slope_mm: 8}}, {{joint: j2}}], 0.1]
    """
    entry = ", ".join(f"{key}: {value}" for key, value in {"name": "ma", **motor}.items())
    return prepare(parse_robot(
        f"""
        name: two
        motors: [{{{entry}}}, {{name: mb}}]
        joints: [{{name: j1, range: [-2, 2]}}, {{name: j2, range: [-2, 2]}}]
        friction: {{mu_c: 0.1}}
        cables:
        """
        + cable.format(name="a") + cable.format(name="b")
    ))  # fmt: skip


MODEL = model_of()


def in_steps(group):
    """What a group reads of the truth step by step."""
    parts = [group.take(TIME[k : k + 1], TRUTH[k : k + 1]) for k in range(TIME.size)]
    columns = zip(*parts, strict=True)
    return Messages(*(None if column[0] is None else np.concatenate(column) for column in columns))


@pytest.mark.parametrize("update_rate", [None, 400.0])
def test_a_truth_in_steps_gives_the_readings_of_the_whole(update_rate):
    settings = SensorSettings(
        replace(NOISY, rate=700.0),
        Encoder(counts=4096, rate=300.0, phase=0.0004, noise=1e-3), 0.01,
        update_rate=update_rate, faults=(Freeze(1.5, "j1"),),
    )  # fmt: skip
    whole, stepwise = (encoder_groups(MODEL, settings, 3) for _ in range(2))
    assert [group.kind for group in whole] == (["all"] if update_rate else ["motors", "joints"])
    for one, other in zip(whole, stepwise, strict=True):
        read = one.take(TIME, TRUTH)
        for once, steps in zip(read, in_steps(other), strict=True):
            assert (once is None) == (steps is None)
            if once is not None:
                np.testing.assert_array_equal(once, steps)
        assert read.stamps.size > 1000
        still = np.ptp(read.position[read.stamps > 1.5], axis=0) == 0.0
        assert [name for name, at in zip(one.names, still, strict=True) if at] == (
            ["j1"] if "j1" in one.names else []
        )


def test_messages_of_a_broadcaster_have_all_axes_at_one_rate_with_speeds_and_efforts():
    model = model_of(scale=-0.02, offset=0.3)
    (group,) = encoder_groups(model, SensorSettings(effort_noise=0.0, update_rate=500.0), 0)
    read = group.take(TIME, TRUTH)
    assert group.names == ("ma", "mb", "j1", "j2")
    np.testing.assert_allclose(np.diff(read.stamps), 0.002, rtol=1e-9)
    np.testing.assert_allclose(-0.02 * read.position[:, 0] + 0.3, ANGLE[::2, 0], atol=1e-4)
    np.testing.assert_allclose(-0.02 * read.velocity[:, 0], SPEED[::2, 0], atol=1e-12)
    np.testing.assert_allclose(read.effort[:, :2], EFFORT[::2, :2], atol=1e-4)
    assert np.isnan(read.effort[:, 2:]).all(), "the joints have no drives"


def test_a_message_has_the_axes_of_one_clock():
    model = model_of(clock_offset=0.25)
    groups = encoder_groups(model, SensorSettings(), 0)
    assert [(one.names, one.clock_offset_ns) for one in groups] == [
        (("ma",), 250_000_000), (("mb",), 0), (("j1", "j2"), 0),
    ]  # fmt: skip
    with pytest.raises(UsageError, match="one clock_offset"):
        encoder_groups(model, SensorSettings(update_rate=500.0), 0)


def test_corrected_readings_are_the_true_angles():
    """The estimator's own conversion undoes what the simulated sensor does."""
    correction = "{angle: [-1.0, -0.4, 0.3, 1.1], value: [0.05, -0.1, 0.2, -0.02]}"
    model = model_of(scale=-0.5, offset=0.1, period=3.0, correction=correction)
    (motors, _) = encoder_groups(model, SensorSettings(Encoder(counts=2**24, rate=1000.0)), 0)
    read = motors.take(TIME, TRUTH)
    conditioner = Conditioner(model.robot)
    found = []
    for stamp, row in zip(read.stamps, read.position, strict=True):
        stamp_ns = 10**9 + round(stamp * 1e9)
        take(conditioner, "joints", stamp_ns, ["j1", "j2"], np.zeros(2))
        found += [
            s.motor_angle[0] for s in take(conditioner, "motors", stamp_ns, motors.names, row)
        ]
    assert len(found) > 3_990
    np.testing.assert_allclose(found, ANGLE[: len(found), 0], atol=1e-6)
    uncorrected = -0.5 * np.unwrap(read.position[:, 0], period=3.0) + 0.1
    assert np.abs(uncorrected - ANGLE[:, 0]).max() > 0.09, "the correction is not negligible"


def test_a_frozen_encoder_repeats_its_last_reading_until_a_restart():
    faults = (Freeze(0.1, "ma"), Freeze(3.0, "mb"))
    group, _ = encoder_groups(MODEL, SensorSettings(faults=faults), 0)
    read = group.take(TIME[:2_000], TRUTH[:2_000]).position
    assert np.ptp(read[100:, 0]) == 0.0
    assert read[100, 0] == pytest.approx(ANGLE[99, 0], abs=1e-3)
    assert np.ptp(read[:, 1]) > 0.5
    group.restart(2.0)
    read = group.take(TIME[2_000:], TRUTH[2_000:]).position
    assert np.ptp(read[:100, 0]) > 0.01
    assert np.ptp(read[100:, 0]) == 0.0, "0.1 s after the restart"
    assert np.ptp(read[:, 1]) > 0.5, "3 s after the restart"
    with pytest.raises(UsageError, match="an encoder must be one of ma, mb, j1, j2, got 'thumb'"):
        encoder_groups(MODEL, SensorSettings(faults=(Freeze(0.0, "thumb"),)), 0)


def test_load_cells_read_the_truth_with_their_noise_and_resolution():
    cells = LoadCells(rate=100.0, bias=0.5)
    settings = SensorSettings(elements=("b/1", "a/2"), load_cells=cells)
    stamps, values = CellGroup(MODEL, settings, 1).take(TIME, TRUTH)
    assert stamps.size == 401
    error = values - np.stack([10.0 + 0.0 * stamps, 20.0 - stamps], axis=1)
    assert error.mean() == pytest.approx(0.5, abs=0.003)
    assert error.std() == pytest.approx(0.02, rel=0.1)
    np.testing.assert_array_equal(values * 128.0, np.round(values * 128.0))
    with pytest.raises(UsageError, match=r"must be one of a/1, .* got 'a/9'"):
        CellGroup(MODEL, SensorSettings(elements=("a/9",)), 1)

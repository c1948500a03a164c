"""A cable depends on the axes and the numbers on its path, and on nothing else: so do costs."""

from dataclasses import replace

import numpy as np
import pytest
from support.fingers import WRIST, finger, hand

from cdrj_ros.estimation.encoderless import EncoderlessEstimator
from cdrj_ros.estimation.ensemble import MEMBERS, Ensemble
from cdrj_ros.estimation.estimator import Sample, Samples, initial_state, run
from cdrj_ros.estimation.model_error import load_share, offset_gain
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import build_robot

START_NS = 1_700_000_000 * 10**9
NAMES = "abcd"
DRUM, MCP, PIP = 0.006, 0.008, 0.006
"""Radii of drums and of the pulleys on both axes of a finger [m]."""


def fingers(count):
    return prepare(hand(*(finger(name) for name in NAMES[:count])))


def angles(model, angle):
    """All joints at the same angles [rad], motors that keep up with them; (n, axes)."""
    far = (MCP + PIP) / DRUM * angle
    motors = [
        far if name.endswith("motor0") else MCP / DRUM * angle for name in model.layout.motors
    ]
    joints = [(name != "wrist") * angle for name in model.layout.joints]  # which slackens cables
    return np.stack([*motors, *joints], axis=1)


def feed(model, rate, rows):
    """The steps of cables that every sample takes after the first one."""
    live = LiveEstimator(model)
    core, taken = live.ensemble.core, []
    for k, row in enumerate(rows):
        before = core.cable_steps
        live.feed(
            "both",
            START_NS + round(k * 1e9 / rate),
            (*model.layout.motors, *model.layout.joints),
            row,
        )
        taken.append(core.cable_steps - before)
    return taken[taken.index(MEMBERS * len(model.robot.cables)) + 1 :], live


@pytest.mark.parametrize("rate", [1000.0, 500.0, 100.0, 50.0])
@pytest.mark.parametrize("frequency", [0.2, 1.0, 3.0])
def test_a_hand_takes_the_steps_that_its_fingers_take_alone(rate, frequency):
    time = np.arange(0.0, 0.6 if rate > 100.0 else 1.5, 1.0 / rate)
    angle = 0.5 + 0.4 * np.sin(2.0 * np.pi * frequency * time)
    alone = []
    for name in NAMES[:4]:
        model = prepare(hand(finger(name)))
        alone.append(feed(model, rate, angles(model, angle))[0])
    model = fingers(4)
    taken, _ = feed(model, rate, angles(model, angle))
    assert taken == np.sum(alone, axis=0).tolist()
    if rate >= 500.0 or frequency <= 1.0:
        cables = len(model.robot.cables)
        assert max(taken) <= 4 * cables, "only the member in turn, and where axes have turned"


def test_a_cable_that_slips_on_moves_no_member_between_two_readings():
    """Friction follows a path without a reversal to its ends, however exact the numbers are."""
    known = {"uncertainty": {"others": "exact", "drums": "hold"}}
    model = prepare(build_robot({**hand(finger("a")).document, **known}, "hand"))
    phase = 2.0 * np.pi * np.arange(0.0, 2.0, 0.01)
    taken, _ = feed(model, 100.0, angles(model, 0.5 + 0.4 * np.sin(phase)))
    walked = np.array(taken) > MEMBERS
    turning = np.abs(np.cos(phase[-len(taken) :])) < 0.25
    assert walked[turning].any()
    assert not walked[~turning].any()


def test_what_loads_may_stretch_the_cables_of_a_finger_is_its_own():
    one, three = (load_share(fingers(count)) for count in (1, 3))
    assert set(three.ravel()) == set(one.ravel())


def samples(model, count, unseen):
    """A slow motion at 100 Hz; the last sample has deviations midway, by axis [rad]."""
    axes, motors = len(model.robot.axes), len(model.robot.motors)
    rows = angles(model, 0.5 + 0.1 * np.sin(0.05 * np.arange(count)))
    found = [Sample(START_NS + k * 10**7, r[:motors], r[motors:]) for k, r in enumerate(rows)]
    deviations = np.zeros((2, axes))
    for axis, deviation in unseen.items():
        deviations[1, axis] = deviation
    return [*found[:-1], found[-1]._replace(unseen=deviations)]


def followed(model, unseen):
    """Standard deviations at the last of some samples, and the steps of cables it took."""
    ensemble, state = Ensemble(model), initial_state(model)
    stddev, before = np.empty(0), 0
    for sample in samples(model, 30, unseen):  # without a turning point
        before = ensemble.core.cable_steps
        state, estimate = ensemble.step(state, sample)
        stddev = estimate.stddev
    return stddev, ensemble, ensemble.core.cable_steps - before


def test_small_deviations_move_no_member_and_enter_the_variance_through_their_gain():
    model = fingers(2)
    plain, _, steps = followed(model, {})
    motor, joint = 2, len(model.robot.motors) + 2
    deviations = {motor: 2e-4, joint: 1e-4}
    widened, _, same = followed(model, deviations)
    assert same == steps == len(model.robot.cables)
    gain = offset_gain(model)
    expected = sum((gain[:, axis] * size) ** 2 for axis, size in deviations.items())
    assert expected.max() > 1e-4
    np.testing.assert_allclose(widened**2 - plain**2, expected, rtol=1e-6, atol=1e-12)


def test_large_deviations_are_walked_by_the_cables_on_whose_path_the_axis_lies_alone():
    model = prepare(hand(finger("a", "palm"), finger("b", "palm"), **WRIST))
    plain, _, _ = followed(model, {})
    joints = {name: len(model.robot.motors) + k for k, name in enumerate(model.layout.joints)}
    # one that stretches a cable by more than it carries lets its members start anew, in one step
    given = [("a_pip", 0.025, 1, 4), ("a_pip", 0.05, 1, 1)]
    given += [("a_mcp", 0.05, 2, 1), ("wrist", 0.05, 4, 1)]
    for name, size, cables, walk in given:
        stddev, ensemble, steps = followed(model, {joints[name]: size})
        assert steps == walk * MEMBERS * cables + len(model.robot.cables)
        touched = np.abs(stddev / plain - 1.0) > 1e-6
        own = [one.startswith("a") or cables == 4 for one in model.layout.elements]
        assert not np.any(touched[: len(own)] & ~np.array(own)), "a measured wrist joins no cables"
        assert touched[: len(own)].any()
        assert (ensemble.core.stamps == START_NS + 29 * 10**7).all(axis=0).sum() == cables


def test_efforts_of_walked_cables_follow_from_their_tensions():
    """The rest is that the drums of the members differ in their radii."""
    model = fingers(1)
    joint = len(model.robot.motors)
    _, ensemble, _ = followed(model, {joint: 0.05, joint + 1: 0.05})
    elements, pulleys = len(model.layout.elements), len(model.layout.pulleys)
    tensions = ensemble.deviation[:, :elements]
    efforts = ensemble.deviation[:, elements + pulleys :]
    first = [k for k, name in enumerate(model.layout.elements) if name.endswith("/1")]
    for motor, element in enumerate(first):
        torque = -DRUM * tensions[:, element]
        assert np.corrcoef(efforts[:, motor], torque)[0, 1] > 0.98
        assert np.std(efforts[:, motor]) == pytest.approx(np.std(torque), rel=0.1)


@pytest.mark.parametrize("drums", [{}, {"b_0": "hold", "b_1": "hold"}])
@pytest.mark.parametrize("rate", [500.0, 20.0])
def test_an_unrelated_finger_changes_no_bit_of_the_others(rate, drums):
    """Whether it moves fast, has no path, drums that may slip, or is not there at all."""
    time = np.arange(0.0, 0.3 + 10.0 / rate, 1.0 / rate)
    slow, fast = 0.5 + 0.3 * np.sin(3.0 * time), 0.5 + 0.45 * np.sin(60.0 * time)
    known = {"uncertainty": {"drums": drums}}
    alone, both = (
        prepare(build_robot({**hand(*fingers).document, **known}, "hand"))
        for fingers in ([finger("b")], [finger("a"), finger("b")])
    )
    other, calm = angles(prepare(hand(finger("a"))), fast), angles(alone, slow)
    motors = len(alone.robot.motors)
    rows = np.concatenate(
        [other[:, :motors], calm[:, :motors], other[:, motors:], calm[:, motors:]], axis=1
    )
    far = rows.copy()
    far[10:, 0] += 1e4  # all of a cable is wound in
    expected = results(alone, rate, calm)
    for hand_rows in (rows, far):
        found = results(both, rate, hand_rows)
        for name, values in expected.items():
            np.testing.assert_array_equal(found[name], values, err_msg=name)


def results(model, rate, rows):
    """Tensions, forces and efforts with standard deviations at all samples, by name."""
    live, layout = LiveEstimator(model), model.layout
    names = (*layout.motors, *layout.joints)
    found = []
    for k, row in enumerate(rows):
        found += live.feed("both", START_NS + round(k * 1e9 / rate), names, row)[1]
    columns = [*layout.elements, *(f"force {name}" for name in layout.pulleys), *names]
    values = np.array([one.values[live.ensemble.columns] for one in found])
    stddev = np.array([one.stddev for one in found])
    assert len(found) > 10
    status = np.array([one.status for one in found])
    return (
        dict(zip(columns, values.T, strict=True))
        | {f"deviation of {name}": one for name, one in zip(columns, stddev.T, strict=True)}
        | {f"status of {name}": one for name, one in zip(layout.elements, status.T, strict=True)}
    )


def without_encoder(*names):
    """Fingers whose outer joints have no encoder."""
    robot = hand(*(finger(name) for name in names))
    joints = [replace(one, measured=not one.name.endswith("pip")) for one in robot.joints]
    return prepare(replace(robot, joints=tuple(joints)))


def test_an_unrelated_finger_changes_no_bit_of_joints_without_encoder():
    alone, both = without_encoder("b"), without_encoder("a", "b")
    time = 0.002 * np.arange(60)
    slow, fast = 0.5 + 0.3 * np.sin(3.0 * time), 0.5 + 0.4 * np.sin(20.0 * time)
    other, calm = angles(prepare(hand(finger("a"))), fast), angles(prepare(hand(finger("b"))), slow)
    stamps = START_NS + 2_000_000 * np.arange(60)
    efforts = np.stack(
        [-0.07 + 0.01 * np.sin(5.0 * time), -0.07 + 0.02 * np.cos(5.0 * time)], axis=1
    )

    def estimated(model, motor, joint, effort):
        found = EncoderlessEstimator(model).run(Samples(stamps, motor, joint), effort)
        own = [k for k, name in enumerate(model.layout.elements) if name.startswith("b")]
        return (
            found.angles.value[:, -1], found.angles.stddev[:, -1],
            found.values[:, own], found.stddev[:, own],
        )  # fmt: skip

    expected = estimated(alone, calm[:, :2], calm[:, 2:3], efforts)
    assert np.ptp(expected[0]) > 0.01
    beside = estimated(
        both,
        np.concatenate([other[:, :2], calm[:, :2]], axis=1),
        np.concatenate([other[:, 2:3], calm[:, 2:3]], axis=1),
        np.concatenate([2.0 * efforts, efforts], axis=1),
    )
    for found, one in zip(beside, expected, strict=True):
        np.testing.assert_array_equal(found, one)


def test_chosen_cables_run_alone_and_their_shares_of_efforts_add_up():
    model = fingers(2)
    angle = 0.4 + 0.4 * np.sin(np.linspace(0.0, 6.0, 200))
    rows, motors = angles(model, angle), len(model.layout.motors)
    stamps = START_NS + 5_000_000 * np.arange(len(rows))
    samples = Samples(stamps, rows[:, :motors].copy(), rows[:, motors:].copy())
    whole = run(model, initial_state(model), samples)[1]
    shares = []
    for c, cable in enumerate(model.robot.cables):
        chosen = np.arange(len(model.robot.cables)) == c
        alone = run(model, initial_state(model), samples, chosen=chosen)[1]
        own = np.isin(model.layout.elements, cable.element_names)
        np.testing.assert_array_equal(alone.tension[:, own], whole.tension[:, own])
        assert not alone.tension[:, ~own].any()
        shares.append([alone.joint_effort, alone.motor_effort])
    for all_together, parts in zip(
        (whole.joint_effort, whole.motor_effort), zip(*shares, strict=True), strict=True
    ):
        np.testing.assert_allclose(sum(parts), all_together, rtol=1e-12, atol=1e-15)
    assert np.ptp(whole.joint_effort) > 0.01

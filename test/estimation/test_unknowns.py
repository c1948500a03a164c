"""Unknowns of a robot: they stand for the numbers of its file, and share robots that show them."""

import numpy as np
import pytest
from support.places import ROBOTS

from cdrj_ros.estimation.draws import independent_causes
from cdrj_ros.estimation.estimator import Sample, Samples, initial_state, run, step
from cdrj_ros.estimation.group import Group
from cdrj_ros.estimation.unknowns import DRAG, PRELOAD, SLIP
from cdrj_ros.model.prepared import load_model, prepare
from cdrj_ros.robot.description import Pulley
from cdrj_ros.robot.parameters import number_at, with_numbers
from cdrj_ros.robot.reader import build_robot

START = 1_700_000_000 * 10**9
MS = 1_000_000


def _free(name):
    """A shipped robot whose reference pose is not at the ends of its joints' ranges."""
    document = load_model(str(ROBOTS / f"{name}.yaml")).robot.document
    joints = [
        {**one, "range": [one["range"][0] - 0.05, one["range"][1]]} if "range" in one else one
        for one in document["joints"]
    ]
    return prepare(build_robot({**document, "joints": joints}, name))


def _with(model, changes):
    """The robot with some numbers changed [SI], and its angles less those that are read."""
    document = {**model.robot.document, "uncertainty": {"others": "exact"}}
    values = {path: number_at(document, path) + by for path, by in changes.items()}
    for path, value in values.items():
        if path.endswith("bearing_torque"):  # below 0 the least possible one
            values[path] = max(value, 0.0)
    robot = build_robot(with_numbers(document, values), "changed")
    return prepare(robot, check_range=False), np.subtract(robot.offsets, model.robot.offsets)


def _course(model, samples):
    """All joints bend by some degrees and the motors wind along, 20 ms apart."""
    robot, found = model.robot, []
    for k in range(samples):
        motor = robot.reference_motors + 0.05 * np.sin(0.3 * k + np.arange(len(robot.motors)))
        bent = 0.08 * np.sin(0.2 * k + 0.5 * np.arange(len(robot.joints)))
        joint = np.clip(
            robot.reference_pose + bent,
            [one.lower for one in robot.joints], [one.upper for one in robot.joints],
        )  # fmt: skip
        found.append(Sample(START + 20 * MS * k, motor, joint))
    return found


def _values(model, shift, samples, columns):
    """Quantities of a robot along a course by ``step``, shape (samples, columns)."""
    state, found, motors = initial_state(model), [], len(model.robot.motors)
    for one in samples:
        moved = Sample(
            one.stamp_ns, one.motor_angle + shift[:motors], one.joint_angle + shift[motors:]
        )
        state, estimate = step(model, state, moved)
        found.append(estimate.values[columns])
    return np.array(found)


def _columns(model):
    layout = model.layout
    parts = (layout.tension, layout.magnitude, layout.motor_effort, layout.joint_effort)
    return np.concatenate([np.arange(one.start, one.stop) for one in parts])


@pytest.mark.parametrize("name", ["finger", "finger3d", "cdpr"])
def test_a_signature_is_what_the_robot_with_this_number_alone_does(name):
    """Whatever other unknowns its robots show, half the difference of one unit to either side."""
    model = _free(name)
    known = model.robot.uncertainty
    group = Group(model, range(len(model.robot.cables)), {})
    samples = _course(model, 12)
    slopes = []
    for sample in samples:
        assert group.follow(sample, 0.0)
        slopes.append(group.slopes)
    checked = 0
    for u, unknown in enumerate(group.unknowns):
        if u < group.modes.shape[1]:
            changes = dict(zip(known.parameters, group.modes[:, u].tolist(), strict=True))
        elif unknown.kind is PRELOAD:
            changes = {f"cables.{unknown.name.removeprefix('preload of ')}.preload": unknown.unit}
        else:
            continue
        ends = [
            _values(*_with(model, {path: sign * by for path, by in changes.items()}), samples,
                    _columns(model))
            for sign in (1.0, -1.0)
        ]  # fmt: skip
        expected = 0.5 * (ends[0] - ends[1])
        assert np.allclose(np.array(slopes)[:, u], expected, rtol=1e-6, atol=1e-6), u
        checked += 1
    assert checked >= len(model.robot.cables)


@pytest.mark.parametrize("name", ["finger", "finger3d"])
def test_drag_and_slip_show_what_pulleys_that_turn_harder_and_drums_that_forget_do(name):
    """Beside the robot without them, by the two units that they may be."""
    model = _free(name)
    robot, samples = model.robot, _course(model, 40)
    group = Group(model, range(len(robot.cables)), {})
    slopes = []
    for sample in samples:
        assert group.follow(sample, 0.0)
        slopes.append(group.slopes)
    stamps, motor, joint = (np.array([one[k] for one in samples]) for k in range(3))
    motion = Samples(stamps, motor, joint)
    tension = np.arange(len(model.layout.elements))
    plain, slipping = (
        run(model, initial_state(model), motion, slipping=np.array(slips))[1].tension
        for slips in ([False] * len(robot.cables), [True] * len(robot.cables))
    )
    turns_harder = {
        f"cables.{cable.name}.nodes.{k + 1}.bearing_torque": 0.06 * cable.preload * node.radius
        for cable in robot.cables
        for k, node in enumerate(cable.nodes)
        if isinstance(node, Pulley) and node.radius > 0.0
    }
    dragging = _values(*_with(model, turns_harder), samples, tension)
    for kind, changed in ((DRAG, dragging), (SLIP, slipping)):
        of_kind = [u for u, one in enumerate(group.unknowns) if one.kind is kind]
        assert of_kind
        both = 2.0 * np.array(slopes)[:, of_kind][:, :, tension].sum(axis=1)
        assert np.abs(changed - plain).max() > 0.02
        assert np.allclose(both, changed - plain, rtol=1e-6, atol=1e-6)


def test_few_modes_stand_for_all_numbers_of_a_file():
    """They give the tensions the variances that all independent causes of error give."""
    model = _free("finger")
    known = model.robot.uncertainty
    group = Group(model, range(len(model.robot.cables)), {})
    samples, tensions = _course(model, 1), np.arange(len(model.layout.elements))
    nominal = _values(model, np.zeros(len(model.robot.axes)), samples, tensions)

    def variance(changes):
        """By a hundredth of each: larger ones make cables slack."""
        small = [{path: 0.01 * by for path, by in one.items()} for one in changes]
        effects = [_values(*_with(model, one), samples, tensions) - nominal for one in small]
        return np.asarray((np.array(effects) ** 2).sum(axis=0)[0])

    causes = [
        {known.parameters[n]: float(by) for n, by in zip(one.numbers, one.factor, strict=True)}
        for one in independent_causes(known)
    ]
    modes = [dict(zip(known.parameters, one.tolist(), strict=True)) for one in group.modes.T]
    assert len(modes) < 0.4 * len(causes)
    assert np.allclose(np.sqrt(variance(modes)), np.sqrt(variance(causes)), rtol=0.05)


def test_a_hand_needs_few_robots_for_its_unknowns():
    """Unknowns of different cables share them, so that most serve as many as there are cables."""
    model = load_model(str(ROBOTS / "hand.yaml"))
    thumb = [c for c, name in enumerate(model.layout.cables) if name.startswith("thumb_")]
    group = Group(model, thumb, {})
    of_one_cable = [one for one in group.unknowns if 0 <= one.only < len(thumb)]
    robots = {id(end) for one in of_one_cable for end in (one.more, one.less)}
    assert len(robots) <= 3 * 2 * len(of_one_cable) / len(thumb) / 2

"""Friction of cables in space: capstan on every kind of contact, energy, lift-off, virtual work."""

from __future__ import annotations

from math import exp

import numpy as np
import pytest

from cdrj_ros.estimation.estimator import Estimates, initial_state, run
from cdrj_ros.estimation.samples import Samples
from cdrj_ros.model.prepared import Model, prepare, shape_at
from cdrj_ros.robot.reader import parse_robot

MU = 0.15
ROBOT = """
name: space
motors: [{name: m}]
joints: [{name: q, range: [-0.6, 0.6]}]
frames:
  - {name: arm, motion: revolute, joint: q, origin: [0.3, 0, 0], axis: [0, 1, 1]}
  - {name: lift, motion: prismatic, joint: q, axis: [0, 1, 0]}
friction: {law: LAW, mu_c: 0.15, bristle_stiffness: 1e8}
cables:
  - name: c
    axial_stiffness: 1e5
    preload: 30
    nodes:
      - {type: winch, motor: m, winding: 1, radius: 0.02, position: [-0.1, 0, 0], axis: [0, 0, 1], turn: cw}
      - {NODE}
      - {END}
"""  # noqa: E501
BASE_END = "type: anchor, position: [0.3, -0.02, 0.05]"
ARM_END = "type: anchor, position: [0.05, 0.04, 0.02], frame: arm"

CONTACTS = {
    "cylinder": "type: cylinder, radius: 0.04, position: [0.1, 0, 0], axis: [0.2, 0, 1], turn: cw",
    "helix": (
        "type: cylinder, radius: 0.04, position: [0.1, 0, 0], axis: [0, 0, 1], turn: cw, turns: 3"
    ),
    "sphere": "type: sphere, radius: 0.05, position: [0.1, -0.01, 0]",
    "eyelet": "type: eyelet, position: [0.1, 0.1, -0.05]",
    "pulley": "type: pulley, radius: 0.04, position: [0.1, 0, 0], axis: [0.2, 0, 1], turn: cw",
    "swivel": "type: swivel, radius: 0.04, position: [0.1, 0.1, 0], axis: [1, 1, 0]",
    "sheath": "type: sheath, position: [0.1, 0, 0], exit: [0.2, 0, 0], length: 0.5, bend: 2.5",
}  # fmt: skip


def robot(
    node: str, law: str = "elastoplastic", end: str = BASE_END, cable: str = "1e5\n    preload: 30"
) -> Model:
    text = ROBOT.replace("1e5\n    preload: 30", cable)
    text = text.replace("LAW", law).replace("{NODE}", f"{{{node}}}").replace("{END}", f"{{{end}}}")
    return prepare(parse_robot(text), check_range=False)


def play(model: Model, motor: np.ndarray, joint: np.ndarray) -> Estimates:
    stamps = 1_000_000 * np.arange(motor.size, dtype=np.int64)
    samples = Samples(stamps, motor[:, None].copy(), joint[:, None].copy())
    return run(model, initial_state(model), samples)[1]


@pytest.mark.parametrize("contact", CONTACTS)
def test_a_pulled_cable_has_the_capstans_ratio_of_tensions(contact: str) -> None:
    model = robot(CONTACTS[contact])
    far = 4.0 if contact == "helix" else 0.4
    motor = np.concatenate([np.linspace(0.0, far, 400), np.linspace(far, 0.04, 500)])
    wrap = shape_at(model, np.zeros(1)).wrap[0]
    assert wrap > 0.2
    before, after = play(model, motor, np.zeros(motor.size)).values[:, model.layout.tension].T
    assert before[399] > after[399] > 5.0
    assert after[399] / before[399] == pytest.approx(exp(-MU * wrap), rel=1e-6)
    if contact != "helix":  # which holds the tension behind it beyond any release
        assert before[-1] / after[-1] == pytest.approx(exp(-MU * wrap), rel=1e-6)


@pytest.mark.parametrize("contact", CONTACTS)
def test_friction_only_takes_energy(contact: str) -> None:
    """Over closed cycles of the joint the work done on the robot is not negative."""
    model = robot(CONTACTS[contact], end=ARM_END)
    joint = 0.25 * np.sin(np.linspace(0.0, 8.0 * np.pi, 1601))
    found = play(model, np.full(joint.size, 0.2), joint)
    effort = found.values[:, model.layout.joint_effort][:, 0]
    work = -np.cumsum(0.5 * (effort[1:] + effort[:-1]) * np.diff(joint))
    cycles = work[[799, 1199, 1599]] - work[[399, 799, 1199]]
    if contact != "helix":  # which still releases what it held at the start
        assert np.all(cycles > 1e-5)
    friction = found.values[:, model.layout.friction][:, 0]
    slip = 1e-3 * found.values[:, model.layout.slip_speed][:, 0]
    lost = np.cumsum(friction * slip)
    assert lost[-1] > 0.0
    assert np.all(lost[[799, 1199, 1599]] > lost[[399, 799, 1199]] - 1e-9)


@pytest.mark.parametrize("law", ["lugre", "elastoplastic"])
def test_a_cable_that_lifted_off_comes_back_without_a_memory(law: str) -> None:
    """Wrap, friction and force are zero in the air; the contact then begins without a bristle."""
    node = "type: cylinder, radius: 0.02, position: [0.1, 0, 0], axis: [0, 0, 1], turn: cw"
    end = "type: anchor, position: [0.2, -0.03, 0], frame: lift"
    model = robot(node, law, end, "2e3\n    preload: 100")
    down = np.linspace(0.0, 0.1, 400)
    joint = np.concatenate([down, down[::-1], np.full(100, 0.0)])
    found = play(model, np.full(joint.size, 0.1), joint)
    wrap = np.array([shape_at(model, np.array([angle])).wrap[0] for angle in joint])
    layout = model.layout
    friction = found.values[:, layout.friction][:, 0]
    magnitude = found.values[:, layout.magnitude][:, 0]
    tension = found.values[:, layout.tension]
    off = wrap == 0.0
    assert 100 < off.sum() < 700
    assert wrap.max() > 0.2
    assert np.abs(friction[~off]).max() > 0.3
    assert np.abs(friction[off]).max() < 1e-5
    assert magnitude[off].max() < 1e-4 * tension.max()
    # friction grows from nothing where the cable touches again
    again = int(np.flatnonzero(off)[-1]) + 1
    assert np.abs(friction[again : again + 3]).max() < 0.05 * np.abs(friction).max()
    assert np.abs(np.diff(tension, axis=0)).max() < 0.05 * tension.max()

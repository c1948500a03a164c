"""Efforts are the moments of the forces of contact, static friction does no work, for every robot.

The forces are those that are published: at a body, the pull of the element after it and that of the
element before it, whose sum is the nodal force; at an end, the pull alone.  The bodies' velocities
are complex steps of ``rigid_bodies``, so that only rounding limits the agreement.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from model.reference_geometry import plane
from model.rigid_bodies import bodies, pulls, velocity
from numpy.typing import NDArray

from cdrj_ros.estimation.estimator import Estimate, initial_state, step
from cdrj_ros.estimation.samples import Sample
from cdrj_ros.model.prepared import Model, prepare, shape_at
from cdrj_ros.model.state import state_views
from cdrj_ros.robot.description import PassiveTorque, Pulley, Robot, Winch
from cdrj_ros.robot.reader import load_robot, parse_robot
from cdrj_ros.simulation.follow import follow_joints

Vector = NDArray[np.float64]

FILES = sorted((Path(__file__).parents[2] / "config" / "robots").glob("*.yaml"))
BY_FILE = pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
MOTIONS, SAMPLES = 4, 60


@cache
def plain(path: Path) -> Model:
    """A robot without signs and passive torques of its axes, which are not the cables'."""
    robot = load_robot(path)
    none: dict[str, Any] = {"effort_sign": 1, "passive": PassiveTorque()}
    return prepare(
        replace(
            robot,
            motors=tuple(replace(axis, **none) for axis in robot.motors),
            joints=tuple(replace(axis, **none) for axis in robot.joints),
        ),
        check_range=False,
    )


def smooth(generator: np.random.Generator, low: Vector, high: Vector) -> Vector:
    """A random motion within a range, shape (SAMPLES, axes)."""
    time = np.linspace(0.0, 1.0, SAMPLES)[:, None]
    waves = sum(
        generator.uniform(-1.0, 1.0, low.size)
        * np.sin(2 * np.pi * (k * time + generator.random(low.size)))
        for k in (0.5, 1.0, 2.0)
    )
    return np.asarray(0.5 * (low + high) + waves / 3.0 * 0.5 * (high - low))


def tightened(model: Model) -> Vector:
    """Motor angles that stretch cables by a thousandth, of motors that wind all of theirs in."""
    robot, length = model.robot, shape_at(model, reference(model.robot)).length
    turns, first = np.zeros(len(robot.motors)), 0
    for m, motor in enumerate(robot.motors):
        first, ways = 0, []
        for cable in robot.cables:
            total = length[first : first + len(cable.nodes) - 1].sum()
            first += len(cable.nodes) - 1
            ways.extend(
                1e-3 * node.winding * total / node.reel
                for node in (cable.nodes[0], cable.nodes[-1])
                if isinstance(node, Winch) and node.motor == motor.name
            )
        if len(set(np.sign(ways))) == 1:
            turns[m] = ways[0]
    return turns


def reference(robot: Robot) -> Vector:
    return np.array([joint.reference_angle for joint in robot.joints])


def ends_of_motions(model: Model) -> list[tuple[Vector, Vector, Estimate]]:
    """Joint angles, motor angles and estimates after random motions in which cables slide."""
    robot, generator = model.robot, np.random.default_rng(11)
    low = np.array([joint.lower for joint in robot.joints])
    high = np.array([joint.upper for joint in robot.joints])
    rest = reference(robot)
    found = []
    for _ in range(MOTIONS):
        ramp = np.minimum(np.linspace(0.0, 3.0, SAMPLES), 1.0)[:, None]
        joint = rest + ramp * (smooth(generator, low, high) - rest)
        motor = follow_joints(model, joint).motor_angle
        wave = smooth(generator, -np.ones(motor.shape[1]), np.ones(motor.shape[1]))
        motor += ramp * (0.05 * wave + tightened(model))
        state = initial_state(model)
        for k in range(SAMPLES):
            sample = Sample((k + 1) * 5_000_000, motor[k].copy(), joint[k].copy())
            state, estimate = step(model, state, sample)
        assert estimate.solved
        assert (estimate.tension > 0.1).mean() > 0.5
        found.append((joint[-1], motor[-1], estimate))
    return found


@BY_FILE
def test_the_effort_of_a_joint_is_the_power_of_the_forces_of_contact(path: Path) -> None:
    model = plain(path)
    robot, count = model.robot, len(model.robot.joints)
    rubbed = 0.0
    for q, motor, estimate in ends_of_motions(model):
        t, expected, scale = estimate.tension, np.zeros(count), 1e-9
        # of cables by tables: the tensions times the rates of free lengths, contacts at rest
        given = np.repeat(
            [not cable.placed for cable in robot.cables],
            [len(cable.nodes) - 1 for cable in robot.cables],
        )
        if given.any():
            expected -= (t * given) @ plane(robot, q).arm
        for pull in pulls(model, q, motor):
            ahead, back = t[pull.elements][0] * pull.unit, -t[pull.elements][-1] * pull.unit
            for j in range(count):
                leaving, arriving = (
                    velocity(robot, q, j, *point) for point in (pull.left, pull.meets)
                )
                expected[j] += ahead @ leaving + back @ arriving
                scale = max(scale, float(np.abs(ahead @ leaving)), float(np.abs(back @ arriving)))
        scale = max(scale, float(np.abs(expected).max(initial=0.0)))
        np.testing.assert_allclose(estimate.joint_effort, expected, rtol=0, atol=1e-9 * scale)
        rubbed = max(rubbed, float(np.abs(estimate.friction).max(initial=0.0)))
    assert rubbed > 0.05, "friction is part of it"


@BY_FILE
def test_the_effort_of_a_motor_is_the_moment_of_the_pull_about_its_drum(path: Path) -> None:
    model = plain(path)
    robot = model.robot
    names = [motor.name for motor in robot.motors]
    for q, motor, estimate in ends_of_motions(model):
        expected, element = np.zeros(len(names)), 0
        here, free = bodies(robot, q), pulls(model, q, motor)
        for cable in robot.cables:
            last = element + len(cable.nodes) - 2
            for node, e, way in ((cable.nodes[0], element, -1), (cable.nodes[-1], last, 1)):
                if not isinstance(node, Winch):
                    continue
                place = node.place
                moment = -node.reel * estimate.tension[e]
                if place is not None and place.turn != 0:
                    (pull,) = (one for one in free if one.elements.start <= e < one.elements.stop)
                    rotation, origin = here[place.frame]
                    axis = rotation @ np.array(place.axis)
                    _, point = pull.left if way < 0 else pull.meets
                    force = -way * estimate.tension[e] * pull.unit
                    arm = point - origin - rotation @ np.array(place.position)
                    # the drum turns against the cable's way at the first end as it winds in
                    moment = way * place.turn * float(axis @ np.cross(arm, force))
                expected[names.index(node.motor)] += node.winding * moment
            element = last + 1
        scale = float(np.abs(expected).max())
        np.testing.assert_allclose(estimate.motor_effort, expected, rtol=0, atol=1e-9 * scale)


STUCK = """
name: stuck
motors: [{name: m}]
joints: [{name: x, range: [-0.05, 0.05]}, {name: q, range: [-0.3, 0.3]}]
frames:
  - {name: slide, motion: prismatic, joint: x, origin: [0.3, 0, 0], axis: [0.2, 1, 0.3]}
  - {name: arm, parent: slide, motion: revolute, joint: q, axis: [0.1, 0.2, 1]}
friction: {law: elastoplastic, mu_c: 0.6, bristle_stiffness: 2e6}
cables:
  - name: c
    axial_stiffness: 2e4
    preload: 40
    nodes:
      - {type: winch, motor: m, winding: 1, radius: 0.02, position: [-0.1, 0, 0]}
      - {NODE}
      - {type: anchor, position: [0.05, -0.04, 0.02], frame: arm}
"""
PLANE = """
name: stuck
motors: [{name: m}]
joints: [{name: x, range: [-0.05, 0.05]}, {name: q, range: [-0.3, 0.3]}]
frames:
  - {name: slide, motion: prismatic, joint: x, origin: [0.3, 0], direction: [0.2, 1]}
  - {name: arm, parent: slide, motion: revolute, joint: q}
friction: {law: elastoplastic, mu_c: 0.6, bristle_stiffness: 2e6}
cables:
  - name: c
    axial_stiffness: 2e4
    preload: 40
    nodes:
      - {type: winch, motor: m, winding: 1, radius: 0.02, position: [-0.1, 0], turn: cw}
      - {NODE}
      - {type: anchor, position: [0.05, -0.04], frame: arm}
"""
BODIES = {
    "plane": "type: pulley, radius: 0.04, position: [0.1, 0.02], turn: cw",
    "plane, on the slide": (
        "type: pulley, radius: 0.03, position: [-0.1, 0.05], frame: slide, turn: cw"
    ),
    "cylinder": (
        "type: cylinder, radius: 0.04, position: [0.1, 0.02, 0], axis: [0.2, 0, 1], turn: cw"
    ),
    "sphere": "type: sphere, radius: 0.05, position: [0.1, 0.0, 0]",
    "swivel": "type: swivel, radius: 0.03, position: [0.1, 0.06, 0], axis: [1, 1, 0]",
    "eyelet": "type: eyelet, position: [0.1, 0.06, 0.0]",
    "sheath": "type: sheath, position: [0.05, 0, 0], exit: [0.15, 0, 0], length: 0.3, bend: 1.5",
}


def stored(robot: Robot, model: Model, values: Vector) -> float:
    """Energy in segments and bristles of a linear cable [J]."""
    views, cable = state_views(model.sizes, values), robot.cables[0]
    strain = views.length / views.material - 1.0
    elastic = 0.5 * cable.axial_stiffness * float(np.sum(strain**2 * views.material))
    return (
        elastic + 0.5 * float(views.bristle[0]) ** 2 / cable.pulleys[0].friction.bristle_stiffness
    )


def in_one_cell(robot: Robot) -> Robot:
    """Cells of one arc would slide one after another."""
    (cable,) = robot.cables
    nodes = tuple(
        replace(node, cells=1) if isinstance(node, Pulley) else node for node in cable.nodes
    )
    return replace(robot, cables=(replace(cable, nodes=nodes),))


@pytest.mark.parametrize("body", BODIES)
def test_static_friction_does_no_work(body: str) -> None:
    """What cables store is what the joints put in, as long as no contact slides.

    Material that moves past a contact, as its middle moves or its bristles give, carries strain
    energy of half of the strain times the tension per metre, which the balance of forces does not
    contain: hence the tolerance, the strain times the sum of tension times these ways.
    """
    text = (PLANE if "plane" in body else STUCK).replace("{NODE}", f"{{{BODIES[body]}}}")
    robot = in_one_cell(parse_robot(text))
    model = prepare(robot, check_range=False)
    # pull until the contact slides, then let go until it holds half of its bound
    held = 1.0 - float(np.exp(-0.6 * shape_at(model, np.zeros(2)).wrap[0]))
    winding = np.concatenate([np.linspace(0.0, 0.12, 200), np.linspace(0.12, 0.0, 2000)])
    state, stamp = initial_state(model), 0
    for k, motor in enumerate(winding):
        stamp += 1_000_000
        state, estimate = step(model, state, Sample(stamp, np.array([motor]), np.zeros(2)))
        share = abs(float(estimate.friction[0])) / (held * float(estimate.tension.max()))
        if k < 200:
            most = share
        elif share < 0.5:
            break
    assert most > 0.99
    steps = 400
    phase = np.linspace(0.0, 2.0, steps + 1)
    joint = np.stack([2e-4 * np.sin(3 * phase), 1.5e-3 * (1 - np.cos(2 * phase))], axis=1)
    work = ways = lost = track = 0.0
    last: Estimate | None = None
    energy = []
    for k in range(steps + 1):
        sample = Sample(stamp + (k + 1) * 1_000_000, np.array([motor]), joint[k])
        state, estimate = step(model, state, sample)
        views = state_views(model.sizes, state.values)
        bound = 1.0 - np.exp(-0.6 * shape_at(model, joint[k]).wrap[0])
        assert abs(estimate.friction[0]) < 0.9 * bound * estimate.tension.max(), "it sticks"
        if last is not None:
            mean = 0.5 * (last.joint_effort + estimate.joint_effort)
            work += float(mean @ (joint[k] - joint[k - 1]))
            laid, gave = abs(float(views.track[0]) - track), 1e-3 * abs(estimate.slip_speed[0])
            ways += (laid + gave) * float(estimate.tension.max())
            lost += laid * abs(float(estimate.friction[0]))
        track, last = float(views.track[0]), estimate
        energy.append(stored(robot, model, state.values))
    assert last is not None
    strain = float(np.max(last.tension)) / robot.cables[0].axial_stiffness
    change = energy[-1] - energy[0]
    assert abs(last.friction[0]) > 2.0
    trapezoids = 1e-6 * abs(change) + 1e-9  # of the integral of the work over 400 steps
    allowed = strain * ways + trapezoids
    if body not in ("eyelet", "sheath"):  # whose middles are at rest
        assert allowed < 0.2 * lost, "work of friction, were laying on a slip"
    assert change + work == pytest.approx(0.0, abs=allowed)
    assert abs(change) > 1e-5

"""Every sample of ``step`` equals the plain NumPy reference, all robots and all friction laws.

The reference starts every sample from the estimator's own history, so that deviations do not
accumulate and every part of the new history is compared.  With the estimator's slips, its tensions,
forces, efforts, histories and imbalances equal the estimator's to 1e-12 of the cable's largest
tension, plus the rounding of (E1), 8 EA times the machine epsilon: an element of 4 m of the cable
robot does not resolve less.

The slips solve (E11): the imbalances are at most 1e-8 N + 1e-14 EA.  There is no other solution,
because the imbalance of a contact falls with its own flux, more than it rises with all others.
"""

from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from model import reference
from model.reference import Drum, History
from model.reference_geometry import Geometry
from model.reference_in_space import geometry, moved, paths
from numpy.typing import NDArray
from support.places import ROBOTS, shipped_once
from support.state import state_views

from cdrj_ros._core import Law
from cdrj_ros.estimation.estimator import Sample, initial_state, step
from cdrj_ros.model.laws import elasticity_of, strain_at
from cdrj_ros.model.packing import OK, SLACK, topology_views
from cdrj_ros.model.prepared import placed, prepare, shape_at
from cdrj_ros.robot.description import PassiveTorque, Pulley, Winch
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.simulation import assembly

Vector = NDArray[np.float64]

FILES = sorted(path.stem for path in ROBOTS.glob("*.yaml"))
EVERY_LAW = ("prototype", "finger", "finger3d")
"""Robots in the plane by tables and by positions, and one in space: a law knows no geometry."""
STEP_NS = 5_000_000
EPSILON = float(np.finfo(float).eps)
LARGE, SMALL, HELD, OUT = 15, 6, 3, 7
"""Samples of large and of small reversals, at rest, and with the winches paid out."""
NEWTON_ALONE = 80
"""Iterations of two attempts; more where a sample was divided into substeps."""
MOST_DIVIDED = 4
"""Samples of a motion that may be divided into substeps.  They are not compared: the reference
solves a sample as one step.  Only ``euler`` on the prototypes has such samples."""


@dataclass(frozen=True)
class Course:
    """A motion of a robot and its geometry, which no friction law changes."""

    motor: Vector
    joint: Vector
    rest: Geometry
    poses: list[Geometry]


def motion(robot, model):
    """Motor and joint angles: large reversals, small ones, rest, slack, and taut again."""
    large = np.sin(4 * np.pi * np.arange(LARGE) / LARGE)
    small = large[-1] + 2e-3 * np.sin(4 * np.pi * np.arange(SMALL) / SMALL)
    still = np.full(HELD + OUT, small[-1])
    wave = np.concatenate([large, small, still, 0.8 * large])
    joints = []
    for k, joint in enumerate(robot.joints):
        room = min(joint.upper - joint.reference_angle, joint.reference_angle - joint.lower)
        middle = joint.reference_angle if room > 0 else 0.5 * (joint.lower + joint.upper)
        swing = 0.25 * (room if room > 0 else 0.5 * (joint.upper - joint.lower))
        joints.append(middle + swing * (1 - 0.3 * (k % 3)) * wave)
    joint = np.array(joints).T.reshape(wave.size, -1)
    pull = 0.8 + 0.4 * np.concatenate([np.cos(3 * large), 1 + 0.1 * small, still, large[::-1]])
    out = LARGE + SMALL + HELD
    pull[out : out + OUT] = 0.2, -0.4, -1.0, -1.0, -1.0, -0.4, 0.2
    return _winding(robot, model, joint, pull), joint


def _winding(robot, model, joint, pull):
    """Motor angles that follow the cables' lengths and give shares of the preload."""
    length = np.array([shape_at(model, q).length for q in joint])
    rest = shape_at(model, robot.reference_pose).length
    motor = np.zeros((pull.size, len(robot.motors)))
    for m, drive in enumerate(robot.motors):
        for c, cable in enumerate(robot.cables):
            winch = cable.nodes[0]
            if not isinstance(winch, Winch) or winch.motors != ((drive.name, 1.0),):
                continue
            elements, _ = reference.parts(robot, c)
            now, first = length[:, elements].sum(axis=1), rest[elements].sum()
            tension = pull * (cable.preload or 30.0)
            law = elasticity_of(cable)
            taut, rest_strain = strain_at(law, tension), strain_at(law, cable.preload)
            wound = first - now + now * taut - first * rest_strain
            motor[:, m] = drive.reference_angle + winch.winding * wound / winch.radius
            break  # a further cable on the motor has to follow
    return motor


def with_law(robot, law):
    return replace(robot, cables=tuple(replace(cable, law=law) for cable in robot.cables))


@cache
def shipped(file):
    robot = prepare(shipped_once(file), check_range=False).robot
    return robot, course(robot)  # with the cells that are chosen for its pulleys


def course(robot):
    model = prepare(robot, check_range=False)
    motor, joint = motion(robot, model)
    tracks = assembly.course(model, joint).track
    rest = paths_at(robot, model, robot.reference_pose, None)
    ways = [(q, paths_at(robot, model, q, rest)) for q in joint]
    for (before, now), way in zip(pairwise(ways), np.diff(tracks, axis=0), strict=True):
        np.testing.assert_allclose(moved(robot, before, now), way, rtol=1e-11, atol=2e-14)
    poses = [
        replace(posed(robot, model, q, now, rest), middle=track)
        for (q, now), track in zip(ways, tracks, strict=True)
    ]
    return Course(motor, joint, posed(robot, model, robot.reference_pose, rest, rest), poses)


def paths_at(robot, model, q, rest):
    """The reference's paths, whose points of contact are the estimator's."""
    touches = placed(model, q)[1].touches
    found = paths(robot, q, touches, rest)
    contacts = [one for path in found if path for one in path.contacts]
    if contacts:
        touching = touches["touching"] == 1.0
        np.testing.assert_array_equal([one.touches for one in contacts], touching)
        for name in ("entry", "exit"):
            own = np.array([getattr(one, name) for one in contacts])
            np.testing.assert_allclose(own[touching], touches[name][touching], atol=2e-14)
    return found


def posed(robot, model, q, now, rest):
    """The reference's own geometry, which equals the estimator's.

    What is laid on the ends is taken from the estimator, because rounding decides whether a drum
    that rests has a further point.
    """
    found, views = placed(model, q)
    own = geometry(robot, q, now, rest)
    pairs = {
        "length": (own.length, found.length), "arm": (own.arm, found.lever_arm),
        "wrap": (own.wrap, found.wrap), "arc": (own.arc, views.arc), "laid": (own.laid, views.laid),
    }  # fmt: skip
    if any(cable.placed for cable in robot.cables):
        pairs["direction"] = own.direction, found.direction
    for name, (one, other) in pairs.items():
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=2e-14, err_msg=name)
    return replace(own, laid=views.laid)


def history_of(model, state):
    """The estimator's state in the words of the reference."""
    views = state_views(model.sizes, state.values)
    if not views.started[0]:
        return None
    rows = views.drums
    ends = topology_views(model.topology).ends
    drums = [
        Drum(row["angle"][:n], row["material"][:n], row["rate_below"], row["spacing"])
        if drum >= 0 and (n := int((row := rows[drum])["points"]))
        else None
        for drum in ends["drum"]
    ]
    return History(
        views.length, views.material, views.delayed, views.bristle, views.slip_speed,
        views.lagged_speed, views.angle, views.bearing_friction, tuple(drums),
    )  # fmt: skip


def agree(name, one, other, allowed):
    assert np.all(np.abs(np.asarray(one) - other) <= allowed), name


def roundings(robot, kept, estimate, dt):
    """For every cable 1e-12 of its largest tension, and the rounding of (E1) [N].

    Between cells a segment is shorter than the slip from which its material follows, whose rounding
    then counts more.
    """
    found = []
    for c, cable in enumerate(robot.cables):
        elements, _ = reference.parts(robot, c)
        own, touching = reference.rows(robot, c)
        fineness = 1.0
        if any(pulley.cells > 1 for pulley in cable.pulleys):
            slip = np.abs(kept.slip_speed[touching]).max() * dt
            fineness = max(1.0, slip / kept.length[own].min())
        coarse = 8 * EPSILON * cable.axial_stiffness
        found.append(1e-12 * float(estimate.tension[elements].max()) + coarse * fineness)
    return found


def check_sample(robot, history, outputs, kept, estimate, dt):
    """All results and the whole new history, the slips given, and that these solve (E11)."""
    residual, most = estimate.values[estimate.layout.residual], roundings(robot, kept, estimate, dt)
    for c, cable in enumerate(robot.cables):
        elements, pulleys = reference.parts(robot, c)
        own = reference.rows(robot, c)[1]
        agree("tension", outputs.tension[elements], estimate.tension[elements], most[c])
        agree("friction", outputs.friction[pulleys], estimate.friction[pulleys], most[c])
        agree("bristle", history.bristle[own], kept.bristle[own], most[c])
        agree("imbalance", outputs.imbalance[c], residual[c], most[c])
        agree("balance", residual[c], 0.0, 1e-8 + 1e-14 * cable.axial_stiffness)
        agree("magnitude", outputs.magnitude[pulleys], estimate.nodal_force[pulleys], most[c])
        for k, force in enumerate((estimate.force_x, estimate.force_y, estimate.force_z)):
            agree(f"force {k}", outputs.force[pulleys, k], force[pulleys], most[c])
    for name in ("material", "length"):
        one, other = getattr(history, name), getattr(kept, name)
        agree(name, one, other, 1e-12 * other)
    for name in ("slip_speed", "lagged_speed", "angle", "bearing"):
        one, other = getattr(history, name), getattr(kept, name)
        agree(name, one, other, 1e-12 * max(1e-3, np.abs(other).max(initial=0.0)))
    agree("motor effort", outputs.motor_effort, estimate.motor_effort, sum(most))
    agree("joint effort", outputs.joint_effort, estimate.joint_effort, sum(most))
    for drum, same in zip(history.drums, kept.drums, strict=True):
        assert (drum is None) == (same is None)
        if drum is not None and same is not None:
            assert (drum.angle.size, drum.spacing) == (same.angle.size, same.spacing)
            agree("drum", drum.angle, same.angle, 1e-12 * max(1.0, np.abs(same.angle).max()))
            # taken from the angle by the radius: rounding of a metre of cable
            agree("drum", drum.material, same.material, 1e-15)


def check(robot, course):
    """Step a robot through a motion beside the reference."""
    model = prepare(robot, check_range=False)
    state, seen = initial_state(model), {"slack": 0, "taut": 0, "stuck": 0, "sliding": 0}
    divided = 0
    for k, pose in enumerate(course.poses):
        before, dt = history_of(model, state), STEP_NS * 1e-9 if k else 0.0
        earlier = course.poses[k - 1] if k else None
        reading = Sample((k + 1) * STEP_NS, course.motor[k], course.joint[k])
        state, estimate = step(model, state, reading)
        after = history_of(model, state)
        assert estimate.solved
        if (estimate.values[model.layout.iterations] > NEWTON_ALONE).any():
            divided += 1
            continue
        slips, angles = after.slip_speed * dt, (course.motor[k], course.joint[k])
        own = reference.sample(robot, course.rest, pose, earlier, before, angles, slips, dt)
        check_sample(robot, *own, after, estimate, dt)
        for c, cable in enumerate(robot.cables):
            elements, _ = reference.parts(robot, c)
            t, status = estimate.tension[elements], estimate.status[elements].astype(int)
            assert ((status & SLACK != 0) == (t <= cable.slack_tension)).all()
            seen["slack"] += int((t == 0).any())
            seen["taut"] += int((status == OK).all())
        seen["stuck"] += int((np.abs(slips) < 1e-9).sum()) if k else 0
        seen["sliding"] += int((np.abs(slips) > 1e-4).sum())
    assert divided <= MOST_DIVIDED
    assert min(seen.values()) > 0, seen


@pytest.mark.parametrize(
    ("file", "law"),
    [
        *((file, "elastoplastic") for file in FILES),
        *((file, law) for file in EVERY_LAW for law in Law.__members__ if law != "elastoplastic"),
    ],
)
def test_every_sample_equals_the_reference(file, law):
    robot, course = shipped(file)
    check(with_law(robot, law), course)


def with_everything(robot):
    """The prototype with every term of sections 2, 4 and 6 that the shipped files leave out."""

    def changed(k, node):
        if not isinstance(node, Pulley):
            return node if isinstance(node, Winch) else Winch((("winch", 1.0),), 0.002, 1)
        friction = replace(
            node.friction, breakaway=0.6, bristle_damping=300.0, viscous=150.0, mu_s=0.17,
            stribeck="capstan", stribeck_lag=0.03, stribeck_speed=0.1,
        )  # fmt: skip
        more = {"cells": 1 + k % 3, "bearing_torque": 1e-4}
        return replace(node, friction=friction, moving_end="before", **more)

    def both(node):
        return replace(node, moving_end="both") if isinstance(node, Pulley) else node

    def axis(axis, size):
        passive = PassiveTorque(0.05 * size, 3.0 * size, 0.2 * size, 0.1)
        return replace(axis, effort_sign=-1, passive=passive, reference_angle=0.05)

    upper, lower = robot.cables
    nodes = tuple(changed(k, node) for k, node in enumerate(upper.nodes))
    return replace(
        robot,
        cables=(
            replace(upper, nodes=nodes, creep_share=0.3, creep_time=2.0, flow_time=300.0),
            replace(
                lower, nodes=tuple(map(both, lower.nodes)), bedding_strain=0.004,
                bedding_tension=12.0, creep_share=0.2,
            ),
        ),
        motors=tuple(axis(motor, 1.0) for motor in robot.motors),
        joints=tuple(axis(joint, 2.0) for joint in robot.joints),
    )  # fmt: skip


@pytest.mark.parametrize("law", ["none", "lugre", "elastoplastic"])
def test_terms_that_no_shipped_robot_has(law, prototype):
    robot = prepare(with_law(with_everything(prototype), law), check_range=False).robot
    check(robot, course(robot))


BODIES = """
name: bodies
motors: [{name: winch}]
joints:
  - {name: turn, range: [-0.15, 0.15]}
  - {name: slide, range: [-0.02, 0.02]}
frames:
  - {name: arm, joint: turn, motion: revolute, origin: [0.1, 0.02, 0.01], axis: [0.2, 0.1, 1]}
  - {name: tip, parent: arm, joint: slide, motion: prismatic, origin: [0.1, 0, 0], axis: [0, 0, 1]}
cables:
  - name: only
    preload: 20
    axial_stiffness: 500
    friction: {mu_c: 0.1}
    nodes:
      - {type: winch, motor: winch, radius: 0.01, winding: 1, position: [0, 0, 0],
         axis: [0.1, 0, 1], turn: cw}
      - {type: cylinder, radius: 0.012, position: [0.05, 0.004, 0], axis: [0, 1, 6], turn: ccw}
      - {type: sphere, frame: arm, radius: 0.015, position: [0.03, 0.008, 0], side: [0.03, 0.05, 0]}
      - {type: cylinder, frame: arm, radius: 0.006, position: [0.06, 0.03, 0.01],
         axis: [0.2, 0.3, 1], inside: true}
      - {type: pulley, frame: tip, radius: 0.008, position: [0, 0, 0], axis: [0, 0.2, 1], turn: cw}
      - {type: sphere, frame: tip, radius: 0.01, position: [0.04, -0.03, 0.02], inside: true}
      - {type: eyelet, frame: tip, position: [0.07, -0.02, 0.02]}
      - {type: anchor, position: [0.35, -0.03, 0.03]}
"""


MORE_BODIES = """
name: more_bodies
motors: [{name: winch}]
joints:
  - {name: turn, range: [-0.15, 0.15]}
  - {name: slide, range: [-0.02, 0.02]}
frames:
  - {name: arm, joint: turn, motion: revolute, origin: [0.3, 0.02, 0.01], axis: [0, 1, 1],
     rpy: [0.1, 0.2, 0.3]}
  - {name: knee, parent: arm, joint: slide, motion: rolling, origin: [0.1, 0, 0.02], radius: 0.02,
     rpy: [0.3, -0.2, 0.1]}
  - {name: finger, joint: turn, motion: continuous, multiplier: -0.7, offset: 0.2,
     origin: [0.6, 0, 0.02], axis: [0, 0, 1], quaternion: [0, 0, 0.6, 0.8]}
friction: {mu_c: 0.1}
cables:
  - name: one
    preload: 20
    axial_stiffness: 500
    nodes:
      - {type: winch, motor: winch, radius: 0.01, winding: 1, position: [0, 0, 0], turn: cw,
         axis: [0, 0, 1]}
      - {type: sphere, radius: 0.03, position: [0.1, 0.01, 0], side: [0.02, 0.1, 0],
         side_frame: arm}
      - {type: sphere, frame: arm, radius: 0.03, position: [0.03, 0.03, 0.03]}
      - {type: anchor, frame: knee, position: [0.2, 0.02, 0.02]}
  - name: two
    preload: 20
    axial_stiffness: 500
    nodes:
      - {type: anchor, position: [0, 0, 0]}
      - {type: cylinder, radius: 0.03, position: [0.15, 0, 0], axis: [0.2, 0, 1], turn: ccw,
         turns: 3}
      - {type: cylinder, frame: arm, radius: 0.02, position: [0, 0.015, 0], axis: [0, 0, 1]}
      - {type: anchor, frame: finger, radius: 0.015, position: [0.1, 0.05, 0], axis: [0, 0, 1],
         turn: cw}
"""
"""Frames that roll and that turn without end, three turns, and a sphere that the cable leaves."""


@pytest.mark.parametrize("text", [BODIES, MORE_BODIES], ids=["bodies", "more bodies"])
def test_bodies_that_no_shipped_robot_has(text):
    robot = prepare(parse_robot(text), check_range=False).robot
    check(robot, course(robot))

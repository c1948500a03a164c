"""Robots over whose bodies joints lay cable, their motions, and their true tensions.

The geometry is the estimator's, which test_reference.py holds to one of its own; friction is that
of ``truth.surface``.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.prepared import placed, prepare
from cdrj_ros.robot.description import Pulley, Robot
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.simulation import assembly
from truth import surface
from truth.surface import Contact, Course

Array = NDArray[np.float64]

CELL = np.radians(1.5)
"""Angle of a contact cell about a body."""

HEAD = """
name: scene
friction: {law: elastoplastic, rho: 1, bristle_stiffness: 1e6}
"""
ONE_CABLE = """
motors: [{name: motor}]
cables:
  - name: cable
    axial_stiffness: 1e4
    preload: 40
    nodes:
"""

SKEW_CYLINDERS = (
    """
joints: [{name: swing, range: [-0.62, 0.5]}, {name: slide, range: [-0.045, 0.022]}]
frames:
  - {name: arm, motion: revolute, joint: swing, origin: [0.3, 0.05, 0], rpy: [0.2, 0.1, 0],
     axis: [0, 0, 1]}
  - {name: slider, parent: arm, motion: prismatic, joint: slide, axis: [0.6, 0, 0.8]}
"""
    + ONE_CABLE
    + """
      - {type: winch, motor: motor, winding: 1, radius: 0.015, position: [-0.2, -0.1, 0],
         axis: [0, 0, 1], turn: cw}
      - {type: cylinder, radius: 0.025, position: [0, 0, 0], axis: [0.2, 0.1, 1], turn: cw,
         friction: {mu_c: 0.15}}
      - {type: eyelet, position: [0.1, -0.05, 0.03], friction: {mu_c: 0.2}}
      - {type: cylinder, radius: 0.02, position: [0.2, 0, 0], axis: [-0.1, 0.3, 1], turn: ccw,
         friction: {mu_c: 0.25}}
      - {type: anchor, frame: slider, position: [0.02, 0.12, 0.02]}
"""
)

SPHERE = (
    """
joints: [{name: swing, range: [-0.575, 0.337]}, {name: lift, range: [-0.0079, 0.0467]}]
frames:
  - {name: arm, motion: revolute, joint: swing, rpy: [0.1, 0.2, 0], axis: [1, 0, 0]}
  - {name: slider, parent: arm, motion: prismatic, joint: lift, axis: [0, 1, 0]}
"""
    + ONE_CABLE
    + """
      - {type: winch, motor: motor, winding: 1, radius: 0.015, position: [-0.12, 0.01, 0.005]}
      - {type: sphere, radius: 0.03, position: [0, 0, 0], side: [0, 0.1, 0],
         friction: {mu_c: 0.25}}
      - {type: anchor, frame: slider, position: [0.055, 0.01, 0.005]}
"""
)
"""The cable leaves the sphere and meets it again; the plane of its great circle turns."""

CARRIAGE = (
    """
joints:
  - {name: x, range: [-0.055, 0.044]}
  - {name: yaw, range: [-0.925, 0.219]}
  - {name: lever, range: [-0.79, 0.435]}
frames:
  - {name: along, motion: prismatic, joint: x, origin: [0, 0.1, 0], axis: [1, 0, 0]}
  - {name: carriage, parent: along, motion: revolute, joint: yaw, axis: [0, 0, 1]}
  - {name: lever, motion: revolute, joint: lever, origin: [0.3, 0.1, 0], axis: [0, 0, 1]}
"""
    + ONE_CABLE
    + """
      - {type: winch, motor: motor, winding: 1, radius: 0.015, position: [-0.2, -0.15, 0.01],
         axis: [0, 0, 1], turn: cw}
      - {type: cylinder, frame: carriage, radius: 0.025, position: [0.01, 0, 0],
         axis: [0.1, 0.05, 1], turn: cw, friction: {mu_c: 0.15}}
      - {type: pulley, radius: 0.02, position: [0.15, -0.1, 0], axis: [0, 0, 1], turn: ccw,
         friction: {mu_c: 0.1}}
      - {type: anchor, frame: lever, radius: 0.03, position: [0, 0, 0], axis: [0, 0, 1], turn: cw}
"""
)
"""The body moves and turns under its cable, and the tangents move on a drum and on a sector."""

PLATFORM = """
joints:
  - {name: x, range: [-0.246, 0.207]}
  - {name: y, range: [-0.282, 0.066]}
  - {name: yaw, range: [-0.244, 0.164]}
frames:
  - {name: along, motion: prismatic, joint: x, axis: [1, 0, 0]}
  - {name: across, parent: along, motion: prismatic, joint: y, axis: [0, 1, 0]}
  - {name: platform, parent: across, motion: revolute, joint: yaw, axis: [0, 0, 1]}
motors: [{name: motor_1}, {name: motor_2}, {name: motor_3}, {name: motor_4}]
cables:
""" + "".join(
    f"""
  - name: cable_{k}
    axial_stiffness: 2e4
    preload: 40
    nodes:
      - {{type: winch, motor: motor_{k}, winding: 1, radius: 0.02, turn: ccw, axis: [0, 1, 0],
         position: [{0.9 * x + 0.02}, {0.7 * y}, -0.4]}}
      - {{type: swivel, radius: 0.03, position: [{0.9 * x}, {0.7 * y}, 0.3], axis: [0, 0, 1],
         friction: {{mu_c: 0.15}}}}
      - {{type: anchor, frame: platform, position: [{0.08 * x}, {0.06 * y}, -0.02]}}
"""
    for k, (x, y) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1)), start=1)
)  # fmt: skip

SHEATH = (
    """
joints: [{name: elbow, range: [-0.506, 0.487]}]
frames: [{name: lever, motion: revolute, joint: elbow, origin: [0.3, 0.2, 0.1], axis: [0, 0, 1]}]
"""
    + ONE_CABLE
    + """
      - {type: winch, motor: motor, winding: 1, radius: 0.015, position: [-0.1, -0.15, 0],
         axis: [0, 0, 1], turn: cw}
      - {type: pulley, radius: 0.02, position: [0, 0, 0], axis: [0, 0, 1], turn: cw,
         friction: {mu_c: 0.15}}
      - {type: sheath, position: [0.1, 0, 0], exit: [0.3, 0.08, 0.1], exit_frame: base,
         length: 0.4, bend_deg: 157, friction: {mu_c: 0.12}}
      - {type: anchor, frame: lever, position: [0.05, 0, 0]}
"""
)


@dataclass(frozen=True)
class Scene:
    """A robot and its motion, which begins in the reference pose."""

    robot: Robot
    time: Array
    """[s], shape (n,)."""
    joint: Array
    """[rad] or [m], shape (n, joints)."""
    pull: Array
    """Cable that a motor winds beyond what its cable's geometry asks for [m], shape (n, motors)."""
    cycle: float
    """Time after which every body has slipped [s]."""


def scene(name):
    """A scene of ``MOTIONS``."""
    text, cycle, seconds, rate, joints, pulls = MOTIONS[name]
    time = np.arange(round(seconds * rate) + 1) / rate
    joint = np.stack([waves(time, *terms) for terms in joints], axis=1)
    pull = np.stack([waves(time, one) for one in pulls], axis=1)
    return Scene(parse_robot(HEAD + text), time, joint, pull, cycle)


def waves(time, *terms):
    """A sum of sines that begins at 0, from (amplitude, frequency [Hz], phase [rad]) each."""
    angle = np.zeros(time.size)
    for amplitude, frequency, phase in terms:
        angle += amplitude * (np.sin(2.0 * np.pi * frequency * time + phase) - np.sin(phase))
    return angle


MOTIONS = {
    "skew cylinders": (
        SKEW_CYLINDERS, 6.0, 9.0, 62.5,
        [[(0.5, 0.17, 0.0), (0.08, 0.53, 1.0)], [(0.03, 0.11, 0.5), (0.01, 0.37, 0.0)]],
        [(0.0006, 0.23, 0.0)],
    ),
    "sphere": (
        SPHERE, 7.0, 20.0, 50.0,
        [[(0.4, 0.21, 0.3), (0.05, 0.47, 0.0)], [(0.025, 0.15, -0.9), (0.002, 0.53, 0.0)]],
        [(0.0002, 0.23, 0.0)],
    ),
    "carriage": (
        CARRIAGE, 7.0, 10.0, 62.5,
        [[(0.04, 0.13, 0.0), (0.01, 0.47, 0.4)], [(0.5, 0.19, 0.9), (0.1, 0.41, 0.0)],
         [(0.6, 0.16, 0.3)]],
        [(0.0006, 0.23, 0.0)],
    ),
    "platform": (
        PLATFORM, 8.0, 10.0, 75.0,
        [[(0.2, 0.13, 0.0), (0.03, 0.47, 0.4)], [(0.15, 0.17, 0.9), (0.03, 0.37, 0.0)],
         [(0.2, 0.11, 0.2)]],
        [(0.0012, 0.19 + 0.04 * k, 0.5 * k) for k in range(4)],
    ),
    "sheath": (
        SHEATH, 6.0, 9.0, 62.5, [[(0.5, 0.16, 0.0), (0.08, 0.45, 0.4)]], [(0.0012, 0.23, 0.0)],
    ),
}  # fmt: skip
"""Text, cycle [s], duration [s], rate [Hz], and the motions of joints and pulls of motors."""


@dataclass(frozen=True)
class Truth:
    """Angles of the motors, tensions and efforts over time."""

    motor: Array
    """[rad], shape (n, motors)."""
    tension: Array
    """Of every straight span [N], shape (n, elements)."""
    joint_effort: Array
    """[N m] or [N], shape (n, joints)."""
    motor_effort: Array
    """[N m], shape (n, motors)."""


@dataclass(frozen=True)
class Path:
    """One cable over time; it has S spans."""

    span: Array
    """Straight lengths [m], shape (n, S)."""
    arc: Array
    """Cable on every body [m], shape (n, S - 1)."""
    middle: Array
    """Place of the arc's middle on the surface [m]."""
    wrap: Array
    touching: NDArray[np.bool_]
    laid: Array
    """Cable laid onto both ends as tangents move [m], shape (n, 2)."""
    lever: Array
    """Of the pull about the axis of the first node [m], shape (n,)."""


def paths_of(model, joint):
    """Paths of all cables, and lever arms, shape (n, elements, joints)."""
    poses = [placed(model, pose) for pose in joint]
    length, wrap, direction, arm = (
        np.array([getattr(found, name) for found, _ in poses])
        for name in ("length", "wrap", "direction", "lever_arm")
    )
    arc, laid = (np.array([getattr(views, name) for _, views in poses]) for name in ("arc", "laid"))
    track, paths, body = assembly.course(model, joint).track, [], 0
    for c, (cable, part) in enumerate(zip(model.robot.cables, model.robot.parts, strict=True)):
        own = slice(body, body := body + len(cable.pulleys))
        span, ends = length[:, part].copy(), laid[:, 2 * c : 2 * c + 2]
        span[:, [0, -1]] -= ends
        span[:, :-1] -= 0.5 * arc[:, own]
        span[:, 1:] -= 0.5 * arc[:, own]
        leaves = np.array([pulley.kind == "sphere" for pulley in cable.pulleys])
        touching = (wrap[:, own] > 0.0) | ~leaves
        for k, off in enumerate((~touching).T):  # the whole line is in the span before the body
            span[off, k] += span[off, k + 1]
            span[off, k + 1] = 0.0
        first = cable.nodes[0]
        lever = np.full(len(joint), first.radius)
        if first.place and first.place.turn:
            pull = np.cross(first.place.axis, direction[:, part.start])
            lever *= np.linalg.norm(pull, axis=1)
        paths.append(Path(span, arc[:, own], track[:, own], wrap[:, own], touching, ends, lever))
    return paths, arm


def truth_of(scene):
    """Solve all cables over time; every cable has a motor of its own at its first node."""
    model = prepare(scene.robot, check_range=False)
    paths, arm = paths_of(model, scene.joint)
    motor, motor_effort = np.zeros((2, *scene.pull.shape))
    tension = []
    for c, (cable, path) in enumerate(zip(scene.robot.cables, paths, strict=True)):
        length = path.span.sum(1) + path.arc.sum(1) + path.laid.sum(1)
        wound = scene.pull[:, c] - (length - length[0])
        motor[:, c] = wound / cable.nodes[0].radius
        drums = path.laid + np.outer(wound, [1.0, 0.0])
        one = surface.Cable(cable.axial_stiffness, cable.preload, contacts_of(cable))
        states = surface.solve(one, courses_of(path, drums))
        tension.append(np.stack([state.tension(one) for state in states]))
        motor_effort[:, c] = -path.lever * tension[c][:, 0]
    every = np.concatenate(tension, axis=1)
    return Truth(motor, every, -np.einsum("ne,nej->nj", every, arm), motor_effort)


def courses_of(path, drums):
    first, last = path.middle - 0.5 * path.arc, path.middle + 0.5 * path.arc
    return map(Course, path.span, first, last, path.wrap, path.touching, drums)


def contacts_of(cable):
    """The bodies; an eyelet is one cell."""

    def cell(pulley):
        if pulley.kind != "sheath":
            return float(CELL * pulley.radius)
        return float(pulley.place.length / np.ceil(pulley.wrap[0].value[0] / CELL))

    return tuple(Contact(pulley.friction.mu_c, cell(pulley)) for pulley in cable.pulleys)


def with_cells(robot, cells):
    """The robot with so many contact cells on every body."""
    cables = [
        replace(cable, nodes=tuple(
            replace(node, cells=cells) if isinstance(node, Pulley) and node.kind != "eyelet"
            else node for node in cable.nodes
        ))
        for cable in robot.cables
    ]  # fmt: skip
    return replace(robot, cables=tuple(cables))

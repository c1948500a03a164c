"""The scenes' robots and motions."""

from __future__ import annotations

import numpy as np

from cdrj_ros.robot.reader import parse_robot
from truth.scenes import Scene, waves

FRICTION = "friction: {law: elastoplastic, rho: 1, bristle_stiffness: 1e6}\n"


def _scene(
    text: str, seconds: float, rate: float, joints: list[list[tuple[float, float, float]]],
    pull: dict[str, tuple[float, float, float]], cycle: float, stride: int = 4,
) -> Scene:  # fmt: skip
    time = np.arange(round(seconds * rate) + 1) / rate
    joint = np.stack([waves(time, *terms) for terms in joints], axis=1)
    winds = {name: waves(time, term) for name, term in pull.items()}
    return Scene(parse_robot(text + FRICTION), time, joint, winds, cycle, stride)


def skew_cylinders() -> Scene:
    """Two skew cylinders, an eyelet between them; a drum at one end, two joints at the other."""
    text = """
name: skew_cylinders
motors: [{name: motor}]
joints: [{name: swing, range: [-0.61, 0.49]}, {name: slide, range: [-0.045, 0.022]}]
frames:
  - {name: arm, motion: revolute, joint: swing, origin: [0.3, 0.05, 0], rpy: [0.2, 0.1, 0]}
  - {name: slider, parent: arm, motion: prismatic, joint: slide, axis: [0.6, 0, 0.8]}
cables:
  - name: cable
    axial_stiffness: 1e4
    preload: 40
    nodes:
      - {type: winch, motor: motor, winding: 1, position: [-0.2, -0.1, 0], radius: 0.015,
         axis: [0, 0, 1], turn: cw}
      - {type: cylinder, position: [0, 0, 0], radius: 0.025, axis: [0.2, 0.1, 1], turn: cw,
         friction: {mu_c: 0.15}}
      - {type: eyelet, position: [0.1, -0.05, 0.03], friction: {mu_c: 0.2}}
      - {type: cylinder, position: [0.2, 0, 0], radius: 0.02, axis: [-0.1, 0.3, 1], turn: ccw,
         friction: {mu_c: 0.25}}
      - {type: anchor, position: [0.02, 0.12, 0.02], frame: slider}
"""
    swing = [(0.5, 0.17, 0.0), (0.08, 0.53, 1.0)]
    slide = [(0.03, 0.11, 0.5), (0.01, 0.37, 0.0)]
    return _scene(text, 9.0, 62.5, [swing, slide], {"motor": (0.0006, 0.23, 0.0)}, 6.0)


def sphere() -> Scene:
    """A sphere, which the cable leaves and meets again; the plane of its great circle turns."""
    text = """
name: sphere
motors: [{name: motor}]
joints: [{name: swing, range: [-0.57, 0.33]}, {name: lift, range: [-0.0075, 0.047]}]
frames:
  - {name: arm, motion: revolute, joint: swing, rpy: [0.1, 0.2, 0], axis: [1, 0, 0]}
  - {name: slider, parent: arm, motion: prismatic, joint: lift, axis: [0, 1, 0]}
cables:
  - name: cable
    axial_stiffness: 1e4
    preload: 40
    nodes:
      - {type: winch, motor: motor, winding: 1, position: [-0.12, 0.01, 0.005], radius: 0.015}
      - {type: sphere, position: [0, 0, 0], radius: 0.03, side: [0, 0.1, 0],
         friction: {mu_c: 0.25}}
      - {type: anchor, position: [0.055, 0.01, 0.005], frame: slider}
"""
    swing = [(0.4, 0.21, 0.3), (0.05, 0.47, 0.0)]
    lift = [(0.025, 0.15, -0.9), (0.002, 0.53, 0.0)]
    return _scene(text, 20.0, 50.0, [swing, lift], {"motor": (0.0002, 0.23, 0.0)}, 7.0, 1)


def carriage() -> Scene:
    """A cylinder on a carriage that moves and turns under its cable, which ends on a lever.

    The tangent moves on the drum and on a sector of the lever, on neither of which the cable slips.
    """
    text = """
name: carriage
motors: [{name: motor}]
joints:
  - {name: x, range: [-0.055, 0.044]}
  - {name: yaw, range: [-0.92, 0.22]}
  - {name: lever, range: [-0.79, 0.43]}
frames:
  - {name: along, motion: prismatic, joint: x, origin: [0, 0.1, 0], axis: [1, 0, 0]}
  - {name: carriage, parent: along, motion: revolute, joint: yaw}
  - {name: lever, motion: revolute, joint: lever, origin: [0.3, 0.1, 0]}
cables:
  - name: cable
    axial_stiffness: 1e4
    preload: 40
    nodes:
      - {type: winch, motor: motor, winding: 1, position: [-0.2, -0.15, 0.01], radius: 0.015,
         axis: [0, 0, 1], turn: cw}
      - {type: cylinder, position: [0.01, 0, 0], frame: carriage, radius: 0.025,
         axis: [0.1, 0.05, 1], turn: cw, friction: {mu_c: 0.15}}
      - {type: pulley, position: [0.15, -0.1, 0], radius: 0.02, axis: [0, 0, 1], turn: ccw,
         friction: {mu_c: 0.1}}
      - {type: anchor, position: [0, 0, 0], frame: lever, radius: 0.03, axis: [0, 0, 1], turn: cw}
"""
    x, yaw = [(0.04, 0.13, 0.0), (0.01, 0.47, 0.4)], [(0.5, 0.19, 0.9), (0.1, 0.41, 0.0)]
    pull = {"motor": (0.0006, 0.23, 0.0)}
    return _scene(text, 10.0, 62.5, [x, yaw, [(0.6, 0.16, 0.3)]], pull, 7.0)


def platform() -> Scene:
    """A platform on four cables, which moves along two directions and turns.

    The drums lie under the swivels, so that the cables enter along the swivels' axes.
    """
    text = """
name: platform
motors: [{name: motor_1}, {name: motor_2}, {name: motor_3}, {name: motor_4}]
joints:
  - {name: x, range: [-0.25, 0.21]}
  - {name: y, range: [-0.28, 0.07]}
  - {name: yaw, range: [-0.25, 0.17]}
frames:
  - {name: along, motion: prismatic, joint: x, axis: [1, 0, 0]}
  - {name: across, parent: along, motion: prismatic, joint: y, axis: [0, 1, 0]}
  - {name: platform, parent: across, motion: revolute, joint: yaw}
cables:
"""
    pull = {}
    for k, (x, y) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1)), start=1):
        text += f"""
  - name: cable_{k}
    axial_stiffness: 2e4
    preload: 40
    nodes:
      - {{type: winch, motor: motor_{k}, winding: 1, position: [{x * 0.9 + 0.02}, {y * 0.7}, -0.4],
         radius: 0.02, axis: [0, 1, 0], turn: ccw}}
      - {{type: swivel, position: [{x * 0.9}, {y * 0.7}, 0.3], radius: 0.03, axis: [0, 0, 1],
         friction: {{mu_c: 0.15}}}}
      - {{type: anchor, position: [{x * 0.08}, {y * 0.06}, -0.02], frame: platform}}
"""
        pull[f"motor_{k}"] = 0.0012, 0.15 + 0.04 * k, 0.5 * (k - 1)
    x_way, y_way = [(0.2, 0.13, 0.0), (0.03, 0.47, 0.4)], [(0.15, 0.17, 0.9), (0.03, 0.37, 0.0)]
    return _scene(text, 10.0, 62.5, [x_way, y_way, [(0.2, 0.11, 0.2)]], pull, 8.0)


def sheath() -> Scene:
    """A Bowden sheath behind a pulley, from the motor to a lever."""
    text = """
name: sheath
motors: [{name: motor}]
joints: [{name: elbow, range: [-0.5, 0.48]}]
frames: [{name: lever, motion: revolute, joint: elbow, origin: [0.3, 0.2, 0.1]}]
cables:
  - name: cable
    axial_stiffness: 1e4
    preload: 40
    nodes:
      - {type: winch, motor: motor, winding: 1, position: [-0.1, -0.15, 0], radius: 0.015,
         axis: [0, 0, 1], turn: cw}
      - {type: pulley, position: [0, 0, 0], radius: 0.02, axis: [0, 0, 1], turn: cw,
         friction: {mu_c: 0.15}}
      - {type: sheath, position: [0.1, 0, 0], exit: [0.3, 0.08, 0.1], exit_frame: base,
         length: 0.4, bend_deg: 157, friction: {mu_c: 0.12}}
      - {type: anchor, position: [0.05, 0, 0], frame: lever}
"""
    elbow = [(0.5, 0.16, 0.0), (0.08, 0.45, 0.4)]
    return _scene(text, 9.0, 62.5, [elbow], {"motor": (0.0012, 0.23, 0.0)}, 6.0)

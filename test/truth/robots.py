"""The scenes' robots and motions."""

from __future__ import annotations

import numpy as np

from truth.bodies import Node
from truth.frames import Frame
from truth.scenes import Line, Scene, waves


def _clock(seconds: float, rate: float) -> np.ndarray:
    return np.arange(round(seconds * rate) + 1) / rate


def skew_cylinders(seconds: float = 20.0, rate: float = 250.0) -> Scene:
    """Two skew cylinders, an eyelet between them; a drum at one end, two joints at the other."""
    time = _clock(seconds, rate)
    joint = np.stack(
        [
            waves(time, (0.5, 0.17, 0.0), (0.08, 0.53, 1.0)),
            waves(time, (0.03, 0.11, 0.5), (0.01, 0.37, 0.0)),
        ],
        axis=1,
    )
    frames = (
        Frame("arm", "base", "revolute", "swing", origin=(0.3, 0.05, 0.0), rpy=(0.2, 0.1, 0.0)),
        Frame("slider", "arm", "prismatic", "slide", axis=(0.6, 0.0, 0.8)),
    )
    nodes = (
        Node("winch", (-0.2, -0.1, 0.0), radius=0.015, axis=(0.0, 0.0, 1.0), turn=-1,
             motor="motor", winding=1),
        Node("cylinder", (0.0, 0.0, 0.0), radius=0.025, axis=(0.2, 0.1, 1.0), turn=-1, mu=0.15),
        Node("eyelet", (0.1, -0.05, 0.03), mu=0.2),
        Node("cylinder", (0.2, 0.0, 0.0), radius=0.02, axis=(-0.1, 0.3, 1.0), turn=1, mu=0.25),
        Node("anchor", (0.02, 0.12, 0.02), frame="slider"),
    )  # fmt: skip
    return Scene(
        "skew_cylinders", frames, ("swing", "slide"), ("motor",),
        (Line("cable", 1e4, 40.0, nodes),), time, joint,
        {"motor": waves(time, (0.0006, 0.23, 0.0))}, 6.0,
    )  # fmt: skip


def sphere(seconds: float = 20.0, rate: float = 250.0) -> Scene:
    """A sphere, which the cable leaves and meets again; the plane of its great circle turns."""
    time = _clock(seconds, rate)
    joint = np.stack(
        [
            waves(time, (0.4, 0.21, 0.3), (0.05, 0.47, 0.0)),
            waves(time, (0.025, 0.15, -0.9), (0.002, 0.53, 0.0)),
        ],
        axis=1,
    )
    frames = (
        Frame("arm", "base", "revolute", "swing", rpy=(0.1, 0.2, 0.0), axis=(1.0, 0.0, 0.0)),
        Frame("slider", "arm", "prismatic", "lift", axis=(0.0, 1.0, 0.0)),
    )
    nodes = (
        Node("winch", (-0.12, 0.01, 0.005), radius=0.015, motor="motor", winding=1),
        Node("sphere", (0.0, 0.0, 0.0), radius=0.03, mu=0.25, side=(0.0, 0.1, 0.0)),
        Node("anchor", (0.055, 0.01, 0.005), frame="slider"),
    )
    return Scene(
        "sphere", frames, ("swing", "lift"), ("motor",), (Line("cable", 1e4, 40.0, nodes),),
        time, joint, {"motor": waves(time, (0.0002, 0.23, 0.0))}, 7.0,
    )  # fmt: skip


def carriage(seconds: float = 20.0, rate: float = 250.0) -> Scene:
    """A cylinder on a carriage that moves and turns under its cable, which ends on a lever.

    The tangent moves on the drum and on a sector of the lever, on neither of which the cable slips.
    """
    time = _clock(seconds, rate)
    joint = np.stack(
        [
            waves(time, (0.04, 0.13, 0.0), (0.01, 0.47, 0.4)),
            waves(time, (0.5, 0.19, 0.9), (0.1, 0.41, 0.0)),
            waves(time, (0.6, 0.16, 0.3)),
        ],
        axis=1,
    )
    frames = (
        Frame("along", "base", "prismatic", "x", origin=(0.0, 0.1, 0.0), axis=(1.0, 0.0, 0.0)),
        Frame("carriage", "along", "revolute", "yaw"),
        Frame("lever", "base", "revolute", "lever", origin=(0.3, 0.1, 0.0)),
    )
    z = (0.0, 0.0, 1.0)
    nodes = (
        Node("winch", (-0.2, -0.15, 0.01), radius=0.015, axis=z, turn=-1, motor="motor",
             winding=1),
        Node("cylinder", (0.01, 0.0, 0.0), frame="carriage", radius=0.025, axis=(0.1, 0.05, 1.0),
             turn=-1, mu=0.15),
        Node("pulley", (0.15, -0.1, 0.0), radius=0.02, axis=z, turn=1, mu=0.1),
        Node("anchor", (0.0, 0.0, 0.0), frame="lever", radius=0.03, axis=z, turn=-1),
    )  # fmt: skip
    return Scene(
        "carriage", frames, ("x", "yaw", "lever"), ("motor",),
        (Line("cable", 1e4, 40.0, nodes),), time, joint,
        {"motor": waves(time, (0.0006, 0.23, 0.0))}, 7.0,
    )  # fmt: skip


def platform(seconds: float = 20.0, rate: float = 200.0) -> Scene:
    """A platform on four cables, which moves along two directions and turns."""
    time = _clock(seconds, rate)
    joint = np.stack(
        [
            waves(time, (0.2, 0.13, 0.0), (0.03, 0.47, 0.4)),
            waves(time, (0.15, 0.17, 0.9), (0.03, 0.37, 0.0)),
            waves(time, (0.2, 0.11, 0.2)),
        ],
        axis=1,
    )
    frames = (
        Frame("along", "base", "prismatic", "x", axis=(1.0, 0.0, 0.0)),
        Frame("across", "along", "prismatic", "y", axis=(0.0, 1.0, 0.0)),
        Frame("platform", "across", "revolute", "yaw"),
    )
    lines = []
    pull = {}
    for k, (x, y) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        motor, r = f"motor_{k + 1}", 0.02
        # the drum lies under the swivel, so that the cable enters along the swivel's axis
        nodes = (
            Node("winch", (x * 0.9 + r, y * 0.7, -0.4), radius=r, axis=(0.0, 1.0, 0.0), turn=1,
                 motor=motor, winding=1),
            Node("swivel", (x * 0.9, y * 0.7, 0.3), radius=0.03, axis=(0.0, 0.0, 1.0), mu=0.15),
            Node("anchor", (x * 0.08, y * 0.06, -0.02), frame="platform"),
        )  # fmt: skip
        lines.append(Line(f"cable_{k + 1}", 2e4, 40.0, nodes))
        pull[motor] = waves(time, (0.0012, 0.19 + 0.04 * k, 0.5 * k))
    return Scene(
        "platform", frames, ("x", "y", "yaw"), tuple(pull), tuple(lines), time, joint, pull, 8.0
    )


def sheath(bend: float = np.radians(157.0), seconds: float = 20.0, rate: float = 250.0) -> Scene:
    """A Bowden sheath behind a pulley, from the motor to a lever."""
    time = _clock(seconds, rate)
    joint = waves(time, (0.5, 0.16, 0.0), (0.08, 0.45, 0.4))[:, None]
    frames = (Frame("lever", "base", "revolute", "elbow", origin=(0.3, 0.2, 0.1)),)
    nodes = (
        Node("winch", (-0.1, -0.15, 0.0), radius=0.015, axis=(0.0, 0.0, 1.0), turn=-1,
             motor="motor", winding=1),
        Node("pulley", (0.0, 0.0, 0.0), radius=0.02, axis=(0.0, 0.0, 1.0), turn=-1, mu=0.15),
        Node("sheath", (0.1, 0.0, 0.0), exit=(0.3, 0.08, 0.1), length=0.4, bend=bend, mu=0.12),
        Node("anchor", (0.05, 0.0, 0.0), frame="lever"),
    )  # fmt: skip
    return Scene(
        "sheath", frames, ("elbow",), ("motor",), (Line("cable", 1e4, 40.0, nodes),), time, joint,
        {"motor": waves(time, (0.0012, 0.23, 0.0))}, 6.0,
    )  # fmt: skip

"""Which cables of a robot depend on each other, and the part of a robot file about some of them.

A cable depends on its motors, on the joints that move its nodes or enter its tables, and on the
numbers of its path.  Cables that share a motor or a joint are connected, by a measured joint
through its zero.  The branches beyond a measured joint that several of them pass, such as the
fingers beyond a wrist, may count as groups of their own: its angle, which is known, couples them,
and nothing else.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.robot.couplings import is_coupled
from cdrj_ros.robot.description import Cable, Robot
from cdrj_ros.robot.names import NAMED_KINDS
from cdrj_ros.robot.parameters import find_number
from cdrj_ros.robot.space import Frame
from cdrj_ros.robot.stated import with_covariance

Groups = tuple[tuple[int, ...], ...]
"""Indices of cables, increasing; the groups in the order of their first cables."""


def joints_of(robot: Robot, cable: Cable) -> frozenset[str]:
    """Names of the joints on which the lengths and wraps of a cable depend."""
    found = {profile.joint for profile in cable.profiles}
    found |= {frame.joint for frame in _frames_of(robot, cable)}
    return frozenset(name for name in found if name is not None)


def connected_cables(robot: Robot, *, branches: bool = False, by_joints: bool = True) -> Groups:
    """The cables of a robot in groups that do not depend on each other.

    Args:
        robot: the robot.
        branches: whether the branches beyond a measured joint are groups of their own.
        by_joints: whether a joint connects cables; otherwise only motors do.
    """
    joints = [joints_of(robot, cable) for cable in robot.cables]
    motors = [cable.motors for cable in robot.cables]
    label = np.arange(len(robot.cables))

    def passing(name: str, names: Sequence[Collection[str]]) -> list[int]:
        return [c for c, own in enumerate(names) if name in own]

    def connect(members: Sequence[int]) -> None:
        label[np.isin(label, label[members])] = label[members].min(initial=len(label))

    for motor in robot.motors:
        connect(passing(motor.name, motors))
    connecting = robot.joints if by_joints else ()
    for joint in connecting:
        if not joint.measured:
            connect(passing(joint.name, joints))
    beyond: set[int] = set()  # cables that a joint nearer to their ends moves, too
    for members in sorted((passing(one.name, joints) for one in connecting), key=len):
        groups = {label[c] for c in beyond.intersection(members)}
        whole = set(np.flatnonzero(np.isin(label, [*groups])).tolist()) <= set(members)
        several = branches and len(groups) > 1 and whole
        connect([c for c in members if not several or label[c] not in groups])
        beyond |= set(members)
    return tuple(tuple(np.flatnonzero(label == one).tolist()) for one in np.unique(label))


def part_of(robot: Robot, cables: Collection[int]) -> Document:
    """The robot file of some cables alone, with their motors, joints and frames.

    What the file states of the accuracy of other numbers is left out, as are errors of efforts at
    joints that other cables move, too.  A part with all cables is the file itself.

    Args:
        robot: the robot.
        cables: their indices.
    """
    document: Any = robot.document
    if len(cables) == len(robot.cables):
        return dict(document)
    own = [robot.cables[c] for c in sorted(cables)]
    joints = {name for one in own for name in joints_of(robot, one)}
    coupled = {
        one["name"]
        for one in document["joints"]
        if is_coupled(one) and joints.issuperset(one["coupled"])
    }
    kept = {
        "motors": {name for one in own for name in one.motors},
        "joints": joints | coupled,
        "frames": {frame.name for one in own for frame in _frames_of(robot, one)},
        "cables": {one.name for one in own},
    }
    part = {
        key: [one for one in value if one["name"] in kept[key]] if key in kept else value
        for key, value in document.items()
        if key not in ("parts", "uncertainty", "residual", "identified", "visuals", "assumed")
    }
    if "uncertainty" in document:
        part["uncertainty"] = _known_of(robot, part, channels_of(robot, cables))
    return part


def channels_of(robot: Robot, cables: Collection[int]) -> set[str]:
    """Efforts and tensions on which only some cables act: ``effort/jaw``, ``tension/upper/8``.

    Args:
        robot: the robot.
        cables: their indices.
    """
    own = [robot.cables[c] for c in cables]
    others = [cable for c, cable in enumerate(robot.cables) if c not in cables]
    axes, elsewhere = (
        {name for one in some for name in (*one.motors, *joints_of(robot, one))}
        for some in (own, others)
    )
    tensions = {f"tension/{name}" for one in own for name in one.element_names}
    return tensions | {f"effort/{name}" for name in axes - elsewhere}


class Owners:
    """To which group of cables a number of the robot file belongs."""

    def __init__(self, robot: Robot, groups: Groups) -> None:
        """Follow every cable of ``robot``.

        Args:
            robot: the robot.
            groups: of its cables, as of ``connected_cables``.
        """
        self._of: dict[str, set[int]] = {}
        for g, members in enumerate(groups):
            for cable in (robot.cables[c] for c in members):
                frames = {frame.name for frame in _frames_of(robot, cable)}
                parts = {f"cables.{cable.name}"}
                parts |= {f"motors.{name}" for name in cable.motors}
                parts |= {f"joints.{name}" for name in joints_of(robot, cable)}
                parts |= {f"frames.{name}" for name in frames}
                parts |= {
                    f"joints.{entry['joint']}"  # coupled to others
                    for entry in robot.document.get("frames", ())
                    if entry["name"] in frames and "joint" in entry
                }
                for part in parts:
                    self._of.setdefault(part, set()).add(g)

    def groups(self, path: str) -> frozenset[int]:
        """Indices of the groups with a number on their cables' paths.

        Args:
            path: of the number; one of the whole robot, such as ``friction.mu_c``, is of no group.
        """
        part = path
        while part not in self._of and "." in part:
            part = part.rpartition(".")[0]
        return frozenset(self._of.get(part, ()))

    def group(self, path: str) -> int | None:
        """Index of the only group with a number on its cables' paths; None if there are several."""
        found = self.groups(path)
        return min(found) if len(found) == 1 else None

    def group_of_all(self, paths: Iterable[str]) -> int | None:
        """Index of the only group with these numbers; None if there are several."""
        found = {self.group(path) for path in paths}
        return found.pop() if len(found) == 1 else None


def _known_of(robot: Robot, part: Document, channels: Collection[str]) -> Document:
    """What the block ``uncertainty`` states of the numbers and channels of a part."""
    stated: Any = robot.document["uncertainty"]
    entry = {key: value for key, value in stated.items() if key in ("others", "drums")}
    if isinstance(drums := entry.get("drums"), dict):
        own = {one["name"] for one in part["cables"]}
        entry["drums"] = {name: drums[name] for name in drums if name in own}
    errors = stated.get("model_error", {})
    entry["model_error"] = {name: errors[name] for name in errors if name in channels}
    known = robot.uncertainty
    names = known.parameters[: known.stated] if known is not None else ()
    if known is None or not (at := [k for k, path in enumerate(names) if has_number(part, path)]):
        return entry
    numbers = with_covariance([names[k] for k in at], known.covariance[np.ix_(at, at)])
    entry |= {"parameters": [*numbers.paths], "stddev": [*numbers.stddev]}
    return {**entry, "correlation": numbers.correlation.tolist()}


def has_number(document: Document, path: str) -> bool:
    """Whether a document has a number, if only by default."""
    kind, _, rest = path.partition(".")
    parts: Any = document.get(kind)
    if kind in NAMED_KINDS and not any(rest.startswith(f"{one['name']}.") for one in parts or ()):
        return False
    try:
        find_number(document, path)
    except UsageError:
        return False
    return True


def _frames_of(robot: Robot, cable: Cable) -> Iterator[Frame]:
    """The frames in which the nodes of a cable lie, and those that carry them; some repeatedly."""
    frames = {frame.name: frame for frame in robot.frames}
    for node in cable.nodes:
        for name in (node.place.frame, node.place.exit_frame) if node.place else ():
            frame = frames.get(name)
            while frame is not None:
                yield frame
                frame = frames.get(frame.parent or "")

"""The beginning of a robot file from a URDF: motors, joints and frames; it has no cables.

The format of ``<ros2_control>`` is that of control.ros.org: a joint with a command interface is
driven, one with state interfaces alone is measured.  Behind a simple transmission of the reduction
N, position of the joint = position of the actuator / N + offset, and the effort of the joint is N
times that of the actuator.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from math import inf, pi
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as Xml

from cdrj_ros.foundation.files import write_text
from cdrj_ros.foundation.output import listed, printable, said_once
from cdrj_ros.foundation.yaml import Document, yaml_flow
from cdrj_ros.robot.couplings import Coupling
from cdrj_ros.robot.imported import beginning, prefix_offered
from cdrj_ros.robot.space import UrdfJoint
from cdrj_ros.robot.transmissions import Transmission, transmissions_of
from cdrj_ros.robot.urdf import HELD, ROOT, joints_of, urdf_element

FASTER: Final = 2.0
"""Largest speed that a reading may have, in units of the limit of commands."""

LEFT_OUT: Final = "none of its reductions is in the file"
"""What becomes of a transmission that is not carried over."""

TURN: Final = (-pi, pi)
"""Assumed range of a hinge without limits [rad]."""

WAY: Final = (-1.0, 1.0)
"""Assumed range of a slide without limits [m]."""

FRICTION: Final = 0.15
"""Assumed coefficient of cables on what they touch."""


def import_urdf(path: Path, out: str) -> tuple[str, ...]:
    """Begin a robot file whose motors, joints and frames are those of a URDF.

    Args:
        path: URDF.
        out: robot file to write; its cables are left to be added.

    Returns:
        Remarks on what has to be checked or added.

    Raises:
        RobotFileError: the URDF cannot be read, or cannot be represented.
    """
    root = urdf_element(path, out)
    begun = _Begun(root, joints_of(root, path), path)
    place = os.path.relpath(path.resolve(), Path(out).resolve().parent)
    document = begun.document(place)
    head = (
        f"Begun from {printable(path.name)} by import_robot: names, gears, limits.",
        "max_speed is twice the limit of the URDF; ranges are its limits of position.  What is",
        "assumed is listed under assumed; take what you replace off the list.",
    )
    remarks = [*said_once(begun.remarks()), *prefix_offered(document)]
    lines = [*beginning(document, remarks, head), *_no_cables(begun.links())]
    write_text(out, "\n".join(lines) + "\n")
    return tuple(remarks)


def _no_cables(links: Sequence[str]) -> tuple[str, ...]:
    """The lines of a robot file whose cables are to be added, with nodes on these links."""
    return (
        "cables: []",
        "# One entry for each, in place of [], as in docs/tutorial.md, with nodes on the links",
        f"# {printable(listed(links))}",
    )


def controlled(root: Xml.Element) -> tuple[list[str], list[str]]:
    """Joints of ros2_control with a command interface, and with a state ``position`` alone."""
    driven, measured = [], []
    for joint in root.iterfind(".//ros2_control/joint"):
        states = {state.get("name") for state in joint.findall("state_interface")}
        if joint.find("command_interface") is not None:
            driven.append(joint.get("name", ""))
        elif "position" in states:
            measured.append(joint.get("name", ""))
    return driven, measured


class _Begun:
    """A robot file being begun."""

    def __init__(self, root: Xml.Element, joints: Sequence[UrdfJoint], path: Path) -> None:
        self._title = root.get("name", "")
        held = (one for one in root.findall("joint") if one.get("type") in HELD)
        self._held = [one.get("name", "") for one in held]
        self._joints = {one.name: one for one in joints}
        self._moving = [one.name for one in joints if one.motion != "fixed" and not one.mimic]
        self._speeds = {one.name: one.max_speed for one in joints}
        self._driven, self._read = controlled(root)
        self._transmissions = [*transmissions_of(root, path)]
        followed = [one for one in self._transmissions if self._follows(one)]
        self._following = {name: one for by in followed for name, one in by.joints.items()}
        """Joints that are not published, as functions of the actuators."""
        self._leading = {name: one for by in followed for name, one in by.actuators.items()}
        """These actuators, as functions of those joints."""
        driven = self._driven or [*self._undriven()]
        self.motors = [one for one in driven if one not in self._leading]
        taken = {*self._following, *self._leading, *self.motors}
        for one in self._transmissions:  # to drums, whose angles are not read
            if not one.refused and (self._driven or not self._has_motors(one)):
                taken |= one.joints.keys() - {*self._read}
        own = [one for one in self._moving if one not in taken]
        self._measured = [one for one in self._read or own if one in own]
        self._still = [one for one in own if one not in self._measured]

    def _undriven(self) -> Iterator[str]:
        """Motors where nothing is said to be driven: actuators of the robot's joints, and drums."""
        for one in self._transmissions:
            yield from one.actuators if self._has_motors(one) else one.joints

    def _has_motors(self, one: Transmission) -> bool:
        """Whether actuators are motors of their own beside joints of the robot."""
        return self._moves_links(one) and not one.actuators.keys() & self._joints.keys()

    def _moves_links(self, one: Transmission) -> bool:
        """Whether joints of a transmission are of the robot: that of a drum carries no other."""
        return any(name in self._joints and self._carries(name) for name in one.joints)

    def _follows(self, one: Transmission) -> bool:
        """Whether joints of the robot are not published, and follow actuators that are."""
        published = {*self._driven, *self._read}
        return (
            not one.refused
            and {*one.actuators} <= {*self._driven}
            and not published.intersection(one.joints)
            and {*one.joints} <= {*self._moving}
            and self._moves_links(one)
        )

    def _carries(self, name: str) -> bool:
        """Whether the link of a joint carries that of another moving joint."""
        links = {self._joints[name].child}
        for one in self._joints.values():  # parents first
            if one.parent in links:
                if one.name in self._moving:
                    return True
                links.add(one.child)
        return False

    def links(self) -> list[str]:
        """Links that nodes of cables may be on: not those of drums."""
        named = [one.child for one in self._joints.values() if one.name not in self.motors]
        return named if "" in self._joints else [ROOT, *named]

    def document(self, urdf: str) -> Document:
        """The content of the file; ``urdf`` leads from it to the URDF."""
        name = re.sub(r"\W", "_", self._title, flags=re.ASCII)
        read = {*self._measured, *self._leading}
        unlimited = [one for one in self._measured if self._joints[one].limits is None]
        if any(self._joints[one].limits is None for one in self._following):
            unlimited += self._leading
        return {
            "name": name if name[:1].isalpha() else f"robot_{name}",
            "motors": [self._motor(one) for one in self.motors],
            "joints": [*map(self._joint, self._measured), *map(self._leader, self._leading),
                       *map(self._follower, self._following)],
            "frames": {"urdf": urdf, "joints": [one for one in self._moving if one in read]},
            "friction": {"mu_c": FRICTION},
            "assumed": ["friction.mu_c",
                        *(f"joints.{one}.range.{k}" for one in unlimited for k in (1, 2))],
        }  # fmt: skip

    def _motor(self, name: str) -> Document:
        """A motor; one that is published before its gear has the gear in its scales."""
        motor: Document = {"name": name}
        joint, reduction, offset = self._gear(name)
        if joint not in ("", name):
            motor |= {"scale": 1.0 / reduction, "effort_scale": reduction}
            motor |= {"offset": offset} if offset else {}
        return motor | _fastest(self._speeds.get(joint or name, 0.0))

    def _gear(self, actuator: str) -> tuple[str, float, float]:
        """Joint, reduction and offset of the simple transmission of an actuator."""
        for one in self._transmissions:
            if not one.refused and [*one.actuators] == [actuator]:
                ((joint, behind),) = one.joints.items()
                return joint, one.actuators[actuator].shares[0][1], behind.offset
        return "", 1.0, 0.0

    def _range(self, name: str) -> tuple[float, float]:
        """The limits of a joint; assumed ones where it has none."""
        slides = self._joints[name].motion == "prismatic"
        return self._joints[name].limits or (WAY if slides else TURN)

    def _joint(self, name: str) -> Document:
        entry: Document = {"name": name}
        if self._joints[name].limits is None:
            entry["range"] = [*self._range(name)]
        return entry | _fastest(self._speeds.get(name, 0.0))

    def _leader(self, name: str) -> Document:
        """An actuator that joints follow: a measured joint, with what their limits allow it."""
        coupling, ends, speed = self._leading[name], [0.0, 0.0], 0.0
        for joint, share in coupling.shares:
            limits = self._range(joint)
            ends = [sum(pair) for pair in zip(ends, sorted(share * x for x in limits), strict=True)]
            speed += abs(share) * self._speeds.get(joint, 0.0)
        return {"name": name, "range": [coupling.offset + end for end in ends]} | _fastest(speed)

    def _follower(self, name: str) -> Document:
        one = self._following[name]
        return {"name": name, "coupled": dict(one.shares), "offset": one.offset}

    def remarks(self) -> Iterator[str]:
        """What has to be checked or added."""
        yield from self._of_joints()
        if self.motors and not self._driven:
            yield "there is no ros2_control: motors and joints are those of the transmissions"
        for one in self._transmissions:
            yield from self._of_transmission(one)
        yield from self._refused()
        yield from self._of_gears()
        if not self.motors:
            yield "no joint has a command interface: add the motors under their names"
        if not self._measured and not self._leading:
            yield "all moving joints are driven: list those that cables move under joints"
        yield "the cables are not in a URDF: add them"

    def _of_joints(self) -> Iterator[str]:
        for name in self._still:
            yield f"{name} is not in ros2_control: it stands at 0"
        for name in self._measured:
            if self._joints[name].limits is None:
                wide = "2 m" if self._joints[name].motion == "prismatic" else "one turn"
                yield f"{name} has no limits: a range of {wide} is assumed"
        for name in self.motors:
            if name in self._joints and self._carries(name):
                yield (
                    f"{name} is a motor here: the links that it carries stand still with it; if it "
                    "moves them without a cable, list it under joints instead"
                )
        for name in self._held:
            yield (
                f"{printable(name)} is a floating or planar joint: it is held at its place in the "
                "model"
            )

    def _of_transmission(self, one: Transmission) -> Iterator[str]:
        """How a transmission whose map is known is carried over, or why it is not."""
        if one.refused:
            return
        joints, actuators = {*one.joints}, {*one.actuators}
        couples = f"transmission {_couples(one)}"
        if joints <= {*self._following}:
            yield (
                f"{couples}: the joints follow the actuators, which are measured joints here and "
                "no motors; if cables move the joints, list the actuators under motors, and the "
                "joints with measured: false"
            )
        elif len(joints) == 1:
            return
        elif actuators <= {*self.motors}:
            yield f"{couples}: {_drums(one.joints)}"
        elif joints <= {*self.motors}:
            yield f"{couples}: {_drums(one.actuators)}"
        else:
            missing = sorted((actuators or joints) - {*self.motors})
            yield f"{couples}: {', '.join(missing)} is not published: {LEFT_OUT}"

    def _refused(self) -> Iterator[str]:
        """Transmissions whose maps are not known, by the reason."""
        alike: dict[str, list[str]] = {}
        for one in self._transmissions:
            if one.refused:
                alike.setdefault(one.refused, []).append(_couples(one))
        for reason, names in alike.items():
            yield f"transmission {listed(names)}: {reason}: {LEFT_OUT}"

    def _of_gears(self) -> Iterator[str]:
        """What is said of simple transmissions whose joints are the motors."""
        gears = [
            (*one.joints, *one.actuators)
            for one in self._transmissions
            if not one.refused and len(one.joints) == 1 and {*one.joints} <= {*self.motors}
        ]
        for joint, actuator in gears:
            if (reduction := self._gear(actuator)[1]) != 1.0:
                yield (
                    f"{joint} is published behind its transmission of {reduction:g}, as "
                    "ros2_control does; if the hardware publishes the actuator itself, scale: "
                    f"{1.0 / reduction:.6g} and effort_scale: {reduction:g}"
                )


def _couples(one: Transmission) -> str:
    """A transmission and what it is between."""
    joints, actuators = ", ".join(one.joints), ", ".join(one.actuators)
    between = f"{joints or 'no joint'} to {actuators or 'no actuator'}"
    return f"{one.name} ({one.kind}) couples {between}"


def _drums(shafts: Mapping[str, Coupling]) -> str:
    """How the motors turn a drum on each of some shafts."""
    return "; ".join(
        f"a drum that turns with {name} has motor: {yaml_flow(dict(one.shares))}"
        for name, one in shafts.items()
    )


def _fastest(speed: float) -> Document:
    return {"max_speed": FASTER * speed} if 0.0 < speed < inf else {}

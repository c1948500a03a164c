"""Robot files from a MuJoCo model, and the beginning of one from a URDF.

The format of ``<ros2_control>`` and of ``<transmission>`` is that of control.ros.org: a joint with
a command interface is driven, one with state interfaces alone is measured.  Behind a transmission
of the reduction N, position of the joint = position of the actuator / N + offset, and the effort of
the joint is N times that of the actuator.  The cables are not in a URDF.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from math import isfinite, pi
from pathlib import Path
from typing import Any, Final, NamedTuple
from xml.etree import ElementTree as Xml

from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.foundation.files import write_text
from cdrj_ros.foundation.output import printable
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.robot.mjcf import read_mjcf
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.robot.space import UrdfJoint
from cdrj_ros.robot.urdf import ROOT, joints_of, urdf_element

_PLAIN: Final = re.compile(r"(?i)^(?!(y|n|yes|no|on|off|true|false|null)$)[a-z_][a-z0-9_./-]*$")
"""Texts that YAML takes as they are."""

ASSUMED: Final = {
    "axial_stiffness": "assumed: EA [N], measure it by hanging a weight on the cable",
    "preload": "assumed: tension [N] at rest in the reference pose",
    "mu_c": "assumed: Coulomb coefficient of the cable on what it touches",
}
"""Comments on keys that models of other programs do not have."""


def import_mjcf(
    path: str | Path, out: str | Path, tendons: Sequence[str] | None = None
) -> tuple[str, ...]:
    """Turn a MuJoCo model's spatial tendons into the cables of a robot file, docs/robot_file.md.

    Args:
        path: MJCF file.
        out: robot file to write; values that the model does not have are marked as assumed.
        tendons: names of those that become cables; None for all.

    Returns:
        Remarks on what the robot file does not represent.

    Raises:
        UsageError: MuJoCo is not installed, or cannot read the model within the limits of time and
            memory, or no tendon can be represented.
        RobotFileError: the result would be no possible robot.
    """
    imported = read_mjcf(path, tendons)
    text = robot_text(imported.document, imported.remarks, Path(path).name)
    parse_robot(text, str(out))
    write_text(out, text)
    return tuple(imported.remarks)


def robot_text(document: Document, remarks: Sequence[str], source: str) -> str:
    """YAML text of a robot file, with numbers at full precision.

    Args:
        document: as the reader takes it, in SI.
        remarks: comment lines at the beginning.
        source: name of the model.
    """
    lines = [f"# Imported from {printable(source)} by import_robot.  Values marked as assumed are"]
    lines += [
        "# not in the model.  The drums are assumed: their radii and the sign of winding, and"
    ]
    lines += ["# the names of the motors; a cable leaves its drum at the tendon's first site."]
    lines += [f"# - {printable(remark)}" for remark in remarks]
    lines += [f"name: {document['name']}", "", "motors:"]
    lines += [f"  - {flow(motor)}" for motor in document["motors"]]
    lines += ["", "joints:" if document["joints"] else "joints: []"]
    lines += [f"  - {flow(joint)}" for joint in document["joints"]]
    lines += ["", "frames:" if document["frames"] else "frames: []"]
    lines += [f"  - {flow(frame)}" for frame in document["frames"]]
    lines += ["", "friction:"]
    lines += [_assumed(key, value, "  ") for key, value in document["friction"].items()]
    lines += ["", "cables:"]
    for cable in document["cables"]:
        lines += [f"  - name: {cable['name']}"]
        lines += [_assumed(key, cable[key], "    ") for key in ("axial_stiffness", "preload")]
        lines += ["    nodes:"]
        lines += [f"      - {flow(node)}" for node in cable["nodes"]]
    return "\n".join(lines) + "\n"


def _assumed(key: str, value: float, indent: str) -> str:
    return f"{indent}{key}: {flow(value)}  # {ASSUMED[key]}"


def flow(value: Any) -> str:
    """A value in YAML's flow style; floats have a decimal point, which YAML 1.1 requires."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {flow(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(flow, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        text = repr(value)
        mantissa, exponent, power = text.partition("e")
        return mantissa + (".0" if exponent and "." not in mantissa else "") + exponent + power
    if isinstance(value, str) and not _PLAIN.match(value):
        return json.dumps(value)
    return str(value)


FASTER: Final = 2.0
"""Largest speed that a reading may have, in units of the limit of commands."""

MOST_LINKS: Final = 8
"""Number of links that the file names."""


@dataclass
class Transmission:
    """A gear between an actuator and a joint."""

    joint: str
    actuator: str
    reduction: float
    offset: float
    """Position of the joint at position 0 of the actuator [rad]."""


@dataclass
class Control:
    """What the tags of ros2_control say."""

    driven: list[str] = field(default_factory=list)
    """Names with a command interface."""
    measured: list[str] = field(default_factory=list)
    """Names with a state interface ``position`` alone."""
    transmissions: list[Transmission] = field(default_factory=list)


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
    joints = joints_of(root, path)
    control = control_of(root, path)
    moving = {one.name: one for one in joints if one.motion != "fixed" and not one.mimic}
    speeds = {
        joint.get("name", ""): _number(limit.get("velocity"), path) or 0.0
        for joint in root.findall("joint")
        if (limit := joint.find("limit")) is not None
    }
    remarks: list[str] = []
    motors = [_motor(name, control, speeds, remarks) for name in _driven(control)]
    driven = {motor["name"] for motor in motors} | {one.joint for one in control.transmissions}
    own = [name for name in moving if name not in driven]
    listed = control.measured or own
    remarks += [f"{name} is not in ros2_control: it stands at 0" for name in own
                if name not in listed]  # fmt: skip
    measured = [_joint(moving[name], speeds) for name in listed if name in own]
    remarks += [f"{one['name']} has no limits: a range of one turn is assumed" for one in measured
                if "range" in one]  # fmt: skip
    if not motors:
        remarks.append("no joint has a command interface: add the motors under their names")
    if not measured:
        remarks.append("all moving joints are driven: list those that cables move under joints")
    remarks.append("the cables are not in a URDF: add them")
    example = _example_cable(motors, measured, joints, control)
    place = os.path.relpath(path.resolve(), Path(out).resolve().parent)
    name = re.sub(r"\W", "_", root.get("name", ""), flags=re.ASCII)
    name = name if name[:1].isalpha() else f"robot_{name}"
    write_text(out, _text(name, motors, measured, example, place, remarks))
    return tuple(remarks)


def control_of(root: Xml.Element, path: Path) -> Control:
    """The tags of ros2_control, and transmissions beside them.

    Raises:
        RobotFileError: a reduction or an offset is no number.
    """
    found = Control()
    for system in root.iter("ros2_control"):
        for joint in system.findall("joint"):
            name = joint.get("name", "")
            states = {state.get("name") for state in joint.findall("state_interface")}
            if joint.find("command_interface") is not None:
                found.driven.append(name)
            elif "position" in states:
                found.measured.append(name)
    for element in root.iter("transmission"):
        joint_tag, actuator = element.find("joint"), element.find("actuator")
        if joint_tag is not None and actuator is not None:
            given = [_first(element, key, path) for key in ("reduction", "offset")]
            found.transmissions.append(
                Transmission(
                    joint_tag.get("name", ""), actuator.get("name", ""), given[0] or 1.0,
                    given[1] or 0.0,
                )
            )  # fmt: skip
    return found


def _first(element: Xml.Element, key: str, path: Path) -> float | None:
    """The first number below an element whose tag ends with a key, in any spelling."""
    for one in element.iter():
        if one.tag.lower().replace("_", "").endswith(key):
            return _number(one.text, path)
    return None


def _number(text: str | None, path: Path) -> float | None:
    try:
        value = float(text or "nan")
    except ValueError:
        raise RobotFileError(f"{path}: must be a number, got {printable(text)[:60]!r}") from None
    return value if isfinite(value) else None


def _driven(control: Control) -> list[str]:
    """Names of the motors: driven ones, else the joints of the transmissions."""
    return control.driven or [one.joint for one in control.transmissions]


def _motor(name: str, control: Control, speeds: dict[str, float], remarks: list[str]) -> Document:
    """A motor; one that is published before its gear has the gear in its scales."""
    motor: Document = {"name": name}
    speed = speeds.get(name, 0.0)
    for one in control.transmissions:
        if name == one.actuator and name != one.joint:
            motor |= {"scale": 1.0 / one.reduction, "effort_scale": one.reduction}
            motor |= {"offset": one.offset} if one.offset else {}
            speed = speeds.get(one.joint, 0.0)
        elif name == one.joint and one.reduction != 1.0:
            remarks.append(
                f"{name} is published behind its transmission of {one.reduction:g}, as "
                f"ros2_control does; if the hardware publishes {one.actuator} itself, scale: "
                f"{1.0 / one.reduction:.6g} and effort_scale: {one.reduction:g}"
            )
    return motor | ({"max_speed": FASTER * speed} if speed > 0.0 else {})


def _joint(joint: UrdfJoint, speeds: dict[str, float]) -> Document:
    entry: Document = {"name": joint.name}
    if joint.limits is None:
        entry["range"] = [-pi, pi]
    if speeds.get(joint.name, 0.0) > 0.0:
        entry["max_speed"] = FASTER * speeds[joint.name]
    return entry


class Example(NamedTuple):
    """What the commented cable of the file shows."""

    links: list[str]
    """Links that may carry nodes: the root and those that measured joints move."""
    nodes: list[Document]


def _example_cable(
    motors: Sequence[Document],
    measured: Sequence[Document],
    joints: Sequence[UrdfJoint],
    control: Control,
) -> Example:
    """From a drum where the URDF has the motor's shaft, to the link of the last measured joint."""
    named = {one.name: one for one in joints if one.name}
    root = next((one.child for one in joints if not one.name), ROOT)
    motor = motors[0]["name"] if motors else "MOTOR"
    behind = {one.actuator: one.joint for one in control.transmissions}
    winch: Document = {"type": "winch", "motor": motor, "winding": 1, "radius_mm": 15}
    shaft = named.get(motor) or named.get(behind.get(motor, ""))
    if shaft is None or any(shaft.rpy):  # a turned shaft: its axis is not that of the parent
        winch |= {"frame": root, "position_mm": [0, 0, 0], "axis": [0, 0, 1], "turn": "cw"}
    else:
        place = [round(1e3 * value, 6) for value in shaft.origin]
        winch |= {"frame": shaft.parent, "position_mm": place, "axis": shaft.axis, "turn": "cw"}
    driven = {entry["name"] for entry in motors} | {one.joint for one in control.transmissions}
    links = [root, *(one.child for one in joints if one.name and one.name not in driven)]
    last = named[measured[-1]["name"]].child if measured else links[-1]
    anchor: Document = {"type": "anchor", "frame": last, "position_mm": [50, 50, 50]}
    return Example(links, [winch, anchor])


def _text(
    name: str,
    motors: Sequence[Document],
    joints: Sequence[Document],
    example: Example,
    place: str,
    remarks: Sequence[str],
) -> str:
    """Text of the robot file, whose cables are an example in comments."""
    more = ", ..." if len(example.links) > MOST_LINKS else ""

    def lines() -> Iterator[str]:
        yield f"# Begun from {printable(Path(place).name)} by import_robot: names, gears, limits."
        yield "# max_speed is twice the limit of the URDF; ranges are its limits of position."
        yield from (f"# - {printable(remark)}" for remark in remarks)
        yield f"name: {name}"
        for kind, entries in (("motors", motors), ("joints", joints)):
            yield f"\n{kind}:" + ("" if entries else " []")
            yield from (f"  - {flow(entry)}" for entry in entries)
        measured = [joint["name"] for joint in joints]
        yield f"\nframes: {flow({'urdf': place, 'joints': measured})}"
        yield "\nfriction: {mu_c: 0.15}          # assumed"
        yield "\ncables: []"
        yield "# One entry for each, in place of [], with nodes on the links"
        yield f"# {printable(', '.join(example.links[:MOST_LINKS]))}{more}:"
        yield "#  - name: cable_1"
        yield "#    axial_stiffness: 60000     # EA [N]"
        yield "#    preload: 20                # tension at rest in the reference pose [N]"
        yield "#    nodes:"
        yield from (f"#      - {flow(node)}" for node in example.nodes)

    return "\n".join(lines()) + "\n"

"""Robot files from a MuJoCo model, and the beginning of one from a URDF.

The format of ``<ros2_control>`` and of ``<transmission>`` is that of control.ros.org: a joint with
a command interface is driven, one with state interfaces alone is measured.  Behind a simple
transmission of the reduction N, position of the joint = position of the actuator / N + offset, and
the effort of the joint is N times that of the actuator.  Other transmissions, such as differentials
and four-bar linkages, have no single gear: they are named.  The cables are not in a URDF.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import accumulate
from math import isfinite, pi
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as Xml

from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.foundation.files import write_text
from cdrj_ros.foundation.output import printable
from cdrj_ros.foundation.yaml import Document, yaml_flow
from cdrj_ros.robot.mjcf import read_mjcf
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.robot.space import UrdfJoint
from cdrj_ros.robot.urdf import ROOT, held_joints, joints_of, urdf_element

ASSUMED: Final = {
    "axial_stiffness": "assumed: EA [N], measure it by hanging a weight on the cable",
    "preload": "assumed: tension [N] at rest in the reference pose",
    "rest_length": "assumed: length [m] without tension",
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
    remarks = [*said_once(imported.remarks), *_prefix_offered(imported.document)]
    text = robot_text(imported.document, remarks, Path(path).name)
    parse_robot(text, str(out))
    write_text(out, text)
    return tuple(remarks)


def said_once(remarks: Iterable[str]) -> list[str]:
    """Remarks that differ in the name at their beginning alone, joined to one with all names."""
    names: dict[str, list[str]] = {}
    for remark in remarks:
        name, _, rest = remark.partition(" ")
        own = names.setdefault(rest if name.endswith(":") else f" {rest}", [])
        own += [name.rstrip(":")]
    return [
        f"{', '.join(own)}: {rest}" if not rest.startswith(" ")
        else f"{'each of ' if len(own) > 1 else ''}{', '.join(own)}{rest}"
        for rest, own in names.items()
    ]  # fmt: skip


def _prefix_offered(document: Document) -> Iterator[str]:
    """That ``prefix`` may stand for what the names of all motors and joints begin with."""
    names = [entry["name"] for kind in ("motors", "joints") for entry in document[kind]]
    begins = accumulate(names[0]) if len(names) > 1 else ()
    shared = [one for one in begins if all(name.startswith(one) for name in names)]
    ends = [one for one in shared if one[-1] in "_/" and one not in names]
    if ends:
        yield (
            f"the names of all motors and joints begin with {ends[-1]}: prefix: {ends[-1]} says it "
            "once, and another prefix makes the file one of another robot"
        )


def robot_text(document: Document, remarks: Sequence[str], source: str) -> str:
    """YAML text of a robot file, with numbers at full precision.

    Args:
        document: as the reader takes it, in SI.
        remarks: comment lines at the beginning.
        source: name of the model.
    """
    head = (
        f"Imported from {printable(source)} by import_robot.  Values marked as assumed are",
        "not in the model, and listed under assumed; take those that you replace off the list.",
        "Drums are assumed: their radii and the sign of winding; a cable leaves its drum at the",
        "tendon's first site.",
    )
    assumed = document.get("assumed", ())
    cables = [line for cable in document["cables"] for line in _cable(cable, assumed)]
    return "\n".join([*_beginning(document, remarks, head), "cables:", *cables]) + "\n"


def _beginning(document: Document, remarks: Sequence[str], head: Sequence[str]) -> Iterator[str]:
    """Lines of a robot file before its cables."""
    yield from (f"# {line}" for line in head)
    yield from (f"# - {printable(remark)}" for remark in remarks)
    yield f"name: {document['name']}"
    for key in ("motors", "joints", "frames"):
        entries = document[key]
        listed = isinstance(entries, list) and entries
        yield f"\n{key}:" if listed else f"\n{key}: {yaml_flow(entries)}"
        yield from (f"  - {yaml_flow(entry)}" for entry in entries if listed)
    if "assumed" in document:
        yield f"\nassumed: {yaml_flow(document['assumed'])}"
    yield "\nfriction:"
    yield from (_marked(key, value, "  ") for key, value in document["friction"].items())
    yield ""


def _cable(cable: Document, assumed: Collection[str]) -> Iterator[str]:
    yield f"  - name: {cable['name']}"
    for key in ("axial_stiffness", "preload", "rest_length"):
        if key in cable:
            marked = f"cables.{cable['name']}.{key}" in assumed
            line = _marked(key, cable[key], "    ")
            yield line if marked else line.partition("  #")[0]
    yield "    nodes:"
    yield from (f"      - {yaml_flow(node)}" for node in cable["nodes"])


def _marked(key: str, value: float, indent: str) -> str:
    return f"{indent}{key}: {yaml_flow(value)}  # {ASSUMED[key]}"


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
class Linkage:
    """A transmission that is not simple: several joints or actuators, or another type."""

    name: str
    kind: str
    joints: list[str]
    actuators: list[str]


@dataclass
class Control:
    """What the tags of ros2_control say."""

    driven: list[str] = field(default_factory=list)
    """Names with a command interface."""
    measured: list[str] = field(default_factory=list)
    """Names with a state interface ``position`` alone."""
    transmissions: list[Transmission] = field(default_factory=list)
    """Simple ones."""
    linkages: list[Linkage] = field(default_factory=list)
    """All other ones."""


def _no_cables(links: Sequence[str]) -> tuple[str, ...]:
    """The lines of a robot file whose cables are to be added, with nodes on these links."""
    left = len(links) - MOST_LINKS
    more = f", and {left} more links of the URDF" if left > 0 else ""
    return (
        "cables: []",
        "# One entry for each, in place of [], as in docs/tutorial.md, with nodes on the links",
        f"# {printable(', '.join(links[:MOST_LINKS]))}{more}",
    )


def _speeds(root: Xml.Element, path: Path) -> dict[str, float]:
    """Greatest speeds of the joints of a URDF that states them, by name [rad/s] or [m/s]."""
    return {
        joint.get("name", ""): _number(limit.get("velocity"), path) or 0.0
        for joint in root.findall("joint")
        if (limit := joint.find("limit")) is not None
    }


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
    speeds = _speeds(root, path)
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
    remarks += [_linkage(one, control) for one in control.linkages]
    remarks += [
        f"{printable(name)} is a floating or planar joint: it is held at its place in the model"
        for name in held_joints(root)
    ]
    if not motors:
        remarks.append("no joint has a command interface: add the motors under their names")
    if not measured:
        remarks.append("all moving joints are driven: list those that cables move under joints")
    remarks.append("the cables are not in a URDF: add them")
    place = os.path.relpath(path.resolve(), Path(out).resolve().parent)
    name = re.sub(r"\W", "_", root.get("name", ""), flags=re.ASCII)
    name = name if name[:1].isalpha() else f"robot_{name}"
    document: Document = {
        "name": name, "motors": motors, "joints": measured, "friction": {"mu_c": 0.15},
        "frames": {"urdf": place, "joints": [one["name"] for one in measured]},
    }  # fmt: skip
    head = (
        f"Begun from {printable(path.name)} by import_robot: names, gears, limits.",
        "max_speed is twice the limit of the URDF; ranges are its limits of position.",
    )
    links = [one.child for one in joints if one.name not in driven]
    cables = _no_cables(links if joints and not joints[0].name else [ROOT, *links])
    remarks = [*said_once(remarks), *_prefix_offered(document)]
    write_text(out, "\n".join([*_beginning(document, remarks, head), *cables]) + "\n")
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
        joints, actuators = (
            [one.get("name", "") for one in element if one.tag.lower().endswith(kind)]
            for kind in ("joint", "actuator")
        )
        kind = _kind(element)
        if "simple" in kind.lower() and len(joints) == len(actuators) == 1:
            given = [_first(element, key, path) for key in ("reduction", "offset")]
            one = Transmission(joints[0], actuators[0], given[0] or 1.0, given[1] or 0.0)
            found.transmissions.append(one)
        elif joints or actuators:
            found.linkages.append(Linkage(element.get("name", ""), kind, joints, actuators))
    return found


def _kind(element: Xml.Element) -> str:
    """Type of a transmission, without its package; simple where it has none."""
    given = [element.findtext("plugin"), element.findtext("type"), element.get("type")]
    kind = next((text.strip() for text in given if text and text.strip()), "SimpleTransmission")
    return kind.rsplit("/", 1)[-1]


def _linkage(linkage: Linkage, control: Control) -> str:
    """What is said of a transmission without a single gear."""
    joints, actuators = ", ".join(linkage.joints), ", ".join(linkage.actuators)
    before = [name for name in linkage.actuators if name in control.driven]
    side = "before it, at the actuators" if before else "behind it, at the joints"
    return (
        f"transmission {linkage.name} ({linkage.kind}) couples {joints or 'no joint'} to "
        f"{actuators or 'no actuator'}: it has no single gear, and none of its reductions is in "
        f"the file; motors are published {side}"
    )


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
    return control.driven or [
        *(one.joint for one in control.transmissions),
        *(name for one in control.linkages for name in one.joints),
    ]


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

"""Frames and joints of a robot file that are taken from a URDF."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import replace
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree as Xml

from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.foundation.files import InputError, parse_xml, read_regular
from cdrj_ros.foundation.output import printable
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.robot.couplings import is_coupled
from cdrj_ros.robot.names import prefixed, renamed
from cdrj_ros.robot.space import UrdfJoint, standing, urdf_visuals

MAXIMUM_BYTES: Final = 20_000_000
"""Largest accepted size of a URDF [bytes]."""

MOTIONS: Final = ("fixed", "revolute", "continuous", "prismatic")

HELD: Final = ("floating", "planar")
"""Types of joints without a single angle, which stand at their origin."""

MOST_ROOTS: Final = 8
"""Number of root links that a message names."""

ROOT: Final = "base"
"""Name of the root link in robot files, whatever the URDF calls it."""

DESCRIPTION: Final = "robot_description"
"""Name that stands for the URDF that robot_state_publisher publishes."""

PUBLISHED: Final[ContextVar[Callable[[], str] | None]] = ContextVar(DESCRIPTION, default=None)
"""Returns the URDF for a robot file that names ``robot_description``; called only for those."""


def with_urdf_frames(document: Document, source: str) -> Document:
    """Add the frames and joint limits of the URDF that a document names.

    Only links with nodes, and the links between them and the root, become frames.

    Args:
        document: a robot file in SI, not yet validated.
        source: path of the robot file; a relative path of the URDF starts from its folder.

    Raises:
        RobotFileError: the URDF cannot be read, or cannot be represented.
    """
    entry = document.get("frames")
    if not isinstance(entry, dict):
        return document
    unknown = [key for key in entry if key not in ("urdf", "joints")]
    if unknown or not isinstance(entry.get("urdf"), str):
        raise RobotFileError(
            f"frames must be a list, or a mapping with urdf, the path of a URDF, and joints, the "
            f"names of those that are measured ({source})"
        )
    if entry["urdf"] == DESCRIPTION:
        path = Path(DESCRIPTION)
        element = parsed_urdf(_described(source), path)
    else:
        path = _find(entry["urdf"], source)
        element = urdf_element(path, source)
    joints = joints_of(element, path)
    root = joints[0].child if joints and not joints[0].name else ROOT
    document, joints = _with_prefix(document, joints)
    entry = document["frames"]
    given = document.get("joints")
    coupled = {str(one.get("name")): one["coupled"] for one in given or () if is_coupled(one)}
    measured = entry.get(
        "joints",
        [j.name for j in joints if j.motion != "fixed" and not j.mimic and j.name not in coupled],
    )
    _check_measured(measured, joints, path, source)
    kept = _needed(document, joints)
    frames = _frames(joints, kept, {*measured, *coupled}, path)
    moving = {str(frame.get("joint")) for frame in frames}
    moving |= {leader for name in moving & coupled.keys() for leader in coupled[name]}
    if "joints" not in entry:
        measured = [name for name in measured if name in moving]
    carrying = {*measured, *coupled}
    return {
        "base_link": root,
        "visuals": urdf_visuals(element, joints, kept, carrying, lambda name: _mesh(name, path)),
        **document,
        "frames": frames,
        "joints": _joints(given, measured, joints, source),
    }


def _with_prefix(document: Document, joints: list[UrdfJoint]) -> tuple[Document, list[UrdfJoint]]:
    """Names that agree where the document has a prefix, which the URDF may have or not.

    Joints take the prefix unless another one has that name; links named in the document are those
    with the prefix, where the URDF has them.
    """
    prefix = document.get("prefix")
    if not isinstance(prefix, str) or not prefix:
        return document, joints
    names, links = {one.name for one in joints}, {one.child for one in joints}

    def joint(name: str) -> str:
        other = prefixed(name, prefix)
        return name if not name or other in names else other

    def link(name: str) -> str:
        other = prefixed(name, prefix)
        return other if other in links else name

    cables = renamed(document.get("cables"), ("frame", "exit_frame", "side_frame"), link)
    return {**document, "cables": cables}, [
        replace(
            one, name=joint(one.name), mimic=one.mimic and (joint(one.mimic[0]), *one.mimic[1:])
        )
        for one in joints
    ]


def _find(path: str, source: str) -> Path:
    """Path of the URDF; ``package://NAME/...`` is looked up below AMENT_PREFIX_PATH."""
    if path.startswith("package://"):
        package, _, rest = path.removeprefix("package://").partition("/")
        for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
            found = Path(prefix) / "share" / package / rest
            if prefix and found.is_file():
                return found
        raise RobotFileError(
            f"frames.urdf: there is no {path} below AMENT_PREFIX_PATH; is the workspace sourced? "
            f"({source})"
        )
    return Path(source).parent / path


def _mesh(name: str, urdf: Path) -> Path | None:
    """Path of a mesh that a URDF names; None if it is not on this machine."""
    path = Path(name.removeprefix("file://"))
    if name.startswith("package://"):
        try:
            path = _find(name, "")
        except RobotFileError:
            return None
    elif not path.is_absolute():
        path = urdf.parent / path
    try:
        return path.resolve() if path.is_file() else None
    except (OSError, ValueError):
        return None


def _described(source: str) -> bytes:
    """The text of robot_description."""
    text = PUBLISHED.get()
    if text is None:
        raise RobotFileError(
            f"frames.urdf: {DESCRIPTION} is known to nodes only; save it by ros2 param get "
            f"--hide-type /robot_state_publisher {DESCRIPTION} and name the file ({source})"
        )
    return text().encode(errors="surrogatepass")


def urdf_element(path: Path, source: str) -> Xml.Element:
    """The element ``robot`` of a URDF.

    Args:
        path: the file.
        source: path of the robot file, for messages.

    Raises:
        RobotFileError: the URDF cannot be read.
    """
    try:
        data = read_regular(path, MAXIMUM_BYTES)
    except InputError as error:
        raise RobotFileError(f"frames.urdf: cannot read {path}: {error} ({source})") from error
    return parsed_urdf(data, path)


def parsed_urdf(data: bytes, path: Path) -> Xml.Element:
    """The element ``robot`` of the text of a URDF; ``path`` names it in messages."""
    if len(data) > MAXIMUM_BYTES:
        raise RobotFileError(f"{path} has {len(data)} bytes; a URDF has at most {MAXIMUM_BYTES}")
    try:
        root = parse_xml(data)
    except InputError as error:
        raise RobotFileError(f"cannot read {path}: {error}") from error
    if root.tag != "robot":
        raise RobotFileError(f"{path} is no URDF: its first element is {root.tag[:40]!r}")
    if any("xacro" in element.tag for element in root.iter()):
        raise RobotFileError(f"{path} is a xacro file; {expanding(path)}")
    return root


def expanding(path: Path) -> str:
    """The command that expands a xacro file."""
    name = re.sub(r"(\.xacro|\.urdf)+$", "", path.name)
    out = f"{name}.urdf" if f"{name}.urdf" != path.name else f"{name}.expanded.urdf"
    return f"expand it first: ros2 run xacro xacro {printable(str(path))} -o {printable(out)}"


def joints_of(root: Xml.Element, path: Path) -> list[UrdfJoint]:
    """All joints of a URDF, parents before children; the first one carries the root link.

    Args:
        root: the element ``robot``.
        path: names the file in messages.

    Raises:
        RobotFileError: the URDF cannot be represented.
    """
    links = [link.get("name", "") for link in root.findall("link")]
    joints = [_joint(element, path) for element in root.findall("joint")]
    return _ordered(links, joints, path)


def _joint(element: Xml.Element, path: Path) -> UrdfJoint:
    name = element.get("name", "")
    where = f"{path}: joint {name[:60]!r}"
    motion = element.get("type", "")
    if motion in HELD:
        motion = "fixed"
    if motion not in MOTIONS:
        allowed = ", ".join((*MOTIONS, *HELD))
        raise RobotFileError(f"{where} must be one of {allowed}, got {motion[:40]!r}")

    def link(tag: str) -> str:
        end = element.find(tag)
        return "" if end is None else end.get("link", "")

    def given(tag: str, key: str, default: str, words: str = "") -> list[float]:
        found = element.find(tag)
        text = default if found is None else found.get(key) or default
        return _values(text, len(default.split()), f"{where}, {words or key}")

    limits = None
    if motion in ("revolute", "prismatic") and element.find("limit") is not None:
        lower = given("limit", "lower", "0", "lower limit")[0]
        upper = given("limit", "upper", "0", "upper limit")[0]
        limits = (lower, upper) if lower < upper else None  # left out, or the wrong way round
    follows = None
    if (mimic := element.find("mimic")) is not None:
        share, constant = given("mimic", "multiplier", "1")[0], given("mimic", "offset", "0")[0]
        follows = (mimic.get("joint", ""), share, constant)
    axis = given("axis", "xyz", "1 0 0", "axis")
    if motion != "fixed" and not any(axis):
        raise RobotFileError(f"{where}: its axis must be a direction, not of the length 0")
    place = given("origin", "xyz", "0 0 0"), given("origin", "rpy", "0 0 0")
    speed = given("limit", "velocity", "0")[0]
    return UrdfJoint(
        name, motion, link("parent"), link("child"), *place, axis, limits, follows, speed
    )


def _values(text: str, count: int, where: str) -> list[float]:
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != count:
        raise RobotFileError(f"{where} must have {count} numbers, got {text[:60]!r}")
    return values


def _ordered(links: list[str], joints: list[UrdfJoint], path: Path) -> list[UrdfJoint]:
    """Sort the joints so that parents come first; check that the links form one tree."""
    names: set[str] = set()
    by_parent: dict[str, list[UrdfJoint]] = {}
    children: set[str] = set()
    known = set(links)
    for joint in joints:
        if joint.name in names:
            raise RobotFileError(f"{path} has two joints of the name {joint.name!r}")
        for link in (joint.parent, joint.child):
            if link not in known:
                raise RobotFileError(f"{path}: joint {joint.name!r} names no link: {link!r}")
        if joint.child in children:
            raise RobotFileError(
                f"{path}: link {joint.child!r} is the child of two joints; a URDF is a tree"
            )
        names.add(joint.name)
        children.add(joint.child)
        by_parent.setdefault(joint.parent, []).append(joint)
    roots = [link for link in links if link not in children]
    ordered: list[UrdfJoint] = []
    waiting = list(roots)
    while waiting:
        for joint in by_parent.get(waiting.pop(), ()):
            ordered.append(joint)
            waiting.append(joint.child)
    if len(ordered) < len(joints):
        raise RobotFileError(f"{path}: the joints form a loop; a URDF is a tree")
    if len(roots) != 1:
        named = ", ".join(printable(link)[:60] for link in roots[:MOST_ROOTS])
        more = ", ..." if len(roots) > MOST_ROOTS else ""
        raise RobotFileError(
            f"{path} must have one root link, got {len(roots)}{': ' * bool(roots)}{named}{more}; "
            "a link that is the child of no joint is a root"
        )
    ordered = _led(ordered, path)
    root = UrdfJoint("", "fixed", ROOT, roots[0], [0.0] * 3, [0.0] * 3, [0.0] * 3, None, None)
    return ([root] if roots[0] != ROOT else []) + ordered


def _led(joints: list[UrdfJoint], path: Path) -> list[UrdfJoint]:
    """Joints that mimic others which mimic others themselves, as functions of the last ones."""
    own = {joint.name: joint.mimic for joint in joints if joint.mimic}
    last: dict[str, tuple[str, float, float]] = {}
    for name in own:
        chain = {name: None}
        while (leader := own[next(reversed(chain))][0]) in own and leader not in last:
            if leader in chain:
                raise RobotFileError(f"{path}: joint {leader!r} mimics itself, through others")
            chain[leader] = None
        for one in reversed(chain):
            leader, share, constant = own[one]
            further, multiplier, offset = last.get(leader, (leader, 1.0, 0.0))
            last[one] = further, share * multiplier, share * offset + constant
    return [replace(joint, mimic=last.get(joint.name)) for joint in joints]


def _check_measured(measured: Any, joints: list[UrdfJoint], path: Path, source: str) -> None:
    known = {joint.name: joint for joint in joints if joint.motion != "fixed"}
    if not isinstance(measured, list):
        raise RobotFileError(f"frames.joints must be a list of names ({source})")
    for name in measured:
        if name not in known:
            raise RobotFileError(
                f"frames.joints: {path.name} has no moving joint {name!r}; it has "
                f"{', '.join(sorted(known)) or 'none'} ({source})"
            )
        if known[name].mimic:
            raise RobotFileError(
                f"frames.joints: {name} mimics {known[name].mimic[0]} in {path.name} and is not "  # type: ignore[index]
                f"measured ({source})"
            )


def _needed(document: Document, joints: list[UrdfJoint]) -> set[str]:
    """Links with nodes, and all links between them and the root."""
    used: set[str] = set()
    for cable in document.get("cables") or ():
        for node in (cable.get("nodes") if isinstance(cable, dict) else None) or ():
            if isinstance(node, dict):
                used.add(str(node.get("frame", "base")))
                used |= {str(node[key]) for key in ("exit_frame", "side_frame") if key in node}
    carrier = {joint.child: joint.parent for joint in joints}
    kept: set[str] = set()
    waiting = sorted(used)
    while waiting:
        link = waiting.pop()
        if link not in kept and link in carrier:
            kept.add(link)
            waiting.append(carrier[link])
    return kept


def _frames(
    joints: list[UrdfJoint], kept: set[str], measured: set[str], path: Path
) -> list[Document]:
    """Frames of the kept links; joints that are not measured, nor follow one, stand still."""
    frames: list[Document] = []
    names = {joint.name for joint in joints}
    for joint in joints:
        if joint.child not in kept:
            continue
        frame: Document = {
            "name": joint.child, "parent": joint.parent, "motion": "fixed",
            "origin": joint.origin, "rpy": joint.rpy,
        }  # fmt: skip
        leader, multiplier, offset = joint.mimic or (joint.name, 1.0, 0.0)
        if joint.mimic and leader not in names:
            raise RobotFileError(f"{path}: joint {joint.name!r} mimics no joint: {leader!r}")
        if joint.motion != "fixed" and leader in measured:
            frame |= {
                "motion": joint.motion, "joint": leader, "axis": joint.axis,
                "multiplier": multiplier, "offset": offset,
            }  # fmt: skip
        elif joint.motion != "fixed" and offset:
            frame["origin"], frame["rpy"] = standing(joint, offset)
        frames.append(frame)
    return frames


def _joints(given: Any, measured: list[str], joints: list[UrdfJoint], source: str) -> list[Any]:
    """Joints of the robot file, with the URDF's limits for those without a range."""
    entries = [dict(entry) if isinstance(entry, dict) else entry for entry in given or ()]
    names = {str(entry.get("name")) for entry in entries if isinstance(entry, dict)}
    entries += [{"name": name} for name in measured if name not in names]
    limits = {joint.name: joint.limits for joint in joints}
    for entry in entries:
        name = entry.get("name") if isinstance(entry, dict) else None
        if not isinstance(name, str) or "range" in entry or "coupled" in entry:
            continue
        if name not in limits:
            moving = sorted(joint.name for joint in joints if joint.motion != "fixed")
            raise RobotFileError(
                f"joints: the URDF has no joint {name!r}; its moving joints are "
                f"{', '.join(moving) or 'none'}; any other one needs a range ({source})"
            )
        found = limits[name]
        if found is None:
            raise RobotFileError(
                f"joints: {name} has no limits in the URDF; list it with its range ({source})"
            )
        entry["range"] = list(found)
        entry.setdefault("reference_angle", min(max(0.0, found[0]), found[1]))
    return entries

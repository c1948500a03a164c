"""Reading of a robot file into a ``Robot``, with the checks that the schema cannot express.

Errors in a file are reported by this package with the path of the key, what was given and what is
allowed.  All other code relies on a ``Robot`` being valid.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from cdrj_ros.foundation.errors import Refusal, ordered
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.robot.axes import ProfileReader, read_joints, read_motors
from cdrj_ros.robot.cables import CableReader
from cdrj_ros.robot.couplings import own_joints, read_couplings
from cdrj_ros.robot.description import (
    Cable,
    Residual,
    Robot,
    Uncertainty,
    residual_shape,
)
from cdrj_ros.robot.document import explained, parse_document, read_text
from cdrj_ros.robot.names import NAMED_KINDS
from cdrj_ros.robot.space import read_visuals
from cdrj_ros.robot.space_reader import PlaceReader, is_spatial, read_frames
from cdrj_ros.robot.stated import check_stated, stated_numbers
from cdrj_ros.robot.tolerances import complete_uncertainty

NARROWEST: Final = 1e-9
"""Range of a learned correction [rad], [m], [N m] or [N]."""


def load_robot(path: str | Path) -> Robot:
    """Read a robot file.

    Raises:
        RobotFileError: with one line that names the key, what was given and what is allowed.
    """
    source = str(Path(path))
    return parse_robot(read_text(source, "robot file"), source)


def load_document(path: str | Path) -> tuple[Document, str]:
    """Content of a robot file, in SI and validated against the schema, and the file's name.

    Raises:
        RobotFileError: see ``load_robot``.
    """
    source = str(Path(path))
    return parse_document(read_text(source, "robot file"), source), source


def parse_robot(text: str, source: str = "robot file") -> Robot:
    """The robot that a YAML text describes; ``source`` is named in error messages.

    Raises:
        RobotFileError: see ``load_robot``.
    """
    with explained(text, source):
        return build_robot(parse_document(text, source), source)


def build_robot(document: Document, source: str) -> Robot:
    """Build a robot from a document that satisfies the schema, and check what the schema cannot.

    Raises:
        RobotFileError: see ``load_robot``.
    """
    refuse = Refusal(source)
    for kind in NAMED_KINDS:
        _check_unique(document, kind, refuse)
    joints = {joint.name: joint for joint in read_joints(document, refuse)}
    couplings = dict(read_couplings(document, joints, refuse))
    motors = tuple(read_motors(document, refuse))
    for k, motor in enumerate(motors):
        if motor.name in couplings:  # both may be read from one topic
            raise refuse(f"motors[{k}].name", f"{motor.name!r} is the name of a joint")
    profiles = ProfileReader(joints, couplings, refuse)
    planar = not is_spatial(document)
    frames = tuple(read_frames(document, planar, profiles.coupling, refuse))
    names = [frame.name for frame in frames]
    places = PlaceReader(names, planar, refuse)
    turning = [motor.name for motor in motors]
    reader = CableReader(document.get("friction", {}), turning, places, profiles, refuse)
    cables = tuple(reader.read(f"cables[{k}]", entry) for k, entry in enumerate(document["cables"]))
    elements = {element for cable in cables for element in cable.element_names}
    for name in (*turning, *joints):
        if name in elements:  # both may be the name of a sensor
            raise refuse(f"the name {name!r} of a motor or joint", "is that of an element")
    placed = any(cable.placed for cable in cables)
    visuals = tuple(read_visuals(document, names, refuse))
    robot = Robot(
        document["name"],
        motors,
        tuple(joints.values()),
        cables,
        frames if placed else (),
        source,
        _uncertainty(document, cables, refuse),
        document,
        planar or not placed,
        document.get("base_link", Robot.base_link),
        visuals if placed else (),
    )
    return replace(robot, residuals=tuple(_residuals(document, robot, refuse)))


def _check_unique(document: Document, kind: str, refuse: Refusal) -> None:
    seen: set[str] = set()
    for k, entry in enumerate(document.get(kind, [])):
        if entry["name"] in seen:
            raise refuse(f"{kind}[{k}].name", f"{entry['name']!r} is taken already")
        seen.add(entry["name"])


def _channels(document: Document, cables: tuple[Cable, ...]) -> set[str]:
    """Channels of efforts and tensions."""
    axes = [axis["name"] for axis in (*document["motors"], *own_joints(document))]
    channels = {f"effort/{name}" for name in axes}
    return channels | {f"tension/{name}" for cable in cables for name in cable.element_names}


def _residuals(document: Document, robot: Robot, refuse: Refusal) -> Iterator[Residual]:
    """The learned corrections."""
    entries = document.get("residual", [])
    if entries and robot.unmeasured:
        raise refuse("residual", "is not possible for a robot with joints without encoder")
    channels, seen = _channels(document, robot.cables), set[str]()
    axes = {axis.name for axis in robot.axes}
    for k, entry in enumerate(entries):
        path, output, inputs = f"residual[{k}]", entry["output"], entry["inputs"]
        if output not in channels or output in seen:
            what = "is taken already" if output in seen else "is no channel of this robot"
            raise refuse(f"{path}.output", f"{output!r} {what}; there are {ordered(channels)}")
        seen.add(output)
        if next(iter(inputs)) != output or not axes.issuperset([*inputs][1:]):
            raise refuse(
                f"{path}.inputs",
                f"must be {output}, then some of {', '.join(sorted(axes))}; got {ordered(inputs)}",
            )
        for name, (lower, upper) in inputs.items():
            if not lower + NARROWEST <= upper:
                raise refuse(
                    f"{path}.inputs.{name}",
                    f"must increase by {NARROWEST:g} or more, got {[lower, upper]}",
                )
        shape = residual_shape(len(inputs))
        if [len(row) for row in entry["weights"]] != [shape[1]] * shape[0]:
            raise refuse(f"{path}.weights", f"must have {shape[0]} rows of {shape[1]} numbers")
        yield Residual(
            output,
            entry["bound"],
            entry["stddev"],
            {name: (float(lower), float(upper)) for name, (lower, upper) in inputs.items()},
            np.array(entry["weights"], dtype=float),
        )


def _uncertainty(
    document: Document, cables: tuple[Cable, ...], refuse: Refusal
) -> Uncertainty | None:
    """The stated standard deviations, the default ones, and the model's error."""
    entry: Document = document.get("uncertainty", {})
    errors = entry.get("model_error", {})
    channels = _channels(document, cables)
    for name in errors:
        if name not in channels:
            raise refuse(
                "uncertainty.model_error",
                f"has no channel {name!r}; there are {ordered(channels)}",
            )
    exact = entry.get("others") == "exact"
    known = complete_uncertainty(document, _stated(entry, refuse), exact=exact)
    slips = _slipping(entry.get("drums", {}), "hold" if exact else "may_slip", cables, refuse)
    if not slips and not errors:
        return known
    known = known or Uncertainty((), np.zeros((0, 0)))
    return replace(known, may_slip=slips, model_error=tuple(sorted(errors.items())))


def _slipping(
    drums: str | Document, default: str, cables: tuple[Cable, ...], refuse: Refusal
) -> tuple[str, ...]:
    """Names of the cables that may slip on drums; ``drums``: one word for all, or one by cable."""
    wound = [cable.name for cable in cables if cable.motors]
    words = dict.fromkeys(wound, drums) if isinstance(drums, str) else drums
    for name in words:
        if name not in wound:
            what = f"has no cable {name!r}; on drums are {ordered(wound)}"
            raise refuse("uncertainty.drums", what)
    return tuple(name for name in wound if words.get(name, default) == "may_slip")


def _stated(entry: Document, refuse: Refusal) -> Uncertainty | None:
    check_stated(entry, refuse)
    known = stated_numbers(entry)
    if not known.paths:
        return None
    return Uncertainty(known.paths, known.covariance, len(known.paths))

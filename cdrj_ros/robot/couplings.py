"""Linear maps of a robot file: joints that follow other joints, drums that several motors turn.

A tendon, a belt, a four-bar linkage or a differential couples a joint to others: its angle is
q = offset + sum of share * q_i over joints with angles of their own.  Frames that move with it move
with those joints, (G14) in docs/model.md, so that lengths, arms and efforts are theirs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from cdrj_ros.foundation.errors import Refusal, ordered
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.robot.description import Joint
from cdrj_ros.robot.space import IDENTITY, Frame


@dataclass(frozen=True)
class Coupling:
    """The angle of a joint as a linear function of measured ones; of such a joint, itself."""

    shares: tuple[tuple[str, float], ...]
    """Joints with angles of their own, and the change of the angle per change of theirs [-]."""
    offset: float = 0.0
    """Its angle where all of theirs are 0 [rad] or [m]."""


def is_coupled(entry: Any) -> bool:
    """Whether an entry of ``joints`` is a coupled joint."""
    return isinstance(entry, dict) and "coupled" in entry


def motor_shares(winch: Document) -> dict[str, float]:
    """Motors that turn a drum, each with the drum's turn per turn of the motor [-]."""
    given = winch["motor"]
    return {given: 1.0} if isinstance(given, str) else {name: float(given[name]) for name in given}


def drum_radii(document: Document) -> dict[str, dict[str, float]]:
    """Radii of all drums of a robot file by path [m], by the motors that turn them."""
    found: dict[str, dict[str, float]] = {}
    for cable in document["cables"]:
        for k, node in enumerate(cable["nodes"]):
            if node["type"] == "winch":
                path = f"cables.{cable['name']}.nodes.{k + 1}.radius"
                found.setdefault(" and ".join(motor_shares(node)), {})[path] = node["radius"]
    return found


def own_joints(document: Document) -> list[Document]:
    """Entries of the joints that are not coupled to others."""
    return [entry for entry in document.get("joints", ()) if not is_coupled(entry)]


def read_couplings(
    document: Document, joints: Mapping[str, Joint], refuse: Refusal
) -> Iterator[tuple[str, Coupling]]:
    """Name and function of every joint.

    Args:
        document: satisfies the schema.
        joints: those with angles of their own, by name.
        refuse: makes the errors.

    Raises:
        RobotFileError: one follows no joint, or one that is coupled itself.
    """
    for k, entry in enumerate(document["joints"]):
        if not is_coupled(entry):
            yield entry["name"], Coupling(((entry["name"], 1.0),))
            continue
        for name in entry["coupled"]:
            if name not in joints:
                raise refuse(
                    f"joints[{k}].coupled",
                    f"must name joints that are not coupled ({ordered(joints)}), got {name!r}",
                )
            if entry["coupled"][name] == 0.0:
                raise refuse(f"joints[{k}].coupled.{name}", "must not be 0: leave the joint out")
        shares = tuple((name, float(share)) for name, share in entry["coupled"].items())
        yield entry["name"], Coupling(shares, float(entry.get("offset", 0.0)))


def coupled_frames(frame: Frame, coupling: Coupling) -> Iterator[Frame]:
    """Frames that together move as one frame of a joint, each with one of the joints that move it.

    Turns about one axis add up, and so do slides along it: the frame is the last one of a row of
    frames that turn about, or slide along, the same axis (G14).
    """
    names = [f"{frame.name}#{k + 1}" for k in range(len(coupling.shares) - 1)] + [frame.name]
    coupled = coupling.shares != ((frame.joint, 1.0),)
    own = replace(frame, offset=frame.offset + frame.multiplier * coupling.offset, coupled=coupled)
    for name, (joint, share) in zip(names, coupling.shares, strict=True):
        yield replace(own, name=name, joint=joint, multiplier=frame.multiplier * share)
        own = replace(own, parent=name, origin=(0.0, 0.0, 0.0), rotation=IDENTITY, offset=0.0)

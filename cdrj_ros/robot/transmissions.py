"""Transmissions of a URDF as linear maps between the positions of their joints and actuators.

The format is that of ``<transmission>`` in ros2_control, in ROS 1 and in pr2_mechanism_model.
Actuators a follow from joints j by a = diag(r) M (j - offset), where r are the reductions of the
actuators and M depends on the type and on those of the joints, as in the classes of
transmission_interface and in WristTransmission; efforts follow by the transpose.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from types import MappingProxyType
from typing import Final
from xml.etree import ElementTree as Xml

import numpy as np

from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.foundation.output import counted, printable
from cdrj_ros.robot.couplings import Coupling


@dataclass(frozen=True)
class _Type:
    """A type of transmissions whose map is known."""

    joints: tuple[str, ...]
    """Their roles, in the order of the columns of M."""
    actuators: tuple[str, ...]
    matrix: Callable[..., list[list[float]]]
    """M, from the reductions of the joints."""


_BOTH: Final = (("joint1", "joint2"), ("actuator1", "actuator2"))

_TYPES: Final[Mapping[str, _Type]] = MappingProxyType(
    {
        "SimpleTransmission": _Type(("joint1",), ("actuator1",), lambda n: [[n]]),
        "DifferentialTransmission": _Type(*_BOTH, lambda n, m: [[n, m], [n, -m]]),
        "FourBarLinkageTransmission": _Type(*_BOTH, lambda n, m: [[n, 0.0], [1.0, m]]),
        "WristTransmission": _Type(
            ("flex", "roll"), ("right", "left"), lambda n, m: [[n, -m], [-n, -m]]
        ),
    }
)

_PACKAGES: Final = ("", "transmission_interface", "pr2_mechanism_model")
"""Packages whose types these are; those of the name of a simple one are all alike."""

DIGITS: Final = 15
"""Significant digits of a share, of which rounding spoils no more than the last one."""


@dataclass(frozen=True)
class _Shaft:
    """A joint or an actuator of a transmission."""

    name: str
    role: str
    reduction: float | None
    offset: float


@dataclass(frozen=True)
class Transmission:
    """A transmission, as a linear map in both directions."""

    name: str
    kind: str
    """Its type, without the package."""
    joints: Mapping[str, Coupling]
    """Every joint as a function of the actuators; their shares are empty if it is refused."""
    actuators: Mapping[str, Coupling]
    """Every actuator as a function of the joints."""
    refused: str = ""
    """Why its map is not known; empty if it is."""


def transmissions_of(root: Xml.Element, path: Path) -> Iterator[Transmission]:
    """All transmissions of a URDF.

    Args:
        root: the element ``robot``.
        path: names the file in messages.

    Raises:
        RobotFileError: a reduction or an offset is no number.
    """
    for element in root.iter("transmission"):
        joints, actuators = (_shafts(element, kind, path) for kind in ("joint", "actuator"))
        if not joints and not actuators:
            continue
        package, _, kind = _kind(element).rpartition("/")
        simple = kind == "SimpleTransmission"
        if simple:
            joints, actuators = _with_one_reduction(element, joints, actuators, path)
        if kind in _TYPES and element.find("plugin") is None:  # ROS 1 goes by the roles
            joints = sorted(joints, key=_place_in(_TYPES[kind].joints))
            actuators = sorted(actuators, key=_place_in(_TYPES[kind].actuators))
        known = kind in _TYPES and (simple or package in _PACKAGES)
        named = f"{kind} of {package}" if kind in _TYPES else kind
        reason = _reason(kind, joints, actuators) if known else f"{named} is not known"
        maps = _maps(kind, joints, actuators) if not reason else ({}, {})
        yield Transmission(
            element.get("name", ""),
            kind,
            {one.name: maps[0].get(one.name, Coupling(())) for one in joints},
            {one.name: maps[1].get(one.name, Coupling(())) for one in actuators},
            reason,
        )


def _place_in(roles: tuple[str, ...]) -> Callable[[_Shaft], int]:
    """Place of a shaft among roles; after all of them for other roles."""
    return lambda shaft: roles.index(shaft.role) if shaft.role in roles else len(roles)


def _kind(element: Xml.Element) -> str:
    """Type of a transmission; simple where it has none."""
    given = [element.findtext("plugin"), element.findtext("type"), element.get("type")]
    return next((text.strip() for text in given if text and text.strip()), "SimpleTransmission")


def _shafts(element: Xml.Element, kind: str, path: Path) -> list[_Shaft]:
    """Joints or actuators of a transmission, which pr2_mechanism_model calls ``flexJoint``."""
    return [
        _Shaft(
            one.get("name", ""),
            one.get("role") or (one.findtext("role") or "").strip() or tag.removesuffix(kind),
            _number(one, "reduction", path),
            _number(one, "offset", path) or 0.0,
        )
        for one in element
        if (tag := one.tag.lower()).endswith(kind) and one.get("name")
    ]


def _number(element: Xml.Element, key: str, path: Path) -> float | None:
    """The number of an attribute or of a child whose name ends with a key, in any spelling."""
    for name, text in (*element.attrib.items(), *((one.tag, one.text or "") for one in element)):
        if not name.lower().endswith(key) or not text.strip():
            continue
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not isfinite(value):
            given = printable(text.strip())[:60]
            raise RobotFileError(f"{path}: {name} must be a number, got {given!r}")
        return value
    return None


def _with_one_reduction(
    element: Xml.Element, joints: list[_Shaft], actuators: list[_Shaft], path: Path
) -> tuple[list[_Shaft], list[_Shaft]]:
    """Shafts of a simple transmission, whose reduction may stand anywhere in it, at its joint."""
    stated = [one.reduction for one in (*joints, *actuators)]
    stated.append(_number(element, "reduction", path))
    found = [value for value in dict.fromkeys(stated) if value not in (None, 1.0)]
    if len(found) > 1:
        return joints, actuators
    reduction = found[0] if found else 1.0
    return (
        [replace(one, reduction=reduction) for one in joints],
        [replace(one, reduction=None) for one in actuators],
    )


def _reason(kind: str, joints: list[_Shaft], actuators: list[_Shaft]) -> str:
    """Why the map of a transmission of a known type is not known; empty if it is."""
    roles = _TYPES[kind]
    count = len(roles.joints)
    if (len(joints), len(actuators)) != (count, count):
        found = f"{counted(len(joints), 'joint')} and {counted(len(actuators), 'actuator')}"
        return f"it has {found}, not {count} of each"
    for what, shafts, order in (
        ("joints", joints, roles.joints), ("actuators", actuators, roles.actuators),
    ):  # fmt: skip
        given = tuple(one.role for one in shafts)  # others than these do not count
        if count > 1 and {*given} <= {*order} and given != order:
            return f"the roles of its {what} are not {', '.join(order)}, in this order"
        if len({one.name for one in shafts} - {""}) < count:
            return f"its {what} have no names of their own"
    if count > 1 and {one.name for one in joints} & {one.name for one in actuators}:
        return "joints and actuators of it have the same names"
    stated = [one.reduction for one in (*actuators, *joints) if one.reduction is not None]
    if 0.0 in stated:
        return "it has a reduction of 0"
    if len(stated) > count == 1:
        return f"it has the reductions {stated[0]:g} and {stated[1]:g}, of which one counts"
    return ""


def _maps(
    kind: str, joints: list[_Shaft], actuators: list[_Shaft]
) -> tuple[dict[str, Coupling], dict[str, Coupling]]:
    """Joints as functions of the actuators, and actuators as functions of the joints."""
    of_joints, of_actuators = (
        [1.0 if one.reduction is None else one.reduction for one in part]
        for part in (joints, actuators)
    )
    offset = np.array([one.offset for one in joints])
    back = np.array(of_actuators)[:, None] * np.array(_TYPES[kind].matrix(*of_joints))
    ahead = np.linalg.inv(back)
    return _couplings(joints, actuators, ahead, offset), _couplings(
        actuators, joints, back, -back @ offset
    )


def _couplings(
    shafts: list[_Shaft], movers: list[_Shaft], matrix: Vector, offset: Vector
) -> dict[str, Coupling]:
    """One row of a matrix for every shaft, without what is zero to rounding."""
    least = 1e-12 * np.abs(matrix).max()
    return {
        shaft.name: Coupling(
            tuple(
                (mover.name, float(f"{share:.{DIGITS}g}"))
                for mover, share in zip(movers, row, strict=True)
                if abs(share) > least
            ),
            float(f"{constant:.{DIGITS}g}"),
        )
        for shaft, row, constant in zip(shafts, matrix, offset, strict=True)
    }

"""What check_robot tells of every cable, in tables of text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import degrees, isfinite, pi

from cdrj_ros.foundation.text import counted, fixed
from cdrj_ros.inspection.checks import CableCheck, Extent, Inspection, pose_text
from cdrj_ros.robot.description import Cable, Robot


def elasticity_text(cable: Cable) -> str:
    """``EA 6283 N``, followed by bedding of the strands and creep where a cable has them."""
    text = f"EA {cable.axial_stiffness:.4g} N"
    if cable.bedding_strain:
        text += f", bedding {cable.bedding_strain:.3g} at {cable.bedding_tension:.3g} N"
    if cable.creep_share:
        text += f", creep {cable.creep_share:.3g} in {cable.creep_time:.3g} s"
    if isfinite(cable.flow_time):
        text += f", flow in {cable.flow_time:.3g} s"
    return text


@dataclass(frozen=True)
class CableTable:
    """Elements and pulleys of one cable, in the order in which the cable meets them."""

    name: str
    headings: tuple[str, ...]
    """Of the columns, the first of which names the row."""
    rows: tuple[tuple[str, ...], ...]
    """Elements and pulleys alternate; the last row is the whole cable."""
    facts: tuple[str, ...]
    """Sentences on its stiffness and tensions."""


def headline(inspection: Inspection) -> str:
    """Numbers of parts and poses, and the loads."""
    robot = inspection.model.robot
    layout = inspection.model.layout
    parts = [
        counted(len(robot.motors), "motor"),
        counted(len(robot.joints), "joint"),
        counted(len(robot.cables), "cable"),
        counted(len(layout.elements), "element"),
        counted(len(layout.pulleys), "pulley"),
    ]
    loads = "".join(
        f", load {value:g} {'N' if name in robot.prismatic_joints else 'N m'} on {name}"
        for name, value in inspection.loads.items()
    )
    return f"{robot.name}: {', '.join(parts)}; {len(inspection.poses)} poses{loads}"


def cable_tables(inspection: Inspection) -> list[CableTable]:
    """A table of every cable, in the order of the robot file."""
    robot = inspection.model.robot
    units = ["-" if joint.name in robot.prismatic_joints else "mm" for joint in robot.joints]
    headings = (
        "", "length [mm]",
        *(f"arm {joint.name} [{unit}]" for joint, unit in zip(robot.joints, units, strict=True)),
        "wrap [°]", "η at rest", "η sliding", "passes [mm]",
    )  # fmt: skip
    return [
        CableTable(
            check.name, headings, tuple(_rows(robot, check)), tuple(_facts(inspection, check))
        )
        for check in inspection.cables
    ]


def _rows(robot: Robot, check: CableCheck) -> Iterator[tuple[str, ...]]:
    cable = _cable_of(robot, check)
    blank = [""] * (1 + len(robot.joints))
    for k, element in enumerate(check.elements):
        arms = _arms(robot, element.moment_arm)
        yield (f"element {k + 1}", _shown(element.length, 1e3, 1), *arms, "", "", "", "")
        if k < len(check.pulleys):
            pulley = check.pulleys[k]
            yield (
                f"{cable.pulleys[k].kind} {k + 2}",
                *blank,
                _shown(pulley.wrap, 180.0 / pi, 1),
                _shown(pulley.transmission_at_rest, 1.0, 3),
                _shown(pulley.transmission_sliding, 1.0, 3),
                f"{1e3 * pulley.passing:.2f}",
            )
    yield (
        "whole cable",
        _shown(check.length, 1e3, 1),
        *_arms(robot, check.moment_arm),
        "",
        _shown(check.transmission_at_rest, 1.0, 3),
        _shown(check.transmission_sliding, 1.0, 3),
        "",
    )


def _arms(robot: Robot, arms: Sequence[Extent]) -> list[str]:
    positions = robot.prismatic_joints
    return [
        _shown(arm, 1.0, 3) if joint.name in positions else _shown(arm, 1e3, 2)
        for joint, arm in zip(robot.joints, arms, strict=True)
    ]


def _shown(extent: Extent, factor: float, decimals: int) -> str:
    """``40.9`` or ``0.6 … 78.5``."""
    low, high = (fixed(factor * value, decimals) for value in (extent.low, extent.high))
    return low if low == high else f"{low} … {high}"


def _cable_of(robot: Robot, check: CableCheck) -> Cable:
    """The cable that was checked."""
    return next(cable for cable in robot.cables if cable.name == check.name)


def _facts(inspection: Inspection, check: CableCheck) -> Iterator[str]:
    robot = inspection.model.robot
    cable = _cable_of(robot, check)
    yield (
        f"{elasticity_text(cable)}, {1e-3 * check.stiffness:.3g} N/mm, "
        f"preload {cable.preload:g} N, law {cable.law}"
    )
    limit = f"; max_tension {cable.maximum_tension:g} N" if isfinite(cable.maximum_tension) else ""
    loaded = "under the load" if inspection.loads else "when the motors follow"
    where = pose_text(robot, check.worst.high_at)
    yield (
        f"tension {loaded}: {_shown(check.followed, 1.0, 2)} N; worst {check.worst.high:.4g} N, at "
        f"the pulling end with every pulley slipping{f' ({where})' if where else ''}{limit}"
    )
    still = [
        f"{joint.name} moved by {1e3 * way:.2f} mm"
        if joint.name in robot.prismatic_joints
        else f"{joint.name} turned by {degrees(way):.2f}°"
        for joint, way in zip(robot.joints, check.slack_after, strict=True)
        if isfinite(way)
    ]
    if still and cable.preload > 0.0:
        yield f"with the motors held, its preload is lost with {' or '.join(still)}"

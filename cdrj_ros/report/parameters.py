"""A robot in tables of text: its parameters, and what check_robot tells of every cable."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import degrees, isfinite, pi
from typing import Any

from cdrj_ros.foundation.text import counted, fixed
from cdrj_ros.inspection.checks import CableCheck, Extent, Inspection, pose_text
from cdrj_ros.report.table import ABSENT
from cdrj_ros.robot.description import Cable, Friction, PassiveTorque, Pulley, Robot, Sensor, Winch


@dataclass(frozen=True)
class ParameterTable:
    """Named rows of text; the first column names the row."""

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def parameter_tables(robot: Robot) -> tuple[ParameterTable, ...]:
    """Tables of cables, friction, axes, and standard deviations of the parameters."""
    tables = [_cables(robot), _friction(robot), _axes(robot)]
    if robot.uncertainty is not None:
        tables.append(_uncertainty(robot))
    if identified := robot.document.get("identified"):
        tables.append(_identified(identified))
    return tuple(table for table in tables if table.rows)


def robot_summary(robot: Robot, *, with_preload: bool = True) -> str:
    """Summary of the robot and its parameters in one or two sentences."""
    cables = "; ".join(
        f"{cable.name}: {len(cable.nodes) - 1} elements, "
        + (f"preload {cable.preload:g} N, " if with_preload else "")
        + f"{elasticity_text(cable)}, {cable.law}"
        for cable in robot.cables
    )
    return f"{robot.name} ({robot.source}). {cables}."


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


def _cables(robot: Robot) -> ParameterTable:
    rows = tuple(
        (
            cable.name,
            elasticity_text(cable).removeprefix("EA "),
            f"{cable.preload:.4g} N",
            cable.law,
            ", ".join(
                f"{node.motor} {1e3 * node.radius:.3g} mm"
                for node in cable.nodes
                if isinstance(node, Winch)
            )
            or ABSENT,
            f"{len(cable.pulleys)}",
        )
        for cable in robot.cables
    )
    return ParameterTable(
        "Cable", ("EA", "preload", "friction law", "winch, radius", "pulleys"), rows
    )


def _friction(robot: Robot) -> ParameterTable:
    """Table of friction parameters; adjacent pulleys with equal parameters share a row."""
    rows: list[tuple[str, ...]] = []
    for cable in robot.cables:
        for first, last, pulley in _alike(cable):
            own = f"{cable.name}/{first}" + (f"–{last}" if last > first else "")
            rows.append((own, f"{1e3 * pulley.radius:.4g}", *_coefficients(pulley)))
    headings = (
        "radius [mm]", "ρ", "μ_c", "μ_s", "v_s [mm/s]", "f_d", "d [mm]", "bearing [mN·m]",
        "σ0 [N/m]", "σ1 [N·s/m]", "σ2 [N·s/m]",
    )  # fmt: skip
    return ParameterTable("Pulley", headings, tuple(rows))


def _alike(cable: Cable) -> list[tuple[int, int, Pulley]]:
    """(first node, last node, pulley) of runs of adjacent pulleys with equal parameters."""
    runs: list[tuple[int, int, Pulley]] = []
    for number, node in enumerate(cable.nodes, start=1):
        if not isinstance(node, Pulley):
            continue
        if runs and runs[-1][1] == number - 1 and _signature(runs[-1][2]) == _signature(node):
            runs[-1] = (runs[-1][0], number, node)
        else:
            runs.append((number, number, node))
    return runs


def _signature(pulley: Pulley) -> tuple[float | Friction, ...]:
    return pulley.radius, pulley.friction, pulley.bearing_diameter, pulley.bearing_torque


def _coefficients(pulley: Pulley) -> Sequence[str]:
    friction = pulley.friction
    speed = friction.stribeck_speed
    return (
        f"{friction.rho:.4g}",
        f"{friction.mu_c:.4g}",
        f"{friction.mu_s:.4g}",
        ABSENT if speed is None else f"{1e3 * speed:.4g}",
        f"{friction.bearing_friction:.4g}",
        f"{1e3 * pulley.bearing_diameter:.4g}",
        f"{1e3 * pulley.bearing_torque:.4g}",
        f"{friction.bristle_stiffness:.4g}",
        f"{friction.bristle_damping:.4g}",
        f"{friction.viscous:.4g}",
    )


def _axes(robot: Robot) -> ParameterTable:
    rows = [
        (f"{motor.name} (motor)", ABSENT, *_axis(motor.passive, motor.sensor))
        for motor in robot.motors
    ]
    rows += [
        (
            f"{joint.name} (joint)",
            f"{degrees(joint.lower):.4g} to {degrees(joint.upper):.4g}".replace(
                "-", "\N{MINUS SIGN}"
            ),
            *_axis(joint.passive, joint.sensor),
        )
        for joint in robot.joints
    ]
    headings = (
        "range [°]", "bearing [mN·m]", "spring [mN·m/rad]", "scale", "offset [°]", "clock [ms]",
        "resolution [°]", "noise [°]",
    )  # fmt: skip
    return ParameterTable("Motor or joint", headings, tuple(rows))


def _axis(passive: PassiveTorque, sensor: Sensor) -> Sequence[str]:
    return (
        f"{1e3 * passive.bearing_torque:.4g}",
        f"{1e3 * passive.spring_stiffness:.4g}",
        f"{sensor.scale:.6g}",
        f"{degrees(sensor.offset):.4g}",
        f"{1e-6 * sensor.clock_offset_ns:.4g}",
        f"{degrees(sensor.resolution):.3g}",
        f"{degrees(sensor.noise):.3g}",
    )


def _uncertainty(robot: Robot) -> ParameterTable:
    known = robot.uncertainty
    rows: tuple[tuple[str, ...], ...] = ()
    if known is not None:
        rows = tuple(
            (name, f"{float(known.covariance[k, k]) ** 0.5:.3g}")
            for k, name in enumerate(known.parameters[: known.stated])
        )
    return ParameterTable("Parameter, in SI", ("standard deviation",), rows)


def _identified(entry: Mapping[str, Any]) -> ParameterTable:
    rows = tuple((str(key), _text(value)) for key, value in entry.items())
    return ParameterTable("Identified", ("",), rows)


def _text(value: object) -> str:
    if isinstance(value, float) and isfinite(value):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{key}: {_text(one)}" for key, one in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(map(_text, value))
    return str(value)


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

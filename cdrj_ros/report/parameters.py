"""Parameters of a robot as tables and as a summary, for the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees, isfinite
from typing import Any

from cdrj_ros.report.numbers import ABSENT
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

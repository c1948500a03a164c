"""Tables of the source and of this package, for the terminal and ``tables.md``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, radians
from typing import Final

import numpy as np

from cdrj_ros._core import Stribeck, blended_loss
from cdrj_ros.evaluation.metrics import ChannelError
from cdrj_ros.robot.description import Pulley, Robot
from examples.paper.runs import CABLES, Run
from examples.paper.study import (
    CHOICES,
    COMMON,
    OURS,
    PRINTED_DYNAMICS,
    PRINTED_LEVER,
    TOLD,
    Result,
    Study,
    arch,
    at_mid_range,
    change_of,
    errors_of,
    forward_change,
    from_turn,
    loop_width,
    strokes,
)

TABLE_I: Final = (
    (22.0, 10.0, "40.9"),
    (22.0, 10.0, "105.4"),
    (22.0, 10.0, "32.1"),
    (13.0, 6.0, "57.7"),
    (9.0, 5.0, "0.6-78.5"),
    (9.0, 5.0, "180"),
    (9.0, 5.0, "90"),
)
"""As printed, pulleys 2 to 8: diameter [mm], bearing diameter [mm], wrap angle [degrees]."""

TABLE_II: Final = (
    ("sigma0 [N/m]", 1e6, "bristle_stiffness", ""),
    ("sigma1 [N s/m]", 1000.0, "bristle_damping", "a constant sigma1 chatters where mu_s > mu_c"),
    ("sigma2 [N s/m]", 500.0, "viscous", "the source leaves it out of (36)"),
    ("mu_c [-]", 0.15, "mu_c", ""),
    ("mu_s [-]", 0.20, "mu_s", ""),
    ("v_s [m/s]", 0.05, "stribeck_speed", ""),
    ("f_d [-]", 0.01, "bearing_friction", ""),
)
"""As printed: symbol, value, the field of ``Friction`` that holds it here, and why it differs."""

PUBLISHED: Final = (
    ("tension of element 8", "1.34 N, 13.65 %", "1.10 N, 4.44 %"),
    ("force on node 3", "2.58 N, 11.86 %", "2.68 N, 6.74 %"),
    ("friction at node 3", "0.048 N, 15.78 %", "0.039 N, 13.19 %"),
)
"""Errors that the source reports for its rig, in the order of ``TOLD``: mean, mean relative."""

NEAR_S: Final = 0.5
"""Time around a turn of the joint within which an error is attributed to the reversal [s]."""


@dataclass(frozen=True)
class Table:
    """Text in rows and columns."""

    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]


def tables(study: Study) -> tuple[Table, ...]:
    """All tables, in the order of the source."""
    return (
        pulleys(study.robot),
        friction_parameters(study.robot),
        effect_of_rho(study),
        effects(study),
        errors(study),
        choices(study),
        equations(study),
    )


def markdown(all_tables: Sequence[Table]) -> str:
    """The tables as Markdown."""
    lines = ["# The source's tables and figures beside ours", ""]
    for table in all_tables:
        lines += [f"## {table.title}", "", f"| {' | '.join(table.headings)} |"]
        lines.append(f"|{'---|' * len(table.headings)}")
        lines += [*(f"| {' | '.join(row)} |" for row in table.rows), ""]
    return "\n".join(lines)


def pulleys(robot: Robot) -> Table:
    """Table I, and the transmissions at the larger end of the wrap that follow from both tables."""
    rows = []
    for k, (printed, pulley) in enumerate(zip(TABLE_I, robot.cables[0].pulleys, strict=True)):
        low, high = _wrap_range(pulley)
        wrap = f"{low:.4g}" if low == high else f"{low:.4g}-{high:.4g}"
        sizes = f"{2e3 * pulley.radius:g}, {1e3 * pulley.bearing_diameter:g}, {wrap}"
        source = f"{printed[0]:g}, {printed[1]:g}, {printed[2]}"
        rows.append([f"{k + 2}", source, sizes, *_transmissions(pulley)])
    rho = robot.cables[0].pulleys[0].friction.rho
    return Table(
        "Table I: pulleys (diameter [mm], bearing [mm], wrap [°]) and their transmissions",
        ("node", "source", "prototype.yaml", "eta_r (41)", "eta_d (37), v = 0", "eta_d, v >> v_s",
         f"eta, rho = {rho:g}, v = 0"),
        rows,
    )  # fmt: skip


def _wrap_range(pulley: Pulley) -> tuple[float, float]:
    """Smallest and largest wrap angle over the joint range [degrees]."""
    ends = [sum(float(profile.value[end]) for profile in pulley.wrap) for end in (0, -1)]
    return degrees(min(ends)), degrees(max(ends))


def _transmissions(pulley: Pulley) -> list[str]:
    """eta_r, eta_d at rest, eta_d far above v_s, and the blend at rest."""
    friction, wrap = pulley.friction, radians(_wrap_range(pulley)[1])
    mu = friction.mu_c, friction.mu_s
    ratio = friction.bearing_friction * pulley.bearing_diameter / pulley.radius
    (bearing, _), (sliding, further), (kinetic, static) = (
        blended_loss(rho, *mu, wrap, ratio, Stribeck.printed) for rho in (0.0, 1.0, friction.rho)
    )
    return [
        f"{1.0 - bearing:.5f}", f"{1.0 - sliding - further:.4f}", f"{1.0 - sliding:.4f}",
        f"{1.0 - kinetic - static:.4f}",
    ]  # fmt: skip


def friction_parameters(robot: Robot) -> Table:
    """Table II beside the robot file."""
    friction = robot.cables[0].pulleys[0].friction
    rows = []
    for symbol, printed, field, why in TABLE_II:
        rows.append((symbol, f"{printed:g}", f"{getattr(friction, field):g}", why))
    heads = ("", "source", "prototype.yaml", "why")
    return Table("Table II: friction of cable and pulley", heads, rows)


def effect_of_rho(study: Study) -> Table:
    """Differences of both cables in figure 9 [N]."""
    rows = [
        [f"{rho:g}", *("{:.1f}, {:.1f}".format(*difference(run, k)) for k in (1, 8))]
        for rho, run in study.free.items()
    ]
    return Table(
        "Upper less lower tension at mid-range, moving up and down [N]",
        ("rho", "winch", "element 8"),
        rows,
    )


def difference(run: Run, element: int) -> tuple[float, float]:
    """Upper less lower tension at mid-range [N], moving up and moving down."""
    upper, lower = (run.true[f"tension/{cable}/{element}"] for cable in CABLES)
    return at_mid_range(run.angle, upper - lower)


def effects(study: Study) -> Table:
    """What the source describes in words, in the first cycle of the rig's readings."""
    rows = []
    for result in study.results:
        for name, pattern in (
            ("winch", "tension/{}/1"),
            ("node 3", TOLD[1]),
            ("element 8", TOLD[0]),
        ):
            rows += [
                [
                    result.experiment.name,
                    f"{cable}, {name}",
                    *_effects(result, pattern.format(cable)),
                ]
                for cable in CABLES
            ]
    return Table(
        "Shapes of the rig's readings, and errors against its truth with rho identified",
        ("preloads", "force", "arches down, up [N]", "width of loop / mean",
         f"mean error within {NEAR_S:g} s of a turn, elsewhere [N]",
         "largest error [N], time from a turn [s]"),
        rows,
    )  # fmt: skip


def _effects(result: Result, channel: str) -> list[str]:
    rig, read = result.rig, result.rig.read[channel]
    down, up = strokes(rig)
    cycle = slice(down.start, up.stop)
    size = np.abs(result.estimates[OURS][channel] - rig.true[channel])
    away = from_turn(rig.time, rig)
    return [
        ", ".join(f"{arch(rig.angle[part], read[part]):.1f}" for part in (down, up)),
        f"{loop_width(rig.angle[cycle], read[cycle]):.0%}",
        ", ".join(f"{size[part].mean():.3f}" for part in (away <= NEAR_S, away > NEAR_S)),
        f"{size.max():.2f}, {away[np.argmax(size)]:.2f}",
    ]


def errors(study: Study) -> Table:
    """The source's errors beside ours, by its own procedure and with rho known."""
    rows = []
    for (name, *published), pattern in zip(PUBLISHED, TOLD, strict=True):
        for result, theirs in zip(study.results, published, strict=True):
            ours = [_figure(errors_of(result, choice, pattern)) for choice in (COMMON, OURS)]
            rows.append([name, result.experiment.label, theirs, *ours])
    return Table(
        "Errors: mean, and mean relative; both cables together",
        ("", "preloads", "source, own rig", "ours, rho = 0.2", "ours, rho identified"),
        rows,
    )


def _figure(error: ChannelError) -> str:
    if error.mean_abs_error is None or error.mean_relative_error is None:
        return "-"
    return f"{error.mean_abs_error:.3f} N, {100.0 * error.mean_relative_error:.2f} %"


def choices(study: Study) -> Table:
    """Changes of the estimate by single choices [N]."""
    rows = []
    for choice in CHOICES:
        cells = [
            _pair(change_of(result, choice, pattern), 2)
            for pattern in TOLD[:2]
            for result in study.results
        ]
        left = (errors_of(result, choice, TOLD[0]).mean_abs_error for result in study.results)
        rows.append([choice, *cells, *(f"{error:.2f}" for error in left)])
    names = [result.experiment.name for result in study.results]
    return Table(
        "One choice other than ours, same encoder readings: change of the estimate [N]",
        ("choice", *(f"element 8, {n}: mean, largest" for n in names),
         *(f"node 3, {n}: mean, largest" for n in names),
         *(f"error of element 8, {n}" for n in names)),
        rows,
    )  # fmt: skip


def equations(study: Study) -> Table:
    """Changes of the tensions of a prescribed motion by the joint's printed equations [N]."""
    shown = [(element, result) for element in (1, 8) for result in study.results]
    rows = [
        [name, *(_pair(forward_change(result, name, element), 3) for element, result in shown)]
        for name in (PRINTED_DYNAMICS, PRINTED_LEVER)
    ]
    return Table(
        "The joint's equations as printed, same motion: change of the tensions [N]",
        ("as printed", *(f"element {e}, {r.experiment.name}: mean, largest" for e, r in shown)),
        rows,
    )


def _pair(change: tuple[float, float] | None, decimals: int) -> str:
    if change is None:
        return "a cable would have to push"
    return ", ".join(f"{value:.{decimals}f}" for value in change)

"""The source's figures 8, 9, 12, 13 and 14, and the effects of its choices.

The upper cable is blue, the lower vermilion (Okabe and Ito, distinguishable by colour-blind
readers).  Measurements of the rig are thick pale lines, estimates thin dark ones on top.

This module imports matplotlib, which is slow; import it only where pictures are drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import radians
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from cdrj_ros._core import Stribeck, blended_loss
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.foundation.files import replacing
from examples.paper.runs import CABLES, Run
from examples.paper.study import (
    CORRECTED,
    LUGRE,
    OURS,
    PRINTED_LEVER,
    STEADY,
    Result,
    Study,
    at_mid_range,
    strokes,
)
from examples.paper.tables import difference

WIDTH: Final = 7.16
"""Of both columns [in]."""

STYLE: Final[Any] = {
    "font.family": "STIXGeneral",
    "mathtext.fontset": "stix",
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "legend.fontsize": 7.5,
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e6e2",
    "grid.linewidth": 0.5,
    "lines.linewidth": 0.9,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "legend.frameon": False,
    "pdf.fonttype": 42,
    "savefig.dpi": 200,
}

DARK: Final = {"upper": "#0072b2", "lower": "#c94f00"}
PALE: Final = {"upper": "#9fd0ee", "lower": "#f6c08f"}
INK: Final = "#1c1c1a"
MUTED: Final = "#6b6b66"
FAINT: Final = "#c9c9c4"

LINES: Final = ("-", "--", ":")
"""Three curves of a family."""


def figure_files(study: Study, folder: Path, formats: Sequence[str]) -> Iterator[Path]:
    """Draw every figure into a folder; yields the files as they are done."""
    for name, draw in DRAWINGS.items():
        with rc_context(STYLE):
            figure = draw(study)
            for kind in formats:
                path = folder / f"{name}.{kind}"
                undated = {"CreationDate": None} if kind == "pdf" else None
                with replacing(path) as stream:
                    figure.savefig(stream, format=kind, metadata=undated)
                yield path


def _panels(rows: int, columns: int, height: float, **options: Any) -> tuple[Figure, Any]:
    """A figure of lettered panels, with their axes in an array."""
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, **options)
    for k, axes in enumerate(panels.flat):
        letter = f"({chr(ord('a') + k)})"
        axes.text(1.0, 1.02, letter, transform=axes.transAxes, ha="right", va="bottom")
    return figure, panels


def _key(colour: str, label: str, line: Any = "-", width: float = 0.9, **marker: Any) -> Line2D:
    """An entry of a legend."""
    return Line2D([], [], color=colour, linestyle=line, linewidth=width, label=label, **marker)


def _over_angle(
    axes: Axes, angle: Vector, force: Vector, line: str, colour: str, width: float = 0.9
) -> None:
    axes.plot(np.degrees(angle), force, line, color=colour, linewidth=width)
    axes.set_xlabel("joint angle [°]")
    axes.set_xticks([-40, -20, 0, 20, 40])


def _over_time(axes: Axes, result: Result) -> None:
    """Mark the turns and name the axis of time."""
    for turn in result.rig.turns[1:-1]:
        axes.axvline(turn, color=FAINT, linewidth=0.6, zorder=0.5)
    axes.set_xlabel("time [s]")
    axes.margins(x=0.0)


CENTRE: Final = {
    "mu_c": 0.15, "mu_s": 0.20, "speed": 1.0, "f_d": 0.01,
    "bearing_mm": 10.0, "radius_mm": 11.0, "wrap_deg": 105.4,
}  # fmt: skip
"""Parameters that are not varied: Table II, pulley 3 of Table I, slip at the Stribeck speed."""

AXES: Final = {
    "mu_c": (r"Coulomb coefficient $\mu_c$ [-]", 0.1, 0.3),
    "mu_s": (r"static coefficient $\mu_s$ [-]", 0.2, 0.4),
    "wrap_deg": (r"wrap angle $\beta$ [°]", 0.0, 180.0),
    "speed": (r"slip speed $v/v_s$ [-]", 0.0, 3.0),
    "f_d": (r"bearing coefficient $f_d$ [-]", 0.002, 0.05),
    "bearing_mm": (r"bearing diameter $d$ [mm]", 2.0, 10.0),
    "radius_mm": (r"pulley radius $r_p$ [mm]", 4.0, 20.0),
}
"""Label and range of every parameter; those of mu_c and mu_s as in the source's text."""

WRAPS: Final = ("wrap_deg", r"$\beta$", (32.1, 105.4, 180.0))
"""Pulleys 4, 3 and 7 of Table I."""

SENSITIVITIES: Final[tuple[tuple[str, tuple[str, str, tuple[float, ...]]], ...]] = (
    ("mu_c", WRAPS),
    ("mu_s", WRAPS),
    ("wrap_deg", ("mu_c", r"$\mu_c$", (0.10, 0.15, 0.20))),
    ("speed", WRAPS),
    ("f_d", WRAPS),
    ("bearing_mm", WRAPS),
    ("radius_mm", WRAPS),
    ("wrap_deg", ("f_d", r"$f_d$", (0.005, 0.01, 0.02))),
)
"""The panels of figure 8: a parameter, and a curve for each value of another."""


def _eta_d(p: Mapping[str, float]) -> float:
    """(37) at a slip speed in units of v_s."""
    wrap = radians(p["wrap_deg"])
    kinetic, static = blended_loss(1.0, p["mu_c"], p["mu_s"], wrap, 0.0, Stribeck.printed)
    return 1.0 - kinetic - static * float(np.exp(-(p["speed"] ** 2)))


def _eta_r(p: Mapping[str, float]) -> float:
    """(41)."""
    ratio = p["f_d"] * p["bearing_mm"] / p["radius_mm"]
    return 1.0 - blended_loss(0.0, 0.0, 0.0, radians(p["wrap_deg"]), ratio, Stribeck.printed)[0]


def sensitivity(_: Study) -> Figure:
    """Figure 8: eta_d of (37) and eta_r of (41) over each of their parameters."""
    figure, panels = _panels(2, 4, 3.7)
    for k, (axes, (parameter, family)) in enumerate(zip(panels.flat, SENSITIVITIES, strict=True)):
        name, symbol, values = family
        label, low, high = AXES[parameter]
        centre = {**CENTRE, "mu_s": 0.3} if parameter == "mu_c" else CENTRE  # never below mu_c
        grid = np.linspace(low, high, 61)
        for value, line in zip(values, LINES, strict=True):
            curve = [
                (_eta_d if k < 4 else _eta_r)({**centre, name: value, parameter: x}) for x in grid
            ]
            axes.plot(grid, curve, line, color=INK, label=f"{symbol} = {value:g}")
        axes.set_xlabel(label)
        axes.margins(x=0.0)
        axes.set_ylim((0.3, 1.02) if k < 4 else (0.90, 1.003))
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(MaxNLocator(4))
        if k < 4:
            axes.axhline(0.8, color=DARK["lower"], linewidth=0.7)
        if family is not WRAPS:
            axes.legend(loc="lower left", borderaxespad=0.2, labelspacing=0.15)
    panels[0, 0].set_ylabel(r"sliding transmission $\eta_d$ [-]")
    panels[1, 0].set_ylabel(r"bearing transmission $\eta_r$ [-]")
    keys = [_key(INK, rf"$\beta$ = {w:g}°", line) for w, line in zip(WRAPS[2], LINES, strict=True)]
    keys.append(_key(DARK["lower"], r"$\eta_d$ = 0.8, the source's lower limit", width=0.7))
    figure.legend(handles=keys, loc="outside upper center", ncols=4)
    return figure


def effect_of_rho(study: Study) -> Figure:
    """Figure 9: effects of sliding and bearing friction on a cycle and along the cables."""
    figure, panels = _panels(3, len(study.free), 5.6, sharey="row")
    names = {0.0: "bearings alone", 1.0: "sliding alone"}
    for (rho, run), (winch, last, along) in zip(study.free.items(), panels.T, strict=True):
        winch.set_title(rf"$\rho$ = {rho:g} ({names.get(rho, 'the source’s blend')})")
        for cable in CABLES:
            for axes, element in ((winch, 1), (last, 8)):
                force = run.true[f"tension/{cable}/{element}"]
                for stroke, line in zip(strokes(run), ("--", "-"), strict=True):
                    _over_angle(axes, run.angle[stroke], force[stroke], line, DARK[cable])
            _along(along, run, cable)
        winch.set_ylim(0.0, 66.0)
        places = ((0.03, "up", "left"), (0.97, "down", "right"))
        for (x, name, side), value in zip(places, difference(run, 1), strict=True):
            text = rf"$\Delta T_\mathrm{{{name}}}$ = {value:.1f} N".replace("-", "−")
            winch.text(x, 0.95, text, va="top", ha=side, transform=winch.transAxes)
    for axes, place in zip(
        panels[:, 0],
        (
            "tension of element 1\n(winch)",
            "tension of element 8\n(anchor)",
            "tension at\nmid-range",
        ),
        strict=True,
    ):
        axes.set_ylabel(f"{place} [N]")
    handles = [_key(DARK[cable], f"{cable} cable") for cable in CABLES]
    handles.append(_key(MUTED, "moving up", marker="^", markersize=4))
    handles.append(_key(MUTED, "moving down", "--", marker="v", markersize=4, mfc="white"))
    figure.legend(handles=handles, loc="outside upper center", ncols=4)
    return figure


def _along(axes: Axes, run: Run, cable: str) -> None:
    """Tensions at mid-range over the elements, moving up and down."""
    elements = range(1, 9)
    both = [at_mid_range(run.angle, run.true[f"tension/{cable}/{k}"]) for k in elements]
    for k, (line, face) in enumerate((("^-", DARK[cable]), ("v--", "white"))):
        tension = [pair[k] for pair in both]
        axes.plot(elements, tension, line, color=DARK[cable], markersize=4, mfc=face)
    axes.set_xlabel("element, from winch to anchor")
    axes.set_xticks(elements)


def measured(study: Study, pattern: str, title: str) -> Figure:
    """Figures 12 to 14: over time, over the angle, and the error, for both sets of preloads."""
    figure, panels = _panels(len(study.results), 3, 3.9, width_ratios=(1.15, 1.0, 1.15))
    friction = pattern.startswith("friction")
    for result, (over_time, over_angle, errors) in zip(study.results, panels, strict=True):
        rig = result.rig
        cycle = slice(0, strokes(rig)[1].stop)
        for cable in CABLES:
            channel = pattern.format(cable)
            read, used = rig.read[channel], result.used(channel)
            for force, colour, width in ((read, PALE[cable], 2.6), (used, DARK[cable], 0.8)):
                over_time.plot(rig.time, force, color=colour, linewidth=width)
                _over_angle(over_angle, rig.angle[cycle], force[cycle], "-", colour, width)
            # the noise of two cells hides the remaining error of friction
            dark = used - (rig.true[channel] if friction else read)
            errors.plot(rig.time, dark, color=DARK[cable], lw=0.8)
            pale = result.estimates[OURS][channel] - read
            errors.plot(rig.time, pale, color=PALE[cable], lw=0.6, zorder=1.5)
        _over_time(errors, result)
        _over_time(over_time, result)
        for axes in (over_time, over_angle):
            axes.set_ylabel(f"{title} [N]")
        errors.set_ylabel("estimate − rig [N]")
        over_time.set_title(_preloads(result), loc="left", color=MUTED)
    rho = r"$\rho$ identified" if friction else r"$\rho$ = 0.2"
    handles = []
    for cable in CABLES:
        handles.append(_key(PALE[cable], f"{cable}, rig", width=2.6))
        handles.append(_key(DARK[cable], f"{cable}, estimated, {rho}", width=0.8))
    pale_name = "error against noisy cells" if friction else r"error, $\rho$ identified"
    handles.append(_key(PALE["upper"], pale_name, width=0.6))
    figure.legend(handles=handles, loc="outside upper center", ncols=5, columnspacing=1.2)
    return figure


def corrections(study: Study) -> Figure:
    """What the source's friction laws and its equation of motion change, in newtons."""
    figure, panels = _panels(len(study.results), 3, 3.9, width_ratios=(1.15, 1.0, 1.15))
    laws = (
        ("elastoplastic", OURS, DARK["upper"], "-"),
        ("lugre", LUGRE, "#aa3377", "-"),
        ("steady", STEADY, "#009e73", "--"),
    )
    for result, (over_time, errors, forward) in zip(study.results, panels, strict=True):
        channel, rig = "tension/lower/8", result.rig
        over_time.plot(rig.time, rig.read[channel], color=FAINT, linewidth=2.6)
        for _, choice, colour, line in laws:
            estimate = result.estimates[choice][channel]
            over_time.plot(rig.time, estimate, line, color=colour, linewidth=0.8)
            errors.plot(rig.time, estimate - rig.read[channel], line, color=colour, linewidth=0.8)
        for name, line in ((CORRECTED, "-"), (PRINTED_LEVER, "--")):
            if (run := result.forward[name]) is not None:
                cycle = slice(0, strokes(run)[1].stop)
                for cable in CABLES:
                    force = run.true[f"tension/{cable}/8"][cycle]
                    _over_angle(forward, run.angle[cycle], force, line, DARK[cable])
        _over_time(over_time, result)
        _over_time(errors, result)
        over_time.set_title(_preloads(result), loc="left", color=MUTED)
        over_time.set_ylabel("lower element 8 [N]")
        errors.set_ylabel("estimate − rig [N]")
        forward.set_ylabel("element 8 [N]")
    handles = [_key(FAINT, "rig", width=2.6)]
    handles += [_key(colour, f"law {law}", line) for law, _, colour, line in laws]
    handles += [
        _key(DARK[cable], f"{cable}, (10) {form}", line)
        for form, line in (("corrected", "-"), ("printed", "--"))
        for cable in CABLES
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=4, columnspacing=1.2)
    return figure


def _preloads(result: Result) -> str:
    return f"{result.experiment.name} preloads, {result.experiment.label}"


DRAWINGS: Final[Mapping[str, Callable[[Study], Figure]]] = {
    "fig08_sensitivity": sensitivity,
    "fig09_rho": effect_of_rho,
    "fig12_tension": lambda study: measured(study, "tension/{}/8", "tension of element 8"),
    "fig13_nodal_force": lambda study: measured(study, "nodal_force/{}/3", "force on node 3"),
    "fig14_friction": lambda study: measured(study, "friction/{}/3", "friction at node 3"),
    "fig_corrections": corrections,
}
"""Every figure by the name of its files."""

"""The source's figures 8, 9, 12, 13 and 14, and the effects of its choices.

The upper cable is blue, the lower vermilion (Okabe and Ito, distinguishable by colour-blind
readers).  Measurements of the rig are thick pale lines, estimates thin dark ones on top.

This module imports matplotlib, which is slow; import it only where pictures are drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Literal, get_args

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from cdrj_ros.foundation.files import replacing
from examples.paper.runs import CABLES, Free
from examples.paper.sensitivity import SENSITIVITIES, WRAPS_DEG
from examples.paper.study import (
    CORRECTED,
    LUGRE,
    PRINTED_LEVER,
    STEADY,
    Result,
    Study,
    differences,
    first_cycle,
)

Vector = NDArray[np.float64]

DOUBLE: Final = 7.16
"""Width of both columns [in]."""

DPI: Final = 200
"""Resolution of the PNG files [dots per inch]."""

STYLE: Final[Mapping[str, Any]] = MappingProxyType(
    {
        "font.family": "STIXGeneral",
        "mathtext.fontset": "stix",
        "font.size": 8.0,
        "axes.labelsize": 8.0,
        "axes.titlesize": 8.0,
        "xtick.labelsize": 7.5,
        "ytick.labelsize": 7.5,
        "legend.fontsize": 7.5,
        "axes.linewidth": 0.6,
        "axes.grid": True,
        "axes.axisbelow": True,
        "grid.color": "#e6e6e2",
        "grid.linewidth": 0.5,
        "lines.linewidth": 1.0,
        "xtick.direction": "in",
        "ytick.direction": "in",
        "xtick.major.width": 0.6,
        "ytick.major.width": 0.6,
        "xtick.major.size": 2.5,
        "ytick.major.size": 2.5,
        "legend.frameon": False,
        "legend.handlelength": 1.8,
        "pdf.fonttype": 42,
        "savefig.dpi": DPI,
    }
)

DARK: Final = {"upper": "#0072b2", "lower": "#c94f00"}
PALE: Final = {"upper": "#9fd0ee", "lower": "#f6c08f"}
THIRD: Final = "#009e73"
INK: Final = "#1c1c1a"
MUTED: Final = "#6b6b66"

DEGREE: Final = 180.0 / np.pi

LINES: Final = ("-", "--", ":")
"""Three curves of a family."""

SYMBOLS: Final = {"wrap_deg": r"$\beta$", "mu_c": r"$\mu_c$", "f_d": r"$f_d$"}

AXES: Final = {
    "mu_c": r"Coulomb coefficient $\mu_c$ [-]",
    "mu_s": r"static coefficient $\mu_s$ [-]",
    "wrap_deg": r"wrap angle $\beta$ [°]",
    "speed": r"slip speed $v/v_s$ [-]",
    "f_d": r"bearing coefficient $f_d$ [-]",
    "bearing_mm": r"bearing diameter $d$ [mm]",
    "radius_mm": r"pulley radius $r_p$ [mm]",
}

TICKS: Final = {
    "mu_c": (0.1, 0.2, 0.3),
    "mu_s": (0.2, 0.3, 0.4),
    "wrap_deg": (0, 60, 120, 180),
    "speed": (0, 1, 2, 3),
    "f_d": (0.01, 0.03, 0.05),
    "bearing_mm": (2, 6, 10),
    "radius_mm": (4, 12, 20),
}


Format = Literal["png", "pdf"]
FORMATS: Final[tuple[Format, ...]] = get_args(Format)


def figure_files(
    study: Study, folder: Path, formats: Sequence[Format] = FORMATS
) -> Iterator[tuple[Path, ...]]:
    """Draw every figure into a folder; yields the files of each as they are done."""
    for name, draw in DRAWINGS.items():
        with rc_context(_style()):
            figure = draw(study)
            FigureCanvasAgg(figure)
            figure.draw_without_rendering()  # computes the layout, once for all formats
            figure.set_layout_engine("none")
            paths = []
            for kind in formats:
                paths.append(folder / f"{name}.{kind}")
                with replacing(paths[-1]) as stream:
                    figure.savefig(
                        stream,
                        format=kind,
                        metadata={"CreationDate": None} if kind == "pdf" else None,
                    )
        yield tuple(paths)


def _style() -> Any:
    return dict(STYLE)


def _key(colour: str, label: str, line: Any = "-", width: float = 0.9, **marker: Any) -> Line2D:
    """An entry of a legend."""
    return Line2D([], [], color=colour, linestyle=line, linewidth=width, label=label, **marker)


def sensitivity() -> Figure:
    """Figure 8: eta_d of (37) and eta_r of (41) over each of their parameters."""
    figure = Figure(figsize=(DOUBLE, 3.7), layout="constrained")
    panels = figure.subplots(2, 4)
    for k, (axes, panel) in enumerate(zip(panels.flat, SENSITIVITIES, strict=True)):
        for value, line in zip(panel.values, LINES, strict=True):
            label = f"{SYMBOLS[panel.family]} = {value:g}"
            axes.plot(panel.grid, panel.curve(value), line, color=INK, label=label)
        axes.set_xlabel(AXES[panel.parameter])
        axes.set_xticks(TICKS[panel.parameter])
        axes.margins(x=0.0)
        if panel.family != "wrap_deg":
            axes.legend(loc="lower left", borderaxespad=0.2, labelspacing=0.15)
        if panel.transmission == "eta_d":
            axes.axhline(0.8, color=DARK["lower"], linewidth=0.7)
            axes.set_ylim(0.3, 1.02)
        else:
            axes.set_ylim(0.90, 1.003)
            axes.yaxis.set_major_locator(MaxNLocator(5))
        _letter(axes, k)
    panels[0, 0].set_ylabel(r"sliding transmission $\eta_d$ [-]")
    panels[1, 0].set_ylabel(r"bearing transmission $\eta_r$ [-]")
    keys = [
        _key(INK, rf"$\beta$ = {wrap:g}°", line)
        for wrap, line in zip(WRAPS_DEG, LINES, strict=True)
    ]
    keys.append(_key(DARK["lower"], r"$\eta_d$ = 0.8, the source's lower limit", width=0.7))
    figure.legend(handles=keys, loc="outside upper center", ncols=4)
    return figure


def effect_of_rho(study: Study) -> Figure:
    """Figure 9: effects of sliding and bearing friction on a cycle and along the cables."""
    figure = Figure(figsize=(DOUBLE, 5.6), layout="constrained")
    panels = figure.subplots(3, len(study.free), sharey="row")
    for column, (rho, run) in enumerate(study.free.items()):
        cycle = run.time <= study.motion.period
        angle = run.angle[cycle]
        turn = int(np.argmin(angle))
        loops, last, along = panels[:, column]
        loops.set_title(
            rf"$\rho$ = {rho:g}"
            + {0.0: " (bearings alone)", 1.0: " (sliding alone)"}.get(rho, " (source's blend)")
        )
        for cable in CABLES:
            for axes, element in ((loops, 1), (last, 8)):
                tension = run.tension[f"{cable}/{element}"][cycle]
                for stroke, line in ((slice(0, turn + 1), "--"), (slice(turn, None), "-")):
                    axes.plot(
                        angle[stroke] * DEGREE, tension[stroke], line, color=DARK[cable],
                        linewidth=0.9,
                    )  # fmt: skip
            _along(along, run, cable)
        _difference_arrows(loops, run)
        for axes in (loops, last):
            axes.set_xlabel("joint angle [°]")
            axes.set_xticks([-40, -20, 0, 20, 40])
        along.set_xlabel("element, from winch to anchor")
        along.set_xticks(range(1, 9))
        for row, axes in enumerate((loops, last, along)):
            _letter(axes, 3 * row + column)
    for axes, label in zip(
        panels[:, 0],
        ("tension of element 1\n(winch) [N]", "tension of element 8\n(anchor) [N]",
         "tension at\nmid-range [N]"),
        strict=True,
    ):  # fmt: skip
        axes.set_ylabel(label)
    figure.legend(
        handles=[
            _key(DARK["upper"], "upper cable"),
            _key(DARK["lower"], "lower cable"),
            _key(MUTED, "moving up", marker="^", markersize=4),
            _key(MUTED, "moving down", "--", marker="v", markersize=4, markerfacecolor="white"),
        ],
        loc="outside upper center",
        ncols=4,
    )
    return figure


def _along(axes: Axes, run: Free, cable: str) -> None:
    elements = range(1, 9)
    pairs = [_mid(run, f"{cable}/{element}") for element in elements]
    for direction, marker, line, face in ((0, "^", "-", DARK[cable]), (1, "v", "--", "white")):
        axes.plot(
            elements, [pair[direction] for pair in pairs], color=DARK[cable], marker=marker,
            linestyle=line, markersize=4, markerfacecolor=face, linewidth=0.9,
        )  # fmt: skip


def _mid(run: Free, name: str) -> tuple[float, float]:
    return differences(run.angle, run.tension[name], np.zeros(run.angle.size))


def _difference_arrows(axes: Axes, run: Free) -> None:
    """Tension difference of the cables at the winch, moving up and down, at mid-range."""
    upper, lower = (_mid(run, f"{cable}/1") for cable in CABLES)
    axes.set_ylim(0.0, 66.0)
    for at, direction, name, line in ((-6.0, 0, "up", "-"), (6.0, 1, "down", "--")):
        axes.annotate(
            "", (at, upper[direction]), (at, lower[direction]),
            arrowprops={"arrowstyle": "<->", "color": INK, "linewidth": 0.7, "linestyle": line,
                        "shrinkA": 0, "shrinkB": 0, "mutation_scale": 7},
        )  # fmt: skip
        difference = f"{upper[direction] - lower[direction]:.1f}".replace("-", "−")
        axes.text(
            0.03 if name == "up" else 0.97, 0.95,
            rf"$\Delta T_\mathrm{{{name}}}$ = {difference} N",
            ha="left" if name == "up" else "right", va="top", transform=axes.transAxes,
        )  # fmt: skip


def measured(study: Study, pattern: str, title: str) -> Figure:
    """Figures 12 to 14: over time, over the angle, and the error, for both sets of preloads."""
    figure = Figure(figsize=(DOUBLE, 3.9), layout="constrained")
    panels = figure.subplots(len(study.results), 3, width_ratios=(1.15, 1.0, 1.15))
    friction = pattern.startswith("friction")
    for row, result in enumerate(study.results):
        over_time, over_angle, errors = panels[row]
        for cable in CABLES:
            channel = result.used(pattern.format(cable))
            cycle = first_cycle(result, channel)
            time = result.seconds(channel)
            for axes, x, part in (
                (over_time, time, channel), (over_angle, cycle.angle * DEGREE, cycle),
            ):  # fmt: skip
                axes.plot(x, part.reference, color=PALE[cable], linewidth=2.6)
                axes.plot(x, part.estimate, color=DARK[cable], linewidth=0.8)
            known = result.identified[channel.name]
            against_cells = channel.estimate - channel.reference
            if friction:  # the noise of two cells hides the remaining error
                errors.plot(time, against_cells, color=PALE[cable], linewidth=0.5, zorder=1.5)
                errors.plot(
                    time, result.true_error(known), color=DARK[cable], linewidth=0.8,
                    zorder=3.0 if cable == "upper" else 2.5,
                )  # fmt: skip
            else:
                rest = known.estimate - known.reference
                errors.plot(time, rest, color=PALE[cable], linewidth=0.6, zorder=1.5)
                errors.plot(time, against_cells, color=DARK[cable], linewidth=0.8)
        _turn_marks(errors, result)
        _turn_marks(over_time, result)
        over_time.set_ylabel(f"{title} [N]")
        over_angle.set_ylabel(f"{title} [N]")
        errors.set_ylabel("estimate − rig [N]")
        over_time.set_title(_set_name(result), loc="left", color=MUTED)
        over_angle.set_xlabel("joint angle [°]")
        over_angle.set_xticks([-40, -20, 0, 20, 40])
        for axes in (over_time, errors):
            axes.set_xlabel("time [s]")
            axes.margins(x=0.0)
        for k, axes in enumerate(panels[row]):
            axes.yaxis.set_major_locator(MaxNLocator(5))
            _letter(axes, 3 * row + k)
    rho = r"$\rho$ identified" if friction else r"$\rho$ = 0.2"
    handles = []
    for cable in CABLES:
        handles.append(_key(PALE[cable], f"{cable}, rig", width=2.6))
        handles.append(_key(DARK[cable], f"{cable}, estimated, {rho}", width=0.8))
    pale = "error against noisy cells" if friction else r"error, $\rho$ identified"
    handles.append(_key(PALE["upper"], pale, width=0.6))
    figure.legend(handles=handles, loc="outside upper center", ncols=5, columnspacing=1.2)
    return figure


def corrections(study: Study) -> Figure:
    """What the source's friction laws and its equation of motion change, in newtons."""
    figure = Figure(figsize=(DOUBLE, 3.9), layout="constrained")
    panels = figure.subplots(len(study.results), 3, width_ratios=(1.15, 1.0, 1.15))
    laws = (
        ("elastoplastic", None, DARK["upper"], "-"),
        ("lugre", LUGRE, "#aa3377", "-"),
        ("steady", STEADY, THIRD, "--"),
    )
    for row, result in enumerate(study.results):
        over_time, errors, forward = panels[row]
        name = "tension/lower/8"
        ours = result.identified[name]
        time = result.seconds(ours)
        over_time.plot(time, ours.reference, color="#c9c9c4", linewidth=2.6)
        for _, choice, colour, line in laws:
            channel = ours if choice is None else result.choices[choice][name]
            over_time.plot(time, channel.estimate, line, color=colour, linewidth=0.8)
            errors.plot(
                time, channel.estimate - channel.reference, line, color=colour, linewidth=0.8
            )
        _turn_marks(errors, result)
        for style, key in (("-", CORRECTED), ("--", PRINTED_LEVER)):
            run = result.forward[key]
            if run is not None:
                cycle = run.time <= study.motion.period
                for cable in CABLES:
                    forward.plot(
                        run.angle[cycle] * DEGREE, run.tension[f"{cable}/8"][cycle], style,
                        color=DARK[cable], linewidth=0.9,
                    )  # fmt: skip
        over_time.set_title(_set_name(result), loc="left", color=MUTED)
        over_time.set_ylabel("lower element 8 [N]")
        errors.set_ylabel("estimate − rig [N]")
        forward.set_ylabel("element 8 [N]")
        forward.set_xlabel("joint angle [°]")
        forward.set_xticks([-40, -20, 0, 20, 40])
        for axes in (over_time, errors):
            axes.set_xlabel("time [s]")
            axes.margins(x=0.0)
        for k, axes in enumerate(panels[row]):
            axes.yaxis.set_major_locator(MaxNLocator(5))
            _letter(axes, 3 * row + k)
    handles = [_key("#c9c9c4", "rig", width=2.6)]
    handles += [_key(colour, f"law {law}", line) for law, _, colour, line in laws]
    handles += [
        _key(DARK[cable], f"{cable}, {label}", line)
        for label, line in (("(10) corrected", "-"), ("(10) printed", "--"))
        for cable in CABLES
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=4, columnspacing=1.2)
    return figure


def _set_name(result: Result) -> str:
    return f"{result.experiment.name} preloads, {result.label}"


def _turn_marks(axes: Axes, result: Result) -> None:
    for turn in result.turns[1:-1]:
        axes.axvline(turn, color="#c9c9c4", linewidth=0.6, zorder=0.5)


def _letter(axes: Axes, k: int) -> None:
    axes.text(
        1.0, 1.02, f"({chr(ord('a') + k)})", transform=axes.transAxes, ha="right", va="bottom",
        fontsize=8.0,
    )  # fmt: skip


DRAWINGS: Final[Mapping[str, Callable[[Study], Figure]]] = {
    "fig08_sensitivity": lambda _: sensitivity(),
    "fig09_rho": effect_of_rho,
    "fig12_tension": lambda study: measured(study, "tension/{}/8", "tension of element 8"),
    "fig13_nodal_force": lambda study: measured(study, "nodal_force/{}/3", "force on node 3"),
    "fig14_friction": lambda study: measured(study, "friction/{}/3", "friction at node 3"),
    "fig_corrections": corrections,
}
"""Every figure by the name of its files."""

FIGURES: Final = len(DRAWINGS)
"""Number of figures."""

#!/usr/bin/env python3
"""Split the standard deviations of an identified file by cause, on motions that were not fitted.

python tools/spread_causes.py             print the table of docs/uncertainty.md
python tools/spread_causes.py --draws 6   the same with more robots

The truths have eight contact cells per pulley and numbers drawn from the tolerances, as in
standard_errors.py.  Every robot is identified from one recording with 32 references; then another
motion is estimated at 1 kHz, from its beginning at rest and from its middle on.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray
from standard_errors import (
    OTHER_RATE,
    OTHER_SECONDS,
    OTHER_SEED,
    START_SECONDS,
    fitted_numbers,
    moved,
    recording,
    robot_file,
    samples_of,
    truths,
)

from cdrj_ros.commands.identify_uncertainty import uncertainty_section
from cdrj_ros.estimation.ensemble import Ensemble
from cdrj_ros.estimation.estimator import initial_state
from cdrj_ros.estimation.samples import Samples
from cdrj_ros.identification.fit import identify
from cdrj_ros.identification.problem import Settings
from cdrj_ros.model.packing import number_views
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.parameters import with_numbers
from cdrj_ros.robot.reader import build_robot

Table = NDArray[np.float64]

FIT: Final = "rho,preload"
BEGINS_S: Final = (0.0, 6.3)
"""Where in the motion the estimate begins [s]."""


class Kept(NamedTuple):
    """Unknown quantities that differ from member to member."""

    file: str
    """``may_slip``, ``hold`` or ``exact``."""
    readings: bool = False
    history: bool = False
    wound: bool = False


CAUSES: Final[Mapping[str, Kept]] = {
    "all, drums may slip": Kept("may_slip", True, True, True),
    "all, drums hold": Kept("hold", True, True, True),
    "numbers of the file": Kept("hold"),
    "readings": Kept("exact", readings=True),
    "friction history at the start": Kept("exact", history=True),
    "tension at which the cable on the drum was wound": Kept("exact", wound=True),
    "none": Kept("exact"),
}


def estimated(model: Model, samples: Samples, kept: Kept) -> tuple[Table, Table]:
    """Tensions and standard deviations [N] if only some quantities are unknown."""
    spread = Ensemble(model)
    if not kept.readings:
        spread.core.reading_error[:] = 0.0
    if not kept.history:
        spread.core.friction_share[:] = 0.0
    if not kept.wound:
        cables: Any = number_views(model.sizes, spread.numbers).cables
        cables["wound_tension"] = cables["preload"]
    _, found = spread.run(initial_state(model), samples)
    assert found.stddev is not None
    tension = found.values[:, model.layout.tension]
    return tension, found.stddev[:, : tension.shape[1]]


def files(document: Any, values: dict[str, float], seed: int) -> dict[str, Model]:
    """Models of the new file: drums may slip, drums as the fit judges them, all numbers exact."""
    unknowns = fitted_numbers(document, FIT)
    settings = Settings(coarse=True, compares_drums=True)
    found = identify(document, "file", unknowns, [recording(document, values, seed)], settings)
    numbers = with_numbers(document, found.by_path)
    block = yaml.safe_load(uncertainty_section(found, {}, {}))["uncertainty"]
    assert block["drums"] == "hold"
    blocks = {
        "may_slip": {**block, "drums": "may_slip"}, "hold": block, "exact": {"others": "exact"},
    }  # fmt: skip
    return {
        name: prepare(build_robot({**numbers, "uncertainty": one}, name))
        for name, one in blocks.items()
    }


def print_row(what: str, rows: list[tuple[float, float, float]]) -> None:
    """Print root mean squares [N] and the mean and the lowest share within two of them."""
    error, stddev = (np.sqrt(np.mean([row[k] for row in rows])) for k in (0, 1))
    inside = [row[2] for row in rows]
    print(f"| {what} | {error:.2f} | {stddev:.2f} | {np.mean(inside):.1%}, {min(inside):.1%} |")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--draws", type=int, default=4)
    document = robot_file()
    draws = truths(document, fitted_numbers(document, FIT), "all", parser.parse_args().draws)
    rows: dict[tuple[float, str], list[tuple[float, float, float]]] = {}
    for seed, values in enumerate(draws):
        models = files(document, values, seed)
        robot = build_robot(with_numbers(document, values), "truth")
        generator = np.random.default_rng([seed, 2])
        motion = moved(robot, seed + OTHER_SEED, OTHER_SECONDS, generator, OTHER_RATE)
        for begin_s in BEGINS_S:
            begin, first = round(begin_s * OTHER_RATE), round(START_SECONDS * OTHER_RATE)
            true = motion.truth.tension[begin + first :]
            for what, kept in CAUSES.items():
                model = models[kept.file]
                tension, stddev = estimated(model, samples_of(model, motion, begin), kept)
                error, late = tension[-len(true) :] - true, stddev[-len(true) :]
                inside = float(np.mean(np.abs(error) <= 2.0 * late))
                row = float(np.mean(error**2)), float(np.mean(late**2)), inside
                rows.setdefault((begin_s, what), []).append(row)
    for begin_s in BEGINS_S:
        print(f"| from {begin_s} s on | error, RMS [N] | stddev, RMS [N] | within 2σ |")
        print("|---|---|---|---|")
        for what in CAUSES:
            print_row(what, rows[begin_s, what])


if __name__ == "__main__":
    main()

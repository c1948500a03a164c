"""Fit config/robots/davinci_jaw.yaml to recordings of a real cable-driven jaw.

    python tools/fit_davinci_jaw.py TRAIN_FOLDER --out config/robots/davinci_jaw.yaml

TRAIN_FOLDER holds one bag per run: spindle and jaw angles and, as references, both torques (the
data set is named in the robot file).  The model that is fitted is the estimator itself, run
causally from the first sample of every run, friction state unknown, so what is fitted is what
runs.  The residual is the error of either torque over that torque's standard deviation, at every
``STRIDE``-th sample: friction does not depend on rate, and the fit takes seconds instead of
minutes.  The figures printed at the end are those of all samples.

``--cross-validate`` fits again without the runs of each load in turn and judges every run by the
fit that has not seen it: the figure by which the number of parameters was chosen.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from math import exp, log
from pathlib import Path
from time import perf_counter
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from cdrj_ros.bag import Topics
from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.estimation.metrics import ChannelError, channel_error
from cdrj_ros.model.errors import BagError, CdrjError
from cdrj_ros.model.plan import Model, prepare
from cdrj_ros.model.robot_file import parse_robot
from cdrj_ros.validation import condition_recording, read_inputs

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

CHANNELS: Final = ("effort/spindle", "effort/jaw")
"""References that are fitted [N m]: motor first, joint second, as in ``estimated_torques``."""

STRIDE: Final = 10
"""Every how manieth sample is fitted: 100 Hz of 1 kHz."""

STEP: Final = 1e-4
"""Step of the differences that make the Jacobian, in the fit's own coordinates."""

MAX_EVALUATIONS: Final = 60


@dataclass(frozen=True)
class Parameter:
    """A number of the robot file that is fitted."""

    name: str
    """Its place in ``TEMPLATE``."""
    start: float
    """A round guess."""
    lower: float
    upper: float
    spread: float | None = None
    """Unit of the fit's coordinate; None: the coordinate is the logarithm, for positive numbers."""

    def value(self, coordinate: float) -> float:
        """The number at a coordinate; 0 is ``start``."""
        if self.spread is None:
            return self.start * exp(coordinate)
        return self.start + self.spread * coordinate

    def coordinate(self, value: float) -> float:
        """The inverse of ``value``."""
        if self.spread is None:
            return log(value / self.start)
        return (value - self.start) / self.spread


PARAMETERS: Final = (
    Parameter("stiffness_a", 1000.0, 10.0, 100e3),
    Parameter("stiffness_b", 10e3, 1000.0, 100e3),
    Parameter("preload", 5.0, 0.1, 100.0),
    Parameter("mu_a", 0.3, 0.01, 2.0),
    Parameter("mu_b", 0.1, 0.01, 2.0),
    Parameter("jaw_bearing_torque", 0.002, 1e-5, 0.1),
    Parameter("jaw_bristle_stiffness", 50e3, 1e3, 1e7),
    Parameter("jaw_radius_mm", 5.0, 2.0, 10.0),
    Parameter("jaw_reference", 0.8, 0.0, 1.5, spread=0.1),
)
"""What is fitted; the first guess has the jaw's load on cable b, where it is in every run."""

TEMPLATE: Final = """\
# The jaw of a da Vinci Si surgical instrument (Maryland dissector): a motor turns a spindle, two
# cables run from it through the instrument's shaft and over the wrist's pulleys to the jaw.
#
# Fitted to real recordings by tools/fit_davinci_jaw.py; do not edit the numbers by hand.
# Data: MRDLab/mis-tool-characterization, "Tool_4_Maryland_L", wrist straight, 0.1 and 0.3 Hz, jaw
# loads of 10, 30, 50, 70 and 90 %.  O'Neill, Stephens, Kowalewski, IEEE RA-L 3(4), 2018,
# doi 10.1109/LRA.2018.2849862.  Database under ODbL 1.0, its contents under DbCL 1.0.
# On the runs it was fitted to:
{figures}
#
# What the data cannot tell, and what therefore is assumed here:
# - Measured are two angles and two torques.  A torque is (tension of a - tension of b) times a
#   radius: only the difference of both tensions can be checked, and only times a radius.  Every
#   tension scales with 1 / spindle radius, which is assumed.
# - A cable's stiffness per length counts, EA / length; the lengths are assumed.
# - Of friction only mu times wrap angle counts; the wraps are assumed.  All friction that grows
#   with load stands at one pulley near the spindle, all that does not at one near the jaw.
# - The load always pulls at cable b.  Cable a is hardly tight: its stiffness, its friction and the
#   preload describe what load-independent torque there is on the spindle (its bearing, what turns
#   with it), and are no properties of the cable itself.
# - The jaw is zeroed anew in every wrist pose: jaw's reference_angle is that of the wrist straight.
name: davinci_jaw

motors:
  - name: spindle
    reference_angle: 0.5          # a pose amid the stroke, chosen

joints:
  - name: jaw
    range: [-0.5, 2.0]            # assumed; the runs have 0.16 to 1.24 rad
    reference_angle: {jaw_reference:<9.5g}    # fitted: where both have the preload
    effort_sign: -1               # the recorded torque is what holds the jaw against the cables

friction:
  law: elastoplastic

cables:
  - name: a                       # wound by +spindle, lengthened by +jaw
    axial_stiffness: {stiffness_a:<9.5g}    # EA [N], fitted, given the assumed lengths
    preload: {preload:<9.5g}            # [N], fitted, that of b too
    nodes:
      - {{type: winch, motor: spindle, radius_mm: 5, winding: 1}}       # radius assumed
      - type: pulley              # 2, where the cable leaves the spindle
        radius_mm: 3              # assumed
        wrap_angle_deg: 180       # assumed
        friction: {{mu_c: {mu_a:.5g}}}    # fitted, given the wrap
      - {{type: pulley, radius_mm: 3, wrap_angle_deg: 90}}              # 3, the wrist; assumed
      - {{type: anchor}}
    spans:                        # assumed [m]; the last follows the jaw
      - 0.02
      - 0.40
      - {{joint: jaw, offset_mm: 20, slope_mm: {jaw_radius_mm:.5g}}}    # fitted: the jaw's radius

  - name: b                       # wound by -spindle, lengthened by -jaw; carries the load
    axial_stiffness: {stiffness_b:<9.5g}    # EA [N], fitted, given the assumed lengths
    preload: {preload:<9.5g}            # [N], that of a
    nodes:
      - {{type: winch, motor: spindle, radius_mm: 5, winding: -1}}
      - type: pulley              # 2
        radius_mm: 3
        wrap_angle_deg: 180
        friction: {{mu_c: {mu_b:.5g}}}    # fitted, given the wrap
      - type: pulley              # 3, the wrist and the jaw's own bearing
        radius_mm: 3
        wrap_angle_deg: 90
        bearing_torque: {jaw_bearing_torque:<9.5g} # [N m], fitted, given the radius
        friction: {{bristle_stiffness: {jaw_bristle_stiffness:.5g}}}    # [N/m], fitted
      - {{type: anchor}}
    spans:
      - 0.02
      - 0.40
      - {{joint: jaw, offset_mm: 20, slope_mm: -{jaw_radius_mm:.5g}}}
"""


@dataclass(frozen=True)
class Run:
    """One recording: angles in, measured torques out."""

    name: str
    samples: Samples
    torque: Table
    """Measured, in the order of ``CHANNELS`` [N m], shape (n, 2)."""

    def every(self, stride: int) -> Run:
        """Every ``stride``-th sample of it."""
        thinned = Samples(
            self.samples.stamp_ns[::stride],
            self.samples.motor_angle[::stride],
            self.samples.joint_angle[::stride],
        )
        return Run(self.name, thinned, self.torque[::stride])


class Fit(NamedTuple):
    """Result of a fit."""

    values: Mapping[str, float]
    """By parameter name."""
    evaluations: int
    """Steps of the optimiser."""
    cost: float
    """Half the mean squared residual, both torques added."""


def robot_text(values: Mapping[str, float], figures: str = "#   (not run)") -> str:
    """The robot file with the parameters filled in."""
    return TEMPLATE.format(figures=figures, **values)


def robot_model(values: Mapping[str, float]) -> Model:
    """The estimator's model of the robot file with these parameters."""
    return prepare(parse_robot(robot_text(values), source="davinci_jaw.yaml"))


def read_runs(folder: Path) -> list[Run]:
    """Every bag of a folder, in the order of their names.

    Raises:
        CdrjError: the folder holds no bag, or one that cannot be read.
    """
    model = robot_model({parameter.name: parameter.start for parameter in PARAMETERS})
    bags = sorted(entry for entry in folder.iterdir() if entry.is_dir()) if folder.is_dir() else []
    if not bags:
        raise BagError(f"{folder} holds no folder with a bag")
    return [_read_run(bag, model) for bag in bags]


def _read_run(bag: Path, model: Model) -> Run:
    """One bag, its references brought to the stamps of the samples."""
    recording = read_inputs(str(bag), Topics(), model)
    samples = condition_recording(model, recording).segments[-1]
    columns = []
    for channel in CHANNELS:
        if channel not in recording.references:
            raise BagError(f"{bag} has no reference {channel}")
        series = recording.references[channel]
        since = samples.stamp_ns[0]
        columns.append(np.interp(samples.stamp_ns - since, series.stamp_ns - since, series.value))
    return Run(bag.name, samples, np.column_stack(columns))


def estimated_torques(model: Model, samples: Samples) -> Table:
    """What the estimator says from the first sample on [N m], shape (n, 2)."""
    _, estimates = run(model, initial_state(model), samples)
    layout = model.layout
    return np.column_stack(
        (estimates.values[:, layout.motor_effort], estimates.values[:, layout.joint_effort])
    )


def fit(runs: Sequence[Run], begin: Mapping[str, float] | None = None) -> Fit:
    """Least squares over all runs together.

    Args:
        runs: thinned out already.
        begin: where to begin; default: every parameter's ``start``.
    """
    measured = np.concatenate([one.torque for one in runs])
    weight = 1.0 / (measured.std(axis=0) * np.sqrt(len(measured)))

    def values_at(coordinates: Vector) -> dict[str, float]:
        return {
            parameter.name: parameter.value(coordinate)
            for parameter, coordinate in zip(PARAMETERS, coordinates, strict=True)
        }

    def residuals(coordinates: Vector) -> Vector:
        model = robot_model(values_at(coordinates))
        estimated = np.concatenate([estimated_torques(model, one.samples) for one in runs])
        error: Table = (estimated - measured) * weight
        return error.ravel()

    def jacobian(coordinates: Vector) -> Table:
        here = residuals(coordinates)
        columns = []
        for k in range(coordinates.size):
            beside = coordinates.copy()
            step = -STEP if coordinates[k] + STEP > upper[k] else STEP
            beside[k] += step
            columns.append((residuals(beside) - here) / step)
        return np.column_stack(columns)

    lower = np.array([parameter.coordinate(parameter.lower) for parameter in PARAMETERS])
    upper = np.array([parameter.coordinate(parameter.upper) for parameter in PARAMETERS])
    found = least_squares(
        residuals,
        [p.coordinate(begin[p.name]) if begin else 0.0 for p in PARAMETERS],
        jacobian,
        bounds=(lower, upper),
        max_nfev=MAX_EVALUATIONS,
    )
    return Fit(values_at(found.x), int(found.nfev), float(found.cost))


def torque_errors(pairs: Sequence[tuple[Table, Table]]) -> tuple[ChannelError, ChannelError]:
    """Figures of spindle and jaw torque over (estimated, measured) pairs, samples pooled."""
    estimated = np.concatenate([pair[0] for pair in pairs])
    measured = np.concatenate([pair[1] for pair in pairs])
    return (
        channel_error(estimated[:, 0], measured[:, 0]),
        channel_error(estimated[:, 1], measured[:, 1]),
    )


def judge(values: Mapping[str, float], runs: Sequence[Run]) -> list[tuple[Table, Table]]:
    """(estimated, measured) torques of every run."""
    model = robot_model(values)
    return [(estimated_torques(model, one.samples), one.torque) for one in runs]


def cross_validate(runs: Sequence[Run], values: Mapping[str, float]) -> list[tuple[Table, Table]]:
    """(estimated, measured) torques of every run, by a fit without all runs of its load."""

    def load(one: Run) -> str:
        return one.name[-1]

    pairs = []
    for digit, group in groupby(sorted(runs, key=load), key=load):
        held_out = list(group)
        others = [one for one in runs if load(one) != digit]
        found = fit(others, values)
        pairs += judge(found.values, held_out)
        print(f"  without load {digit}: {sentence(torque_errors(pairs[-len(held_out) :]))}")
    return pairs


def sentence(errors: tuple[ChannelError, ChannelError]) -> str:
    """R² and RMSE of both torques in a line."""
    return ", ".join(
        f"{name} R² {error.r2:.4f} RMSE {1e3 * (error.rmse or 0.0):.2f} mN·m"
        for name, error in zip(("spindle", "jaw"), errors, strict=True)
    )


def rounded(values: Mapping[str, float]) -> dict[str, float]:
    """The values with the digits that the file has."""
    return {name: float(f"{value:.5g}") for name, value in values.items()}


def main(arguments: Sequence[str] | None = None) -> int:
    """Fit, print and write; returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("folder", type=Path, metavar="TRAIN_FOLDER", help="one bag per run")
    parser.add_argument("--out", type=Path, help="robot file to write")
    parser.add_argument("--cross-validate", action="store_true", help="judge unseen loads too")
    options = parser.parse_args(arguments)
    begin = perf_counter()
    try:
        runs = read_runs(options.folder)
    except CdrjError as error:
        print(f"fit_davinci_jaw: {error}", file=sys.stderr)
        return 2
    thinned = [one.every(STRIDE) for one in runs]
    print(f"{len(runs)} runs, {sum(len(one.torque) for one in thinned)} samples to fit")
    found = fit(thinned)
    values = rounded(found.values)
    print(f"{found.evaluations} evaluations, {perf_counter() - begin:.0f} s, cost {found.cost:.6f}")
    for name, value in values.items():
        print(f"  {name:24s} {value:.5g}")
    pairs = judge(values, runs)
    for one, pair in zip(runs, pairs, strict=True):
        print(f"  {one.name}: {sentence(torque_errors([pair]))}")
    pooled = sentence(torque_errors(pairs))
    print(f"all {len(runs)} runs: {pooled}")
    if options.cross_validate:
        print(f"unseen loads: {sentence(torque_errors(cross_validate(thinned, values)))}")
    if options.out:
        options.out.write_text(robot_text(values, f"#   {pooled}"), encoding="utf-8")
        print(f"wrote {options.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

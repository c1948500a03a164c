"""``identify``: numbers of the robot file from bags, with standard errors and hold-out figures."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import datetime, timezone
from fnmatch import fnmatchcase
from pathlib import Path
from time import monotonic, perf_counter
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import __version__
from cdrj_ros.bag import Recording, Topics
from cdrj_ros.commands.shared import DONE, add_topic_options, run_command, topics_of
from cdrj_ros.commands.validate import validate_bag
from cdrj_ros.conditioning.whole_recording import Readings
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.progress import LINE_S, progress_bar
from cdrj_ros.identification.fit import WEIGHTS, Identification, Settings, identify
from cdrj_ros.identification.residuals import Recorded
from cdrj_ros.identification.solution import LOSSES
from cdrj_ros.identification.unknowns import (
    parse_unknowns,
    starting_values,
    with_bounds,
    with_priors,
)
from cdrj_ros.judgement.comparison import BagComparison
from cdrj_ros.judgement.metrics import ChannelError, pooled_errors
from cdrj_ros.judgement.validation import read_inputs
from cdrj_ros.model.loading import robot_path
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.document import Document, document_complaints, parse_document
from cdrj_ros.robot.parameters import with_numbers
from cdrj_ros.robot.reader import build_robot, load_document, parse_robot
from cdrj_ros.robot.writer import with_numbers_in_text, with_section, yaml_number

COVARIANCE_LIMIT: Final = 64
"""Parameters whose covariance a robot file can hold."""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="identify",
        description=__doc__.split(": ", 1)[1],
        epilog="Parameters are paths of the robot file in SI, such as cables.upper.preload, "
        "friction.rho, cables.b.nodes.3.bearing_torque, or short forms: rho, mu_c, mu_s, v_s, "
        "f_d, EA, preload, drum_radius, joint_offset, joint_scale, clock_offset. "
        "docs/identification.md",
    )
    parser.add_argument("bags", nargs="+", metavar="BAG", help="rosbag2 folder or .mcap file")
    parser.add_argument("--robot", required=True, metavar="FILE", help="robot file to start from")
    parser.add_argument(
        "--fit", required=True, metavar="NAME,...",
        help="what to identify; 'cables.*.preload' is one common number, 'cables.{*}.preload' one "
        "for each, 'a=b' and 'a=-b' tie two",
    )  # fmt: skip
    parser.add_argument("--out", metavar="FILE", help="robot file to write; comments are kept")
    for option, form, text in (
        ("--start", "NAME=VALUE", "start from this instead of the file's number, or fix it so"),
        ("--bounds", "NAME=LOW:HIGH", "limits of a number; one end may be left out"),
        ("--prior", "NAME=MEAN:STDDEV", "what is known of it beforehand"),
    ):
        parser.add_argument(
            option, action="append", default=[], metavar=form, help=f"{text}; SI, repeatable"
        )
    parser.add_argument(
        "--channels", default="", metavar="NAME,...",
        help="references to fit, wildcards allowed: 'tension/*/8,nodal_force/upper/3' (all)",
    )  # fmt: skip
    parser.add_argument(
        "--weights", choices=WEIGHTS, default="spread",
        help="divide residuals by how much the references of their kind vary, or by the noise of "
        "their sensor (%(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--sigma", action="append", default=[], metavar="NAME=VALUE",
        help="or by this, by reference [N] or [N m]; repeatable",
    )  # fmt: skip
    parser.add_argument("--loss", choices=LOSSES, default="linear", help="(%(default)s)")
    parser.add_argument("--starts", type=int, default=1, metavar="N", help="random ones (1)")
    parser.add_argument("--seed", type=int, default=0, help="of the random starts (0)")
    parser.add_argument(
        "--settle", type=float, default=0.0, metavar="S",
        help="beginning of every bag that is not compared: the friction state is unknown [s] (0)",
    )  # fmt: skip
    parser.add_argument(
        "--hold-out", action="append", nargs="+", default=[], metavar="BAG",
        help="bags that are not fitted, to judge the result by",
    )  # fmt: skip
    parser.add_argument(
        "--cross-validate", nargs="*", metavar="NAMES",
        help="fit again without each bag, or without the bags whose names match, and judge them",
    )  # fmt: skip
    parser.add_argument(
        "--quick", action="store_true",
        help="leave out the last round over every sample: thinned ones, to 100 Hz, do for a look",
    )  # fmt: skip
    parser.add_argument("--json", metavar="FILE", help="write what was found as JSON")
    add_topic_options(parser)
    return parser


def _body(argv: Sequence[str]) -> int:
    arguments = _parser().parse_args(argv)
    begin = perf_counter()
    settings = _settings(arguments)
    path = robot_path(arguments.robot)
    document, source = load_document(path)
    start = starting_values(document, arguments.start)
    document = with_numbers(document, start)
    for complaint in document_complaints(document):
        raise UsageError(f"--start: {complaint}")
    unknowns = parse_unknowns(document, arguments.fit)
    unknowns = with_priors(with_bounds(unknowns, arguments.bounds), arguments.prior)
    model = prepare(build_robot(document, source))
    topics = topics_of(arguments)
    held_out = [bag for group in arguments.hold_out for bag in group]
    both = {Path(bag).resolve() for bag in arguments.bags} & {Path(b).resolve() for b in held_out}
    if both:
        raise UsageError(f"{both.pop().name} cannot be fitted and held out at once")
    recordings = _read(arguments.bags, topics, model)
    read = perf_counter()
    found = identify(document, source, unknowns, recordings, settings, _Lines())
    text = path.read_text(encoding="utf-8")
    values = {**start, **_rounded(found)}
    text = with_numbers_in_text(text, values, source)
    fitted_model = prepare(parse_robot(text, source))
    took = perf_counter() - read
    _print_numbers(found, values)
    before = _compared(model, arguments.bags, topics)
    after = _compared(fitted_model, arguments.bags, topics)
    print(
        f"\n{found.samples} samples, {found.residuals} residuals, {found.evaluations} runs, "
        f"{read - begin:.1f} s reading, {took:.1f} s fitting"
    )
    names = tuple(Path(bag).name for bag in arguments.bags)
    result: dict[str, Any] = {"bags": list(names), "fit": pooled_errors(after)}
    _print_errors("on the bags that were fitted", after, found.channels, before)
    if held_out:
        held = _compared(fitted_model, held_out, topics)
        result["hold_out"] = pooled_errors(held)
        _print_errors("on bags held out", held, found.channels, _compared(model, held_out, topics))
    if arguments.cross_validate is not None:
        unseen = _cross_validated(document, source, found, recordings, arguments, settings, topics)
        result["cross_validation"] = pooled_errors(unseen)
        _print_errors("of fits that had not seen the bag", unseen, found.channels)
    if arguments.out:
        text = with_section(text, "uncertainty", _uncertainty(found))
        text = with_section(text, "identified", _provenance(found, settings, result, held_out))
        parse_document(text, arguments.out)
        Path(arguments.out).write_text(text, encoding="utf-8")
        print(f"robot file: {arguments.out}")
    if arguments.json:
        Path(arguments.json).write_text(
            json.dumps(_as_json(found, values, result, took), indent=2) + "\n", encoding="utf-8"
        )
        print(f"figures: {arguments.json}")
    return DONE


def _settings(arguments: argparse.Namespace) -> Settings:
    sigmas = {}
    for text in arguments.sigma:
        name, _, given = text.rpartition("=")
        try:
            sigma = float(given)
        except ValueError:
            sigma = 0.0
        if not name or not 0.0 < sigma < float("inf"):
            raise UsageError(f"--sigma must be NAME=VALUE with a positive value, got {text!r}")
        sigmas[name] = sigma
    if not 0.0 <= arguments.settle < 1e6:
        raise UsageError(f"--settle must be in [0, 1e6), got {arguments.settle}")
    return Settings(
        tuple(name.strip() for name in arguments.channels.split(",") if name.strip()),
        arguments.weights,
        sigmas,
        arguments.loss,
        arguments.starts,
        arguments.seed,
        arguments.settle,
        arguments.quick,
    )


def recorded(recording: Recording, name: str) -> Recorded:
    """A bag as the identification takes it."""

    def readings(channels: Mapping[str, Any]) -> dict[str, Readings]:
        return {
            key: Readings(series.stamp_ns, series.log_ns, series.value)
            for key, series in channels.items()
        }

    return Recorded(
        name,
        readings(recording.motors),
        readings(recording.joints),
        {key: (series.stamp_ns, series.value) for key, series in recording.references.items()},
    )


def _read(bags: Sequence[str], topics: Topics, model: Model) -> list[Recorded]:
    recordings = []
    with progress_bar("reading", len(bags)) as report:
        for bag in bags:
            recordings.append(recorded(read_inputs(bag, topics, model), Path(bag).name))
            report(len(recordings))
    return recordings


def _compared(model: Model, bags: Sequence[str], topics: Topics) -> list[BagComparison]:
    """Exactly what ``validate`` says."""
    return [validate_bag(model, bag, topics) for bag in bags]


def _rounded(found: Identification) -> dict[str, float]:
    """The numbers with the digits that the file has."""
    return {path: float(yaml_number(value)) for path, value in found.by_path.items()}


class _Lines:
    """Progress: one line that is written over in a terminal, a line now and then elsewhere."""

    def __init__(self) -> None:
        self._terminal = sys.stderr.isatty()
        self._last = monotonic()

    def __call__(self, text: str) -> None:
        if self._terminal:
            print(f"\r\x1b[K{text}", end="\n" if "samples" in text else "", file=sys.stderr)
        elif "samples" in text or monotonic() - self._last > LINE_S:
            self._last = monotonic()
            print(text, file=sys.stderr, flush=True)


def _print_numbers(found: Identification, values: Mapping[str, float]) -> None:
    if sys.stderr.isatty():
        print("\r\x1b[K", end="", file=sys.stderr)
    width = max(len(unknown.name) for unknown in found.unknowns)
    print(f"{'parameter':{width}s} {'start':>12s} {'found':>12s} {'stddev':>10s}")
    for unknown, stddev in zip(found.unknowns, found.stddev, strict=True):
        value = values[unknown.paths[0]]
        print(f"{unknown.name:{width}s} {unknown.start:12.6g} {value:12.6g} {stddev:10.2g}")
    for sentence in found.findings:
        print(f"note: {sentence}")


def _print_errors(
    title: str,
    comparisons: Sequence[BagComparison],
    fitted: Sequence[str],
    before: Sequence[BagComparison] | None = None,
) -> None:
    errors = pooled_errors(comparisons)
    old = pooled_errors(before) if before else {}
    width = max(len(name) for name in errors)
    print(f"\nerrors {title}{' (in brackets: before)' if old else ''}")
    print(f"{'reference':{width}s} {'RMSE':>22s} {'mean rel. error':>22s} {'R²':>20s}")
    for name, error in errors.items():
        cells = [
            _beside(error, old.get(name), "rmse", ".4g"),
            _beside(error, old.get(name), "mean_relative_error", ".2%"),
            _beside(error, old.get(name), "r2", ".5f"),
        ]
        mark = "" if name in fitted else "  (not fitted)"
        print(f"{name:{width}s} {cells[0]:>22s} {cells[1]:>22s} {cells[2]:>20s}{mark}")


def _beside(error: ChannelError, old: ChannelError | None, figure: str, form: str) -> str:
    def shown(one: ChannelError | None) -> str:
        value = getattr(one, figure) if one is not None else None
        return "–" if value is None else format(value, form)

    return shown(error) + (f" ({shown(old)})" if old is not None else "")


def _cross_validated(
    document: Document,
    source: str,
    found: Identification,
    recordings: Sequence[Recorded],
    arguments: argparse.Namespace,
    settings: Settings,
    topics: Topics,
) -> list[BagComparison]:
    """Every bag by a fit that has not seen it, nor those held out with it."""
    names = [one.name for one in recordings]
    patterns = arguments.cross_validate or names
    unseen: list[BagComparison] = []
    rough = Settings(
        found.channels, settings.weights, settings.sigmas, settings.loss, 1, 0,
        settings.settle_s, coarse=True,
    )  # fmt: skip
    begin = with_numbers(document, found.by_path)
    for pattern in patterns:
        out = [k for k, name in enumerate(names) if fnmatchcase(name, pattern)]
        others = [one for k, one in enumerate(recordings) if k not in out]
        if not out or not others:
            raise UsageError(
                f"--cross-validate {pattern} must match some of the bags and not all: "
                f"{', '.join(names)}"
            )
        again = [
            replace(u, start=float(v)) for u, v in zip(found.unknowns, found.values, strict=True)
        ]
        fold = identify(begin, source, again, others, rough, _Lines())
        robot = build_robot(with_numbers(document, fold.by_path), source)
        judged = _compared(prepare(robot), [arguments.bags[k] for k in out], topics)
        unseen += judged
        errors = pooled_errors(judged)
        print(
            f"without {pattern}: "
            + ", ".join(
                f"{name} RMSE {error.rmse:.4g} R² {error.r2:.4f}"
                for name, error in errors.items()
                if name in found.channels and error.rmse is not None and error.r2 is not None
            )
        )
    return unseen


def _expanded(found: Identification) -> tuple[list[str], NDArray[np.float64], NDArray[np.float64]]:
    """Paths, standard deviations and correlation of all places, tied ones included."""
    paths = [path for unknown in found.unknowns for path in unknown.paths]
    signs = np.array([sign for unknown in found.unknowns for sign in unknown.signs], dtype=float)
    which = np.repeat(
        np.arange(len(found.unknowns)), [len(unknown.paths) for unknown in found.unknowns]
    )
    correlation = found.correlation[np.ix_(which, which)] * np.outer(signs, signs)
    return paths, found.stddev[which], correlation


def _uncertainty(found: Identification) -> str | None:
    paths, stddev, correlation = _expanded(found)
    if len(paths) > COVARIANCE_LIMIT:
        print(f"note: more than {COVARIANCE_LIMIT} numbers; their covariance is not written")
        return None
    lines = ["uncertainty:                    # standard deviations and correlations of the fit"]
    lines.append("  parameters:")
    lines += [f"    - {path}" for path in paths]
    lines.append(f"  stddev: [{', '.join(yaml_number(float(s), 3) for s in stddev)}]")
    lines.append("  correlation:")
    lines += [
        "    - [" + ", ".join(f"{value:.4f}".rstrip("0").rstrip(".") for value in row) + "]"
        for row in correlation
    ]
    return "\n".join(lines)


def _provenance(
    found: Identification, settings: Settings, result: Mapping[str, Any], held_out: Sequence[str]
) -> str:
    lines = [
        "identified:                     # where the numbers come from; not read",
        f"  date: {datetime.now(timezone.utc):%Y-%m-%d}",
        f"  tool: cdrj_ros {__version__}",
        f"  bags: [{', '.join(result['bags'])}]",
        f"  references: [{', '.join(found.channels)}]",
        f"  loss: {settings.loss}",
        f"  samples: {found.samples}",
    ]
    if held_out:
        lines.append(f"  held_out: [{', '.join(Path(bag).name for bag in held_out)}]")
    for section in ("fit", "hold_out", "cross_validation"):
        if section in result:
            lines.append(f"  {section}:")
            lines += [
                f"    {name}: {{rmse: {yaml_number(error.rmse, 4)}"
                + (f", r2: {error.r2:.5f}" if error.r2 is not None else "")
                + "}"
                for name, error in result[section].items()
                if name in found.channels and error.rmse is not None
            ]
    return "\n".join(lines)


def _as_json(
    found: Identification, values: Mapping[str, float], result: Mapping[str, Any], took: float
) -> dict[str, Any]:
    def errors(section: Mapping[str, ChannelError]) -> dict[str, Any]:
        return {name: vars(error) for name, error in section.items()}

    return {
        "parameters": [
            {
                "paths": list(unknown.paths),
                "signs": list(unknown.signs),
                "start": unknown.start,
                "value": values[unknown.paths[0]],
                "stddev": float(stddev),
                "lower": unknown.lower,
                "upper": unknown.upper,
            }
            for unknown, stddev in zip(found.unknowns, found.stddev, strict=True)
        ],
        "correlation": found.correlation.tolist(),
        "findings": list(found.findings),
        "references": list(found.channels),
        "samples": found.samples,
        "seconds": took,
        "bags": result["bags"],
        **{
            section: errors(result[section])
            for section in ("fit", "hold_out", "cross_validation")
            if section in result
        },
    }


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return run_command("identify", _body, argv)

"""``commission``: from a new robot file to tensions with status OK, by cheap measurements."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain, count
from math import isfinite
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from cdrj_ros.commands.commission_checks import refuse_efforts, swapped, unlikely, unmoved, unusual
from cdrj_ros.commands.commission_judged import Judged, foretold, judged
from cdrj_ros.commands.commission_steps import Commissioned, begin, provenance
from cdrj_ros.commands.entry import DONE, CommandParser, run_command
from cdrj_ros.commands.shared import add_channel_options, channels_of
from cdrj_ros.evaluation.inputs import condition_recording, doubts_of, read_inputs
from cdrj_ros.foundation.errors import CdrjError, UsageError
from cdrj_ros.foundation.files import check_outputs, write_text
from cdrj_ros.foundation.output import say
from cdrj_ros.identification.fit import lacking, sentences
from cdrj_ros.identification.observations import Recorded
from cdrj_ros.inspection.poses import pose_text
from cdrj_ros.model.packing import EFFORT, TENSION
from cdrj_ros.model.prepared import robot_path
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.recordings.table import Columns
from cdrj_ros.robot.writer import moved, refuse_aliases, with_section


class Step(NamedTuple):
    """A measurement, as its option and the dialogue ask for it."""

    form: str
    words: str
    live_s: float = 0.0
    """How long it is recorded [s], if it is; in the dialogue that of the tare until Enter."""


STEPS: Final[Mapping[str, Step]] = {
    "rest": Step(
        "BAG", "tare: at rest in the reference pose for 3 s; better go on to two or three further "
        "poses and back, rest for 3 s in each, and read every cable on a spring scale in all", 3.0,
    ),
    "preload": Step("CABLE=N,...", "tensions in the reference pose on a spring scale [N]"),
    "drum": Step(
        "MOTOR=MM,...", "diameter of every drum by calliper: over the wound cable, less one cable's"
    ),
    "motion": Step("BAG", "every joint through its range for 60 s, with the motors' efforts", 60.0),
    "cells": Step("BAG", "the same with one or two borrowed load cells in the cables", 60.0),
}  # fmt: skip
"""What is measured, the cheapest first."""

LIVE: Final = "live"
"""In place of a bag: record it from the running robot."""

Record = Callable[[Path, Topics, float, bool], None]
"""Records the topics of a robot into a new bag, for some seconds, and on until Enter or not."""


def _parser() -> argparse.ArgumentParser:
    parser = CommandParser(
        prog="commission",
        description="Lead from a new robot file to tensions with status OK: tare, preloads by "
        "spring scale, drums by calliper, a motion with the motors' efforts, the same with "
        "borrowed load cells. "
        "After each step it says what the file knows, and what the next step would bring.",
        epilog="Record bags with `ros2 bag record`, or give `live` for a bag: it is recorded now, "
        "beside the new file. docs/commission.md",
    )
    parser.add_argument("--robot", required=True, metavar="FILE", help="robot file (YAML)")
    parser.add_argument("--out", required=True, metavar="FILE", help="robot file to write")
    parser.add_argument("--force", action="store_true", help="replace an existing --out")
    group = parser.add_argument_group(
        "measurements, in the order in which they are used",
        "Repeat --preload for every further pose of --rest, as CABLE/ELEMENT=N,...; --motion and "
        "--cells for further bags.",
    )
    for name, step in STEPS.items():
        group.add_argument(
            f"--{name}", action="append", default=[], metavar=step.form, help=step.words
        )
    parser.add_argument(
        "--yes", action="store_true", help="ask nothing: take the given measurements alone"
    )
    add_channel_options(parser)
    return parser


def body(argv: Sequence[str], record: Record | None = None) -> int:
    """The command.

    Args:
        argv: its arguments.
        record: records what is to be measured ``live``; None: bags only.

    Raises:
        CdrjError: an argument, a file or a measurement is none.
    """
    arguments = _parser().parse_args(argv)
    path = robot_path(arguments.robot)
    recorded = (getattr(arguments, name) for name, step in STEPS.items() if step.live_s)
    bags = [bag for bag in chain(*recorded) if bag != LIVE]
    check_outputs({"--out": arguments.out}, [*bags, path], force=arguments.force)
    text = path.read_text(encoding="utf-8")
    refuse_aliases(text, str(path))
    now = begin(text, str(path))
    known = judged(now.model, now.heard, now.interval_ns)
    say(f"new file: {words_of(known)}")
    topics = channels_of(arguments)
    for name in STEPS:
        before, now = now, _answered(now, name, arguments, topics, record)
        if now is before:
            continue
        in_motion = [*now.measured.motion, *now.measured.cells][-1:]
        known = judged(now.model, now.heard, now.interval_ns, *in_motion)
        for note in (*unlikely(before, now), *_notes(now)):
            say(f"note: {note}")
        say(f"{name}: {words_of(known)}")
    text = with_section(now.text, "identified", provenance(now)) if now.origins else now.text
    write_text(arguments.out, moved(text, now.source, arguments.out))
    say_cables(known)
    say(f"out: {arguments.out}")
    return DONE


def _answered(
    now: Commissioned,
    name: str,
    arguments: argparse.Namespace,
    topics: Topics | Columns,
    record: Record | None,
) -> Commissioned:
    """The file after a step, or as it was; an answer that is refused is asked for again."""
    given, live = getattr(arguments, name), STEPS[name].live_s > 0.0
    if given or arguments.yes:
        return _after(now, name, given, arguments, topics, record) if given else now
    if name in ("motion", "cells"):
        say(f"the next step would bring: {words_of(foretold(now, name))}")
    while given := _asked_for(now, name, live=record is not None and live):
        try:
            return _after(now, name, given, arguments, topics, record)
        except CdrjError as error:
            say(f"refused: {error}")
    return now


def _after(
    now: Commissioned,
    name: str,
    given: Sequence[str],
    arguments: argparse.Namespace,
    topics: Topics | Columns,
    record: Record | None,
) -> Commissioned:
    """The file after a step with some measurements."""
    if STEPS[name].live_s:
        on = name == "rest" and not arguments.yes
        given = [_bag(one, name, arguments.out, topics, record, on) for one in given]
    found = now.also(**{name: _measured(now, name, given, topics)})
    if name in ("motion", "cells") and (pair := swapped(found)):
        raise UsageError(
            f"the spring scale's readings of {' and '.join(pair)} fit the recordings only the "
            "other way round: exchange them"
        )
    return found


def _notes(now: Commissioned) -> Iterator[str]:
    """What the last fits say of drums and references, with the cables if there are several parts.

    What several parts have in common is said once.
    """
    said: dict[str, list[str]] = {}
    for one in now.fits:
        doubt = SUSPECTED if now.measured.preload else ""
        left = [f"{sentence}{doubt}" for sentence in lacking(one.found.unexplained)]
        for sentence in (*sentences(one.found.drums), *left, *unusual(one)):
            said.setdefault(sentence, []).append(one.cables)
    for sentence, cables in said.items():
        yield sentence if len(cables) == len(now.fits) else f"{'; '.join(cables)}: {sentence}"


SUSPECTED: Final = " Does the spring scale's reading belong to the pose of the tare?"
"""Where the residual of a fit is large although preloads were measured."""


def _bag(
    given: str, name: str, out: str, topics: Topics | Columns, record: Record | None, on: bool
) -> str:
    """The bag of a step, which is recorded beside the new robot file if it is to be ``live``."""
    if given != LIVE:
        return given
    if record is None or isinstance(topics, Columns):
        raise UsageError(f"--{name} {LIVE} needs ROS 2 and no --columns; give a bag")
    first = Path(out).with_name(f"{Path(out).stem}_{name}")
    later = (first.with_name(f"{first.name}_{k}") for k in count(2))
    path = next(one for one in chain([first], later) if not one.exists())
    record(path, topics, STEPS[name].live_s, on)
    say(f"recorded: {path}")
    return str(path)


def _measured(now: Commissioned, name: str, given: Sequence[str], topics: Topics | Columns) -> Any:
    """What a step takes, from its option or from its answers."""
    if name == "rest":
        return _read(now, given[-1], topics)
    if name == "preload":
        return [_numbers(text, name) for text in given]
    if name == "drum":
        return {motor: 1e-3 * size for motor, size in _numbers(",".join(given), name).items()}
    read = [_read(now, bag, topics) for bag in given]
    for one in read:
        refuse_efforts(now.unfitted, one)
        for joint, share in unmoved(now.model.robot, one).items():
            say(
                f"note: {joint} moves through {share:.0%} of its range in {one.name}; tensions "
                "elsewhere stay less known than foretold"
            )
    return read


def _read(now: Commissioned, bag: str, topics: Topics | Columns) -> Recorded:
    """A bag; where no reference has a motor's effort, that on the topic of its angle is taken."""
    read = read_inputs(bag, topics, now.model, motor_efforts=True)
    for note in doubts_of(now.model, condition_recording(now.model, read)):
        say(f"note: {bag}: {note}")
    own = {f"{EFFORT}/{name}": one for name, one in read.motor_efforts.items()}
    chosen = {}
    for name, one in {**own, **read.references}.items():
        if not name.startswith((EFFORT, TENSION)):
            continue
        if np.any(one.value != one.value[:1]):
            chosen[name] = one
        else:
            say(f"note: {name} never changes in {bag}; it is not used.")
    return Recorded(Path(bag).name, read.motors, read.joints, chosen)


def _numbers(text: str, name: str) -> dict[str, float]:
    """Numbers by name.

    Raises:
        UsageError: the text does not have the form of the step.
    """
    found = {}
    for part in text.split(",") if text.strip() else ():
        key, _, given = part.partition("=")
        try:
            found[key.strip()] = float(given)
        except ValueError as error:
            raise UsageError(f"--{name} must be {STEPS[name].form}, got {text!r}") from error
    return found


def _asked_for(now: Commissioned, name: str, *, live: bool) -> list[str]:
    """The user's answer, or answers for all poses; none to leave the step out."""
    step, number, ways = STEPS[name], [*STEPS].index(name) + 1, ""
    if live:
        until = ", until Enter" if name == "rest" else f" for {step.live_s:.0f} s"
        ways = f"{LIVE}: record it now{until}; "
    first = _asked(f"{number}. {step.words}: {step.form} ({ways}empty: leave it out)")
    poses = now.poses[1:] if name == "preload" and first else ()
    further = (
        f"   in pose {k}, {pose_text(now.model.robot, one.joint_angle)}: CABLE/ELEMENT=N,..."
        for k, one in enumerate(poses, 2)
    )
    return [first, *map(_asked, further)] if first else []


def _asked(question: str) -> str:
    try:
        return input(f"{question} > ").strip()
    except EOFError:
        return ""


FEW: Final = 4
"""Cables up to which each is named after every step."""

ROUGH: Final = 0.1
"""Width of ``Judged.between`` from which both ends are printed."""


def words_of(one: Judged) -> str:
    """What is printed of a file: the share of ``OK``, and how well cables are known."""
    least, most = one.between
    share = f"{one.ok:.0%}" if most - least < ROUGH else f"{least:.0%} to {most:.0%}"
    worst = sorted(one.relative.items(), key=lambda item: -item[1])
    if len(worst) > FEW:
        (name, most), (_, least) = worst[0], worst[-1]
        known = f"{_percent(least)} to {_percent(most)}, most in {name}"
    else:
        known = ", ".join(f"{name} {_percent(share)}" for name, share in one.relative.items())
    return f"OK {share}; standard deviation over tension: {known}"


def _percent(share: float) -> str:
    return f"{share:.1%}" if isfinite(share) else "slack"


def say_cables(one: Judged) -> None:
    """A line for every cable of many, the worst first, and elements that are seldom OK."""
    if len(one.relative) > FEW:
        say("standard deviation over tension:")
        for name, share in sorted(one.relative.items(), key=lambda item: -item[1]):
            say(f"  {name}: {_percent(share)}")
    if 0 < len(one.unsure) < len(one.relative):
        say(
            f"seldom OK: {', '.join(one.unsure)}; check_robot says which numbers are in doubt there"
        )


main = partial(run_command, "commission", body)
"""Entry point; returns the exit code."""

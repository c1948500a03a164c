"""The replay command: plays a bag's inputs to the estimator node and evaluates its answers."""

from __future__ import annotations

import argparse
import math
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from types import FrameType
from typing import Final

from rclpy.utilities import remove_ros_args

from cdrj_ros.commands.entry import DONE, CommandParser, run_command
from cdrj_ros.commands.shared import (
    add_result_options,
    add_robot_option,
    add_topic_options,
    print_results,
    topics_of,
    write_files,
)
from cdrj_ros.evaluation.inputs import read_inputs
from cdrj_ros.evaluation.metrics import errors_of
from cdrj_ros.evaluation.replayed import Outcome, preload_difference
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.files import check_outputs
from cdrj_ros.foundation.interruption import INTERRUPTED, announce_interruption
from cdrj_ros.foundation.output import say
from cdrj_ros.messages.topics import CLOCK
from cdrj_ros.model.prepared import Model, load_model
from cdrj_ros.nodes.player import Ending, Player
from cdrj_ros.nodes.replay_node import ReplayNode
from cdrj_ros.nodes.spinning import StopRequest, exit_code, ros_context, serving, starting
from cdrj_ros.recordings.recording import Recording, Topics
from cdrj_ros.recordings.source import (
    MAX_RATE,
    MIN_RATE,
    Playback,
    Source,
    checked_rate,
    open_source,
    rate_in_words,
    read_messages,
)

INCOMPLETE: Final = 1
"""Exit code: the bag was played, but estimates were lost, none was compared, or the estimator
disappeared."""

CLOCK_HZ: Final = 40.0


@dataclass(frozen=True, eq=False)
class Bag:
    """One recording to be played."""

    path: str
    source: Source
    recording: Recording
    begin_ns: int
    end_ns: int

    def playback(self, topics: Sequence[str], rate: float | None) -> Playback:
        """One pass over these topics."""
        messages = read_messages(
            self.source, topics, start_ns=self.begin_ns, end_ns=self.end_ns + 1
        )
        return Playback(messages, self.begin_ns, self.end_ns, rate=rate)


def replay_parser() -> argparse.ArgumentParser:
    """Make the parser of the replay's own arguments."""
    parser = CommandParser(
        prog="replay",
        description="Play a bag's recorded inputs to a running estimator node, listen to its "
        "answers, compare them with the recorded references and report.",
        epilog="Exit code: 0 done; 1 estimates were lost, nothing of a bag was compared, or the "
        "estimator disappeared; 2 bad "
        "usage or input, or no estimator; 130 ended by Ctrl-C, after the report of what was "
        "played; a second Ctrl-C ends at once.",
    )
    parser.add_argument("bags", nargs="+", metavar="BAG", help="rosbag2 folder or .mcap file")
    add_robot_option(parser)
    _add_playback_options(parser)
    add_topic_options(parser)
    add_result_options(parser)
    return parser


def _add_playback_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("playback")
    group.add_argument(
        "-r", "--rate", type=float, metavar="X",
        help=f"rate as a multiple of real time, {MIN_RATE:g} to {MAX_RATE:g} "
        "(default: as fast as the estimator keeps up)",
    )  # fmt: skip
    group.add_argument(
        "-l", "--loop", type=int, nargs="?", const=0, default=1, metavar="N",
        help="play N times, or until Ctrl-C; the estimator is reset before every pass",
    )  # fmt: skip
    group.add_argument(
        "--start-offset", type=_seconds, default=0.0, metavar="S",
        help="start this long after the beginning of the bag [s]",
    )  # fmt: skip
    group.add_argument(
        "--playback-duration", type=_seconds, default=math.inf, metavar="S",
        help="play this much of the bag [s]",
    )  # fmt: skip
    group.add_argument(
        "--clock", type=_hertz, nargs="?", const=CLOCK_HZ, default=0.0, metavar="HZ",
        help=f"publish the recording's time on {CLOCK} (default {CLOCK_HZ:g} Hz)",
    )  # fmt: skip


def _seconds(text: str) -> float:
    value = float(text)
    if not 0.0 <= value < 1e10:
        raise argparse.ArgumentTypeError(f"must be seconds, 0 or more, got {text}")
    return value


def _hertz(text: str) -> float:
    value = float(text)
    if not 0.0 < value <= 1e4:
        raise argparse.ArgumentTypeError(f"must be in (0, 10000] Hz, got {text}")
    return value


def _open(arguments: argparse.Namespace, model: Model, topics: Topics, path: str) -> Bag:
    """Read one recording and choose what of it is played."""
    source = open_source(path)
    recording = read_inputs(path, topics, model, force_vectors=True, whole=False)
    first, last = recording.start_ns, recording.end_ns
    begin = first + round(arguments.start_offset * 1e9)
    if begin > last:
        raise UsageError(
            f"--start-offset: {path} is {(last - first) * 1e-9:.3f} s long, "
            f"got {arguments.start_offset:g} s"
        )
    duration_s = min(arguments.playback_duration, (last - begin) * 1e-9)
    return Bag(path, source, recording, begin, min(begin + round(duration_s * 1e9), last))


def _play_all(
    arguments: argparse.Namespace, player: Player, bags: Sequence[Bag], stop: StopRequest
) -> tuple[list[Outcome], Ending]:
    """Play all bags in turn, pass after pass; returns an outcome for each bag and the ending."""
    topics = [player.node.topics.motors, player.node.topics.joints]
    outcomes = [Outcome(player.model) for _ in bags]
    passes = arguments.loop or math.inf
    ending, done = Ending.END, 0
    while done < passes and ending is Ending.END:
        done += 1
        for bag, outcome in zip(bags, outcomes, strict=True):
            again = "" if passes == 1 else f", pass {done}"
            player.bar.say(
                f"playing {bag.path}{again}: {(bag.end_ns - bag.begin_ns) * 1e-9:.3f} s, "
                f"{rate_in_words(arguments.rate)}"
            )
            played = player.play(bag.playback(topics, arguments.rate))
            ending = played.ending
            outcome.add(played.answers, whole=ending is Ending.END)
            outcome.span_s += played.span_s
            outcome.wall_s += played.wall_s
            outcome.behind_s = max(outcome.behind_s, played.behind_s)
            at = "" if ending is Ending.END else f" at {played.span_s:.3f} s"
            outcome.ending = f"{ending.value}{at}"
            if ending is Ending.END and stop:
                ending = Ending.USER
            if ending is not Ending.END:
                break
    return outcomes, ending


def _play_and_report(
    arguments: argparse.Namespace, player: Player, bags: Sequence[Bag], stop: StopRequest
) -> int:
    print(f"waiting for {player.node.estimator} ...", flush=True)
    if not player.wait_for_estimator():
        announce_interruption("replay")
        return INTERRUPTED
    if words := preload_difference(player.model, player.estimator):
        player.bar.say(f"warning: {words}")
    with player.bar:
        outcomes, ending = _play_all(arguments, player, bags, stop)
    if stop.interrupted and not any(outcome.tally.sent for outcome in outcomes):
        return exit_code("replay", stop, supervised=False)
    code = _report(arguments, player.model, bags, outcomes, ending)
    sys.stdout.flush()
    return exit_code("replay", stop, supervised=False) or code


def _report(
    arguments: argparse.Namespace, model: Model, bags: Sequence[Bag],
    outcomes: Sequence[Outcome], ending: Ending,
) -> int:  # fmt: skip
    """Print what was played and the comparison with the references; returns the exit code."""
    comparisons, uncompared = [], []
    for bag, outcome in zip(bags, outcomes, strict=True):
        if not outcome.tally.sent:
            continue
        comparison = outcome.comparison(bag.path, bag.recording)
        say(f"{bag.path}:")
        for name, value in comparison.facts.items():
            say(f"  {name}: {value}")
        comparisons.append(comparison)
        if why := outcome.why_nothing(comparison, bag.recording):
            uncompared.append(f"{bag.path}: {why}")
    sys.stdout.flush()
    if not comparisons:
        print("replay: nothing was played", file=sys.stderr)
        return INTERRUPTED
    if any(comparison.channels for comparison in comparisons):
        errors = errors_of(comparisons)
        title = f"{model.robot.name}: estimator node against reference"
        write_files(arguments, model, errors, title)
        print_results(arguments, errors, title)
    if ending is Ending.GONE:
        print("replay: the estimator disappeared during the playback", file=sys.stderr)
        return INCOMPLETE
    for words in uncompared:
        print(f"replay: nothing was compared: {words}", file=sys.stderr)
    complete = not uncompared and all(outcome.complete for outcome in outcomes)
    return DONE if complete else INCOMPLETE


@contextmanager
def _second_signal_aborts(stop: StopRequest) -> Iterator[None]:
    """The first Ctrl-C ends the playback, a second one the command."""

    def on_signal(number: int, frame: FrameType | None) -> None:
        if stop:
            raise KeyboardInterrupt
        stop.ask(number, frame)

    before = signal.signal(signal.SIGINT, on_signal)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _body(argv: Sequence[str]) -> int:
    with starting():
        own = remove_ros_args(["replay", *argv])[1:]
    arguments = replay_parser().parse_args(own)
    results = {"--json": arguments.json, "--html": arguments.html}
    check_outputs(results, [*arguments.bags, arguments.robot])
    if arguments.rate is not None:
        checked_rate(arguments.rate)
    if arguments.loop < 0:
        raise UsageError(f"--loop must be at least 1, got {arguments.loop}")
    model = load_model(arguments.robot, arguments.preload)
    topics = topics_of(arguments)
    bags = [_open(arguments, model, topics, path) for path in arguments.bags]
    with ros_context(["replay", *argv]) as stop, stop.listening(), _second_signal_aborts(stop):
        with starting():
            node = ReplayNode(topics, arguments.clock)
        with serving(node) as executor:
            return _play_and_report(arguments, Player(model, node, executor, stop), bags, stop)


main = partial(run_command, "replay", _body)
"""Entry point; returns the exit code."""

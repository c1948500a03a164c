"""The replay command: plays a bag's inputs to the estimator node and evaluates its answers."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import Final

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
from cdrj_ros.evaluation.replayed import Ending, Played, preload_difference
from cdrj_ros.foundation.files import check_outputs
from cdrj_ros.foundation.interruption import INTERRUPTED, announce_interruption
from cdrj_ros.foundation.output import say
from cdrj_ros.messages.topics import CLOCK
from cdrj_ros.model.prepared import Model, load_model
from cdrj_ros.nodes.player import Player
from cdrj_ros.nodes.replay_node import ReplayNode
from cdrj_ros.nodes.spinning import StopRequest, exit_code, ros_context, serving, starting
from cdrj_ros.recordings.recording import Recording, Topics
from cdrj_ros.recordings.source import (
    MAX_RATE,
    MIN_RATE,
    Playback,
    checked_rate,
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
    recording: Recording

    def playback(self, topics: Sequence[str], rate: float | None) -> Playback:
        """All messages on these topics."""
        begin_ns, end_ns = self.recording.start_ns, self.recording.end_ns
        messages = read_messages(self.path, topics, start_ns=begin_ns, end_ns=end_ns + 1)
        return Playback(messages, begin_ns, end_ns, rate=rate)


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
        "--clock", type=_hertz, nargs="?", const=CLOCK_HZ, default=0.0, metavar="HZ",
        help=f"publish the recording's time on {CLOCK} (default {CLOCK_HZ:g} Hz)",
    )  # fmt: skip


def _hertz(text: str) -> float:
    value = float(text)
    if not 0.0 < value <= 1e4:
        raise argparse.ArgumentTypeError(f"must be in (0, 10000] Hz, got {text}")
    return value


def _play_all(
    arguments: argparse.Namespace, player: Player, bags: Sequence[Bag], stop: StopRequest
) -> list[Played]:
    """Play the bags in turn, up to the first that is not played to its end."""
    topics = [player.node.topics.motors, player.node.topics.joints]
    found = []
    for bag in bags:
        duration_s = (bag.recording.end_ns - bag.recording.start_ns) * 1e-9
        player.bar.say(f"playing {bag.path}: {duration_s:.3f} s, {rate_in_words(arguments.rate)}")
        found.append(player.play(bag.playback(topics, arguments.rate)))
        if found[-1].ending is not Ending.END or stop:
            break
    return found


def _replay(
    arguments: argparse.Namespace, model: Model, topics: Topics, bags: Sequence[Bag],
    stop: StopRequest,
) -> int:  # fmt: skip
    with starting():
        node = ReplayNode(topics, arguments.clock)
    with serving(node) as executor:
        return _play_and_report(arguments, Player(model, node, executor, stop), bags, stop)


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
        played = _play_all(arguments, player, bags, stop)
    if stop.interrupted and not any(one.answers.tally.sent for one in played):
        return exit_code("replay", stop, supervised=False)
    code = _report(arguments, player.model, bags, played)
    sys.stdout.flush()
    return exit_code("replay", stop, supervised=False) or code


def _report(
    arguments: argparse.Namespace, model: Model, bags: Sequence[Bag], played: Sequence[Played]
) -> int:
    """Print what was played and the comparison with the references; returns the exit code."""
    comparisons, uncompared = [], []
    for bag, one in zip(bags, played, strict=False):
        if not one.answers.tally.sent:
            continue
        comparison = one.comparison(model, bag.path, bag.recording)
        say(f"{bag.path}:")
        for name, value in comparison.facts.items():
            say(f"  {name}: {value}")
        comparisons.append(comparison)
        if why := one.why_nothing(model, comparison, bag.recording):
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
    if played[-1].ending is Ending.GONE:
        print("replay: the estimator disappeared during the playback", file=sys.stderr)
        return INCOMPLETE
    for words in uncompared:
        print(f"replay: nothing was compared: {words}", file=sys.stderr)
    lost = any(one.answers.tally.lost for one in played)
    return INCOMPLETE if lost or uncompared else DONE


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


def _divided(argv: Sequence[str]) -> tuple[list[str], list[str]]:
    """Split the arguments into the replay's own and those between ``--ros-args`` and ``--``."""
    own: list[str] = []
    ros: list[str] = []
    inside = False
    for argument in argv:
        inside = inside or argument == "--ros-args"
        (ros if inside else own).append(argument)
        inside = inside and argument != "--"
    return own, ros


def _body(argv: Sequence[str]) -> int:
    own, ros = _divided(argv)
    arguments = replay_parser().parse_args(own)
    results = {"--json": arguments.json, "--html": arguments.html}
    check_outputs(results, [*arguments.bags, arguments.robot])
    if arguments.rate is not None:
        checked_rate(arguments.rate)
    model = load_model(arguments.robot, arguments.preload)
    topics = topics_of(arguments)
    bags = [
        Bag(path, read_inputs(path, topics, model, force_vectors=True)) for path in arguments.bags
    ]
    with ros_context(["replay", *ros]) as stop, stop.listening(), _second_signal_aborts(stop):
        return _replay(arguments, model, topics, bags, stop)


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return run_command("replay", _body, sys.argv[1:] if argv is None else argv)

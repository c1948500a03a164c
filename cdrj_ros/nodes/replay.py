"""The replay node: plays a bag's inputs to the estimator and evaluates its estimates."""

from __future__ import annotations

import argparse
import math
import re
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import Final

import numpy as np
from rclpy.experimental import EventsExecutor

from cdrj_ros.bag import RawMessage, Recording, Topics, read_recording
from cdrj_ros.commands.running import DONE, run_command
from cdrj_ros.commands.shared import print_results, topics_of, write_files
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.interruption import INTERRUPTED, announce_interruption
from cdrj_ros.foundation.output import say
from cdrj_ros.judgement.inputs import require_axes
from cdrj_ros.judgement.metrics import errors_of
from cdrj_ros.messages.cdr import BYTE_ORDER, Field, MessageError, read_layout
from cdrj_ros.messages.topics import CLOCK
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.prepared import Model
from cdrj_ros.nodes.player import Ending, Player
from cdrj_ros.nodes.qos_files import read_overrides, was_latched
from cdrj_ros.nodes.replay_node import Extra, ReplayNode, Wiring, message_class, wiring_of
from cdrj_ros.nodes.replay_options import replay_parser
from cdrj_ros.nodes.services import offer_services
from cdrj_ros.nodes.spinning import StopRequest, exit_code, ros_context, starting
from cdrj_ros.replay.agreement import preload_difference, slow_playback
from cdrj_ros.replay.controls import KEYS, Controls, rate_in_words
from cdrj_ros.replay.display import Display
from cdrj_ros.replay.keyboard import Keyboard
from cdrj_ros.replay.outcome import Outcome
from cdrj_ros.replay.playback import (
    ORDERS,
    Playback,
    Reel,
    check_span,
    checked_rate,
    log_order,
    merged_source,
    stamp_order,
)

INCOMPLETE: Final = 1
"""Exit code: the bag was played, but estimates were lost or the estimator disappeared."""

REPORT_S: Final = 1.5
"""Time for the last answers and the report after Ctrl-C [s]."""

_STAMP: Final = (Field("header.stamp.sec", "i4"), Field("header.stamp.nanosec", "u4"))


@dataclass(frozen=True, eq=False)
class Bag:
    """One recording to be played."""

    path: str
    recording: Recording
    reel: Reel
    begin_ns: int
    end_ns: int


def _extras(arguments: argparse.Namespace, topics: Topics) -> list[Extra]:
    """Topics that are played in addition to the estimator's inputs.

    Raises:
        UsageError: a topic does not exist in the bag, or a required one is excluded.
    """
    source = merged_source(arguments.bags)
    for file in source.files:
        file.declare_all()
    there = source.channels()
    inputs = {topics.motors, topics.joints}
    wanted = set(there) if arguments.all else set(arguments.topics)
    if missing := sorted(wanted - set(there)):
        raise UsageError(f"--topics: {source.path} has no {', '.join(missing)}")
    wanted |= {topic for topic in there if _matches(arguments.regex, topic, "--regex")}
    dropped = set(arguments.exclude_topics)
    dropped |= {
        t for t in there if _matches(arguments.exclude_regex, t, "--exclude-regex") and t in wanted
    }
    if needed := sorted(inputs & dropped):
        raise UsageError(f"--exclude-topics: the estimator needs {', '.join(needed)}")
    if arguments.clock or arguments.clock_topics or arguments.clock_topics_all:
        dropped.add(CLOCK)
    extras = []
    for topic in sorted(wanted - dropped - inputs):
        channel = there[topic]
        try:
            message_class(channel.msgtype)
        except UsageError as error:
            if topic in arguments.topics:
                raise UsageError(f"--topics: {topic}: {error}") from None
            say(f"left out: {topic}: {error}", flush=True)
            continue
        latched = was_latched(dict(channel.metadata).get("offered_qos_profiles", ""))
        extras.append(Extra(topic, channel.msgtype, latched))
    return extras


def _matches(pattern: str | None, topic: str, option: str) -> bool:
    if not pattern:
        return False
    try:
        return re.search(pattern, topic) is not None
    except re.error as error:
        raise UsageError(f"{option}: {pattern!r} is not a regular expression: {error}") from None


def _remap(arguments: argparse.Namespace) -> dict[str, str]:
    rules = {}
    for rule in arguments.remap:
        old, sign, new = rule.partition(":=")
        if not (old and sign and new):
            raise UsageError(f"--remap takes OLD:=NEW, got {rule!r}")
        rules[old] = new
    return rules


def _open(arguments: argparse.Namespace, model: Model, wiring: Wiring, paths: list[str]) -> Bag:
    """Read one recording, or several merged into one, and prepare its playback."""
    name = " + ".join(paths)
    topics = wiring.topics
    recording = read_recording(merged_source(paths), topics, force_vectors=True)
    require_axes(name, recording, model.robot)
    source = merged_source(paths)
    played = [topics.motors, topics.joints, *(extra.topic for extra in wiring.extras)]
    first, last = recording.start_ns, recording.end_ns
    if arguments.message_order == ORDERS[0]:
        reel = log_order(source, played)
    else:
        reel, first, last = stamp_order(source, played, _header_stamp)
    begin = first + round(arguments.start_offset * 1e9)
    end = last
    if arguments.playback_duration is not None:
        end = min(last, begin + round(arguments.playback_duration * 1e9))
    elif arguments.playback_until_sec is not None:
        end = min(last, round(arguments.playback_until_sec * 1e9))
    elif arguments.playback_until_nsec is not None:
        end = min(last, arguments.playback_until_nsec)
    if begin > last:
        raise UsageError(
            f"--start-offset: {name} is {(last - first) * 1e-9:.3f} s long, "
            f"got {arguments.start_offset:g} s"
        )
    check_span(begin, end)
    return Bag(name, recording, reel, begin, end)


def _header_stamp(message: RawMessage) -> int:
    """Stamp of the header [ns]; 0 if the message does not begin with a header."""
    if BYTE_ORDER.get(message.data[:2]) is None:
        return 0
    try:
        numbers = read_layout(message.data, _STAMP).numbers
    except MessageError:
        return 0
    sec, nanosec = (
        int(np.frombuffer(message.data, span.dtype, 1, span.offset)[0]) for span in numbers.values()
    )
    return sec * 1_000_000_000 + nanosec


def _play_all(
    arguments: argparse.Namespace, player: Player, bags: Sequence[Bag]
) -> tuple[list[Outcome], Ending]:
    """Play all bags in turn, pass after pass; returns an outcome for each bag and the ending."""
    outcomes = [Outcome(player.model) for _ in bags]
    rounds = math.inf if arguments.loop else arguments.passes
    ending, done = Ending.END, 0
    while done < rounds and ending is Ending.END:
        done += 1
        for bag, outcome in zip(bags, outcomes, strict=True):
            again = "" if rounds == 1 else f", pass {done}"
            player.display.say(
                f"playing {bag.path}{again}: {(bag.end_ns - bag.begin_ns) * 1e-9:.3f} s, "
                f"{rate_in_words(arguments.rate)}"
            )
            playback = Playback(
                bag.reel, bag.begin_ns, bag.end_ns,
                rate=arguments.rate, paused=arguments.start_paused and done == 1,
            )  # fmt: skip
            for played in player.play(playback, arguments.delay):
                outcome.add(played.heard, whole=played.whole)
                outcome.span_s += played.span_s
                outcome.wall_s += played.wall_s
                outcome.behind_s = max(outcome.behind_s, played.behind_s)
                ending = played.ending
                at = "" if ending is Ending.END else f" at {played.from_s + played.span_s:.3f} s"
                outcome.ending = f"{ending.value}{at}"
            if ending is not Ending.END or player.stopping:
                ending = Ending.USER if ending is Ending.END else ending
                break
    return outcomes, ending


def _replay(
    arguments: argparse.Namespace, model: Model, wiring: Wiring, bags: Sequence[Bag],
    stop: StopRequest,
) -> int:  # fmt: skip
    with starting():
        node = ReplayNode(wiring)
    executor = EventsExecutor()
    executor.add_node(node)
    try:
        return _play_and_report(arguments, model, node, executor, bags, stop)
    finally:  # in this order: the executor must not serve a destroyed node
        executor.shutdown()
        node.destroy_node()


def _play_and_report(
    arguments: argparse.Namespace, model: Model, node: ReplayNode, executor: EventsExecutor,
    bags: Sequence[Bag], stop: StopRequest,
) -> int:  # fmt: skip
    controls, display, keyboard = Controls(), Display(), Keyboard()
    player = Player(model, node, executor, stop, controls, keyboard, display)
    offer_services(node, controls, player)
    with _keys(arguments, keyboard) as heard:
        if heard:
            print(f"keys: {KEYS}")
        print(f"waiting for {arguments.estimator} ...", flush=True)
        if not player.wait_for_estimator(arguments.patience):
            announce_interruption("replay")
            return INTERRUPTED
        model = player.model = _agreed(arguments, player)
        with display.bar():
            outcomes, ending = _play_all(arguments, player, bags)
            if arguments.wait_for_all_acked is not None:
                for topic in node.wait_for_acknowledgements(arguments.wait_for_all_acked):
                    display.say(f"not every listener of {topic} has acknowledged every message")
    if stop.interrupted and not any(outcome.tally.sent for outcome in outcomes):
        return exit_code("replay", stop, supervised=False)
    code = _report(arguments, model, bags, outcomes, ending, hurried=stop.interrupted)
    sys.stdout.flush()
    return exit_code("replay", stop, supervised=False) or code


def _agreed(arguments: argparse.Namespace, player: Player) -> Model:
    """The robot, with the node's preloads if requested; warn of what the estimates will show."""
    clock = bool(arguments.clock or arguments.clock_topics or arguments.clock_topics_all)
    slow = slow_playback(arguments.rate, paused=arguments.start_paused, clock=clock)
    if slow:
        player.display.say(f"note: {slow}")
    words = preload_difference(player.model, player.estimator)
    if words and arguments.use_node_preload:
        return load_model(arguments.robot, player.estimator.preload)
    if words:
        player.display.say(f"warning: {words}")
    return player.model


@contextmanager
def _keys(arguments: argparse.Namespace, keyboard: Keyboard) -> Iterator[bool]:
    if arguments.disable_keyboard_controls:
        yield False
        return
    with keyboard.listening() as heard:
        yield heard


def _report(
    arguments: argparse.Namespace, model: Model, bags: Sequence[Bag],
    outcomes: Sequence[Outcome], ending: Ending, *, hurried: bool,
) -> int:  # fmt: skip
    """Print what was played and the comparison with the references; returns the exit code."""
    comparisons = []
    for bag, outcome in zip(bags, outcomes, strict=True):
        if not outcome.tally.sent:
            continue
        comparison = outcome.comparison(bag.path, bag.recording)
        say(f"{bag.path}:")
        for name, value in comparison.facts.items():
            say(f"  {name}: {value}")
        comparisons.append(comparison)
    sys.stdout.flush()
    if not comparisons:
        print("replay: nothing was played", file=sys.stderr)
        return INTERRUPTED
    if any(comparison.channels for comparison in comparisons):
        errors = errors_of(comparisons)
        title = f"{model.robot.name}: estimator node against reference"
        first = argparse.Namespace(json=arguments.json, html=None) if hurried else arguments
        write_files(first, model, errors, title)
        print_results(first, model, errors, title)
        if hurried and arguments.html:  # it may take longer than the time left after Ctrl-C
            sys.stdout.flush()
            write_files(argparse.Namespace(json=None, html=arguments.html), model, errors, title)
            say(f"report: {arguments.html}")
    else:
        print("no references in the bag: nothing to compare with; name topics with --reference")
    if ending is Ending.GONE:
        print("replay: the estimator disappeared during the playback", file=sys.stderr)
        return INCOMPLETE
    return DONE if all(outcome.complete for outcome in outcomes) else INCOMPLETE


@contextmanager
def _second_signal_aborts(stop: StopRequest) -> Iterator[None]:
    """The first Ctrl-C ends the playback and leaves ``REPORT_S``; a second one exits at once."""

    def on_signal(number: int, frame: FrameType | None) -> None:
        if stop:
            raise KeyboardInterrupt
        stop.ask(number, frame)
        signal.setitimer(signal.ITIMER_REAL, REPORT_S)

    before = signal.signal(signal.SIGINT, on_signal)
    signal.signal(signal.SIGALRM, on_signal)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGINT, before)


def _divided(argv: Sequence[str]) -> tuple[list[str], list[str]]:
    """Split the arguments into the replay's own and those between ``--ros-args`` and ``--``.

    rclpy's own parser would treat ``--remap OLD:=NEW`` as a deprecated remapping rule.
    """
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
    if arguments.rate is not None:
        try:
            checked_rate(arguments.rate)
        except UsageError as error:
            raise UsageError(f"--rate: {error}") from None
    if arguments.passes < 1:
        raise UsageError(f"--passes must be at least 1, got {arguments.passes}")
    model = load_model(arguments.robot, arguments.preload)
    topics = topics_of(arguments)
    overrides = {}
    if arguments.qos_profile_overrides_path:
        overrides = read_overrides(arguments.qos_profile_overrides_path)
    wiring = wiring_of(
        topics, _extras(arguments, topics), _remap(arguments), overrides,
        clock_hz=arguments.clock,
        clock_topics=None if arguments.clock_topics_all else arguments.clock_topics,
        estimator=arguments.estimator,
    )  # fmt: skip
    groups = [arguments.bags] if arguments.merge else [[path] for path in arguments.bags]
    bags = [_open(arguments, model, wiring, paths) for paths in groups]
    with ros_context(["replay", *ros]) as stop, stop.listening(), _second_signal_aborts(stop):
        return _replay(arguments, model, wiring, bags, stop)


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return run_command("replay", _body, sys.argv[1:] if argv is None else argv)

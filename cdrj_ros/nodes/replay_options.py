"""The options of the replay command."""

from __future__ import annotations

import argparse
from typing import Final

from cdrj_ros.commands.running import CommandParser
from cdrj_ros.commands.shared import add_result_options, add_robot_option, add_topic_options
from cdrj_ros.messages.topics import CLOCK, in_namespace
from cdrj_ros.replay.controls import KEYS
from cdrj_ros.replay.playback import MAX_RATE, MIN_RATE, ORDERS

CLOCK_HZ: Final = 40.0


def replay_parser() -> argparse.ArgumentParser:
    """Make the parser of the replay's own arguments."""
    parser = CommandParser(
        prog="replay",
        description="Play a bag's recorded inputs to a running estimator node, listen to its "
        "answers, compare them with the recorded references and report.",
        epilog=f"Keys in a terminal: {KEYS}. Services under /cdrj/replay: pause, resume, "
        "toggle_paused, is_paused, play_next, stop, set_rate, seek, burst, get_playback. "
        "Exit code: 0 done, or stopped by the user; 1 estimates were lost or the estimator "
        "disappeared; 2 bad usage or input, or no estimator; 130 ended by Ctrl-C, after the report "
        "of what was played if it takes less than two seconds.",
    )
    parser.add_argument("bags", nargs="+", metavar="BAG", help="rosbag2 folder or .mcap file")
    add_robot_option(parser)
    _add_time_options(parser)
    _add_choice_options(parser)
    group = parser.add_argument_group("estimator")
    group.add_argument(
        "--estimator", default=in_namespace("estimator"), metavar="NAME",
        help="full name of the estimator node (default %(default)s)",
    )  # fmt: skip
    group.add_argument(
        "--use-node-preload", action="store_true",
        help="use the preloads of the estimator node instead of those of --robot and --preload",
    )  # fmt: skip
    group.add_argument(
        "--patience", type=_seconds, default=120.0, metavar="S",
        help="how long to wait for the estimator [s] (default %(default)g)",
    )  # fmt: skip
    group.add_argument(
        "--wait-for-all-acked", type=_seconds, metavar="S",
        help="at the end, wait this long for every listener to acknowledge every message [s]",
    )  # fmt: skip
    group.add_argument("--disable-keyboard-controls", action="store_true", help="read no keys")
    add_topic_options(parser)
    add_result_options(parser)
    return parser


def _add_time_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("time")
    group.add_argument(
        "-r", "--rate", type=float, metavar="X",
        help=f"rate as a multiple of real time, {MIN_RATE:g} to {MAX_RATE:g} "
        "(default: as fast as the estimator keeps up)",
    )  # fmt: skip
    repeat = group.add_mutually_exclusive_group()
    repeat.add_argument(
        "-l", "--loop", action="store_true",
        help="repeat until stopped; the estimator is reset before every pass",
    )  # fmt: skip
    repeat.add_argument("--passes", type=int, default=1, metavar="N", help="play N times")
    group.add_argument(
        "-d", "--delay", type=_seconds, default=0.0, metavar="S", help="wait before each pass [s]"
    )
    group.add_argument(
        "--start-offset", type=_seconds, default=0.0, metavar="S",
        help="start this long after the beginning of the bag [s]",
    )  # fmt: skip
    end = group.add_mutually_exclusive_group()
    end.add_argument(
        "--playback-duration", type=_seconds, metavar="S", help="play this much of the bag [s]"
    )
    end.add_argument(
        "--playback-until-sec", type=_seconds, metavar="T",
        help="end at this time, in seconds since the epoch",
    )  # fmt: skip
    end.add_argument("--playback-until-nsec", type=int, metavar="T", help="the same in nanoseconds")
    group.add_argument("-p", "--start-paused", action="store_true", help="begin paused")
    group.add_argument(
        "--message-order", choices=ORDERS, default=ORDERS[0],
        help="order by the time of recording or by the header stamp (default %(default)s)",
    )  # fmt: skip
    clock = group.add_mutually_exclusive_group()
    clock.add_argument(
        "--clock", type=_hertz, nargs="?", const=CLOCK_HZ, default=0.0, metavar="HZ",
        help=f"publish the recording's time on {CLOCK} (default {CLOCK_HZ:g} Hz)",
    )  # fmt: skip
    clock.add_argument(
        "--clock-topics", nargs="+", default=[], metavar="TOPIC",
        help=f"publish {CLOCK} just before every message of these topics",
    )  # fmt: skip
    clock.add_argument(
        "--clock-topics-all", action="store_true",
        help=f"publish {CLOCK} just before every message",
    )  # fmt: skip


def _add_choice_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("played topics")
    group.add_argument(
        "--merge", action="store_true",
        help="play several bags as one, in order of time (default: one after the other)",
    )  # fmt: skip
    group.add_argument(
        "--topics", nargs="+", default=[], metavar="TOPIC",
        help="play these topics in addition to the estimator's inputs",
    )  # fmt: skip
    group.add_argument("-a", "--all", action="store_true", help="play every topic of the bag")
    group.add_argument("-e", "--regex", metavar="R", help="also play topics that match R")
    group.add_argument(
        "--exclude-topics", nargs="+", default=[], metavar="TOPIC", help="do not play these topics"
    )
    group.add_argument("-x", "--exclude-regex", metavar="R", help="do not play topics that match R")
    group.add_argument(
        "-m", "--remap", nargs="+", default=[], metavar="OLD:=NEW",
        help="publish topic OLD of the bag as NEW",
    )  # fmt: skip
    group.add_argument(
        "--qos-profile-overrides-path", metavar="FILE",
        help="YAML of QoS by topic, as for ros2 bag play",
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

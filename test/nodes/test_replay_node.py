"""The replay command as a user runs it, with one estimator process for all tests."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import re
import signal
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from support.forked import Forked, end
from support.turned_forces import turned_bag

from cdrj_ros.bag import BagWriter, Topics, read_recording
from cdrj_ros.commands import validate

ROOT = Path(__file__).parents[2]
ROBOT = str(ROOT / "config" / "robots" / "prototype.yaml")
SAMPLE = ROOT / "bags" / "prototype_preload_36_26"
PATIENCE_S = 120.0
LAST_WORDS_S = 30.0
ASK_AGAIN_S = 5.0

ANSWERED = r"[1-9]\d* answered"
"""Pattern of a progress line once estimates have been received."""

TAKE_TERMINAL = """
import fcntl, os, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.argv[1], sys.argv[1:])
"""
"""Script that makes standard input the controlling terminal, then executes the command."""


@pytest.fixture(scope="module")
def estimator(
    executables: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[subprocess.Popen[bytes]]:
    """One estimator for many replays; each replay resets it."""
    log = tmp_path_factory.mktemp("estimator") / "log"
    with log.open("wb") as stream:
        process = subprocess.Popen(
            [executables / "estimator", "--ros-args", "-p", f"robot:={ROBOT}"],
            stdout=stream,
            stderr=stream,
        )
    deadline = time.monotonic() + PATIENCE_S
    while " pulleys" not in log.read_text(errors="replace"):
        assert process.poll() is None, log.read_text(errors="replace")
        assert time.monotonic() < deadline, log.read_text(errors="replace")
        time.sleep(0.05)
    yield process
    end(process)


class Replay:
    """A replay process whose output is read while it runs."""

    def __init__(self, process: Forked | subprocess.Popen[bytes], stream: int) -> None:
        self.process = process
        self.output = ""
        self._thread = threading.Thread(target=self._read, args=(stream,), daemon=True)
        self._thread.start()

    def _read(self, stream: int) -> None:
        with contextlib.suppress(OSError):  # reading a closed terminal raises an error
            while data := os.read(stream, 65536):
                self.output += data.decode(errors="replace")

    def wait_for(self, pattern: str, patience_s: float = PATIENCE_S) -> re.Match[str]:
        """Wait for a pattern; the last output of an ended process may arrive with a delay."""
        deadline = time.monotonic() + patience_s
        while not (found := re.search(pattern, self.output)):
            if self.process.poll() is not None:
                deadline = min(deadline, time.monotonic() + LAST_WORDS_S)
            assert time.monotonic() < deadline, f"no {pattern!r} in:\n{self.output}"
            time.sleep(0.01)
        return found

    def finish(self) -> tuple[int, str]:
        code = self.process.wait(2 * PATIENCE_S)
        self._thread.join(LAST_WORDS_S)
        return code, self.output


class Services:
    """Clients for all services of a replay, created before it starts.

    A response to a client that the replay has not discovered is dropped. The replay discovers the
    clients in this order, so once it responds to the last one, it has discovered all.
    """

    def __init__(self, node: Any) -> None:
        from cdrj_msgs.srv import Burst, GetPlayback, Seek, SetRate
        from std_srvs.srv import Trigger

        triggers = ("pause", "resume", "toggle_paused", "is_paused", "play_next", "stop")
        kinds = dict.fromkeys(triggers, Trigger) | {"seek": Seek, "set_rate": SetRate}
        kinds |= {"burst": Burst, "get_playback": GetPlayback}
        self._node = node
        self._clients = {
            name: node.create_client(kind, f"/cdrj/replay/{name}") for name, kind in kinds.items()
        }

    def call(self, name: str, patience_s: float = PATIENCE_S, **request: Any) -> Any:
        """Call a service; returns the response, or None if there is none in time."""
        import rclpy

        client = self._clients[name]
        assert client.wait_for_service(PATIENCE_S), name
        future = client.call_async(client.srv_type.Request(**request))
        rclpy.spin_until_future_complete(self._node, future, timeout_sec=patience_s)
        return future.result()

    def state(self, condition: Callable[[Any], bool] = lambda _: True) -> Any:
        """Wait until the state of the playback meets a condition; returns the state."""
        deadline = time.monotonic() + PATIENCE_S
        while not (state := self.call("get_playback", ASK_AGAIN_S)) or not condition(state):
            assert time.monotonic() < deadline, state
        return state


def _spun_until(node: Any, condition: Callable[[], bool]) -> bool:
    import rclpy

    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > deadline:
            return False
        rclpy.spin_once(node, timeout_sec=0.1)
    return True


@pytest.fixture
def replay(executables: Path) -> Iterator[Callable[..., Replay]]:
    """Start a replay of one or more bags with a robot and further arguments."""
    started: list[Replay] = []

    def start(
        bag: str,
        *arguments: str,
        more: Sequence[str] = (),
        terminal: tuple[int, int] | None = None,
    ) -> Replay:
        command = ["replay", bag, *more, "--robot", ROBOT, *arguments]
        process: Forked | subprocess.Popen[bytes]
        if terminal is None:
            reader, writer = os.pipe()
            process = Forked(command[0], command[1:], writer)
            os.close(writer)
        else:
            reader, screen = terminal
            process = subprocess.Popen(
                [sys.executable, "-c", TAKE_TERMINAL, executables / command[0], *command[1:]],
                stdin=screen,
                stdout=screen,
                stderr=screen,
                start_new_session=True,
            )
        started.append(Replay(process, reader))
        return started[-1]

    yield start
    for one in started:
        end(one.process)


def _facts(path: Path) -> dict[str, str]:
    (bag,) = json.loads(path.read_text())["bags"]
    return dict(bag["facts"])


def test_replay_evaluates_the_node_and_writes_json_and_report(
    estimator: Any, replay: Any, short_bag: str, tmp_path: Path
) -> None:
    figures, report = tmp_path / "f.json", tmp_path / "r.html"
    code, out = replay(short_bag, "--json", str(figures), "--html", str(report)).finish()
    assert code == 0, out
    assert "all elements" in out
    (bag,) = json.loads(figures.read_text())["bags"]
    assert bag["channels"]["tension/upper/8"]["mean_relative_error"] < 0.015
    facts = bag["facts"]
    assert facts["estimates lost"] == "0"
    assert facts["estimates received"] == facts["estimates expected"] != "0"
    assert "inputs/s" in facts["rate achieved"]
    assert facts["latency"].startswith("p50 ")
    assert "tension/upper/8" in report.read_text()
    assert "rate achieved" in report.read_text()


def test_replay_compares_force_vectors_as_validate_does(
    estimator: Any, replay: Any, tmp_path: Path
) -> None:
    degrees = 6.0
    bag = str(turned_bag(tmp_path, degrees))
    played, offline = tmp_path / "played.json", tmp_path / "offline.json"
    code, out = replay(bag, "--json", str(played)).finish()
    assert code == 0, out
    assert "mean direction" in out
    assert validate.main([bag, "--robot", ROBOT, "--json", str(offline), "--quiet"]) == 0
    ours, theirs = (
        {
            name: figures
            for name, figures in json.loads(path.read_text())["all"]["channels"].items()
            if name.startswith("force_vector/")
        }
        for path in (played, offline)
    )
    assert len(ours) == 14
    assert ours.keys() == theirs.keys()
    for name, figures in ours.items():
        assert figures["mean_direction_error_deg"] == pytest.approx(degrees, rel=1e-9)
        assert figures.pop("coverage") is None
        assert figures == pytest.approx({k: v for k, v in theirs[name].items() if k != "coverage"})


def test_different_preloads_of_the_node_cause_a_warning_or_are_adopted(
    estimator: Any, replay: Any, short_bag: str
) -> None:
    short = ("--playback-duration", "0.2", "--preload", "30,20")
    code, out = replay(short_bag, *short).finish()
    assert code == 0, out
    differ = "preloads differ: upper 36.85 N in the estimator, 30 N here"
    assert differ in " ".join(out.split())
    code, out = replay(short_bag, *short, "--use-node-preload").finish()
    assert code == 0, out
    assert differ not in " ".join(out.split())


def test_passes_agree_bit_for_bit(
    estimator: Any, replay: Any, short_bag: str, tmp_path: Path
) -> None:
    figures = tmp_path / "f.json"
    code, out = replay(
        short_bag, "--passes", "3", "--playback-duration", "0.5", "--json", str(figures)
    ).finish()
    assert code == 0, out
    facts = _facts(figures)
    assert "3 runs, 3 of them whole" in facts["played"]
    assert facts["between passes"].startswith("0 at most")


def test_a_part_of_a_bag_is_answered_completely(
    estimator: Any, replay: Any, short_bag: str, tmp_path: Path
) -> None:
    figures = tmp_path / "f.json"
    code, out = replay(
        short_bag, "--start-offset", "1.25", "--playback-duration", "1", "--message-order", "sent",
        "--json", str(figures),
    ).finish()  # fmt: skip
    assert code == 0, out
    facts = _facts(figures)
    assert facts["played"].startswith("1.000 s of ")
    assert facts["estimates received"] == facts["estimates expected"]
    # one second of motors at 1 kHz, and of joints at 500 Hz with stamps in between
    assert 1490 < int(facts["estimates expected"]) <= 1501


def _figures(path: Path) -> list[dict[str, Any]]:
    bags: list[dict[str, Any]] = json.loads(path.read_text())["bags"]
    for bag in bags:
        facts = bag["facts"]
        assert facts["estimates received"] == facts["estimates expected"] != "0"
        assert facts["estimates lost"] == facts["estimates late"].split()[0] == "0"
    return bags


ANGLES_AND_TENSIONS = (Topics().motors, Topics().joints, Topics().references[0])


def _excerpt(
    path: Path, begin_s: float, end_s: float, topics: Sequence[str] = ANGLES_AND_TENSIONS
) -> str:
    """Write a bag with a part of the sample recording."""
    files = list(SAMPLE.glob("*.mcap"))
    assert len(files) == 1
    path.mkdir()
    with files[0].open("rb") as source, (path / f"{path.name}.mcap").open("wb") as target:
        writer = Writer(target)
        writer.start("ros2")
        reader = make_reader(source)
        begin = reader.get_summary().statistics.message_start_time
        schemas: dict[int, int] = {}
        channels: dict[int, int] = {}
        first, beyond = (begin + round(at * 1e9) for at in (begin_s, end_s))
        part = reader.iter_messages(topics, starting_at=first, ending_before=beyond)
        for schema, channel, message in part:
            if schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(
                    schema.name, schema.encoding, schema.data
                )
            if channel.id not in channels:
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schemas[schema.id], channel.metadata
                )
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time
            )
        writer.finish()
    return str(path)


def test_several_bags_play_one_after_the_other_each_with_its_own_figures(
    estimator: Any, replay: Any, tmp_path: Path
) -> None:
    first, second = _excerpt(tmp_path / "a", 0.0, 2.0), _excerpt(tmp_path / "b", 10.0, 12.0)
    figures = tmp_path / "f.json"
    code, out = replay(first, "--json", str(figures), more=(second,)).finish()
    assert code == 0, out
    a, b = _figures(figures)
    assert a["facts"]["played"].startswith("1.999 s of 1.999 s")
    assert b["facts"]["played"].startswith("1.999 s of 1.999 s")
    # the bags do not affect each other: the results equal those of single replays
    for bag, path in ((a, first), (b, second)):
        code, out = replay(path, "--json", str(figures)).finish()
        assert code == 0, out
        (alone,) = _figures(figures)
        assert alone["channels"] == bag["channels"]


def test_bags_of_one_topic_each_are_merged_into_the_original_recording(
    estimator: Any, replay: Any, tmp_path: Path
) -> None:
    whole = _excerpt(tmp_path / "whole", 0.0, 2.0)
    motors = _excerpt(tmp_path / "motors", 0.0, 2.0, [Topics().motors])
    rest = _excerpt(tmp_path / "rest", 0.0, 2.0, [Topics().joints, Topics().references[0]])
    figures = tmp_path / "f.json"
    code, out = replay(motors, "--merge", "--json", str(figures), more=(rest,)).finish()
    assert code == 0, out
    (merged,) = _figures(figures)
    code, out = replay(whole, "--json", str(figures)).finish()
    assert code == 0, out
    (at_once,) = _figures(figures)
    assert merged["facts"]["inputs sent"] == at_once["facts"]["inputs sent"]
    for name, channel in merged["channels"].items():
        if name.startswith("tension/"):
            assert channel == at_once["channels"][name]


@pytest.mark.parametrize("metadata", [True, False])
def test_a_bag_in_several_files_plays_as_one(
    metadata: bool, estimator: Any, replay: Any, tmp_path: Path
) -> None:
    whole = _excerpt(tmp_path / "whole", 0.0, 2.4)
    split = tmp_path / "split"
    split.mkdir()
    for k in range(3):  # each part excludes its last stamp
        part = Path(_excerpt(tmp_path / f"part_{k}", 0.8 * k, 0.8 * (k + 1)))
        (part / f"part_{k}.mcap").rename(split / f"split_{k}.mcap")
    if metadata:
        names = "".join(f"\n    - split_{k}.mcap" for k in range(3))
        (split / "metadata.yaml").write_text(
            "rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: mcap\n"
            f"  relative_file_paths:{names}\n  compression_format: ''\n  compression_mode: ''\n"
        )
    figures = tmp_path / "f.json"
    code, out = replay(str(split), "--json", str(figures)).finish()
    assert code == 0, out
    (parts,) = _figures(figures)
    code, out = replay(whole, "--json", str(figures)).finish()
    assert code == 0, out
    (at_once,) = _figures(figures)
    assert parts["channels"] == at_once["channels"]
    assert parts["facts"]["inputs sent"] == at_once["facts"]["inputs sent"]


def test_other_topics_are_played_with_the_inputs_as_recorded(
    estimator: Any, replay: Any, short_bag: str, node: Any, tmp_path: Path
) -> None:
    from cdrj_msgs.msg import CableTensions
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from rosgraph_msgs.msg import Clock

    heard: list[float] = []
    clocks: list[float] = []

    def seconds(stamp: Any) -> float:
        return float(stamp.sec + stamp.nanosec * 1e-9)

    latched = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(
        CableTensions, "/recorded", lambda m: heard.append(seconds(m.header.stamp)), latched
    )
    node.create_subscription(Clock, "/clock", lambda m: clocks.append(seconds(m.clock)), 1000)
    services = Services(node)
    qos = tmp_path / "qos.yaml"
    qos.write_text("/reference/tensions: {durability: transient_local, depth: 500}\n")
    one = replay(
        short_bag, "--topics", "/reference/tensions", "--remap", "/reference/tensions:=/recorded",
        "--qos-profile-overrides-path", str(qos), "--clock-topics", "/reference/tensions",
        "--rate", "2", "--playback-duration", "2", "--wait-for-all-acked", "10", "--start-paused",
    )  # fmt: skip
    one.wait_for("playing ")
    assert _spun_until(
        node,
        lambda: bool(node.count_publishers("/recorded") and node.count_publishers("/clock")),
    ), one.output
    services.state()  # the replay has discovered this node and its clock subscription
    assert services.call("resume").success
    assert _spun_until(node, lambda: one.process.poll() is not None), one.output
    code, out = one.finish()
    assert code == 0, out
    recording = read_recording(short_bag)
    stamps = next(iter(recording.references.values())).stamp_ns
    expected = stamps[stamps <= recording.start_ns + 2_000_000_000]
    _spun_until(node, lambda: min(len(heard), len(clocks)) >= len(expected))
    assert len(heard) == len(expected) > 100, out
    assert heard[0] == pytest.approx(expected[0] * 1e-9)
    assert clocks == pytest.approx(heard)
    assert "ms behind the recorded time" in out


def test_a_slow_and_late_channel_neither_stalls_nor_loses_anything(
    estimator: Any, replay: Any, tmp_path: Path
) -> None:
    bag = tmp_path / "slow"
    whole = read_recording(SAMPLE)
    until = whole.start_ns + 4_000_000_000
    with BagWriter(bag) as writer:
        for topic, channels, every in (
            (Topics().motors, whole.motors, 1),
            (Topics().joints, whole.joints, 200),
        ):
            for name, series in channels.items():
                kept = np.flatnonzero(series.stamp_ns < until)[::every]
                kept = kept[kept >= (1 if every == 1 else 600)]
                writer.write_joint_states(
                    topic, series.stamp_ns[kept], (name,), position=series.value[kept, None]
                )
    code, out = replay(str(bag)).finish()
    assert code == 0, out
    assert "estimates lost: 0" in out
    assert "nothing to compare with" in out
    assert "within the time allowed" not in out


def test_ctrl_c_writes_the_report_of_what_was_played_and_exits_with_130(
    estimator: Any, replay: Any, longer_bag: str, node: Any, tmp_path: Path
) -> None:
    figures = tmp_path / "f.json"
    services = Services(node)
    one = replay(longer_bag, "--rate", "1", "--json", str(figures))
    one.wait_for("playing ")
    services.state(lambda state: state.received > 0)
    one.process.send_signal(signal.SIGINT)
    code, out = one.finish()
    assert code == 130, out
    assert out.endswith("replay: interrupted\n")
    assert out.count("interrupted") == 1
    assert "Traceback" not in out
    facts = _facts(figures)
    assert "ended by the user at" in facts["played"]
    assert facts["estimates lost"] == "0"
    assert int(facts["estimates received"]) > 0


def test_a_second_ctrl_c_ends_at_once(
    estimator: Any, replay: Any, longer_bag: str, node: Any
) -> None:
    services = Services(node)
    one = replay(longer_bag, "--rate", "1")
    services.state(lambda state: state.received > 0)
    estimator.send_signal(signal.SIGSTOP)  # estimates in flight are no longer answered
    try:
        services.state(lambda state: state.expected - state.received - state.lost > 16)
        one.process.send_signal(signal.SIGINT)
        one.wait_for("Ctrl-C again ends at once")
        one.process.send_signal(signal.SIGINT)
        code, out = one.finish()
    finally:
        estimator.send_signal(signal.SIGCONT)
    assert code == 130, out
    assert "replay: interrupted" in out
    assert "all elements" not in out
    assert "Traceback" not in out


def test_ctrl_z_restores_the_terminal_and_fg_takes_it_again(
    estimator: Any, replay: Any, longer_bag: str
) -> None:
    keys, screen = pty.openpty()
    before = termios.tcgetattr(screen)
    one = replay(longer_bag, "--rate", "1", terminal=(keys, screen))
    try:
        one.wait_for("keys: space")
        one.wait_for(" answered")
        assert termios.tcgetattr(screen) != before
        os.write(keys, b"\x1a")
        deadline = time.monotonic() + PATIENCE_S
        while not (changed := os.waitpid(one.process.pid, os.WUNTRACED | os.WNOHANG))[0]:
            assert time.monotonic() < deadline, one.output
            time.sleep(0.01)
        assert os.WIFSTOPPED(changed[1])
        assert termios.tcgetattr(screen) == before
        one.process.send_signal(signal.SIGCONT)
        deadline = time.monotonic() + PATIENCE_S
        while termios.tcgetattr(screen) == before:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        os.write(keys, b" ")
        one.wait_for("paused at")
        os.write(keys, b"q")
        assert one.process.wait(PATIENCE_S) == 0, one.output
        one.wait_for("estimates lost: 0")
    finally:
        os.close(screen)


def test_an_estimator_that_disappears_is_reported_and_its_answers_are_evaluated(
    start_node: Any, replay: Any, longer_bag: str, tmp_path: Path
) -> None:
    name = "/cdrj/mortal"
    other = ("-r", "__node:=mortal", *(
        part for topic in ("motor_states", "joint_states", "tensions", "nodal_forces", "efforts")
        for part in ("-r", f"{topic}:=mortal/{topic}")
    ))  # fmt: skip
    mortal = start_node("estimator", "--ros-args", "-p", f"robot:={ROBOT}", *other)
    one = replay(
        longer_bag, "--rate", "1", "--estimator", name, "--patience", f"{PATIENCE_S}",
        "--ros-args", *other[2:],
    )  # fmt: skip
    one.wait_for(ANSWERED, 2 * PATIENCE_S)
    mortal.send_signal(signal.SIGINT)
    code, out = one.finish()
    assert code == 1, out
    assert "the estimator disappeared" in out
    assert "all elements" in out
    assert "Traceback" not in out


def test_services_control_the_playback(
    estimator: Any, replay: Any, longer_bag: str, node: Any, tmp_path: Path
) -> None:
    from rosgraph_msgs.msg import Clock

    def nanoseconds(stamp: Any) -> int:
        return int(stamp.sec * 10**9 + stamp.nanosec)

    times: list[int] = []
    node.create_subscription(Clock, "/clock", lambda m: times.append(nanoseconds(m.clock)), 100)
    services = Services(node)
    call, until = services.call, services.state

    figures = tmp_path / "f.json"
    one = replay(
        longer_bag, "--rate", "1", "--start-paused", "--clock", "100", "--json", str(figures)
    )
    one.wait_for("playing ")
    state = until(lambda state: state.duration > 0)
    assert (state.paused, state.rate, state.offset, state.sent) == (True, 1.0, 0.0, 0)
    assert call("is_paused").success
    for _ in range(2):
        assert call("play_next").success
    state = until(lambda state: state.sent == 2)
    assert state.paused
    assert call("burst", number=500).number == 500
    state = until(lambda state: state.sent >= 502 and state.received == state.expected)
    assert (state.sent, state.lost) == (502, 0)
    assert state.expected > 300
    still = nanoseconds(state.time)
    assert _spun_until(node, lambda: bool(times) and times[-1] == still)
    times.clear()
    assert _spun_until(node, lambda: len(times) >= 5)
    assert set(times) == {still}  # the clock stands still and is still published

    assert state.offset < 10.0
    seek = call("seek", offset=10.0)
    assert seek.success
    assert seek.offset == 10.0
    assert "is reset" in seek.message
    assert not call("seek", offset=float("nan")).success
    assert call("set_rate", rate=2.0).rate == 2.0
    assert not call("set_rate", rate=-2.0).success
    assert call("resume").success
    state = until(lambda state: state.run == 2 and state.offset > 11.0)
    assert state.rate == 2.0
    times.clear()
    assert _spun_until(node, lambda: len(times) >= 20 and times[-1] > times[0])
    assert all(np.diff(times) >= 0)
    assert call("pause").success
    assert call("toggle_paused").message.startswith("playing on")
    assert call("stop").success
    code, out = one.finish()
    assert code == 0, out
    assert "was reset 2 times" in out
    assert _facts(figures)["estimates lost"] == "0"


def test_keys_control_the_playback_in_a_terminal(
    estimator: Any, replay: Any, longer_bag: str
) -> None:
    keys, screen = pty.openpty()
    before = termios.tcgetattr(screen)
    one = replay(longer_bag, "--rate", "1", terminal=(keys, screen))
    try:
        one.wait_for("keys: space")
        one.wait_for(" answered")
        for key, words in (
            (b" ", "paused at"),
            (b"n", "next message after"),
            (b"\x1b[A", "2 x real time from"),
            (b"]", r"moved to \d"),
            (b" ", "playing on from"),
            (b"q", "stopping at"),
        ):
            os.write(keys, key)
            one.wait_for(words)
        code = one.process.wait(PATIENCE_S)
        one.wait_for("all elements")
        assert code == 0, one.output
        begin, end = (
            float(one.wait_for(rf"{words} ([\d.]+) s")[1])
            for words in ("2 x real time from", "moved to")
        )
        assert end == pytest.approx(begin + 10.0, abs=2e-3)
        assert "Traceback" not in one.output
        assert termios.tcgetattr(screen) == before
    finally:
        os.close(screen)


def test_without_an_estimator_the_missing_parts_are_named(replay: Any, short_bag: str) -> None:
    one = replay(short_bag, "--patience", "1", "--estimator", "/nobody")
    code, out = one.finish()
    assert code == 2
    assert "no estimator within 1 s" in out
    assert "no service /nobody/reset" in out
    assert "Traceback" not in out


def test_ctrl_c_before_anything_was_played_is_an_interruption(replay: Any, short_bag: str) -> None:
    one = replay(short_bag, "--estimator", "/nobody")
    one.wait_for("waiting for /nobody")
    one.process.send_signal(signal.SIGINT)
    code, out = one.finish()
    assert code == 130
    assert "Traceback" not in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--rate", "0"), "--rate"),
        (("--rate", "-1"), "--rate"),
        (("--rate", "nan"), "--rate"),
        (("--passes", "0"), "--passes"),
        (("--start-offset", "1e6"), "--start-offset"),
        (("--playback-until-sec", "0"), "nothing to play"),
        (("--remap", "/a:=/b"), "--remap: /a is not played"),
        (("--remap", "nonsense"), "--remap takes OLD:=NEW"),
        (("--topics", "/nothing"), "has no /nothing"),
        (("--regex", "("), "not a regular expression"),
        (("--exclude-topics", "/cdrj/motor_states"), "the estimator needs /cdrj/motor_states"),
        (("--clock-topics", "/nothing"), "--clock-topics: /nothing is not played"),
        (("--qos-profile-overrides-path", "/nowhere.yaml"), "/nowhere.yaml"),
    ],
)
def test_invalid_options_of_replay_are_refused_in_one_line(
    arguments: tuple[str, ...],
    words: str,
    short_bag: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from cdrj_ros.nodes.replay import main

    assert main([short_bag, "--robot", ROBOT, *arguments]) == 2
    errors = capsys.readouterr().err
    assert words in errors
    assert errors.count("\n") == 1

"""The estimator in a separate process, tested over DDS."""

from __future__ import annotations

import signal
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cdrj_msgs.msg import NodalForces
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from support.forked import Forked
from support.places import ROBOT
from support.remote import Remote

from cdrj_ros.evaluation.estimating import estimate
from cdrj_ros.evaluation.inputs import condition_recording, read_inputs
from cdrj_ros.messages.cdr import CABLE_TENSIONS, JOINT_STATE, NODAL_FORCES, read_layout
from cdrj_ros.messages.templates import FORCES
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.state import UNSURE
from cdrj_ros.recordings import Topics, read_messages

PATIENCE_S = 120.0


FIELDS = {"tensions": CABLE_TENSIONS, "nodal_forces": NODAL_FORCES, "efforts": JOINT_STATE}
WINDOW = 64
"""Maximum number of messages in flight; less than any queue depth."""


def stamp_of(payload: bytes) -> int:
    """Header stamp of a message [ns]."""
    sec = int.from_bytes(payload[4:8], "little", signed=True)
    return sec * 1_000_000_000 + int.from_bytes(payload[8:12], "little")


def play(remote: Remote, bag: str, last_ns: int) -> None:
    """Publish a bag's inputs, about WINDOW of them in flight; wait for the last estimate."""
    topics, under_way = Topics(), list[int]()
    publishers = {
        topics.motors: remote.inputs["motor_states"], topics.joints: remote.inputs["joint_states"],
    }  # fmt: skip
    heard = (remote.answers, *remote.others.values())

    def answered(wanted_ns: int) -> bool:
        return all(payloads and stamp_of(payloads[-1]) >= wanted_ns for payloads in heard)

    for message in read_messages(bag, list(publishers)):
        publishers[message.topic].publish(message.data)
        under_way.append(stamp_of(message.data))
        if len(under_way) % 16 == 0 and len(under_way) > WINDOW:
            assert remote.until(lambda: answered(under_way[-WINDOW]))
    assert remote.until(lambda: answered(last_ns))


def arrays(payloads: list[bytes], topic: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    columns: dict[str, list[np.ndarray]] = {}
    for payload in payloads:
        for name, span in read_layout(payload, FIELDS[topic].fields).numbers.items():
            numbers = np.frombuffer(payload, span.dtype, span.count, span.offset)
            columns.setdefault(name, []).append(numbers.astype(np.float64))
    found = {name: np.array(rows) for name, rows in columns.items() if "header" not in name}
    return np.array([stamp_of(payload) for payload in payloads], np.int64), found


def test_every_published_number_equals_the_offline_path_bit_for_bit_also_after_a_reset(
    brisk_node: Any, start_node: Any, short_bag: str
) -> None:
    model = load_model(ROBOT)
    offline = estimate(model, condition_recording(model, read_inputs(short_bag, Topics(), model)))
    layout, values = offline.layout, offline.values
    assert offline.stamp_ns.size > 5000
    others = {"nodal_forces": NodalForces, "efforts": JointState}
    remote = Remote(brisk_node, start_node, "offline", others)
    remote.start()
    for _ in range(2):
        assert remote.call(Trigger, "reset", Trigger.Request()).success
        for heard in (remote.answers, *remote.others.values()):
            heard.clear()
        play(remote, short_bag, int(offline.stamp_ns[-1]))
        stamps, tensions = arrays(remote.answers, "tensions")
        assert np.array_equal(stamps, offline.stamp_ns)
        assert np.array_equal(tensions["tension"], values[:, layout.tension])
        certain = tensions["status"].astype(int) & ~UNSURE
        assert np.array_equal(certain, values[:, layout.status])
        stamps, forces = arrays(remote.others["nodal_forces"], "nodal_forces")
        assert np.array_equal(stamps, offline.stamp_ns)
        for name in (*FORCES, "status"):
            if name not in ("force_z", "status"):
                assert np.array_equal(forces[name], values[:, getattr(layout, name)]), name
        stamps, efforts = arrays(remote.others["efforts"], "efforts")
        assert np.array_equal(stamps, offline.stamp_ns)
        both = slice(layout.motor_effort.start, layout.joint_effort.stop)
        assert np.array_equal(efforts["effort"], values[:, both])


QOS = "qos_overrides./cdrj/tensions.publisher.reliability"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "robot is missing"),
        (["--ros-args", "-p", "robot:=/no/such.yaml"], "/no/such.yaml"),
        (["--ros-args", "-p", f"robot:={ROBOT}", "-p", "preload:=[1.0]"], "preload needs 2"),
        (["surplus"], "surplus"),
        (["--ros-args", "-p", "robot"], "'-p robot'"),
        (["--ros-args", "-p", "robot:=3"], "'robot' to '3' of type 'INTEGER'"),
        (["--ros-args", "-p", f"robot:={ROBOT}", "-p", "timeout:=-3.0"], "timeout out of range"),
        (["--ros-args", "--params-file", "/nowhere.yaml"], "/nowhere.yaml"),
        (["--ros-args", "-r", "__node:=1bad"], "__node:=1bad"),
        (["--ros-args", "-p", f"robot:={ROBOT}", "-p", f"{QOS}:=maybe"], "`maybe`"),
    ],
)
def test_a_wrong_start_is_one_clear_line_and_exit_code_2(
    arguments: list[str], words: str, tmp_path: Path
) -> None:
    with (tmp_path / "said").open("wb") as said:
        process = Forked("estimator", arguments, said.fileno())
    assert process.wait(PATIENCE_S) == 2
    errors = (tmp_path / "said").read_text("utf-8")
    assert words in errors
    assert len(lines_of_ours(errors)) == 1


def test_a_wrong_start_of_the_installed_executable_is_one_clear_line(start_executable: Any) -> None:
    process = start_executable("estimator", stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    output, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 2
    assert not output
    (line,) = lines_of_ours(errors.decode())
    assert "robot is missing" in line


def lines_of_ours(errors: str) -> list[str]:
    return [line for line in errors.strip().splitlines() if "[rcl]" not in line]


@pytest.mark.parametrize(
    ("options", "number", "code"),
    [((), signal.SIGINT, 130), (("--supervised",), signal.SIGINT, 0), ((), signal.SIGTERM, 0)],
)
def test_the_exit_code_of_a_running_node_tells_an_interrupt_unless_it_is_supervised(
    brisk_node: Any, start_executable: Any, options: tuple[str, ...], number: int, code: int
) -> None:
    """ros2 launch reports every code but 0 as a crash, even of a node that it has interrupted."""
    remote = Remote(brisk_node, start_executable, "ended")
    remote.start(*options)
    assert remote.call(Trigger, "reset", Trigger.Request()).success, "it spins"
    remote.process.send_signal(number)
    assert remote.process.wait(PATIENCE_S) == code

"""The estimator over DDS, how it starts and how it ends."""

import signal

import numpy as np
import pytest
from cdrj_msgs.msg import CableTensions, NodalForces
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from support.places import ROBOT

from cdrj_ros.evaluation.estimating import estimate
from cdrj_ros.evaluation.inputs import condition_recording, read_inputs
from cdrj_ros.messages.cdr import CABLE_TENSIONS, JOINT_STATE, NODAL_FORCES, read_layout
from cdrj_ros.messages.templates import FORCES
from cdrj_ros.model.packing import UNSURE
from cdrj_ros.model.prepared import load_model
from cdrj_ros.nodes.estimator import main
from cdrj_ros.nodes.spinning import StopRequest, exit_code
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.recordings.source import read_messages

PATIENCE_S = 120.0
FIELDS = {"tensions": CABLE_TENSIONS, "nodal_forces": NODAL_FORCES, "efforts": JOINT_STATE}
WINDOW = 64
"""Maximum number of messages in flight; less than any queue depth."""


def stamp_of(payload):
    """Header stamp of a message [ns]."""
    sec = int.from_bytes(payload[4:8], "little", signed=True)
    return sec * 1_000_000_000 + int.from_bytes(payload[8:12], "little")


def play(bench, bag, last_ns, heard):
    """Publish a bag's inputs, about WINDOW of them in flight; wait for the last estimate."""
    topics, under_way = Topics(), list[int]()

    def answered(wanted_ns):
        return all(payloads and stamp_of(payloads[-1]) >= wanted_ns for payloads in heard)

    for message in read_messages(bag, (topics.motors, topics.joints)):
        bench.publishers[message.topic].publish(message.data)
        under_way.append(stamp_of(message.data))
        if len(under_way) % 16 == 0 and len(under_way) > WINDOW:
            assert bench.until(lambda: answered(under_way[-WINDOW]))
    assert bench.until(lambda: answered(last_ns))


def arrays(payloads, topic):
    columns = {}
    for payload in payloads:
        for name, span in read_layout(payload, FIELDS[topic].fields).numbers.items():
            numbers = np.frombuffer(payload, span.dtype, span.count, span.offset)
            columns.setdefault(name, []).append(numbers.astype(np.float64))
    found = {name: np.array(rows) for name, rows in columns.items() if "header" not in name}
    return np.array([stamp_of(payload) for payload in payloads], np.int64), found


def test_every_published_number_equals_the_offline_path_bit_for_bit_also_after_a_reset(
    bench, short_bag
):
    model = load_model(ROBOT)
    offline = estimate(model, condition_recording(model, read_inputs(short_bag, Topics(), model)))
    layout, values = offline.layout, offline.values
    assert offline.stamp_ns.size > 5000
    heard = {topic: [] for topic in FIELDS}
    for topic, kind in zip(heard, (CableTensions, NodalForces, JointState), strict=True):
        keep = heard[topic].append
        bench.node.create_subscription(kind, f"/cdrj/{topic}", keep, 2000, raw=True)
    for topic in (Topics().motors, Topics().joints):
        bench.publishers[topic] = bench.node.create_publisher(JointState, topic, 2000)
    estimator = bench.estimator()
    outputs = estimator.outputs
    ends = (*bench.publishers.values(), outputs.tensions, outputs.forces, outputs.efforts)
    assert bench.until(lambda: all(one.get_subscription_count() == 1 for one in ends))
    for _ in range(2):
        assert bench.call(Trigger, "/cdrj/estimator/reset", Trigger.Request()).success
        for payloads in heard.values():
            payloads.clear()
        play(bench, short_bag, int(offline.stamp_ns[-1]), heard.values())
        stamps, tensions = arrays(heard["tensions"], "tensions")
        assert np.array_equal(stamps, offline.stamp_ns)
        assert np.array_equal(tensions["tension"], values[:, layout.tension])
        certain = tensions["status"].astype(int) & ~UNSURE
        assert np.array_equal(certain, values[:, layout.status].astype(int) & ~UNSURE)
        stamps, forces = arrays(heard["nodal_forces"], "nodal_forces")
        assert np.array_equal(stamps, offline.stamp_ns)
        for name in (*FORCES, "status"):
            if name not in ("force_z", "status"):
                assert np.array_equal(forces[name], values[:, getattr(layout, name)]), name
        stamps, efforts = arrays(heard["efforts"], "efforts")
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
def test_a_wrong_start_is_one_clear_line_and_exit_code_2(arguments, words, capfd):
    assert main(arguments) == 2
    output, errors = capfd.readouterr()
    assert not output
    (line,) = [one for one in errors.splitlines() if "[rcl]" not in one]
    assert words in line


def test_a_running_node_ends_with_the_code_of_an_interrupt_unless_it_is_supervised(
    bench, start_executable
):
    """ros2 launch reports every code but 0 as a crash, even of a node that it has interrupted."""
    process = start_executable("estimator", "--ros-args", "-p", f"robot:={ROBOT}")
    reset = bench.call(Trigger, "/cdrj/estimator/reset", Trigger.Request())
    assert reset.success, "it spins"
    process.send_signal(signal.SIGINT)
    assert process.wait(PATIENCE_S) == 130
    for number, supervised in ((signal.SIGINT, True), (signal.SIGTERM, False)):
        stop = StopRequest()
        stop.ask(number, None)
        assert exit_code("estimator", stop, supervised=supervised) == 0

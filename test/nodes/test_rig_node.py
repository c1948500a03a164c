"""The rig node: with a real estimator, and with valid and invalid commands."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from cdrj_msgs.msg import CableTensions
from cdrj_msgs.srv import Push
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger
from support.estimators import Bench
from support.places import ROBOT

from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.messages import topics
from cdrj_ros.model.packing import SLACK
from cdrj_ros.model.prepared import load_model
from cdrj_ros.nodes.rig import RigNode
from cdrj_ros.nodes.rig_topics import RigOutputs


def overrides(**given):
    return [Parameter(name, value=value) for name, value in {"robot": ROBOT, **given}.items()]


@pytest.fixture
def bench(ros, tmp_path):
    """Create rigs in this process; they are destroyed after the test."""
    opened = []

    def open_bench(text="{}", **given):
        path = tmp_path / "rig.yaml"
        path.write_text(text)
        asked = overrides(**{"cells": 1, **given, "rig": str(path)})
        one = Bench("cdrj")
        opened.append(one)
        one.rig = one.add(RigNode(parameter_overrides=asked))
        return one

    yield open_bench
    for one in opened:
        one.close()


def array_of(*values):
    return Float64MultiArray(data=list(values))


def stamp_ns(message):
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


GEARED = (
    Path(ROBOT).read_text()
    .replace("name: prototype\n", "name: prototype\nprefix: arm1_\n")
    .replace("- name: winch", "- name: winch\n    scale: -0.02\n    effort_scale: 2.7")
    .replace("resolution_deg: 0.00439453125", "resolution_deg: 0.2197265625")
)  # fmt: skip
"""A robot file whose motor is published with its gear of -50, its current and a prefix."""


def test_an_estimator_beside_the_rig_finds_its_true_tensions(bench, tmp_path):
    """On the one topic of ros2_control, 250 times a second."""
    robot = str(tmp_path / "robot.yaml")
    Path(robot).write_text(GEARED)
    one = bench("ros2_control: {update_rate: 250}", robot=robot, cells=4, truth_rate=100.0)
    remaps = ("-r", "motor_states:=/joint_states", "-r", "joint_states:=/joint_states")
    estimator = one.estimator(*remaps, robot=robot)
    truths = one.listen(CableTensions, "truth/tensions")
    # nothing slips before the first command, so the estimator knows the friction history
    assert one.until(lambda: bool(truths and estimator.answers))
    first = stamp_ns(truths[-1])
    for count, speed in enumerate((2.5, -2.5, -2.5), start=1):  # each holds for half a second
        one.publish("commands/velocity", array_of(speed))
        wanted = first + count * 800_000_000
        assert one.until(lambda: estimator.answers[-1].stamp_ns > wanted < stamp_ns(truths[-1]))  # noqa: B023
    assert np.median(np.diff([stamp_ns(truth) for truth in truths])) == 10_000_000
    times = np.array([answer.stamp_ns for answer in estimator.answers])
    pairs = [
        (estimator.answers[np.argmin(np.abs(times - stamp))].tension, truth.tension)
        for truth in truths
        if first < (stamp := stamp_ns(truth)) < times[-1]
        and np.abs(times - stamp).min() < 4_500_000
    ]
    assert len(pairs) > 100
    told, true = (np.array(column) for column in zip(*pairs, strict=True))
    assert np.ptp(true[:, 0]) > 5.0, "the rig moved"
    assert np.mean(np.abs(told - true) / true) < 0.03
    assert np.all(np.abs(told - true).mean(axis=0) < 0.05 * true.mean(axis=0))


def test_the_rig_stands_in_for_hardware_under_ros2_control(bench, tmp_path):
    """A current drives the published position up, also that of a motor that turns the other way."""
    (tmp_path / "robot.yaml").write_text(GEARED)
    one = bench(
        "{ros2_control: {update_rate: 500}, motor_efforts: {noise: 0}, "
        "drives: {command_timeout: 30}}",
        robot=str(tmp_path / "robot.yaml"),
    )
    heard = one.listen(JointState, "/joint_states")
    rig = one.rig.rig
    for mode, value, reached in (
        ("position", -15.0, lambda: rig.motor_angle[0] == pytest.approx(0.3)),
        ("velocity", -50.0, lambda: rig.motor_angle[0] > 0.5),
        ("effort", 0.5 / 2.7, lambda: one.rig.drives.mode == "effort"),
    ):
        one.publish(f"/forward_{mode}_controller/commands", array_of(value))
        assert one.until(reached), mode
        assert one.rig.drives._target == pytest.approx(
            {"position": 0.3, "velocity": 1.0, "effort": -0.5}[mode]
        )
    one.publish("/forward_position_controller/commands", array_of(-5.0))
    assert one.until(lambda: rig.motor_angle[0] == pytest.approx(0.1))
    assert sum(one.rig.commands.refused.values()) == 0
    heard.clear()
    assert one.until(lambda: len(heard) > 300)
    message = heard[-1]
    assert list(message.name) == ["arm1_winch", "arm1_elbow"]
    assert message.header.frame_id == "base_link"
    steps = np.diff([stamp_ns(one) for one in heard])  # longer where the machine did not keep up
    assert np.min(steps) == np.median(steps) == 2_000_000
    assert message.position[0] == pytest.approx(-5.0, abs=0.01)
    assert len(message.velocity) == 2
    assert message.effort[0] == pytest.approx(rig.motor_effort[0] / 2.7, abs=1e-3)
    assert np.isnan(message.effort[1])


def test_invalid_commands_are_refused_and_counted_and_nothing_moves(bench):
    one = bench()
    heard = one.listen(DiagnosticArray, "/diagnostics")
    nan = float("nan")
    displaced = array_of(0.1)
    displaced.layout.data_offset = 1
    hostile = [
        ("commands/position", array_of(nan)),
        ("commands/position", array_of(0.1, 0.2)),
        ("commands/velocity", array_of(1e12)),
        ("commands/effort", displaced),
    ]
    for topic, message in hostile:
        one.publish(topic, message)
    assert one.until(lambda: sum(one.rig.commands.refused.values()) == len(hostile))
    wanted = {"malformed": 1, "wrong length": 1, "not finite": 1, "out of range": 1}
    assert one.rig.commands.refused == wanted
    assert one.rig.rig.motor_angle[0] == 0.0
    said = {f"refused: {cause}": str(count) for cause, count in wanted.items()}

    def told():
        return any(
            said.items() <= {v.key: v.value for v in message.status[0].values}.items()
            for message in heard
        )

    assert one.until(told)


def test_faults_happen_at_their_times_and_again_after_a_reset(bench):
    text = (
        "faults: [{kind: freeze, at: 1, encoder: winch}, "
        "{kind: snap, at: 1.5, cable: lower, amount: 1}]"
    )
    one = bench(text, truth_rate=100.0)
    tensions = one.listen(CableTensions, "truth/tensions")
    angles = one.listen(JointState, "motor_states")
    heard = one.listen(DiagnosticArray, "/diagnostics")

    def told(words):
        return any(
            words == value.value
            for message in heard
            for value in message.status[0].values
            if value.key == "faults"
        )

    for _ in range(2):
        assert one.until(lambda: tensions and tensions[-1].tension[8] > 20.0)
        assert one.until(lambda: one.rig.rig.time_s > 1.1)
        one.publish("commands/position", array_of(0.2))
        assert one.until(lambda: tensions[-1].tension[8] == 0.0)
        assert one.rig.rig.motor_angle[0] == 0.2
        assert tensions[-1].status[8] & SLACK
        assert angles[-1].position[0] == 0.0
        assert one.until(lambda: told("snap of lower, freeze of winch"))
        assert not one.call(
            Push, "rig/push", Push.Request(torque=float("inf"), duration=1.0)
        ).success
        assert one.call(Push, "rig/push", Push.Request(torque=20.0, duration=60.0)).success
        assert one.until(lambda: one.rig.rig.at_stop)
        before = stamp_ns(tensions[-1])
        assert one.call(Trigger, "rig/reset", Trigger.Request()).success
        assert one.until(lambda: tensions[-1].tension[8] > 20.0)
        assert stamp_ns(tensions[-1]) > before, "the stamps continue to increase"
        heard.clear()
    assert one.until(lambda: told("none"))


def test_load_cells_clock_and_payload(bench):
    text = "{load_cells: {elements: [upper/8, lower/1]}, motor_efforts: {}}"
    one = bench(text, drive_clock=True, speed=3)
    cells = one.listen(CableTensions, "tension_sensors")
    clock = one.listen(Clock, "/clock")
    motors = one.listen(JointState, "motor_states")
    assert one.until(lambda: len(cells) > 30 and len(clock) > 30)
    assert list(cells[-1].name) == ["upper/8", "lower/1"]
    settled = np.array([message.tension for message in cells])
    np.testing.assert_allclose(settled.mean(axis=0), one.rig.rig.tension[[7, 8]], atol=0.1)
    assert 0.0 < np.std(settled) < 20.0
    stamps = [m.clock.sec * 1_000_000_000 + m.clock.nanosec for m in clock]
    assert set(np.diff(stamps)) == {5_000_000}
    effort = np.array([message.effort[0] for message in motors])
    np.testing.assert_allclose(effort.mean(), one.rig.rig.motor_effort[0], atol=5e-3)

    def set_one(name, value):
        request = SetParameters.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg()]
        )
        answer = one.call(SetParameters, "rig/set_parameters", request)
        return bool(answer.results[0].successful)

    before = one.rig.rig.joint_angle[0]
    assert set_one("payload", 2), "an integer is converted to 2.0"
    assert one.until(lambda: one.rig.rig.joint_angle[0] < before - 1e-3)
    assert not set_one("payload", -2.0)
    assert not set_one("preload", [1.0, 2.0])
    assert not set_one("cells", 4)


def test_readings_are_published_in_the_order_of_their_arrival(bench):
    """Those of one step too: otherwise one topic always lags the other, as one of another clock."""
    rig = bench("motors: {latency: 0.0025}").rig
    sent = []

    class Recorder:
        def create_publisher(self, _, topic, __):
            return SimpleNamespace(publish=lambda message: sent.append((topic, message)))

    outputs = RigOutputs(Recorder(), load_model(ROBOT), rig.rig, rig.options)
    for _ in range(20):
        rig.rig.step(rig.rig.motor_angle)
        outputs.emit(rig.rig, np.zeros(1), rig.rig.time_s, 0)
    arrivals = [
        stamp_ns(deserialize_message(message, JointState))
        + (2_500_000 if topic == topics.MOTOR_STATES else 0)
        for topic, message in sent
    ]
    assert {topic for topic, _ in sent} == {topics.MOTOR_STATES, topics.JOINT_STATES}
    assert len(arrivals) > 20
    assert arrivals == sorted(arrivals)


def test_a_rig_that_cannot_keep_up_skips_time_and_reports_it(bench):
    one = bench(drive_clock=True, speed=100.0, cells=8)  # 10 us per step cannot be reached
    heard = one.listen(DiagnosticArray, "/diagnostics")
    assert one.until(
        lambda: any(message.status[0].message.startswith("cannot keep up") for message in heard)
    )
    values = {v.key: v.value for v in heard[-1].status[0].values}
    assert float(values["time left out [s]"]) > 0.0
    steps = one.rig.rig.steps
    assert one.until(lambda: one.rig.rig.steps > steps + 100)


def test_after_a_pause_the_stamps_continue_at_the_time_of_the_machine(bench):
    one = bench()
    heard = one.listen(JointState, "motor_states")
    assert one.until(lambda: len(heard) > 10)
    one.rig._origin_ns -= 2_000_000_000  # as if the process had been stopped for two seconds
    count = len(heard)
    assert one.until(lambda: len(heard) > count + 100)
    between = np.diff([stamp_ns(message) for message in heard])
    assert (between > 0).all()
    assert between.max() > 1_900_000_000


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"robot": ""}, "the parameter robot is missing"),
        ({"use_sim_time": True}, "the rig keeps its own time"),
        ({"joint": "knee"}, "joint must be one of elbow, got 'knee'"),
        ({"rig": "nosy"}, "there is no rig file nosy"),
        ({"motion": "waltz"}, "motion must be one of none, sine"),
        ({"speed": 2.0}, "speed 2 needs drive_clock"),
    ],
)
def test_an_invalid_parameter_is_refused_at_the_start(ros, given, words):
    made = []
    with pytest.raises(CdrjError, match=words):
        made.append(RigNode(parameter_overrides=overrides(**given)))
    assert not made

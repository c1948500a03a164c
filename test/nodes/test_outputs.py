"""What the node publishes: values, frames, a maximum rate, and nothing that nobody listens to."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from cdrj_msgs.msg import CableTensions, NodalForces
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import JointState
from support.estimators import (
    BEGIN,
    JOINT,
    MILLISECOND,
    MOTOR,
    ROBOT,
    diagnosed,
    expected,
    feed,
    sample_at,
    tensions,
    values_of,
)
from support.fingers import finger, hand
from support.places import ROBOTS

from cdrj_ros.messages.cdr import JOINT_STATE, read_layout
from cdrj_ros.messages.templates import Template, marked_stale
from cdrj_ros.model.following import following_motors
from cdrj_ros.model.packing import INVALID
from cdrj_ros.model.prepared import load_model

PLACED = str(ROBOTS / "prototype_positions.yaml")


def test_tensions_by_name_and_forces_on_pulleys_are_those_of_the_estimate(bench):
    estimator = bench.estimator(robot=PLACED, frame_id="arm")
    wrenches = []
    others = []
    for kind, topic in (
        (CableTensions, "tensions"), (NodalForces, "nodal_forces"), (JointState, "efforts"),
    ):  # fmt: skip
        bench.node.create_subscription(kind, f"/cdrj/{topic}", others.append, 10)
    states = bench.listen(JointState, "/cdrj/tension_states")
    bench.node.create_subscription(WrenchStamped, "/cdrj/wrenches/upper_3", wrenches.append, 10)
    outputs = estimator.outputs
    assert bench.until(lambda: bool(outputs.wanted and outputs.states_wanted))
    feed(estimator, 0, 5)
    assert bench.until(lambda: len(states) == len(wrenches) == 5 and len(others) >= 15)
    assert {one.header.frame_id for one in (*states, *wrenches, *others)} == {"arm"}
    layout, estimate = estimator.live.model.layout, estimator.latest
    state, wrench = states[-1], wrenches[-1]
    assert tuple(state.name) == layout.elements
    assert np.array_equal(state.effort, estimate.tension)
    assert not len(state.velocity)
    assert not len(state.position)
    k = layout.pulleys.index("upper/3")
    force = wrench.wrench.force
    wanted = [estimate.values[getattr(layout, f"force_{axis}")][k] for axis in "xyz"]
    assert [force.x, force.y, force.z] == wanted
    assert np.hypot(force.x, force.y) > 1.0
    assert wrench.header.stamp.sec * 10**9 + wrench.header.stamp.nanosec == estimate.stamp_ns

    invalid = replace(marked_stale(estimate), solved=False)
    invalid.status[:] = INVALID
    for unknown in (marked_stale(estimate), invalid):
        outputs.publish(unknown)
    feed(estimator, 5, 6)
    assert bench.until(lambda: len(states) > 5 and len(wrenches) > 5)
    assert len(states) == len(wrenches) == 6, "a message without status says nothing unknown"


def test_wrenches_of_cables_without_positions_are_in_the_frame_of_each_pulley(bench):
    estimator = bench.estimator()
    forces = []
    wrenches = bench.listen(WrenchStamped, "/cdrj/wrenches/lower_5")
    bench.node.create_subscription(NodalForces, "/cdrj/nodal_forces", forces.append, 10)
    assert bench.until(lambda: bool(estimator.outputs.wanted))
    feed(estimator, 0, 1)
    assert bench.until(lambda: bool(wrenches) and bool(forces))
    assert wrenches[0].header.frame_id == "lower_5"
    assert forces[0].header.frame_id == "", "in the frame of each pulley"
    opened = {name for name, _ in bench.node.get_topic_names_and_types() if "wrenches" in name}
    assert opened == {"/cdrj/wrenches/lower_5"}


def efforts_of(payload):
    """Stamp [ns], names and efforts of a JointState."""
    layout = read_layout(payload, JOINT_STATE.fields)
    sec, nanosec = np.frombuffer(payload, "<i4", 2, 4).tolist()
    span = layout.numbers["effort"]
    effort = np.frombuffer(payload, span.dtype, span.count, span.offset)
    return sec * 1_000_000_000 + nanosec, layout.texts["name"], effort


def test_efforts_are_empty_for_unsolved_cables_and_have_standard_deviations_otherwise(bench):
    estimator = bench.estimator()
    heard = {"efforts": [], "efforts_stddev": []}
    for topic, payloads in heard.items():
        bench.node.create_subscription(JointState, f"/cdrj/{topic}", payloads.append, 100, raw=True)
    assert bench.until(lambda: estimator.outputs.efforts.get_subscription_count() > 0)
    assert bench.until(lambda: estimator.outputs.stddev_wanted)
    far = sample_at(0)
    estimator.joint(JOINT.encode(far.stamp_ns, position=far.joint_angle))
    estimator.motor(MOTOR.encode(far.stamp_ns, position=far.motor_angle + 1e4))
    assert not estimator.latest.solved
    assert bench.until(lambda: all(len(payloads) == 1 for payloads in heard.values()))
    for (payload,) in heard.values():
        stamp, names, effort = efforts_of(payload)
        assert (stamp, names, effort.size) == (far.stamp_ns, ("winch", "elbow"), 0)
    estimator.live.reset()
    feed(estimator, 1, 3)
    assert bench.until(lambda: all(len(payloads) == 3 for payloads in heard.values()))
    estimate = estimator.latest
    layout = estimate.layout
    wanted = estimate.values[layout.motor_effort.start : layout.joint_effort.stop]
    assert np.array_equal(efforts_of(heard["efforts"][-1])[2], wanted)
    said = efforts_of(heard["efforts_stddev"][-1])[2]
    assert np.array_equal(said, estimate.stddev[-2:])
    assert np.all(said > 0.0)


def test_a_maximum_rate_omits_messages_and_changes_no_bit(bench):
    everything, slow = bench.estimator(), bench.estimator("-r", "__ns:=/slow", max_rate=100)
    for one in (everything, slow):
        feed(one, 0, 600)
    assert np.array_equal(tensions(everything), expected((load_model(ROBOT),), (range(600),)))
    whole = {one.stamp_ns: one for one in everything.answers}
    assert len(slow.answers) == pytest.approx(60, abs=1)
    for one in slow.answers:
        same = whole[one.stamp_ns]
        assert np.array_equal(one.values, same.values)
        assert np.array_equal(one.stddev, same.stddev)
    last = everything.latest
    assert np.array_equal(slow.latest.values, last.values)


def test_a_silent_axis_takes_its_cables_away_on_every_topic_and_is_named(bench, tmp_path):
    """What has no status leaves them out."""
    path = tmp_path / "hand.yaml"
    path.write_text(yaml.safe_dump(dict(hand(finger("a"), finger("b")).document)), encoding="utf-8")
    estimator = bench.estimator(robot=str(path))
    states = bench.listen(JointState, "/cdrj/tension_states")
    answers = bench.listen(CableTensions, "/cdrj/tensions")
    efforts = bench.listen(JointState, "/cdrj/efforts")
    assert bench.until(lambda: estimator.outputs.states_wanted)
    model = estimator.live.model
    motor, joint, some = (
        Template(JOINT_STATE, names, ("position",))
        for names in (model.layout.motors, model.layout.joints, ("a_mcp", "a_pip", "b_pip"))
    )
    for k in range(0, 1500, 5):
        angle = np.full((1, 4), 0.3 + 0.2 * np.sin(0.003 * k))
        stamp = BEGIN + k * MILLISECOND
        estimator.motor(motor.encode(stamp, position=following_motors(model, angle)[0]))
        if k < 1000:
            estimator.joint(joint.encode(stamp, position=angle[0]))
        else:
            estimator.joint(some.encode(stamp, position=angle[0, :3]))
    assert bench.until(lambda: len(answers) == len(efforts) == len(states) == 300)
    last = zip(answers[-1].name, answers[-1].status, strict=True)
    known = [name for name, status in last if not status & CableTensions.STALE]
    assert known == [name for name in model.layout.elements if name.startswith("a_")]
    assert states[-1].name == known
    assert efforts[-1].name == ["a_motor0", "a_motor1", "a_mcp", "a_pip"]
    assert len(efforts[-1].effort) == 4
    assert len(efforts[0].effort) == 8
    found, *_ = diagnosed(estimator)
    assert found.level == DiagnosticStatus.ERROR
    assert "no reading accepted of b_mcp for 0.5 s" in found.message
    assert values_of(found)["axes not read"] == "b_mcp for 0.5 s"

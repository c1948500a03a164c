"""The example controllers as nodes: what they command for which estimates, and one closed loop."""

from time import monotonic

import numpy as np
import pytest
from cdrj_msgs.msg import CableTensions
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger
from support.estimators import Bench
from support.places import ROOT

EXAMPLES = ROOT / "examples"


class Controlled(Bench):
    """A controller in this process, and a node that wishes, estimates and hears its commands."""

    def __init__(self, controller, mode):
        super().__init__("cdrj")
        self.controller, self.mode = self.add(controller), mode
        self.commands = self.listen(Float64MultiArray, f"commands/{mode}")

    def wish(self, *values):
        self.publish(f"wished/{self.mode}", Float64MultiArray(data=list(values)))

    def tell(self, topic, message):
        message.header.stamp = self.node.get_clock().now().to_msg()
        self.publish(topic, message)

    def commanded(self, holds, *again):
        """Repeat what is published, once what it caused is heard, until a command fulfils this."""
        self.commands.clear()
        seen, due_s = 0, 0.0

        def fulfilled():
            nonlocal seen, due_s
            new = self.commands[seen:]
            seen += len(new)
            if new or monotonic() > due_s:
                due_s = monotonic() + 0.02
                for publish in again:
                    publish()
            return any(holds(list(command.data)) for command in new)

        return self.until(fulfilled)


@pytest.fixture
def controller(ros, monkeypatch):
    """Create a controller of the examples by the names of its module and class."""
    import importlib

    monkeypatch.syspath_prepend(str(EXAMPLES))
    opened = []

    def create(module, name, mode, **parameters):
        made = getattr(importlib.import_module(module), name)
        overrides = [Parameter(key, value=value) for key, value in parameters.items()]
        opened.append(Controlled(made(parameter_overrides=overrides), mode))
        return opened[-1]

    yield create
    for one in opened:
        one.close()


def tensions(upper, lower, status=0):
    names = [f"{cable}/{k}" for cable in ("upper", "lower") for k in range(1, 9)]
    return CableTensions(
        name=names, tension=[upper] * 8 + [lower] * 8, stddev=[0.5] * 16, status=[status] * 16
    )


def test_the_limiter_forwards_reduces_and_reverses_speeds(controller):
    bench = controller("tension_limiter", "LimiterNode", "velocity", limit=60.0)

    def send(message):
        return lambda: bench.wish(2.0), lambda: bench.tell("tensions", message)

    assert bench.commanded(lambda c: c == [2.0], *send(tensions(40.0, 30.0)))
    assert bench.commanded(lambda c: 0.0 < c[0] < 1.0, *send(tensions(57.0, 30.0)))
    assert bench.commanded(lambda c: c[0] < 0.0, *send(tensions(62.0, 30.0)))
    assert bench.commanded(lambda c: c == [2.0], *send(tensions(30.0, 58.0))), "this cable pays out"
    for flag in (CableTensions.UNSURE, CableTensions.STALE, CableTensions.INVALID):
        assert bench.commanded(lambda c: c == [2.0], *send(tensions(40.0, 30.0)))
        assert bench.commanded(lambda c: c == [0.0], *send(tensions(40.0, 30.0, flag)))
    for field in ("tension", "stddev"):
        assert bench.commanded(lambda c: c == [2.0], *send(tensions(40.0, 30.0)))
        unknown = tensions(40.0, 30.0)
        getattr(unknown, field)[3] = np.nan
        assert bench.commanded(lambda c: c == [0.0], *send(unknown))


def test_the_preloads_of_the_file_return_while_a_tension_is_not_known(controller):
    bench = controller("keep_taut", "TautNode", "position", floor=50.0)

    def send(lower):
        return lambda: bench.wish(0.0), lambda: bench.tell("tensions", tensions(40.0, lower))

    assert bench.commanded(lambda c: abs(c[0]) > 0.0, *send(30.0))
    most = abs(bench.commands[-1].data[0])
    assert bench.commanded(lambda c: abs(c[0]) < 0.9 * most, *send(np.nan))
    without = (lambda: bench.wish(0.0),)
    assert bench.commanded(lambda c: 0.5 * most < abs(c[0]) < 0.8 * most, *without), "no jump"


def test_the_motors_stop_without_commands_and_without_tensions(controller):
    bench = controller("tension_limiter", "LimiterNode", "velocity", limit=60.0)
    feed = (lambda: bench.wish(2.0), lambda: bench.tell("tensions", tensions(40.0, 30.0)))
    assert bench.commanded(lambda c: c == [2.0], *feed)
    assert bench.commanded(lambda c: c == [0.0], feed[1]), "nobody wishes any more"
    assert bench.commanded(lambda c: c == [2.0], *feed)
    assert bench.commanded(lambda c: c == [0.0], feed[0]), "no tensions any more"


def _stop_feed(bench, extra, stddev):
    """What the collision stop hears: a wished speed, the joint at rest, and its effort [N m]."""
    held = bench.controller.observer.required(0.0)  # against the weight
    spread = JointState(name=["elbow"], effort=[] if stddev is None else [stddev])
    return [
        lambda: bench.wish(1.0),
        lambda: bench.tell("joint_states", JointState(name=["elbow"], position=[0.0])),
        lambda: bench.tell("efforts_stddev", spread),
        lambda: bench.tell("efforts", JointState(name=["elbow"], effort=[held - extra])),
    ]


def test_a_push_stops_the_motors_until_they_are_released(controller):
    bench = controller("collision_stop", "CollisionNode", "velocity", threshold=0.5)
    calm, push = (_stop_feed(bench, extra, None) for extra in (0.0, 2.0))
    assert bench.commanded(lambda c: c == [1.0], *calm)
    assert bench.commanded(lambda c: c == [0.0], *push)
    assert "push" in bench.controller.reason
    client = bench.node.create_client(Trigger, "collision_stop/release")
    observer = bench.controller.observer  # remembers the push for a while
    assert bench.commanded(lambda _: abs(observer.torque) < 0.1, *calm)
    assert bench.until(client.service_is_ready)
    done = client.call_async(Trigger.Request())
    assert bench.commanded(lambda _: done.done(), *calm)
    assert "push" in done.result().message
    assert bench.commanded(lambda c: c == [1.0] and not bench.controller.reason, *calm)


def test_the_motors_stop_while_an_effort_is_not_known(controller):
    bench = controller("collision_stop", "CollisionNode", "velocity", threshold=0.5)
    calm = _stop_feed(bench, 0.0, None)
    for unknown in (JointState(name=["elbow"], effort=[np.nan]), JointState(effort=[1.0])):
        assert bench.commanded(lambda c: c == [1.0], *calm)
        no_effort = (*calm[:3], lambda message=unknown: bench.tell("efforts", message))
        assert bench.commanded(lambda c: c == [0.0], *no_effort)
        assert not bench.controller.reason

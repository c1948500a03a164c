"""The launch files: required arguments, refused arguments, and the nodes they start."""

import os
import runpy
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
from support.places import ROOT

from cdrj_ros.messages.topics import BROADCAST

FILE = ROOT / "launch" / "estimator.launch.py"
DEMO = FILE.with_name("demo.launch.py")
CDRJ = FILE.with_name("cdrj.launch.py")
STACK = FILE.with_name("ros2_control.launch.py")
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PATIENCE_S = 120.0


class Action(SimpleNamespace):
    """Replaces an action of launch and stores its arguments."""

    def __init__(self, *given, **named):
        super().__init__(given=given, **named)

    @property
    def name(self):
        return str(self.given[0])


class Replaced(ModuleType):
    """A module of launch whose classes are all actions."""

    def __getattr__(self, name):
        if name.startswith("_"):
            raise AttributeError(name)
        setattr(self, name, type(name, (Action,), {}))
        return getattr(self, name)


@pytest.fixture
def launched(monkeypatch):
    """Run the functions of the launch file with a replacement for launch."""
    for name in (
        "launch", "launch.actions", "launch.event_handlers", "launch.events",
        "launch.launch_description_sources", "launch.substitutions", "launch_ros",
        "launch_ros.actions", "launch_ros.event_handlers", "launch_ros.events",
        "launch_ros.events.lifecycle",
    ):  # fmt: skip
        monkeypatch.setitem(sys.modules, name, Replaced(name))
    monkeypatch.setattr(sys, "argv", ["ros2", "launch", "cdrj_ros", FILE.name])

    def run(*argv, file=FILE, included=None):
        space = runpy.run_path(str(file))
        (entities,) = space["generate_launch_description"]().given
        arguments = {one.name: one for one in entities if hasattr(one, "description")}
        if included is not None:
            more = runpy.run_path(str(included))["ARGUMENTS"]
            arguments |= {one.name: one for one in more}
        given = dict(one.split(":=") for one in argv)
        configurations = {
            name: given.get(name, getattr(one, "default_value", None))
            for name, one in arguments.items()
        }
        context = SimpleNamespace(argv=list(argv), launch_configurations=configurations)
        actions = [one.function(context) for one in entities if hasattr(one, "function")]
        return [one for made in actions if made for one in made]

    return run


def test_the_node_gets_the_given_arguments_and_no_others(launched):
    (node,) = launched("robot:=r.yaml")
    assert node.parameters == [{"robot": "r.yaml"}]
    assert (node.namespace, node.arguments, node.ros_arguments) == ("cdrj", ["--supervised"], [])

    change, node = launched(
        "robot:=r.yaml", "params_file:=/p.yaml", "state_file:=/s", "preload:=30,20.5",
        "conditioning:=predict", "log_level:=debug", "namespace:=left", "use_sim_time:=true",
        "motor_states:=/m", "discovery_range:=SUBNET",
    )  # fmt: skip
    assert change.given == (RANGE, "SUBNET")
    assert node.parameters == [
        "/p.yaml",
        {
            "robot": "r.yaml",
            "conditioning": "predict",
            "use_sim_time": True,
            "preload": [30.0, 20.5],
        },
    ]
    assert node.namespace == "left"
    assert node.arguments == ["--supervised", "--state-file", "/s"]
    assert node.ros_arguments == ["--log-level", "debug"]
    assert node.remappings == [("motor_states", "/m"), ("joint_states", "joint_states")]


def test_an_unknown_argument_is_refused_with_the_nearest_known_one(launched, monkeypatch):
    with pytest.raises(RuntimeError, match="'params_fle': did you mean params_file"):
        launched("robot:=r.yaml", "params_fle:=x")
    with pytest.raises(RuntimeError, match="preload must be numbers"):
        launched("robot:=r.yaml", "preload:=much")
    # another launch file that includes this one has arguments of its own
    monkeypatch.setattr(sys, "argv", ["ros2", "launch", "my_robot", FILE.name])
    launched("robot:=r.yaml", "arm:=left")


def test_a_managed_node_is_configured_and_activated_unless_another_program_does_it(launched):
    activate, configure, node = launched("robot:=r.yaml", "managed:=true")
    assert type(node).__name__ == "LifecycleNode"
    assert node.arguments == ["--supervised", "--managed"]
    (event,) = configure.given[0].on_start
    assert event.event.transition_id == 1
    (event,) = activate.given[0].entities
    assert event.event.transition_id == 3
    (node,) = launched("robot:=r.yaml", "managed:=true", "autostart:=false")
    assert node.arguments == ["--supervised", "--managed"]


def test_the_launch_file_of_a_real_robot_adds_what_is_asked_for(launched, monkeypatch):
    assert launched("robot:=r.yaml", file=CDRJ, included=FILE) == []
    (markers,) = launched("robot:=r.yaml", "markers:=true", file=CDRJ, included=FILE)
    assert markers.executable == "markers"
    assert markers.parameters == [{"robot": "r.yaml", "prefix": ""}]
    monkeypatch.setattr(sys, "argv", ["ros2", "launch", "cdrj_ros", CDRJ.name])
    with pytest.raises(RuntimeError, match="'marker': did you mean markers"):
        launched("robot:=r.yaml", "marker:=true", file=CDRJ, included=FILE)


def test_the_stand_in_for_hardware_publishes_what_the_launch_file_of_a_real_robot_hears(launched):
    (rig,) = launched("robot:=r.yaml", "prefix:=arm1_", file=STACK)
    assert (rig.executable, rig.arguments) == ("rig", ["--supervised"])
    given = rig.parameters[0]
    assert given["rig"] == "ros2_control"
    assert (given["robot"], given["prefix"], given["motion"]) == ("r.yaml", "arm1_", "none")
    (entities,) = runpy.run_path(str(STACK))["generate_launch_description"]().given
    included = dict(entities[-1].launch_arguments)
    assert included["motor_states"] == included["joint_states"] == BROADCAST
    assert (FILE.parents[1] / "config" / "rigs" / "ros2_control.yaml").exists()


def examples_of(actions):
    """The examples that are started, and the words after their paths."""
    commands = [one.cmd for one in actions if hasattr(one, "cmd")]
    assert all(Path(command[1]).exists() for command in commands)
    return {Path(command[1]).stem: command[2:] for command in commands}


def nodes_of(actions):
    """The nodes that are started, and their parameters."""
    return {one.executable: one.parameters[0] for one in actions if hasattr(one, "executable")}


def test_the_demonstration_starts_rig_estimator_and_markers_of_one_exact_robot(launched):
    actions = launched("view:=false", file=DEMO)
    nodes = nodes_of(actions)
    assert list(nodes) == ["estimator", "rig", "markers"]
    (robot,) = {one["robot"] for one in nodes.values()}
    assert Path(robot).name == "finger.yaml"
    assert "others: exact" in Path(robot).read_text()
    assert (nodes["rig"]["motion"], nodes["rig"]["rig"]) == ("sine", "hand")
    assert examples_of(actions) == {"compare": []}
    (cleaning,) = [one for one in actions if type(one).__name__ == "RegisterEventHandler"]
    cleaning.given[0].on_shutdown(None, None)
    assert not Path(robot).exists()
    nodes = nodes_of(launched("robot:=hoist", "exact:=false", "view:=true", file=DEMO))
    assert {one["robot"] for one in nodes.values()} == {"hoist"}
    assert "view" in nodes


def test_the_demonstration_starts_a_controller_and_publishes_its_wish(launched):
    given = ("robot:=prototype", "exact:=false", "view:=false")
    actions = launched(*given, "controller:=tension_limiter", "wish:=0.5", file=DEMO)
    assert nodes_of(actions)["rig"]["motion"] == "none"
    started = examples_of(actions)
    assert list(started) == ["compare", "tension_limiter", "wish"]
    assert started["wish"] == ["velocity", "0.5"]
    started = examples_of(launched(*given, "wish:=0.5", file=DEMO))
    assert list(started) == ["compare", "wish"]
    assert started["wish"][-1] == "wished/velocity:=commands/velocity", "to the rig itself"
    started = examples_of(launched(*given, "controller:=keep_taut", file=DEMO))
    assert list(started) == ["compare", "keep_taut", "swing"]
    with pytest.raises(RuntimeError, match="friction_feedforward takes no wish"):
        launched(*given, "controller:=friction_feedforward", "wish:=0.5", file=DEMO)


def launch(*arguments):
    """Start the real `ros2 launch` of this package."""
    return subprocess.Popen(
        ["ros2", "launch", "cdrj_ros", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )


def until(process, *words):
    """Read the output until every word has occurred, then interrupt; returns the whole output."""
    said = ""
    try:
        while not all(word in said for word in words):
            line = process.stdout.readline()
            assert line, said
            said += line
    finally:
        process.send_signal(signal.SIGINT)
        rest, _ = process.communicate(timeout=PATIENCE_S)
    return said + rest


with_launch = pytest.mark.skipif(
    shutil.which("ros2") is None, reason="ROS 2 launch is not installed: no command ros2"
)


@with_launch
def test_the_real_launch_activates_a_managed_node_and_starts_the_markers():
    said = until(
        launch(CDRJ.name, "robot:=prototype", "markers:=true", "managed:=true", "preload:=30,20"),
        "no estimate: no reading of winch",  # said by an active node only
        "cdrj.markers",
    )
    assert said.count("process has finished cleanly") == 2


@with_launch
def test_the_real_launch_of_the_demonstration_estimates():
    said = until(launch(DEMO.name, "robot:=prototype", "view:=false"), "first estimate")
    for node in ("estimator-1", "rig-2", "markers-3"):
        assert f"[{node}]: process has finished cleanly" in said

"""The launch file: required arguments, refused arguments, and the node it starts."""

from __future__ import annotations

import os
import runpy
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

FILE = Path(__file__).parents[2] / "launch" / "estimator.launch.py"
DEMO = FILE.with_name("demo.launch.py")
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PATIENCE_S = 120.0


class Action(SimpleNamespace):
    """Replaces an action of launch and stores its arguments."""

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(given=given, **named)

    @property
    def name(self) -> str:
        return str(self.given[0])


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Run the functions of the launch file with a replacement for launch."""
    modules = {
        name: ModuleType(name)
        for name in ("launch", "launch.actions", "launch_ros", "launch_ros.actions")
    }
    for module, names in (
        ("launch", ("LaunchContext", "LaunchDescription")),
        (
            "launch.actions",
            (
                "DeclareLaunchArgument",
                "ExecuteProcess",
                "OpaqueFunction",
                "SetEnvironmentVariable",
            ),
        ),
        ("launch_ros.actions", ("Node",)),
    ):
        for name in names:
            setattr(modules[module], name, type(name, (Action,), {}))
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(sys, "argv", ["ros2", "launch", "cdrj_ros", FILE.name])

    def run(*argv: str, file: Path = FILE) -> list[Any]:
        space = runpy.run_path(str(file))
        (entities,) = space["generate_launch_description"]().given
        arguments = {one.name: one for one in entities if hasattr(one, "description")}
        given = dict(one.split(":=") for one in argv)
        configurations = {
            name: given.get(name, getattr(one, "default_value", None))
            for name, one in arguments.items()
        }
        context = SimpleNamespace(argv=list(argv), launch_configurations=configurations)
        actions = [one.function(context) for one in entities if hasattr(one, "function")]
        return [one for made in actions if made for one in made]

    return run


def test_robot_is_required_and_all_other_arguments_have_a_default(launched: Any) -> None:
    space = runpy.run_path(str(FILE))
    without = [one.name for one in space["ARGUMENTS"] if not hasattr(one, "default_value")]
    assert without == ["robot"]


def test_the_node_gets_the_given_arguments_and_no_others(launched: Any) -> None:
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


def test_the_parameter_file_is_installed_beside_the_launch_file() -> None:
    from ament_index_python.packages import get_package_share_directory

    share = Path(get_package_share_directory("cdrj_ros"))
    assert (share / "launch" / FILE.name).read_bytes() == FILE.read_bytes()
    own = FILE.parents[1] / "config" / "estimator.params.yaml"
    assert (share / "config" / own.name).read_bytes() == own.read_bytes()


def test_an_exported_discovery_range_is_kept(launched: Any) -> None:
    """The node itself limits discovery to this machine if the environment does not set a range."""
    assert [type(one).__name__ for one in launched("robot:=r.yaml")] == ["Node"]


def test_an_unknown_argument_is_refused_with_the_nearest_known_one(
    launched: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(RuntimeError, match="'params_fle': did you mean params_file"):
        launched("robot:=r.yaml", "params_fle:=x")
    with pytest.raises(RuntimeError, match="preload must be numbers"):
        launched("robot:=r.yaml", "preload:=much")
    # another launch file that includes this one has arguments of its own
    monkeypatch.setattr(sys, "argv", ["ros2", "launch", "my_robot", FILE.name])
    launched("robot:=r.yaml", "arm:=left")


def test_the_demonstration_starts_rig_estimator_and_markers_of_one_robot(launched: Any) -> None:
    estimator, rig, markers = launched("robot:=finger", file=DEMO)
    assert [one.executable for one in (estimator, rig, markers)] == ["estimator", "rig", "markers"]
    assert {one.parameters[0]["robot"] for one in (estimator, rig, markers)} == {"finger"}
    assert rig.parameters[0]["motion"] == "sine"


def test_the_demonstration_starts_a_controller_and_publishes_its_wish(launched: Any) -> None:
    *nodes, controller, wish = launched("controller:=tension_limiter", "wish:=0.5", file=DEMO)
    assert nodes[1].parameters[0]["motion"] == "none"
    script = Path(controller.cmd[1])
    assert script == DEMO.parents[1] / "examples" / "tension_limiter.py"
    assert script.exists()
    assert [Path(wish.cmd[1]).name, *wish.cmd[2:]] == ["wish.py", "velocity", "0.5"]
    with pytest.raises(RuntimeError, match="wish needs a controller of tension_limiter"):
        launched("wish:=0.5", file=DEMO)


def test_the_demonstration_knows_every_controller_and_its_kind_of_wish(launched: Any) -> None:
    examples = DEMO.parents[1] / "examples"
    known = runpy.run_path(str(DEMO))["CONTROLLERS"]
    between = [p for p in examples.glob("*.py") if "import Between" in p.read_text()]
    assert sorted(name for name, kind in known.items() if kind) == sorted(p.stem for p in between)
    for path in between:
        assert f'"{path.stem}", "{known[path.stem]}",' in path.read_text()


@pytest.mark.skipif(
    shutil.which("ros2") is None, reason="ROS 2 launch is not installed: no command ros2"
)
def test_the_real_launch_starts_the_node_and_refuses_a_misspelt_argument() -> None:
    def launch(*arguments: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            ["ros2", "launch", "cdrj_ros", FILE.name, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )

    wrong = {
        (): "required argument 'robot'",
        ("robots:=prototype",): "given: [robots]",
        ("robot:=prototype", "name_space:=left"): "did you mean namespace",
    }
    for arguments, words in wrong.items():
        output, _ = launch(*arguments).communicate(timeout=PATIENCE_S)
        assert words in output
    process = launch("robot:=prototype", "preload:=30,20", "namespace:=left")
    said = ""
    try:
        assert process.stdout is not None
        while "14 pulleys" not in said:
            line = process.stdout.readline()
            assert line, said
            said += line
        assert "left.estimator" in said
    finally:
        process.send_signal(signal.SIGINT)
        rest, _ = process.communicate(timeout=PATIENCE_S)
    assert "process has finished cleanly" in rest

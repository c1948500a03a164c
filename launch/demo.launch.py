"""A robot without hardware: rig, estimator, markers and view, and a controller if one is named.

ros2 launch cdrj_ros demo.launch.py
ros2 launch cdrj_ros demo.launch.py controller:=tension_limiter wish:=0.5
"""

import sys
from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction
from launch_ros.actions import Node

from cdrj_ros.nodes.launching import PACKAGE, refuse_unknown, view_is_installed

CONTROLLERS = {
    "tension_limiter": "velocity",
    "collision_stop": "velocity",
    "keep_taut": "position",
    "friction_feedforward": "",
}
"""The examples, and the kind of command that each of them expects as a wish."""

ARGUMENTS = [
    DeclareLaunchArgument(
        "robot",
        default_value="prototype",
        description="Robot file (YAML), or the name of an installed one.",
    ),
    DeclareLaunchArgument(
        "motion",
        default_value="sine",
        choices=["sine", "ramps", "dwell", "random", "none"],
        description="Motion of the rig until the first command; not used with a wish.",
    ),
    DeclareLaunchArgument(
        "controller",
        default_value="",
        choices=["", *CONTROLLERS],
        description="Controller to start; none by default.",
    ),
    DeclareLaunchArgument(
        "wish",
        default_value="",
        description="Wished speeds [rad/s] or angles [rad] of all motors, separated by commas, "
        "published 50 times a second to the controller.",
    ),
    DeclareLaunchArgument(
        "view",
        default_value="true" if view_is_installed() else "false",
        choices=["true", "false"],
        description="Whether to serve the browser view; by default if the extra `view` is "
        "installed.",
    ),
    DeclareLaunchArgument(
        "truth_rate", default_value="50.0", description="Rate of the rig's true tensions [Hz]."
    ),
]


def _nodes(context: LaunchContext) -> list[Node | ExecuteProcess]:
    given = {argument.name: context.launch_configurations[argument.name] for argument in ARGUMENTS}
    refuse_unknown(Path(__file__), context.argv, list(given))
    robot = {"robot": given["robot"]}
    controller, wish = given["controller"], given["wish"]
    kind = CONTROLLERS.get(controller, "")
    if wish and not kind:
        able = ", ".join(name for name, one in CONTROLLERS.items() if one)
        raise RuntimeError(f"wish needs a controller of {able}, got {controller!r}")
    motion = "none" if wish else given["motion"]
    rig = {**robot, "motion": motion, "truth_rate": float(given["truth_rate"])}
    started: list[Node | ExecuteProcess] = [
        Node(
            package=PACKAGE,
            executable=name,
            output="screen",
            arguments=["--supervised"],
            parameters=[parameters],
        )
        for name, parameters in (
            ("estimator", robot),
            ("rig", rig),
            ("markers", robot),
            *([("view", robot)] if given["view"] == "true" else []),
        )
    ]
    examples = Path(__file__).resolve().parents[1] / "examples"
    if controller:
        options = ["--ros-args", "-p", f"robot:={given['robot']}"]
        if controller == "tension_limiter":
            options += ["-p", "creep_speed:=0.3"]
        command = [sys.executable, str(examples / f"{controller}.py"), *options]
        started.append(ExecuteProcess(cmd=command, output="screen"))
    if wish:
        command = [sys.executable, str(examples / "wish.py"), kind, *wish.split(",")]
        started.append(ExecuteProcess(cmd=command, output="screen"))
    return started


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=_nodes)])

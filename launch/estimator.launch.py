"""Start the estimator: `ros2 launch cdrj_ros estimator.launch.py robot:=my_robot.yaml`."""

import sys
from difflib import get_close_matches
from itertools import pairwise
from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable
from launch_ros.actions import Node

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PACKAGE = "cdrj_ros"

ARGUMENTS = [
    DeclareLaunchArgument(
        "robot", description="Robot file (YAML), or the name of an installed one."
    ),
    DeclareLaunchArgument(
        "namespace", default_value="cdrj", description="Namespace of the node and its topics."
    ),
    DeclareLaunchArgument(
        "motor_states",
        default_value="motor_states",
        description="Topic of the motor angles (sensor_msgs/JointState).",
    ),
    DeclareLaunchArgument(
        "joint_states",
        default_value="joint_states",
        description="Topic of the joint angles (sensor_msgs/JointState).",
    ),
    DeclareLaunchArgument(
        "params_file",
        default_value="",
        description="Parameters of the node (YAML), as in config/estimator.params.yaml; the "
        "arguments given here override it.",
    ),
    DeclareLaunchArgument(
        "state_file",
        default_value="",
        description="File in which the state is stored for the next start; none by default.",
    ),
    DeclareLaunchArgument(
        "preload",
        default_value="",
        description="Preload of every cable [N], as 36.85,26.26; the robot file's by default.",
    ),
    DeclareLaunchArgument(
        "conditioning",
        default_value="",
        choices=["", "wait", "predict"],
        description="Wait for the slower topic (the default), or predict it.",
    ),
    DeclareLaunchArgument(
        "use_sim_time",
        default_value="",
        choices=["", "true", "false", "True", "False"],
        description="Whether to take the time from /clock; false by default.",
    ),
    DeclareLaunchArgument(
        "log_level",
        default_value="",
        choices=["", "debug", "info", "warn", "error", "fatal"],
        description="Lowest severity that is logged; info by default.",
    ),
    DeclareLaunchArgument(
        "discovery_range",
        default_value="",
        choices=["", "LOCALHOST", "SUBNET", "OFF", "SYSTEM_DEFAULT"],
        description=f"Computers with which the node communicates. By default {RANGE} and related "
        "variables of the environment decide; if none is set, only this computer.",
    ),
]


def _on_command_line(argv: list[str]) -> bool:
    """Whether `ros2 launch` starts this file itself, not a file that includes it."""
    here = Path(__file__)
    return any(
        Path(one).name == here.name and (before == PACKAGE or Path(one).resolve() == here.resolve())
        for before, one in pairwise(argv)
    )


def _refuse_unknown(context: LaunchContext) -> None:
    """Refuse unknown arguments, since launch would ignore a misspelt one silently."""
    if not _on_command_line(sys.argv):
        return
    known = [argument.name for argument in ARGUMENTS]
    for given in context.argv:
        name, assigned, _ = given.partition(":=")
        if assigned and name not in known:
            close = get_close_matches(name, known, n=1)
            nearest = f"did you mean {close[0]}? " if close else ""
            raise RuntimeError(
                f"there is no argument {name!r}: {nearest}There are {', '.join(known)}"
            )


def _nodes(context: LaunchContext) -> list[SetEnvironmentVariable | Node]:
    """The node, with only those arguments that the user has set."""
    given = {argument.name: context.launch_configurations[argument.name] for argument in ARGUMENTS}
    parameters: dict[str, object] = {"robot": given["robot"]}
    if given["conditioning"]:
        parameters["conditioning"] = given["conditioning"]
    if given["use_sim_time"]:
        parameters["use_sim_time"] = given["use_sim_time"].lower() == "true"
    if given["preload"]:
        try:
            parameters["preload"] = [float(one) for one in given["preload"].strip("[] ").split(",")]
        except ValueError:
            raise RuntimeError(
                f"preload must be numbers separated by commas, got {given['preload']!r}"
            ) from None
    environment = []
    if given["discovery_range"]:
        environment.append(SetEnvironmentVariable(RANGE, given["discovery_range"]))
    state = ["--state-file", given["state_file"]] if given["state_file"] else []
    files = [str(Path(given["params_file"]).resolve())] if given["params_file"] else []
    return [
        *environment,
        Node(
            package=PACKAGE,
            executable="estimator",
            namespace=given["namespace"],
            output="screen",
            arguments=["--supervised", *state],
            ros_arguments=["--log-level", given["log_level"]] if given["log_level"] else [],
            parameters=[*files, parameters],
            remappings=[
                ("motor_states", given["motor_states"]),
                ("joint_states", given["joint_states"]),
            ],
        ),
    ]


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        [OpaqueFunction(function=_refuse_unknown), *ARGUMENTS, OpaqueFunction(function=_nodes)]
    )

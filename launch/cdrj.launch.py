"""The estimator of a real robot, and what shows its estimates on request.

ros2 launch cdrj_ros cdrj.launch.py robot:=my_robot.yaml
ros2 launch cdrj_ros cdrj.launch.py robot:=my_robot.yaml params_file:=my.params.yaml markers:=true

It takes the arguments of estimator.launch.py too.
"""

import runpy
from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from cdrj_ros.nodes.entry import PACKAGE, refuse_unknown, view_is_installed

ESTIMATOR = Path(__file__).with_name("estimator.launch.py")
YES = ("true", "True")

ARGUMENTS = [
    DeclareLaunchArgument(
        "robot", description="Robot file (YAML), or the name of an installed one."
    ),
    DeclareLaunchArgument(
        "markers",
        default_value="false",
        choices=["true", "false", "True", "False"],
        description="Whether to publish markers for RViz.",
    ),
    DeclareLaunchArgument(
        "view",
        default_value="false",
        choices=["true", "false", "True", "False"],
        description="Whether to serve the browser view, which needs the extra `view`.",
    ),
]


def _refuse_unknown(context: LaunchContext) -> None:
    included = runpy.run_path(str(ESTIMATOR))["ARGUMENTS"]
    known = [argument.name for argument in (*included, *ARGUMENTS[1:])]
    refuse_unknown(Path(__file__), context.argv, known)


def _shown(context: LaunchContext) -> list[Node]:
    """The nodes that show estimates."""
    given = context.launch_configurations
    if given["view"] in YES and not view_is_installed():
        raise RuntimeError("view:=true needs the extra `view`: pip install viser")
    return [
        Node(
            package=PACKAGE,
            executable=name,
            namespace=given["namespace"],
            output="screen",
            arguments=["--supervised"],
            parameters=[{"robot": given["robot"], "prefix": given.get("prefix", "")}],
            remappings=[("joint_states", given["joint_states"])],
        )
        for name in ("markers", "view")
        if given[name] in YES
    ]


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        [
            OpaqueFunction(function=_refuse_unknown),
            *ARGUMENTS,
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(str(ESTIMATOR)),
                launch_arguments=[("robot", LaunchConfiguration("robot"))],
            ),
            OpaqueFunction(function=_shown),
        ]
    )

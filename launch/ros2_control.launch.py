"""A robot under ros2_control without its hardware: the simulated rig, estimator and markers.

ros2 launch cdrj_ros ros2_control.launch.py robot:=my_robot.yaml

The rig publishes /joint_states as joint_state_broadcaster does and takes commands as the usual
controllers do. On the robot itself, cdrj.launch.py starts the rest.
"""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from cdrj_ros.nodes.entry import PACKAGE, refuse_unknown

CDRJ = Path(__file__).with_name("cdrj.launch.py")
TOPIC = "/joint_states"

ARGUMENTS = [
    DeclareLaunchArgument(
        "robot",
        default_value="prototype",
        description="Robot file, or the name of an installed one.",
    ),
    DeclareLaunchArgument(
        "prefix",
        default_value="",
        description="Text before all names; the robot file's by default.",
    ),
    DeclareLaunchArgument(
        "rig",
        default_value="ros2_control",
        description="Rig file with ros2_control, or the name of an installed one.",
    ),
    DeclareLaunchArgument(
        "motion", default_value="none", description="Motion of the rig until the first command."
    ),
    DeclareLaunchArgument(
        "truth_rate", default_value="50.0", description="Rate of the rig's true tensions [Hz]."
    ),
    DeclareLaunchArgument(
        "markers", default_value="true", description="Whether to publish markers for RViz."
    ),
    DeclareLaunchArgument(
        "view", default_value="false", description="Whether to serve the browser view."
    ),
]


def _rig(context: LaunchContext) -> list[Node]:
    names = [argument.name for argument in ARGUMENTS]
    refuse_unknown(Path(__file__), context.argv, names)
    given = {name: context.launch_configurations[name] for name in names}
    parameters = {name: given[name] for name in ("robot", "prefix", "rig", "motion")}
    return [
        Node(
            package=PACKAGE,
            executable="rig",
            output="screen",
            arguments=["--supervised"],
            parameters=[{**parameters, "truth_rate": float(given["truth_rate"])}],
        )
    ]


def generate_launch_description() -> LaunchDescription:
    given = [(name, LaunchConfiguration(name)) for name in ("robot", "prefix", "markers", "view")]
    return LaunchDescription(
        [
            *ARGUMENTS,
            OpaqueFunction(function=_rig),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(str(CDRJ)),
                launch_arguments=[*given, ("motor_states", TOPIC), ("joint_states", TOPIC)],
            ),
        ]
    )

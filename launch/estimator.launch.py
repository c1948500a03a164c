"""Start the estimator: `ros2 launch cdrj_ros estimator.launch.py robot:=my_robot.yaml`."""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    OpaqueFunction,
    RegisterEventHandler,
    SetEnvironmentVariable,
)
from launch.event_handlers import OnProcessStart
from launch.events import matches_action
from launch_ros.actions import LifecycleNode, Node
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from lifecycle_msgs.msg import Transition

from cdrj_ros.nodes.entry import PACKAGE, refuse_unknown

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
YES = ("true", "True")

ARGUMENTS = [
    DeclareLaunchArgument(
        "robot", description="Robot file (YAML), or the name of an installed one."
    ),
    DeclareLaunchArgument(
        "namespace", default_value="cdrj", description="Namespace of the node and its topics."
    ),
    DeclareLaunchArgument(
        "prefix",
        default_value="",
        description="Text before all names, as arm1_; that of the robot file by default.",
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
        "managed",
        default_value="false",
        choices=["true", "false", "True", "False"],
        description="Whether to start a lifecycle node, which another program configures and "
        "activates.",
    ),
    DeclareLaunchArgument(
        "autostart",
        default_value="true",
        choices=["true", "false", "True", "False"],
        description="Whether to configure and activate the managed node at once.",
    ),
    DeclareLaunchArgument(
        "discovery_range",
        default_value="",
        choices=["", "LOCALHOST", "SUBNET", "OFF", "SYSTEM_DEFAULT"],
        description=f"Computers with which the node communicates. By default {RANGE} and related "
        "variables of the environment decide; if none is set, only this computer.",
    ),
]


def _refuse_unknown(context: LaunchContext) -> None:
    refuse_unknown(Path(__file__), context.argv, [argument.name for argument in ARGUMENTS])


def _parameters(given: dict[str, str]) -> dict[str, object]:
    """The parameters that the user has set."""
    parameters: dict[str, object] = {"robot": given["robot"]}
    if given["prefix"]:
        parameters["prefix"] = given["prefix"]
    if given["conditioning"]:
        parameters["conditioning"] = given["conditioning"]
    if given["use_sim_time"]:
        parameters["use_sim_time"] = given["use_sim_time"] in YES
    if given["preload"]:
        try:
            parameters["preload"] = [float(one) for one in given["preload"].strip("[] ").split(",")]
        except ValueError:
            raise RuntimeError(
                f"preload must be numbers separated by commas, got {given['preload']!r}"
            ) from None
    return parameters


def _started(node: LifecycleNode) -> list[RegisterEventHandler]:
    """Actions that configure and activate the node once its process runs."""

    def change(transition: int) -> EmitEvent:
        return EmitEvent(
            event=ChangeState(lifecycle_node_matcher=matches_action(node), transition_id=transition)
        )

    configured = OnStateTransition(
        target_lifecycle_node=node,
        start_state="configuring",
        goal_state="inactive",
        entities=[change(Transition.TRANSITION_ACTIVATE)],
    )
    running = OnProcessStart(target_action=node, on_start=[change(Transition.TRANSITION_CONFIGURE)])
    return [RegisterEventHandler(configured), RegisterEventHandler(running)]


def _nodes(
    context: LaunchContext,
) -> list[SetEnvironmentVariable | RegisterEventHandler | Node]:
    """The node, with only those arguments that the user has set."""
    given = {argument.name: context.launch_configurations[argument.name] for argument in ARGUMENTS}
    environment = []
    if given["discovery_range"]:
        environment.append(SetEnvironmentVariable(RANGE, given["discovery_range"]))
    managed = given["managed"] in YES
    state = ["--state-file", given["state_file"]] if given["state_file"] else []
    files = [str(Path(given["params_file"]).resolve())] if given["params_file"] else []
    kind = LifecycleNode if managed else Node
    node = kind(
        package=PACKAGE,
        executable="estimator",
        name="estimator",
        namespace=given["namespace"],
        output="screen",
        arguments=["--supervised", *(["--managed"] if managed else []), *state],
        ros_arguments=["--log-level", given["log_level"]] if given["log_level"] else [],
        parameters=[*files, _parameters(given)],
        remappings=[
            ("motor_states", given["motor_states"]),
            ("joint_states", given["joint_states"]),
        ],
    )
    starting = _started(node) if managed and given["autostart"] in YES else []
    return [*environment, *starting, node]


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        [OpaqueFunction(function=_refuse_unknown), *ARGUMENTS, OpaqueFunction(function=_nodes)]
    )

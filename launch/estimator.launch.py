"""Start the estimator: `ros2 launch cdrj_ros estimator.launch.py robot:=my_robot.yaml`."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, SetEnvironmentVariable
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    prototype = PathJoinSubstitution(
        [FindPackageShare("cdrj_ros"), "config", "robots", "prototype.yaml"]
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "robot", default_value=prototype, description="The robot file [path]."
            ),
            DeclareLaunchArgument(
                "namespace", default_value="cdrj", description="Where the node and its topics are."
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
                "use_sim_time", default_value="false", description="Take the time from /clock."
            ),
            DeclareLaunchArgument(
                "discovery_range",
                default_value="LOCALHOST",
                choices=["LOCALHOST", "SUBNET", "OFF", "SYSTEM_DEFAULT"],
                description="Whom the node speaks to: this machine only, or the network too.",
            ),
            SetEnvironmentVariable(
                "ROS_AUTOMATIC_DISCOVERY_RANGE", LaunchConfiguration("discovery_range")
            ),
            Node(
                package="cdrj_ros",
                executable="estimator",
                namespace=LaunchConfiguration("namespace"),
                output="screen",
                parameters=[
                    {
                        "robot": ParameterValue(LaunchConfiguration("robot"), value_type=str),
                        "use_sim_time": ParameterValue(
                            LaunchConfiguration("use_sim_time"), value_type=bool
                        ),
                    }
                ],
                remappings=[
                    ("motor_states", LaunchConfiguration("motor_states")),
                    ("joint_states", LaunchConfiguration("joint_states")),
                ],
            ),
        ]
    )

"""Compare the estimates of a bag with its references; the exit code says whether it succeeded.

ros2 launch cdrj_ros validate.launch.py bag:=BAG robot:=prototype
ros2 launch cdrj_ros validate.launch.py bag:=BAG robot:=prototype limits:=limits.yaml html:=out.html

ros2 launch exits with 0 if validate does, and with 1 otherwise: it has no other exit codes.
"""

import shlex
from pathlib import Path

from ament_index_python.packages import get_package_prefix
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction

from cdrj_ros.nodes.entry import PACKAGE, refuse_unknown

PASSED_ON = ("preload", "limits", "json", "html")
"""Arguments that are options of validate by the same name."""

ARGUMENTS = [
    DeclareLaunchArgument("bag", description="rosbag2 folder or .mcap file."),
    DeclareLaunchArgument(
        "robot", description="Robot file (YAML), or the name of an installed one."
    ),
    DeclareLaunchArgument(
        "preload", default_value="", description="Preload of every cable [N], as 36.85,26.26."
    ),
    DeclareLaunchArgument("limits", default_value="", description="Limits of the figures (YAML)."),
    DeclareLaunchArgument("json", default_value="", description="JSON file to write."),
    DeclareLaunchArgument("html", default_value="", description="HTML page to write."),
    DeclareLaunchArgument(
        "options", default_value="", description="Further options of validate, as on its line."
    ),
]


def _fail(event: object, _context: LaunchContext) -> None:
    """Make ros2 launch exit with 1."""
    code = getattr(event, "returncode", 0)
    if code:
        raise RuntimeError(f"validate exited with {code}")


def _process(context: LaunchContext) -> list[ExecuteProcess]:
    given = {argument.name: context.launch_configurations[argument.name] for argument in ARGUMENTS}
    refuse_unknown(Path(__file__), context.argv, list(given))
    executable = Path(get_package_prefix(PACKAGE), "lib", PACKAGE, "validate")
    named = [part for name in PASSED_ON if given[name] for part in (f"--{name}", given[name])]
    command = [str(executable), given["bag"], "--robot", given["robot"], *named]
    return [
        ExecuteProcess(
            cmd=[*command, *shlex.split(given["options"])], output="screen", on_exit=_fail
        )
    ]


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=_process)])

"""A robot without hardware: rig, estimator, markers, view, and a controller that can be switched.

ros2 launch cdrj_ros demo.launch.py controller:=keep_taut
ros2 launch cdrj_ros demo.launch.py robot:=prototype controller:=tension_limiter wish:=0.5
ros2 launch cdrj_ros demo.launch.py robot:=prototype wish:=0.5              # without one

The true tensions are printed every two seconds, with those before the controller was switched:
ros2 param set /cdrj/keep_taut active false
"""

import shutil
import sys
import tempfile
from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    ExecuteProcess,
    OpaqueFunction,
    RegisterEventHandler,
)
from launch.event_handlers import OnShutdown
from launch_ros.actions import Node

from cdrj_ros.model.prepared import robot_path
from cdrj_ros.nodes.entry import PACKAGE, refuse_unknown, view_is_installed
from cdrj_ros.robot.writer import exact_copy

CONTROLLERS = {
    "tension_limiter": "velocity",
    "collision_stop": "velocity",
    "keep_taut": "position",
    "friction_feedforward": "",
}
"""The examples, and the kind of command that each of them expects as a wish."""

UNSURE_SHARES = {"keep_taut": 0.5}
"""The estimator's `unsure_share` for controllers that do with less than its default accuracy."""

SETTINGS = {
    "keep_taut": ("floor:=0.0", "tighten_s:=0.05"),
    "tension_limiter": ("creep_speed:=0.3",),
}
"""Parameters of the controllers other than their defaults."""

RIGS = {"finger": "hand"}
"""Rig files of robots that the default load does not suit."""

ARGUMENTS = [
    DeclareLaunchArgument(
        "robot",
        default_value="finger",
        description="Robot file (YAML), or the name of an installed one.",
    ),
    DeclareLaunchArgument(
        "rig",
        default_value="",
        description="Rig file, or the name of an installed one; by default one for the robot.",
    ),
    DeclareLaunchArgument(
        "exact",
        default_value="true",
        choices=["true", "false"],
        description="Whether the numbers of the robot file count as exact, since they are those "
        "of the simulated robot; otherwise as exact as the file states.",
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
        "published 50 times a second to the controller, or as speeds to the rig if there is none; "
        "a swing of the first joint by default with a controller of angles.",
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

Action = Node | ExecuteProcess | RegisterEventHandler


def _actions(context: LaunchContext) -> list[Action]:
    given = {argument.name: context.launch_configurations[argument.name] for argument in ARGUMENTS}
    refuse_unknown(Path(__file__), context.argv, list(given))
    controller, wish, started = given["controller"], given["wish"], []
    robot = given["robot"]
    if given["exact"] == "true":
        folder = tempfile.mkdtemp(prefix="cdrj_demo_")
        robot = str(exact_copy(robot_path(robot), Path(folder)))
        started.append(
            RegisterEventHandler(OnShutdown(on_shutdown=lambda *_: shutil.rmtree(folder)))
        )
    swings = not wish and CONTROLLERS.get(controller) == "position"
    rig = {
        "robot": robot,
        "rig": given["rig"] or RIGS.get(given["robot"], ""),
        "cells": 4,  # of contact per pulley: a simulation that keeps up beside the other nodes
        "motion": "none" if wish or swings else given["motion"],
        "truth_rate": float(given["truth_rate"]),
    }
    estimator = {"robot": robot, "unsure_share": UNSURE_SHARES.get(controller, 0.1)}
    nodes = {"estimator": estimator, "rig": rig, "markers": {"robot": robot}}
    if given["view"] == "true":
        nodes["view"] = {"robot": robot}
    started += [
        Node(
            package=PACKAGE,
            executable=name,
            output="screen",
            arguments=["--supervised"],
            parameters=[parameters],
        )
        for name, parameters in nodes.items()
    ]
    return [*started, *_examples(robot, controller, wish, swings)]


def _examples(robot: str, controller: str, wish: str, swings: bool) -> list[ExecuteProcess]:
    """The controller, what it is told, and the comparison of the tensions with and without it."""

    def example(name: str, *words: str, parameters: tuple[str, ...] = ()) -> ExecuteProcess:
        path = Path(__file__).resolve().parents[1] / "examples" / f"{name}.py"
        options = [part for one in parameters for part in ("-p", one)]
        command = [
            sys.executable,
            str(path),
            *words,
            *(["--ros-args"] if options else []),
            *options,
        ]
        return ExecuteProcess(cmd=command, output="screen")

    named = (f"controller:={controller}",) if controller else ()
    started = [example("compare", parameters=named)]
    if controller:
        started.append(
            example(controller, parameters=(f"robot:={robot}", *SETTINGS.get(controller, ())))
        )
    if swings:
        started.append(example("swing", parameters=(f"robot:={robot}",)))
    elif wish:
        kind = CONTROLLERS.get(controller, "velocity")
        if not kind:
            raise RuntimeError(f"{controller} takes no wish")
        direct = () if controller else ("--ros-args", "-r", "wished/velocity:=commands/velocity")
        started.append(example("wish", kind, *wish.split(","), *direct))
    return started


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=_actions)])

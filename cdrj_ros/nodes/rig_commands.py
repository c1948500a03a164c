"""Receives commands to the rig's motors: checks them, and executes or refuses and counts them.

Commands in the namespace of the nodes are angles, speeds and torques of the motors.  Those of
ros2_control's controllers are in the units in which the robot publishes its states.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from cdrj_ros.robot.description import Motor, Robot
from cdrj_ros.simulation.commands import (
    CAUSES,
    MODES,
    Cause,
    Command,
    CommandError,
    DriveLimits,
    Mode,
    Trajectory,
    checked_command,
    checked_trajectory,
    command_of_states,
)
from cdrj_ros.simulation.sensors import angle_of

DEPTH = 10
"""Queue depth of a topic [messages]; small because old commands are useless."""

WARNING_S = 5.0
"""Minimum time between two logged refusals [s]."""


FORWARD: Final[dict[Mode, str]] = {mode: f"/forward_{mode}_controller/commands" for mode in MODES}
"""Topics of ros2_control's forward_command_controller, by the commanded interface."""

TRAJECTORY: Final = "/joint_trajectory_controller/joint_trajectory"
"""Topic of ros2_control's joint_trajectory_controller."""

Convert = Callable[[Mode, Sequence[str], Sequence[float]], Sequence[float]]
"""Function from a mode, names of motors and values to values for these motors."""


def as_given(_mode: Mode, _names: Sequence[str], values: Sequence[float]) -> Sequence[float]:
    """Values that are those of the motors."""
    return values


class CommandListener:
    """Subscribes to the topics of all kinds of commands."""

    def __init__(
        self,
        node: Node,
        robot: Robot,
        limits: DriveLimits,
        accept: Callable[[Command | Trajectory], None],
        controllers: bool,
    ) -> None:
        """Open the topics.

        Args:
            node: the node that subscribes.
            robot: its motors convert the commands of controllers.
            limits: limits of the drives.
            accept: called with every valid command.
            controllers: whether to listen to ros2_control's controllers, too.
        """
        self._node, self._limits, self._accept = node, limits, accept
        self._motors = {motor.name: motor for motor in robot.motors}
        self.accepted = 0
        self.refused: dict[Cause, int] = dict.fromkeys(CAUSES, 0)
        for mode in MODES:
            self._listen_to_arrays(f"commands/{mode}", mode, as_given)
        node.create_subscription(JointState, "motor_commands", self._on_states, DEPTH)
        self._listen_to_trajectories("motor_trajectory", as_given)
        if controllers:
            for mode, topic in FORWARD.items():
                self._listen_to_arrays(topic, mode, self._converted)
            self._listen_to_trajectories(TRAJECTORY, self._converted)

    def _converted(
        self, mode: Mode, names: Sequence[str], values: Sequence[float]
    ) -> Sequence[float]:
        """Values in the units of publication as values of the motors; others stay as they are."""
        if len(names) != len(values):
            return values  # refused later
        return [
            value if name not in self._motors else _of_motor(self._motors[name], mode, value)
            for name, value in zip(names, values, strict=True)
        ]

    def _listen_to_arrays(self, topic: str, mode: Mode, convert: Convert) -> None:
        """Subscribe to one value per motor, as forward_command_controller takes them."""

        def on_array(message: Float64MultiArray) -> None:
            def read() -> Command:
                if message.layout.data_offset:
                    raise CommandError("malformed", "data_offset must be 0")
                values = convert(mode, self._limits.motors, message.data)
                return checked_command(self._limits, mode, None, values)

            self._take(topic, read)

        self._node.create_subscription(Float64MultiArray, topic, on_array, DEPTH)

    def _on_states(self, message: JointState) -> None:
        self._take(
            "motor_commands",
            lambda: command_of_states(
                self._limits, message.name, message.position, message.velocity, message.effort
            ),
        )

    def _listen_to_trajectories(self, topic: str, convert: Convert) -> None:
        def on_trajectory(message: JointTrajectory) -> None:
            names, points = message.joint_names, message.points
            self._take(
                topic,
                lambda: checked_trajectory(
                    self._limits,
                    names,
                    [point.time_from_start.sec + point.time_from_start.nanosec * 1e-9
                     for point in points],
                    [convert("position", names, point.positions) for point in points],
                    [convert("velocity", names, point.velocities) for point in points],
                ),
            )  # fmt: skip

        self._node.create_subscription(JointTrajectory, topic, on_trajectory, DEPTH)

    def _take(self, topic: str, read: Callable[[], Command | Trajectory]) -> None:
        """Execute a command, or refuse it as a whole."""
        try:
            command = read()
        except CommandError as error:
            self.refused[error.cause] += 1
            self._node.get_logger().warning(
                f"{topic} refused: {error}", throttle_duration_sec=WARNING_S
            )
            return
        self.accepted += 1
        self._accept(command)


def _of_motor(motor: Motor, mode: Mode, value: float) -> float:
    """The value of a motor's axis that is published as ``value``."""
    if mode == "position":
        return float(angle_of(motor.sensor, np.asarray(value, dtype=np.float64)))
    return value * (motor.sensor.scale if mode == "velocity" else motor.effort_scale)

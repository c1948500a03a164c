"""Receives commands to the rig's motors: checks them, and executes or refuses and counts them."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

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

DEPTH = 10
"""Queue depth of a topic [messages]; small because old commands are useless."""

WARNING_S = 5.0
"""Minimum time between two logged refusals [s]."""


class CommandListener:
    """Subscribes to the topics of all kinds of commands."""

    def __init__(
        self, node: Node, limits: DriveLimits, accept: Callable[[Command | Trajectory], None]
    ) -> None:
        """Open the topics.

        Args:
            node: the node that subscribes.
            limits: limits of the drives.
            accept: called with every valid command.
        """
        self._node, self._limits, self._accept = node, limits, accept
        self.accepted = 0
        self.refused: dict[Cause, int] = dict.fromkeys(CAUSES, 0)
        for mode in MODES:
            node.create_subscription(
                Float64MultiArray, f"commands/{mode}", self._array_listener(mode), DEPTH
            )
        node.create_subscription(JointState, "motor_commands", self._on_states, DEPTH)
        node.create_subscription(JointTrajectory, "motor_trajectory", self._on_trajectory, DEPTH)

    def _array_listener(self, mode: Mode) -> Callable[[Float64MultiArray], None]:
        """Callback for one value per motor, as in ros2_control's forward command controllers."""

        def on_array(message: Float64MultiArray) -> None:
            def read() -> Command:
                if message.layout.data_offset:
                    raise CommandError("malformed", "data_offset must be 0")
                return checked_command(self._limits, mode, None, message.data)

            self._take(f"commands/{mode}", read)

        return on_array

    def _on_states(self, message: JointState) -> None:
        self._take(
            "motor_commands",
            lambda: command_of_states(
                self._limits, message.name, message.position, message.velocity, message.effort
            ),
        )

    def _on_trajectory(self, message: JointTrajectory) -> None:
        points = message.points
        self._take(
            "motor_trajectory",
            lambda: checked_trajectory(
                self._limits,
                message.joint_names,
                [point.time_from_start.sec + point.time_from_start.nanosec * 1e-9
                 for point in points],
                [point.positions for point in points],
                [point.velocities for point in points],
            ),
        )  # fmt: skip

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

"""Recordings from tables, with the names and units of a robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from cdrj_ros.foundation.arrays import Series
from cdrj_ros.model.packing import EFFORT
from cdrj_ros.recordings.recording import Recording
from cdrj_ros.robot.description import Robot
from cdrj_ros.robot.names import known_name


def of_robot(recording: Recording, robot: Robot) -> Recording:
    """A recording with the robot's names, and with efforts in N m; that of a bag as it is.

    Names of motors and joints may lack the prefix of the robot file.
    """
    if not recording.is_table:
        return recording
    own, document = {axis.name for axis in robot.axes}, dict(robot.document)

    def renamed(readings: Mapping[str, Series]) -> dict[str, Series]:
        return {known_name(n, own, document): one for n, one in readings.items()}

    efforts = {
        name: replace(one, value=robot.effort_scale.get(name, 1.0) * one.value)
        for name, one in renamed(recording.motor_efforts).items()
    }
    references = {
        name: one for name, one in recording.references.items() if not name.startswith(f"{EFFORT}/")
    }
    return replace(
        recording,
        motors=renamed(recording.motors),
        joints=renamed(recording.joints),
        references=references | {f"{EFFORT}/{name}": one for name, one in efforts.items()},
        motor_efforts=efforts,
    )

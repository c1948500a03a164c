"""Motors and joints of a robot file: ranges, sensors and passive torques."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from cdrj_ros.foundation.errors import Refusal
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.robot.description import Joint, Motor, PassiveTorque, Sensor

DEFAULT_BREAKAWAY_ANGLE: Final = 1e-3
"""Default angle over which the friction of an axis builds up [rad]."""


def read_motors(document: Document, refuse: Refusal) -> Iterator[Motor]:
    """The motors, in the file's order.

    Raises:
        RobotFileError: an error that the schema cannot express.
    """
    for k, entry in enumerate(document["motors"]):
        yield Motor(
            entry["name"],
            **given(entry, "reference_angle", "max_speed", "effort_noise", "effort_scale"),
            effort_sign=entry.get("effort_sign", Motor.effort_sign),
            passive=_passive(entry),
            sensor=_sensor(f"motors[{k}]", entry, refuse),
        )


def read_joints(document: Document, refuse: Refusal) -> Iterator[Joint]:
    """The joints, in the file's order.

    Raises:
        RobotFileError: an error that the schema cannot express.
    """
    for k, entry in enumerate(document["joints"]):
        lower, upper = map(float, entry["range"])
        if not lower < upper:
            raise refuse(f"joints[{k}].range", f"must increase, got [{lower}, {upper}]")
        reference = float(entry.get("reference_angle", Joint.reference_angle))
        if not lower <= reference <= upper:
            raise refuse(
                f"joints[{k}].reference_angle",
                f"must lie in the range [{lower:g}, {upper:g}], got {reference:g}",
            )
        yield Joint(
            entry["name"],
            lower,
            upper,
            reference,
            **given(entry, "max_speed", "load_drift", "effort_scale"),
            effort_sign=entry.get("effort_sign", Joint.effort_sign),
            passive=_passive(entry),
            sensor=_sensor(f"joints[{k}]", entry, refuse),
            measured=entry.get("measured", Joint.measured),
        )


def given(entry: Document, *keys: str, **renamed: str) -> dict[str, float]:
    """Numbers given by an entry, by field name; fields that are left out keep their defaults.

    Args:
        entry: a mapping of the file.
        keys: keys with the same name as their fields.
        renamed: keys by the name of their field.
    """
    fields = {**{key: key for key in keys}, **renamed}
    return {field: float(entry[key]) for field, key in fields.items() if key in entry}


def _sensor(path: str, entry: Document, refuse: Refusal) -> Sensor:
    for key, what in (("scale", "readings would give one angle"),
                      ("effort_scale", "efforts would be 0")):  # fmt: skip
        if entry.get(key) == 0.0:
            raise refuse(f"{path}.{key}", f"must not be 0: all {what}")
    counts = entry.get("resolution", 0.0) or entry.get("noise", 0.0)
    if entry.get("tracking_bandwidth", 0.0) > 0.0 and not counts:
        raise refuse(
            f"{path}.tracking_bandwidth",
            "needs resolution or noise: the angle is kept within them",
        )
    if "tracking" in entry and "tracking_bandwidth" not in entry:
        raise refuse(f"{path}.tracking", "needs tracking_bandwidth, its value at rest")
    at, correction = _correction(f"{path}.correction", entry.get("correction"), refuse)
    return Sensor(
        **given(entry, "scale", "offset", "period", "resolution", "noise", "tracking_bandwidth"),
        clock_offset_ns=round(entry.get("clock_offset", 0.0) * 1e9),
        tracking=entry.get("tracking", Sensor.tracking),
        corrected_at=at,
        correction=correction,
    )


def _correction(
    path: str, entry: Document | None, refuse: Refusal
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    if entry is None:
        return (), ()
    angle, value = tuple(map(float, entry["angle"])), tuple(map(float, entry["value"]))
    if len(angle) != len(value):
        raise refuse(
            f"{path}.value", f"must have {len(angle)} entries like angle, got {len(value)}"
        )
    steps = np.diff(angle)
    if not np.all(steps > 0.0):
        raise refuse(f"{path}.angle", "must increase")
    if not np.all(np.diff(value) > -steps):
        raise refuse(f"{path}.value", "falls so steeply that two readings would give one angle")
    return angle, value


def _passive(entry: Document) -> PassiveTorque:
    numbers = given(entry, "bearing_torque", "bearing_stiffness", "spring_stiffness", "spring_rest")
    torque = numbers.get("bearing_torque", PassiveTorque.bearing_torque)
    numbers.setdefault("bearing_stiffness", torque / DEFAULT_BREAKAWAY_ANGLE)
    return PassiveTorque(**numbers)

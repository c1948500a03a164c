"""Motors and joints of a robot file: ranges, sensors, passive torques, functions of an angle."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np

from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.foundation.errors import Refusal, ordered
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.robot.couplings import Coupling, is_coupled
from cdrj_ros.robot.description import TABLE_INTERVALS, Joint, Motor, PassiveTorque, Profile, Sensor

DEFAULT_BREAKAWAY_ANGLE: Final = 1e-3
"""Default angle over which the friction of an axis builds up [rad]."""


def read_motors(document: Document, refuse: Refusal) -> Iterator[Motor]:
    """The motors, in the file's order.

    Raises:
        RobotFileError: an error that the schema cannot express.
    """
    for k, entry in enumerate(document["motors"]):
        yield Motor(**_axis(f"motors[{k}]", entry, refuse, "effort_noise"))


def read_joints(document: Document, refuse: Refusal) -> Iterator[Joint]:
    """The joints that are not coupled to others, in the file's order.

    Raises:
        RobotFileError: an error that the schema cannot express.
    """
    for k, entry in enumerate(document["joints"]):
        if is_coupled(entry):
            continue
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
            **_axis(f"joints[{k}]", entry, refuse, "load_drift", "effort_noise"),
            lower=lower,
            upper=upper,
            measured=entry.get("measured", Joint.measured),
        )


def _axis(path: str, entry: Document, refuse: Refusal, *numbers: str) -> dict[str, Any]:
    """The fields of a ``MovingAxis``, and further numbers."""
    words = ("name", "effort_sign", "effort_verified")
    return {
        **{key: entry[key] for key in words if key in entry},
        **given(entry, "reference_angle", "max_speed", "effort_scale", *numbers),
        "passive": _passive(entry),
        "sensor": _sensor(path, entry, refuse),
    }


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
    angle, value = _pairs(path, entry, refuse)
    if not np.all(np.diff(value) > -np.diff(angle)):
        raise refuse(f"{path}.value", "falls so steeply that two readings would give one angle")
    return tuple(angle.tolist()), tuple(value.tolist())


def _pairs(path: str, entry: Document, refuse: Refusal) -> tuple[Vector, Vector]:
    """Increasing angles, and a value for each."""
    angle, value = np.array(entry["angle"], dtype=float), np.array(entry["value"], dtype=float)
    if angle.size != value.size:
        raise refuse(
            f"{path}.value", f"must have {angle.size} entries like angle, got {value.size}"
        )
    if not np.all(np.diff(angle) > 0.0):
        raise refuse(f"{path}.angle", "must increase")
    return angle, value


def _passive(entry: Document) -> PassiveTorque:
    numbers = given(entry, "bearing_torque", "bearing_stiffness", "spring_stiffness", "spring_rest")
    torque = numbers.get("bearing_torque", PassiveTorque.bearing_torque)
    numbers.setdefault("bearing_stiffness", torque / DEFAULT_BREAKAWAY_ANGLE)
    return PassiveTorque(**numbers)


class ProfileReader:
    """Reads the functions of one robot file."""

    def __init__(
        self, joints: Mapping[str, Joint], couplings: Mapping[str, Coupling], refuse: Refusal
    ) -> None:
        self._joints = joints
        self._couplings = couplings
        self._refuse = refuse

    def coupling(self, path: str, name: str | None) -> Coupling:
        """The function of joint angles that is the angle of the joint of that name.

        Raises:
            RobotFileError: there is none.
        """
        if name is None or name not in self._couplings:
            raise self._refuse(path, f"must be one of {ordered(self._couplings)}, got {name!r}")
        return self._couplings[name]

    def read(self, path: str, entry: Any, unit: str) -> tuple[Profile, ...]:
        """Read a number, a function of a joint, or a list of such terms to be summed.

        Raises:
            RobotFileError: names the key below ``path``, what was given and what is allowed.
        """
        if not isinstance(entry, list):
            if isinstance(entry, dict):
                return self._function(path, entry)
            if not entry > 0.0:
                raise self._refuse(path, f"must be greater than 0 {unit}, got {entry:g}")
            return (_constant(float(entry)),)
        return tuple(
            profile
            for k, term in enumerate(entry)
            for profile in (
                self._function(f"{path}[{k}]", term)
                if isinstance(term, dict)
                else (_constant(float(term)),)
            )
        )

    def _function(self, path: str, entry: Document) -> tuple[Profile, ...]:
        coupling = self.coupling(f"{path}.joint", entry["joint"])
        if len(coupling.shares) > 1:
            return self._sum(path, entry, coupling)
        ((leader, share),) = coupling.shares
        joint = self._joints[leader]
        grid = np.linspace(joint.lower, joint.upper, TABLE_INTERVALS + 1)
        angle = coupling.offset + share * grid
        offset = float(entry.get("offset", 0.0))
        slope, sine = float(entry.get("slope", 0.0)), float(entry.get("sine", 0.0))
        values = offset + slope * angle + sine * np.sin(angle)
        slopes = slope + sine * np.cos(angle)
        if ("angle" in entry) != ("value" in entry):
            raise self._refuse(path, "needs both angle and value for a table")
        if "angle" in entry:
            of_table, its_slopes = self._table(path, entry, angle)
            values = values + of_table
            slopes = slopes + _monotone(of_table, its_slopes, angle[1] - angle[0])
        return (Profile(joint.name, grid, values, share * slopes),)

    def _sum(self, path: str, entry: Document, coupling: Coupling) -> tuple[Profile, ...]:
        """A linear term of a joint that follows several: one for each of them."""
        if not entry.keys() <= {"joint", "offset", "slope"}:
            raise self._refuse(
                path,
                f"must have offset and slope alone, for {entry['joint']} follows several joints; "
                "describe the cable by positions",
            )
        slope = float(entry.get("slope", 0.0))
        constant = float(entry.get("offset", 0.0)) + slope * coupling.offset
        terms = [{"joint": name, "slope": slope * share} for name, share in coupling.shares]
        terms[0]["offset"] = constant
        return tuple(profile for term in terms for profile in self._function(path, term))

    def _table(self, path: str, entry: Document, grid: Vector) -> tuple[Vector, Vector]:
        """Values of a table at the angles of a grid, and their slopes."""
        angle, value = _pairs(path, entry, self._refuse)
        lower, upper = sorted((grid[0], grid[-1]))
        slack = 1e-9 + 1e-6 * (upper - lower)
        if angle[0] > lower + slack or angle[-1] < upper - slack:
            raise self._refuse(
                f"{path}.angle",
                f"must cover the range [{lower:g}, {upper:g}] rad of {entry['joint']}, "
                f"got [{angle[0]:g}, {angle[-1]:g}]",
            )
        if angle.size == 2:
            slope = (value[1] - value[0]) / (angle[1] - angle[0])
            return value[0] + slope * (grid - angle[0]), np.full(grid.size, slope)
        from scipy.interpolate import PchipInterpolator  # 0.2 s and 40 MB that few files need

        table = PchipInterpolator(angle, value)
        return table(grid), table.derivative()(grid)


def _monotone(values: Vector, slopes: Vector, step: float) -> Vector:
    """Slopes limited so that a cubic through ``values`` never overshoots (Fritsch, Carlson 1980).

    The grid differs from the table's angles, so the curvature may change within an interval.
    """
    secants = np.diff(values) / step
    left = np.concatenate([secants[:1], secants])
    right = np.concatenate([secants, secants[-1:]])
    most = np.where(left * right > 0.0, 3.0 * np.minimum(np.abs(left), np.abs(right)), 0.0)
    limited: Vector = np.clip(slopes, -most, most)
    return limited


def _constant(value: float) -> Profile:
    empty: Vector = np.empty(0)
    return Profile(None, empty, np.array([value]), empty)

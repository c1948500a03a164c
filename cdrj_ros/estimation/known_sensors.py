"""What is known of load cells and efforts: which are trusted, their errors, when they were read.

``SensorFusion`` corrects with the sensors that are trusted, and keeps here what it learns of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cdrj_ros.estimation.draws import root_mean_square
from cdrj_ros.estimation.innovation_gate import WINDOW_NS, SensorState
from cdrj_ros.estimation.lasting_error import FRICTION
from cdrj_ros.estimation.measurements import Quantity
from cdrj_ros.estimation.preloads import SLOW_DRIFT
from cdrj_ros.estimation.sensor_health import SensorHealth
from cdrj_ros.foundation.arrays import Vector


class KnownSensors:
    """The sensors of one robot that have been read, by name."""

    def __init__(self, quantities: Mapping[str, Quantity], drift: float) -> None:
        """Begin without readings.

        Args:
            quantities: what the robot's sensors measure, by name.
            drift: random-walk spread of a preload after 1 s, as a fraction of it, where no load
                cell measures the cable.
        """
        self.quantities, self._drift = quantities, drift
        self.health: dict[str, SensorHealth] = {}
        """Of every sensor that has been read or dropped."""
        self.states: dict[str, SensorState] = {}
        """The trusted sensors whose readings have been used."""
        self._read_ns: dict[str, int] = {}
        """Time of every sensor's last reading [ns]."""

    def health_of(self, name: str) -> SensorHealth:
        """The health of a sensor, on trial if it has not been read before."""
        return self.health.setdefault(name, SensorHealth(name))

    def faults(self) -> dict[str, str]:
        """Why sensors have been dropped, by name."""
        return {name: one.dropped for name, one in self.health.items() if one.dropped}

    def drop(self, faults: Mapping[str, str]) -> None:
        """Drop sensors, for the reasons given by name."""
        for name, why in faults.items():
            self.health[name] = SensorHealth(name, dropped=why)

    def try_again(self) -> None:
        """Put all sensors on trial again; those dropped stay so."""
        for health in self.health.values():
            health.try_again()

    def pause(self) -> None:
        """Compare readings to come with estimates to come only."""
        for health in self.health.values():
            health.pause()
        for sensor in self.states.values():
            sensor.forget()

    @property
    def contradicted(self) -> bool:
        """Whether the last reading of a trusted sensor contradicts the estimate, or may do so.

        Until a sensor has followed a motion since a sudden change, it may be stuck.
        """
        return any(
            one.contradicts or self.health[name].doubted for name, one in self.states.items()
        )

    @property
    def motor_friction(self) -> dict[str, tuple[float, float]]:
        """Friction of every tracked motor beyond the robot file's, its standard deviation [N m]."""
        return {
            name: (
                float(one.errors.error[FRICTION]),
                root_mean_square(one.errors.deviation[FRICTION]),
            )
            for name, one in self.states.items()
            if self.quantities[name].is_effort
        }

    def lasting(self) -> list[Vector]:
        """Lasting errors of all sensors in every member."""
        return [row for one in self.states.values() for row in one.errors.deviation if row.any()]

    # --- when they were read ----------------------------------------------------------------------

    def read(self, name: str, stamp_ns: int) -> float:
        """Note a reading of a sensor at the sample of a stamp [ns].

        Returns:
            The time since its last reading [s]; 0 for the first one.
        """
        passed = (stamp_ns - self._read_ns.get(name, stamp_ns)) * 1e-9
        self._read_ns[name] = stamp_ns
        return passed

    def forget_readings(self) -> None:
        """Forget when the sensors were read."""
        self._read_ns.clear()

    def recent(self, stamp_ns: int) -> dict[str, Quantity]:
        """The trusted sensors that have been read lately, and what they measure."""
        return {
            name: self.quantities[name]
            for name in self.states
            if self.health[name].trusted
            and 0 <= stamp_ns - self._read_ns.get(name, stamp_ns + 1) <= WINDOW_NS
        }

    def cells(self, cable: int, stamp_ns: int) -> list[str]:
        """The trusted load cells of a cable that have been read lately."""
        recent = self.recent(stamp_ns).items()
        return [name for name, one in recent if not one.is_effort and cable in one.cables]

    def is_checked_by_effort(self, name: str, stamp_ns: int) -> bool:
        """Whether a load cell is the only one of its cable and a trusted effort acts on it."""
        (cable,) = self.quantities[name].cables
        recent = self.recent(stamp_ns).values()
        efforts = [one for one in recent if one.is_effort and cable in one.cables]
        return bool(efforts) and self.cells(cable, stamp_ns) == [name]

    def drift_of(self, cable: int, stamp_ns: int) -> float:
        """Random-walk spread of a preload after 1 s, as a fraction of it.

        It is small where a load cell measures the cable: a preload that changes sooner then shows
        as a contradiction, and so does a cell that drifts.
        """
        if self._drift <= SLOW_DRIFT or not self.cells(cable, stamp_ns):
            return self._drift
        return SLOW_DRIFT

    def drifts(self, cables: int) -> list[float]:
        """The same for all cables while no sensor is read."""
        used = [self.quantities[name] for name in self.states]
        measured = {one.cables[0] for one in used if not one.is_effort}
        slow = min(self._drift, SLOW_DRIFT)
        return [slow if c in measured else self._drift for c in range(cables)]

    # --- over a restart ---------------------------------------------------------------------------

    def memory(self) -> dict[str, Any]:
        """What ``recall`` needs to go on with the sensors of an earlier run, as JSON."""
        return {
            "health": {name: one.memory() for name, one in self.health.items()},
            "sensors": {name: one.memory() for name, one in self.states.items()},
        }

    def recall(self, memory: Mapping[str, Any], members: int) -> None:
        """Take up ``memory``, of an ensemble of as many ``members``.

        Raises:
            KeyError, TypeError, ValueError, AttributeError: it is not one of this robot; nothing
                has changed then.
        """
        health = {str(n): SensorHealth.recalled(n, o) for n, o in memory["health"].items()}
        states = {str(n): SensorState.recalled(o, members) for n, o in memory["sensors"].items()}
        if not set(states) <= set(health) <= set(self.quantities):
            raise ValueError("sensors that the robot does not have")
        self.health, self.states = health, states

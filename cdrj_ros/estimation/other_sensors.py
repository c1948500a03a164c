"""Load cells and motors' efforts of a live estimator: their messages, and when they are used."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.samples import Sample
from cdrj_ros.estimation.ensemble import Spread
from cdrj_ros.estimation.estimator import State
from cdrj_ros.estimation.fusion import Fusion
from cdrj_ros.estimation.options import Options
from cdrj_ros.estimation.preloads import FREE_DRIFT, SLOW_DRIFT
from cdrj_ros.estimation.waiting import Measurement, WaitingMeasurements

Vector = NDArray[np.float64]

SMALLEST_NOISE: Final = 1e-6
LARGEST_NOISE: Final = 1e6
"""Outside these limits a load cell's standard deviation is replaced by the robot file's [N]."""


class OtherSensors:
    """Measurements that wait for their sample, and their fusion with the estimate."""

    def __init__(self, spread: Spread, options: Options) -> None:
        """Begin without measurements.

        Args:
            spread: the robot's ensemble, changed by every correction.
            options: ``track_preload`` and ``effort_noise`` are used.
        """
        self._tracks = options.track_preload
        self._effort_noise = options.effort_noise
        self.unknown_elements = 0
        """Load cell readings of elements that the robot does not have."""
        self._waiting = WaitingMeasurements()
        self._adopt(Fusion(spread, self._drift))

    @property
    def _drift(self) -> float:
        return FREE_DRIFT if self._tracks else SLOW_DRIFT

    def _adopt(self, fusion: Fusion) -> None:
        self.fusion = fusion
        motors = fusion.model.robot.motors
        self._clock_offset_ns = {motor.name: motor.sensor.clock_offset_ns for motor in motors}

    def use(self, spread: Spread) -> None:
        """Continue with other numbers of the robot; what is known of sensors and preloads stays."""
        fusion = Fusion(spread, self._drift)
        fusion.keep(self.fusion)
        self._adopt(fusion)

    def restart(self, *, known: bool) -> None:
        """Begin anew; ``known`` keeps what is known of preloads and sensors."""
        self._waiting.forget()
        if known:
            self.fusion.pause()
        else:
            self.fusion.restart()

    @property
    def overlooked(self) -> int:
        """Load cell readings and efforts discarded because no sample reached their stamp."""
        return self._waiting.overlooked

    def feed_tensions(
        self,
        stamp_ns: int,
        names: Sequence[str],
        tensions: Sequence[float] | Vector,
        stddevs: Sequence[float] | Vector,
    ) -> None:
        """Queue a message of load cells, see ``LiveEstimator.feed_tensions``."""
        fusion = self.fusion
        for k, name in enumerate(names):
            if not fusion.knows(name):
                self.unknown_elements += 1
                continue
            noise = float(stddevs[k]) if len(stddevs) else 0.0
            if not SMALLEST_NOISE <= noise <= LARGEST_NOISE:
                noise = fusion.noise_of(name)
            self._waiting.add(Measurement(stamp_ns, name, float(tensions[k]), noise))

    def wants_efforts(self, stamp_ns: int) -> bool:
        """Whether efforts of this stamp [ns] would be used for any motor, see ``feed_efforts``."""
        return self._tracks and self._waiting.wants_efforts(stamp_ns, len(self._clock_offset_ns))

    def feed_efforts(
        self, stamp_ns: int, names: Sequence[str], efforts: Sequence[float] | Vector
    ) -> None:
        """Queue measured efforts of motors [N m]; other names are ignored."""
        if not self._tracks:
            return
        for name, effort in zip(names, efforts):  # noqa: B905 fewer efforts than names: none
            offset_ns = self._clock_offset_ns.get(name)
            if offset_ns is not None and not self._waiting.is_early(name, stamp_ns):
                at = stamp_ns + offset_ns
                self._waiting.add(Measurement(at, name, float(effort), self._effort_noise))

    def correct(self, sample: Sample, state: State, taught: set[str]) -> tuple[State, str]:
        """Apply the measurements up to a sample, until a sensor that made corrections is dropped.

        Args:
            sample: the last processed sample.
            state: the state after that sample.
            taught: sensors whose corrections the state contains; those that follow are added.

        Returns:
            The corrected state, and the name of the dropped sensor; empty if there is none.
        """
        if not self._waiting:
            return state, ""
        fusion = self.fusion
        for measured in self._waiting.due(sample.stamp_ns):
            dropped = fusion.dropped
            corrected = fusion.correct(sample, state, measured)
            if corrected is not state:
                taught.add(measured.name)
            state = corrected
            if fusion.dropped != dropped and measured.name in taught:
                return state, measured.name
        return state, ""

    def take_back(self, name: str) -> None:
        """Forget all corrections and waiting measurements, because a sensor was wrong.

        Sensors that are still trusted then correct anew.
        """
        self._waiting.clear()
        self.fusion.take_back(name)

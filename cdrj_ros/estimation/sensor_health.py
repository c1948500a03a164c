"""Which sensors correct the estimate: on trial first, then trusted, dropped if they fail.

The thresholds follow from the rates at which a good sensor fails by chance; docs/uncertainty.md has
these rates.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from cdrj_ros.foundation.arrays import Vector

CHECKED: Final = 50
"""Number of latest readings over which a sensor is checked."""

TOO_FAR: Final = 9.0
"""A sensor is dropped if its squared residuals divided by their variance exceed this on average.

Outliers are left out.  If one error lasts over all readings, a good sensor exceeds three standard
deviations with a chance of 0.3 %; if the errors are independent, with a chance of 1e-65."""

OUTLIER: Final = 100.0
"""A reading is refused if its squared residual divided by its variance exceeds this."""

MANY: Final = 13
"""A sensor is dropped for this many outliers among the readings over which it is checked.

A sensor with one bad reading in 50 or in 20 has as many with a chance of 1e-11 or 8e-7."""

STIFF: Final = 4.0
"""A sensor is frozen if its reading is constant while the estimate moves by more standard
deviations than this."""

EQUAL: Final = 5
"""A sensor is frozen only if this many readings in a row are equal."""

RESPONSE: Final = (0.3, 3.0)
"""A sensor is used once the slope of its readings over the estimate lies in this range (U4)."""

CERTAIN: Final = 5.0
"""Standard errors of the slope by which it must lie within ``RESPONSE``.

Readings that do not follow the estimate at all meet this with a chance of 3e-7 per reading."""

TRIAL_STEP: Final = 0.25
"""Between readings on trial the estimate must move by this fraction of their standard deviation."""

PROOF: Final = 0.05
"""A sensor passes its trial only if the estimate changes by this fraction of its largest value."""

FOLLOWED: Final = 25
"""Number of latest readings in motion over which a trusted sensor must follow the estimate."""

TRIED: Final = 400
"""Number of latest readings on trial, each taken after some motion, that determine the slope."""


@dataclass
class SensorHealth:
    """State of one sensor: on trial first, then trusted; dropped permanently if it fails."""

    name: str
    dropped: str = ""
    """Why the sensor was dropped; empty while it is not."""
    trusted: bool = False
    """Whether the readings have followed a motion in proportion; until then none is used."""
    returning: bool = False
    """Whether it was trusted before it came on trial again.

    It must pass the gate once it is trusted: a preload may have changed meanwhile."""
    used: int = 0
    """Readings used so far."""
    refused: int = 0
    """Readings refused: not finite, too old, contradicted, or from a dropped sensor."""
    changes: int = 0
    """How often readings have shown a sudden change of a preload, or of the sensor."""
    doubted: bool = False
    """Whether it has not followed a motion since the last of them."""
    tried: int = 0
    """Readings on trial, which do not correct the estimate."""
    largest: float = 0.0
    """Largest magnitude of the readings on trial [N] or [N m]."""
    _squares: deque[float] = field(default_factory=lambda: deque(maxlen=CHECKED))
    _last: float | None = None
    _equal: deque[float] = field(default_factory=lambda: deque(maxlen=CHECKED))
    """Uncorrected estimates at the latest readings that are all equal."""
    _residuals: deque[float] = field(default_factory=lambda: deque(maxlen=MANY))
    """The latest readings less the uncorrected estimates; as many as drop a sensor."""
    _in_motion: int = 0
    """Readings on trial while the estimate moved."""
    _trial: deque[float] = field(default_factory=lambda: deque(maxlen=TRIED))
    """Readings in motion since the trial began or ended, and the uncorrected estimates at them."""
    _uncorrected: deque[float] = field(default_factory=lambda: deque(maxlen=TRIED))

    def memory(self) -> dict[str, Any]:
        """What it is known by, as JSON; ``recalled`` reads it."""
        return {
            "dropped": self.dropped,
            "returning": self.trusted or self.returning,
            "doubted": self.doubted,
            "largest": self.largest,
        }

    @classmethod
    def recalled(cls, name: str, memory: Mapping[str, Any]) -> SensorHealth:
        """The sensor of an earlier run on trial, from ``memory``.

        Raises:
            KeyError, TypeError, ValueError: not such a memory.
        """
        dropped, largest = str(memory["dropped"]), float(memory["largest"])
        if not 0.0 <= largest < np.inf:
            raise ValueError("a sensor's largest reading is not a number")
        returning, doubted = bool(memory["returning"]), bool(memory["doubted"])
        return cls(name, dropped, returning=returning, doubted=doubted, largest=largest)

    def try_again(self) -> None:
        """Put the sensor on trial again."""
        self.returning = self.returning or self.trusted
        self.trusted = False
        self._in_motion = 0

    def doubt(self) -> None:
        """Note a sudden change: the sensor must follow a motion again."""
        self.changes += 1
        self.doubted = True
        self._trial.clear()
        self._uncorrected.clear()

    def pause(self) -> None:
        """Forget the latest readings: the estimates to compare them with begin anew."""
        for latest in (self._squares, self._equal, self._trial, self._uncorrected, self._residuals):
            latest.clear()
        self._last = None

    @property
    def residual(self) -> float:
        """How far the latest readings are from the uncorrected estimate [N] or [N m]."""
        return float(np.median(self._residuals)) if self._residuals else 0.0

    def evaluate(
        self, value: float, expected: float, uncorrected: float, variance: float, own: float
    ) -> bool:
        """Check a reading; True if it may be used.

        Args:
            value: measured value [N] or [N m].
            expected: estimate for the same time.
            uncorrected: the same estimate without the corrections made so far.
            variance: expected variance of value minus expected.
            own: the part of the variance due to sensor noise and model error.
        """
        if self.dropped:
            self.refused += 1
            return False
        if self.trusted or not self.returning:
            self._squares.append((value - expected) ** 2 / variance)
        self._residuals.append(value - uncorrected)
        if value != self._last:
            self._equal.clear()
        self._last = value
        self._equal.append(uncorrected)
        self.dropped = self._fault(value, expected, own)
        if not self.dropped and not self.trusted:
            return self._try(value, uncorrected, own)
        self.dropped = self.dropped or self._strays(value, uncorrected, own)
        if self.dropped or self._squares[-1] > OUTLIER:
            self.refused += 1
            return False
        return True

    def _fault(self, value: float, expected: float, own: float) -> str:
        """The fault that the last ``CHECKED`` readings show; empty if none."""
        if len(self._equal) >= EQUAL and max(self._equal) - min(self._equal) > STIFF * own**0.5:
            return f"frozen at {value:.4g} while the estimate moves"
        if len(self._squares) < CHECKED:
            return ""
        near = [square for square in self._squares if square <= OUTLIER]
        outliers = CHECKED - len(near)
        said = f"(measured {value:.4g}, expected {expected:.4g})"
        if outliers >= MANY:
            return (
                f"{outliers} of {CHECKED} readings more than {OUTLIER**0.5:.0f} "
                f"standard deviations from the estimate {said}"
            )
        mean = sum(near) / len(near)
        if mean > TOO_FAR:
            return (
                f"{mean**0.5:.1f} standard deviations from the estimate over {CHECKED} readings "
                f"{said}"
            )
        return ""

    def _try(self, value: float, uncorrected: float, own: float) -> bool:
        """Add a reading on trial; True once the readings follow the motion, (U4)."""
        self.tried += 1
        self.largest = max(self.largest, abs(value))
        found = self._response(value, uncorrected, own, TRIED)
        if found is None or not found[2]:
            return False
        response, error, _ = found
        self.trusted = _follows(response, error)
        self._in_motion += 1
        if not self.trusted and self._in_motion == TRIED:
            self.dropped = (
                f"moves {response:.2g} times as far as the estimate over {TRIED} readings, "
                f"where {RESPONSE[0]:g} to {RESPONSE[1]:g} is accepted"
            )
        if self.trusted:
            self.doubted = False
            self.tried -= 1
            self._trial.clear()
            self._uncorrected.clear()
        return self.trusted

    def _strays(self, value: float, uncorrected: float, own: float) -> str:
        """Why a trusted sensor no longer follows the motion, by its latest readings; or empty.

        One that does not follow a motion in one direction is doubted: a preload may have been lost
        at the same time.  In a motion to and fro it is wrong.
        """
        found = self._response(value, uncorrected, own, FOLLOWED)
        if found is None:
            return ""
        response, error, both_ways = found
        low, high = RESPONSE
        outside = response + CERTAIN * error < low or high < response - CERTAIN * error
        if not both_ways:
            if outside and not self.doubted:
                self.doubt()
            return ""
        self.doubted = self.doubted and not _follows(response, error)
        if not outside or len(self._trial) < FOLLOWED:
            return ""
        return f"moves {response:.2g} times as far as the estimate over {FOLLOWED} readings"

    def _response(
        self, value: float, uncorrected: float, own: float, latest: int
    ) -> tuple[float, float, bool] | None:
        """Slope of the latest readings over the estimate, its error, and whether to and fro.

        None without motion.
        """
        if self._uncorrected and abs(uncorrected - self._uncorrected[-1]) < TRIAL_STEP * own**0.5:
            return None
        self._trial.append(value)
        self._uncorrected.append(uncorrected)
        readings, estimates = (
            np.fromiter(one, float)[-latest:] for one in (self._trial, self._uncorrected)
        )
        least = enough(own, float(np.abs(estimates).max()))
        if len(estimates) < 3 or float(np.ptp(estimates)) <= least:
            return None
        return *_slope(estimates, readings, own), _to_and_fro(estimates) > least


def enough(own: float, largest: float) -> float:
    """How far an estimate must rise and fall to judge a sensor by it [N] or [N m].

    Args:
        own: see ``SensorHealth.evaluate``.
        largest: largest magnitude of the estimate.
    """
    return max(STIFF * float(own**0.5), PROOF * abs(largest))


def _follows(response: float, error: float) -> bool:
    """Whether a slope is certainly that of a sensor that follows the estimate."""
    low, high = RESPONSE
    return low <= response - CERTAIN * error and response + CERTAIN * error <= high


def _to_and_fro(estimates: Vector) -> float:
    """The smaller of the greatest rise and the greatest fall; it is small for a mere drift."""
    rise = float(np.max(estimates - np.minimum.accumulate(estimates)))
    fall = float(np.max(np.maximum.accumulate(estimates) - estimates))
    return min(rise, fall)


def _slope(estimates: Vector, readings: Vector, own: float) -> tuple[float, float]:
    """Slope of readings over estimates, and its standard error (U4).

    Args:
        estimates, readings: in pairs, shape (n,), n > 2.
        own: expected variance of a reading; the variance about the line is used if it is larger.
    """
    moved, said = estimates - estimates.mean(), readings - readings.mean()
    spread = float(moved @ moved)
    slope = float(moved @ said) / spread
    left = said - slope * moved
    variance = max(own, float(left @ left) / (len(left) - 2))
    return slope, (variance / spread) ** 0.5

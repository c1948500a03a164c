"""Options of the live estimator."""

from __future__ import annotations

from dataclasses import dataclass

from cdrj_ros.conditioning.conditioner import Mode
from cdrj_ros.estimation.unsure import UNSURE_SHARE


@dataclass(frozen=True)
class Options:
    """Options of the live estimator."""

    conditioning: Mode = "wait"
    """``wait`` for the slower channel, or ``predict`` it."""
    uncertainty: bool = True
    """Whether to estimate standard deviations."""
    unsure_share: float = UNSURE_SHARE
    """An element is ``UNSURE`` if its standard deviation exceeds this fraction of its tension or
    preload, whichever is greater."""
    tension_sensors: bool = False
    """Whether to use load cells; preloads may then drift."""
    track_preload: bool = False
    """Whether to correct the preloads with the motors' efforts."""
    effort_noise: float = 0.01
    """Standard deviation of a motor's effort [N m]."""
    tracking: float | None = None
    """Bandwidth of the tracking filters [Hz], 0 for none; None: the robot file's."""

    @property
    def corrects(self) -> bool:
        """Whether sensors other than the encoders correct the estimate."""
        return self.tension_sensors or self.track_preload

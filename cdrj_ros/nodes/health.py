"""The health monitor of the estimator node and its status on /diagnostics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from numpy.typing import NDArray

from cdrj_ros.estimation.session import LiveEstimator, Output
from cdrj_ros.foundation.text import printable
from cdrj_ros.health.evaluation import Evaluation
from cdrj_ros.health.monitor import HealthMonitor
from cdrj_ros.health.verdict import unsure_elements
from cdrj_ros.robot.tolerances import narrowed

Vector = NDArray[np.float64]

LEVELS: Final = {
    "ok": DiagnosticStatus.OK,
    "warn": DiagnosticStatus.WARN,
    "error": DiagnosticStatus.ERROR,
}


class HealthWatch:
    """A monitor that follows the live estimator, also through changes of its numbers."""

    def __init__(self, live: LiveEstimator, *, marks_unsure: bool = True) -> None:
        """Watch the robot of an estimator; prepares all models, which takes some milliseconds.

        Args:
            live: the estimator.
            marks_unsure: whether the elements that a verdict concerns become ``UNSURE``.
        """
        self._live = live
        self._marks = marks_unsure
        self._standing: Evaluation | None = None
        self.monitor = self._new()
        self.monitor.prepare()

    def _new(self) -> HealthMonitor:
        live = self._live
        known = narrowed(live.model.robot, live.changes)
        return HealthMonitor(live.model, known, live.options.effort_noise)

    def reset(self) -> None:
        """Forget readings and results; take up new numbers of the robot."""
        self._standing = self._live.always_unsure = None
        if self.monitor.model is self._live.model:
            self.monitor.reset()
        else:
            self.monitor = self._new()

    @property
    def heard(self) -> bool:
        """Whether any effort or load cell has been read, so that there is something to compare."""
        return self.monitor.heard

    def wants_efforts(self, stamp_ns: int) -> bool:
        """Whether efforts of this stamp [ns] would be used for any motor."""
        return self.monitor.wants_efforts(stamp_ns)

    def read_efforts(self, stamp_ns: int, names: Sequence[str], efforts: Vector) -> None:
        """Take the efforts of a message [N m]; a message without one for every name has none."""
        if len(efforts) == len(names):
            self.monitor.read_efforts(stamp_ns, names, efforts)

    def read_tensions(
        self, stamp_ns: int, names: Sequence[str], tensions: Vector, stddevs: Vector
    ) -> None:
        """Take the load cells of a message [N]."""
        if len(tensions) == len(names):
            self.monitor.read_tensions(stamp_ns, names, tensions, stddevs)

    def follow(self, output: Output) -> None:
        """Follow the estimator to its last sample; ``output`` is the estimate there."""
        live = self._live
        if live.sample is None:
            return
        if self.monitor.model is not live.model:
            self.monitor = self._new()
        # with other sensors the spread is that of a corrected estimate, not of the file
        self.monitor.follow(live.sample, output.stddev if live.fusion is None else None)
        self._doubt()

    def _doubt(self) -> None:
        """Let the next estimates say what the present verdict means for them."""
        live, standing = self._live, self.monitor.standing
        if not self._marks or standing is self._standing:
            return
        self._standing = standing
        corrected = live.fusion is not None
        unsure = unsure_elements(live.model.robot, standing, corrected=corrected)
        live.always_unsure = unsure if unsure.any() else None

    def status(self, name: str) -> DiagnosticStatus:
        """The verdict as a DiagnosticStatus."""
        found = self.monitor.report()
        self._doubt()
        values = {**found.values, "elements marked UNSURE": self._marked()}
        return DiagnosticStatus(
            level=LEVELS[found.level],
            name=name,
            message=printable(found.message),
            hardware_id=self._live.model.robot.name,
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )

    def _marked(self) -> str:
        """Elements that the verdict marks, in words."""
        unsure, names = self._live.always_unsure, self._live.model.layout.elements
        if unsure is None:
            return "none"
        if unsure.all():
            return "all"
        return ", ".join(name for name, one in zip(names, unsure, strict=True) if one)

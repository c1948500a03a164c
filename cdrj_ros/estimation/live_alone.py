"""The live estimate of a robot with joints without encoder."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.samples import Sample, Samples
from cdrj_ros.estimation.encoderless import EncoderlessEstimator, HeardEfforts
from cdrj_ros.estimation.estimator import Angles, Estimate, State
from cdrj_ros.model.prepared import Model
from cdrj_ros.model.status import INVALID

Vector = NDArray[np.float64]


class LiveAlone:
    """``EncoderlessEstimator``, sample by sample, and the efforts heard so far."""

    def __init__(self, model: Model, before: LiveAlone | None = None) -> None:
        """Prepare.

        Args:
            model: the prepared robot, with at least one joint without encoder.
            before: the estimate with other numbers of the same robot, whose efforts are kept.
        """
        self.solver = EncoderlessEstimator(model)
        motors = model.robot.motors
        self.heard: HeardEfforts = before.heard if before else HeardEfforts(model.layout.motors)
        """The latest efforts of the motors."""
        self.deaf: bool = before is not None and before.deaf
        """Whether the last sample found no effort."""
        self._clock_offset_ns = {motor.name: motor.sensor.clock_offset_ns for motor in motors}

    def reset(self) -> None:
        """Discard efforts and history."""
        self.heard.clear()
        self.solver.reset()

    def feed_efforts(
        self, stamp_ns: int, names: Sequence[str], efforts: Sequence[float] | Vector
    ) -> None:
        """Take measured efforts of motors [N m]; other names are ignored."""
        for name, effort in zip(names, efforts):  # noqa: B905 fewer efforts than names: none
            if name in self._clock_offset_ns:
                self.heard.add(stamp_ns + self._clock_offset_ns[name], (name,), (effort,))

    def estimate(self, sample: Sample) -> tuple[Estimate, Vector, Angles | None]:
        """Estimate a sample; a predicted one leaves the history as it is.

        Returns:
            The estimate, its standard deviations, and the angles of the joints without encoder, one
            row; None where no effort is heard.
        """
        if sample.predicted:
            self.solver.look_ahead()
        else:
            self.solver.look_back()
        efforts = self.heard.at(sample.stamp_ns)
        self.deaf = not bool(np.isfinite(efforts).any())
        one = Samples(
            np.array([sample.stamp_ns]), sample.motor_angle[None, :], sample.joint_angle[None, :]
        )
        found = self.solver.run(one, efforts[None, :])
        assert found.stddev is not None
        values, stddev = np.nan_to_num(found.values[0]), np.nan_to_num(found.stddev[0])
        layout = found.layout
        solved = not any(int(flag) & INVALID for flag in values[layout.status])
        estimate = Estimate(sample.stamp_ns, values, layout, solved)
        return estimate, stddev, None if self.deaf else found.angles

    def state_at(self, stamp_ns: int) -> State:
        """The robot's state after the last sample, whose stamp is given [ns]."""
        return State(stamp_ns, self.solver.state)

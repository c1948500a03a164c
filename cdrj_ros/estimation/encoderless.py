"""Joints without encoder, estimated from the angles and efforts of the motors.

A joint without encoder is found at every sample by two least-squares steps: a prediction, in which
the cables turn the joint with the winches and its load changes little, and a correction by the
measured efforts.  Every member of an ensemble, with parameters, friction history and error of the
effort of its own, does the same; the spread gives the standard deviations.  The core solves them;
see docs/model.md.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import _core
from cdrj_ros.estimation.draws import draw
from cdrj_ros.estimation.ensemble import MEMBERS, new_members, stddev_columns
from cdrj_ros.estimation.estimator import Angles, Estimate, Estimates, Sample, Samples, State
from cdrj_ros.foundation.arrays import Series, Table, Vector
from cdrj_ros.model.packing import INVALID
from cdrj_ros.model.prepared import Model

KEPT: Final = 1_000
"""Efforts of a motor that are kept for samples that wait for a slower topic."""

LARGEST: Final = 1e9
"""Efforts of larger magnitude are refused [N m]."""

EFFORT_AGE_NS: Final = 100_000_000
"""An effort is used for samples at most this much later or earlier [ns]."""


class EncoderlessEstimator:
    """The estimate of a robot some of whose joints have no encoder."""

    def __init__(self, model: Model, members: int = MEMBERS) -> None:
        """Draw the members.

        Args:
            model: the prepared robot, with at least one joint without encoder.
            members: number of members, even; 0 for no ensemble, whose standard deviations are then
                those of the efforts' noise alone.

        Raises:
            ValueError: every joint has an encoder, or the number of members is odd or negative.
        """
        if not model.robot.unmeasured:
            raise ValueError(f"every joint of {model.robot.name} has an encoder")
        if members < 0 or members % 2:
            raise ValueError(f"members must be even and at least 0, got {members}")
        self.model = model
        self.names = tuple(model.layout.joints[j] for j in model.robot.unmeasured)
        joints = ((j, model.robot.joints[j]) for j in model.robot.unmeasured)
        self.core = _core.EncoderlessEstimator(
            ensemble=new_members(model, draw(model, members)),
            joints=[
                _core.EncoderlessJoint(
                    joint=j,
                    lower=one.lower,
                    upper=one.upper,
                    start=one.reference_angle,
                    load_drift=one.load_drift,
                )
                for j, one in joints
            ],
            effort_noise=[motor.effort_noise for motor in model.robot.motors],
        )

    def run(self, samples: Samples, efforts: Table) -> Estimates:
        """Estimate samples that follow those of the call before.

        Args:
            samples: n samples, with the angles of the motors and of the joints with encoders.
            efforts: of the motors [N m], shape (n, motors); NaN where none was heard.

        Returns:
            The estimates, with the angles of the joints without encoder.  Where no effort was heard
            all numbers are NaN and all elements ``INVALID``.

        Raises:
            ValueError: samples or efforts are not those of this robot.
        """
        n, count = samples.stamp_ns.size, len(self.names)
        if efforts.shape != samples.motor_angle.shape:
            raise ValueError(
                f"efforts must have shape {samples.motor_angle.shape}, got {efforts.shape}"
            )
        values = np.empty((n, self.model.layout.size))
        stddev = np.empty((n, stddev_columns(self.model.layout).size))
        angle, angle_stddev = np.empty((n, count)), np.empty((n, count))
        self.core.run(
            np.ascontiguousarray(samples.stamp_ns),
            np.ascontiguousarray(samples.motor_angle, dtype=np.float64),
            np.ascontiguousarray(samples.joint_angle, dtype=np.float64),
            np.ascontiguousarray(efforts, dtype=np.float64),
            values,
            stddev,
            angle,
            angle_stddev,
        )
        angles = Angles(self.names, angle, angle_stddev)
        return Estimates(samples.stamp_ns, values, self.model.layout, stddev, angles)


class RecentEfforts:
    """The latest efforts of the motors, for the samples of a live estimator."""

    def __init__(self, clock_offset_ns: Mapping[str, int]) -> None:
        """Begin without any.

        Args:
            clock_offset_ns: added to the stamps, by motor in the robot's order [ns].
        """
        self.clock_offset_ns = clock_offset_ns
        self.clear()

    def clear(self) -> None:
        """Forget all of them."""
        self._recent: dict[str, list[tuple[int, float]]] = {n: [] for n in self.clock_offset_ns}

    def add(self, stamp_ns: int, names: Sequence[str], efforts: Sequence[float] | Vector) -> None:
        """Take the efforts of a message [N m]; unknown names and impossible numbers are ignored."""
        for name, effort in zip(names, efforts):  # noqa: B905 fewer efforts than names: none
            recent = self._recent.get(name)
            if recent is None or not abs(effort) <= LARGEST:
                continue
            at = stamp_ns + self.clock_offset_ns[name]
            if not recent or at > recent[-1][0]:
                recent.append((at, float(effort)))
                del recent[:-KEPT]

    def at(self, stamp_ns: int) -> Vector:
        """Efforts at a stamp, as of ``efforts_at``, shape (motors,)."""
        return np.array([_effort_at(recent, stamp_ns) for recent in self._recent.values()])


def _effort_at(recent: Sequence[tuple[int, float]], stamp_ns: int) -> float:
    """One motor's effort at a stamp, interpolated; NaN where none is within ``EFFORT_AGE_NS``."""
    after = bisect_right(recent, (stamp_ns, np.inf))
    beside = recent[max(after - 1, 0) : after + 1]
    times = [at - stamp_ns for at, _ in beside]
    if min(map(abs, times), default=np.inf) > EFFORT_AGE_NS:
        return np.nan
    return float(np.interp(0.0, times, [effort for _, effort in beside]))


class LiveEncoderless:
    """``EncoderlessEstimator``, sample by sample, and the efforts heard so far."""

    def __init__(self, model: Model, before: LiveEncoderless | None = None) -> None:
        """Prepare.

        Args:
            model: the prepared robot, with at least one joint without encoder.
            before: the estimate with other numbers of the same robot, whose efforts are kept.
        """
        self.solver = EncoderlessEstimator(model)
        offsets = {motor.name: motor.sensor.clock_offset_ns for motor in model.robot.motors}
        self.heard: RecentEfforts = before.heard if before else RecentEfforts(offsets)
        self.heard.clock_offset_ns = offsets
        self.lacks_efforts: bool = before is not None and before.lacks_efforts
        """Whether no effort was found for the last sample."""

    def reset(self) -> None:
        """Discard efforts and history."""
        self.heard.clear()
        self.solver.core.reset()

    def estimate(self, sample: Sample) -> Estimate:
        """Estimate a sample; a predicted one leaves the history as it is."""
        if sample.predicted:
            self.solver.core.keep()
        else:
            self.solver.core.roll_back()
        efforts = self.heard.at(sample.stamp_ns)
        self.lacks_efforts = not bool(np.isfinite(efforts).any())
        one = Samples(
            np.array([sample.stamp_ns]), sample.motor_angle[None, :], sample.joint_angle[None, :]
        )
        found = self.solver.run(one, efforts[None, :])
        assert found.stddev is not None
        values, stddev = np.nan_to_num(found.values[0]), np.nan_to_num(found.stddev[0])
        layout = found.layout
        solved = not any(int(flag) & INVALID for flag in values[layout.status])
        angles = None if self.lacks_efforts else found.angles
        return Estimate(sample.stamp_ns, values, layout, solved, stddev, angles)

    def state_at(self, stamp_ns: int) -> State:
        """The robot's state after the last sample, whose stamp is given [ns]."""
        return State(stamp_ns, self.solver.core.state)


def efforts_at(
    stamp_ns: NDArray[np.int64], motors: tuple[str, ...], recorded: Mapping[str, Series]
) -> Table:
    """Efforts of the motors at some stamps, interpolated between recorded ones.

    Args:
        stamp_ns: increasing [ns], shape (n,).
        motors: names, in the robot's order.
        recorded: efforts by motor [N m], where there are any.

    Returns:
        Shape (n, motors); NaN where no effort is within ``EFFORT_AGE_NS``.
    """
    found = np.full((stamp_ns.size, len(motors)), np.nan)
    for m, name in enumerate(motors):
        series = recorded.get(name)
        if series is not None:
            usable = np.isfinite(series.value)
            stamps, values = series.stamp_ns[usable].tolist(), series.value[usable].tolist()
            heard = list(zip(stamps, values, strict=True))
            found[:, m] = [_effort_at(heard, stamp) for stamp in stamp_ns.tolist()]
    return found

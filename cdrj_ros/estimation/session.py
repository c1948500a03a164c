"""The live estimator of a node: readings in, estimates out, with changes at run time.

This module is independent of ROS: a node converts messages, calls it and publishes the results.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdrj_ros._core import JointStateDecoder, mark_unsure
from cdrj_ros.estimation.changes import (
    RestWatch,
    narrowed,
    preloads_of,
    reference_at,
    with_other_numbers,
)
from cdrj_ros.estimation.conditioner import TOPICS, Conditioner, Kind, Mode
from cdrj_ros.estimation.encoderless import LiveEncoderless
from cdrj_ros.estimation.ensemble import (
    UNSURE_SHARE,
    Ensemble,
    mark_elements_unsure,
    preload_of_elements,
)
from cdrj_ros.estimation.estimator import (
    NEVER,
    NO_DOUBTS,
    EarlierRun,
    Estimate,
    Sample,
    State,
    initial_state,
    step,
)
from cdrj_ros.estimation.fusion import SensorFusion
from cdrj_ros.estimation.preloads import START_SHARE, Preloads
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import Model


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
    tracking: float | None = None
    """Bandwidth of the tracking filters [Hz], 0 for none; None: the robot file's."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            UsageError: one is out of range.
        """
        if not self.unsure_share > 0.0:
            raise UsageError(f"unsure_share must be greater than 0, got {self.unsure_share:g}")
        if self.tracking is not None and not 0.0 <= self.tracking < inf:
            raise UsageError(f"tracking must be at least 0 Hz, got {self.tracking:g}")

    @property
    def corrects(self) -> bool:
        """Whether sensors other than the encoders correct the estimate."""
        return self.tension_sensors or self.track_preload


class LiveEstimator:
    """Conditioning, estimate, uncertainty and sensor fusion of one robot."""

    def __init__(self, model: Model, options: Options | None = None) -> None:
        """Prepare.

        Args:
            model: the prepared robot.
            options: the options; None: the defaults.

        Raises:
            UsageError: options that exclude each other or are out of range.
        """
        options = options or Options()
        if options.corrects and not options.uncertainty:
            raise UsageError("tension_sensors and track_preload need uncertainty: true")
        if options.corrects and model.robot.unmeasured:
            raise UsageError(
                f"{_without_encoder(model)}: tension_sensors and track_preload are not possible "
                "for a robot with joints without encoder"
            )
        self.options = options
        self.conditioner = Conditioner(model.robot, options.conditioning, tracking=options.tracking)
        self.unsolved = 0
        """Samples with at least one unsolved element, without predicted ones."""
        self.always_unsure: NDArray[np.bool_] | None = None
        """Elements that are ``UNSURE`` whatever their standard deviation, shape (elements,); None
        for none.  The health monitor sets it."""
        self.ensemble: Ensemble | None = None
        self.fusion: SensorFusion | None = None
        """Load cells and motors' efforts, if the options ask for them."""
        self.encoderless: LiveEncoderless | None = None
        """The estimate of a robot with joints without encoder."""
        self.started = model
        """The robot as given at construction."""
        self.changes: dict[str, float] = {}
        """Reference angles and preloads that were set since then, by path [SI]."""
        self.use(model)
        self.reset()

    def set_unsure_share(self, share: float) -> None:
        """Change ``Options.unsure_share``."""
        self.options = replace(self.options, unsure_share=share)

    def set_tracking(self, bandwidth: float | None) -> None:
        """Change the bandwidth of the tracking filters (``Options.tracking``); state is kept."""
        self.options = replace(self.options, tracking=bandwidth)
        self.conditioner.set_tracking(bandwidth)

    def use(self, model: Model) -> None:
        """Continue with other numbers of the same robot; state and readings are kept."""
        options = self.options
        if model.robot.unmeasured:
            self.encoderless = LiveEncoderless(model, self.encoderless)
        elif options.uncertainty:
            known = narrowed(model.robot, self.changes)
            share = START_SHARE if options.corrects else 0.0
            before, self.ensemble = self.ensemble, Ensemble(model, preload_share=share, known=known)
            if before is not None:
                self.ensemble.core.take_offset(before.core.offset)
                self.ensemble.core.swing[:] = before.core.swing
        if self.ensemble is not None and options.corrects:
            if self.fusion is None:
                self.fusion = SensorFusion(self.ensemble, track_preload=options.track_preload)
            else:
                self.fusion.use(self.ensemble)
        self.model = model
        self._predicted: State | None = None
        """The state after the last predicted sample, if one was taken since the last other one."""
        self._preload = preload_of_elements(model.robot)
        self._everywhere = np.ones(self._preload.size, dtype=np.bool_)

    def reset(self) -> None:
        """Discard readings, friction history and measurements; the counters are kept."""
        self.conditioner.reset()
        if self.fusion is not None:
            self.fusion.reset()
        self._restart(known=False)

    def _restart(self, *, known: bool) -> None:
        """Begin anew; ``known`` keeps what is known of preloads and sensors."""
        self._earlier: EarlierRun | None = None
        """The run that the next sample continues."""
        self._jumps = self.conditioner.clock_jumps
        self.state: State = initial_state(self.model)
        self.uncorrected: State = self.state
        """The state without corrections by other sensors."""
        self._uncorrected_values: Vector = np.empty(0)
        """Its estimate, see ``Estimate.values``."""
        self._predicted = None
        self.corrected_by: set[str] = self.corrected_by if known else set()
        """Sensors whose corrections distinguish ``state`` from ``uncorrected``."""
        self.sample: Sample | None = None
        self._watch = RestWatch()
        if self.encoderless is not None:
            self.encoderless.reset()
        if self.ensemble is not None and known:
            self.ensemble.reset()
        elif self.ensemble is not None:
            self.ensemble.restore_preloads()
        if self.fusion is not None:
            self.fusion.restart(known=known)

    def resume(self, earlier: EarlierRun, corrected_by: Iterable[str] = ()) -> None:
        """Continue from the end of an earlier run at the next sample.

        Args:
            earlier: where it ended.
            corrected_by: sensors whose corrections distinguish its state from the one without them.
        """
        self._earlier = earlier
        self.corrected_by = set(corrected_by)
        angles = np.concatenate([earlier.motor_angle, earlier.joint_angle])
        self.conditioner.expect(angles, earlier.state.stamp_ns)

    def suspend(self) -> None:
        """Discard waiting readings; the next sample continues as after a restart of the process.

        If the robot moves in the meantime, its friction history is unknown, see ``resume``.
        Nothing happens before the first sample.
        """
        if self.sample is None:
            return
        motor, joint = self.sample.motor_angle, self.sample.joint_angle
        earlier = EarlierRun(self.state, motor, joint, self.uncorrected.values)
        known = self.conditioner.memory()
        members = None if self.ensemble is None else deepcopy(self.ensemble.memory())
        self.conditioner.reset()
        self._restart(known=True)
        self.conditioner.recall(known)
        if self.ensemble is not None and members is not None:
            self.ensemble.recall(members)
        self.resume(earlier, self.corrected_by)

    def _take_up(self, earlier: EarlierRun, sample: Sample) -> None:
        """Continue an earlier run's state at the first sample of this one."""
        state = earlier.state
        late = sample.stamp_ns - state.stamp_ns
        if late <= 0:  # the clock has been set back since
            state = State(sample.stamp_ns - 1_000_000, state.values)
            if self.ensemble is not None:
                self.ensemble.shift_clock(late - 1_000_000)
        self.state, self.uncorrected = state, State(state.stamp_ns, earlier.uncorrected)
        if self.ensemble is not None:
            if earlier.has_moved(sample):
                self.ensemble.reset()
            # until other sensors narrow it, or ``reset`` confirms the angles
            preloads = Preloads(self.ensemble)
            preloads.vary(preloads.mean_tensions(earlier.pose_change(self.model, sample)))
        if late > 0 and self.fusion is not None:
            self.fusion.drift_unmeasured(late * 1e-9)

    def feed(
        self,
        kind: Kind,
        stamp_ns: int,
        names: Sequence[str],
        positions: Sequence[float] | Vector,
    ) -> tuple[bool, list[Estimate]]:
        """Process a message of angles.

        Args:
            kind: ``motors``, ``joints`` or ``both``.
            stamp_ns: stamp of the message [ns].
            names: names of the axes.
            positions: their angles [rad].

        Returns:
            Whether the clock jumped back, and the estimates that the message completes.
        """
        return self._estimates_of(self.conditioner.feed(TOPICS[kind], stamp_ns, names, positions))

    def feed_message(self, kind: Kind, message: JointStateDecoder) -> tuple[bool, list[Estimate]]:
        """``feed`` the last message of a decoder."""
        return self._estimates_of(self.conditioner.feed_message(TOPICS[kind], message))

    def _estimates_of(self, found: list[tuple[Any, ...]]) -> tuple[bool, list[Estimate]]:
        """Whether the clock jumped back before these samples, and the estimates for them."""
        jumped = self.conditioner.clock_jumps != self._jumps
        if jumped:
            self._restart(known=True)
        estimates = []
        for fields in found:
            sample = Sample(*fields)
            estimate = self.take(sample)
            if not sample.silent:
                estimates.append(estimate)
        return jumped, estimates

    def take(self, sample: Sample) -> Estimate:
        """Process one sample.

        The estimate has its standard deviations, and the angles of joints without encoder.  A
        predicted sample leaves the memory as it is; only the next predicted one continues it.
        """
        if self.encoderless is not None:
            return self._take_encoderless(self.encoderless, sample)
        if sample.predicted:
            return self._take_predicted(sample)
        return self._take_next(sample)

    def _take_next(self, sample: Sample) -> Estimate:
        """``take`` for a sample that continues the memory."""
        self._predicted = None
        if self._earlier is not None:
            self._take_up(self._earlier, sample)
            self._earlier = None
        estimate = self._step(sample)
        self._note(sample, estimate)
        self._mark(sample, estimate)
        if self.fusion is not None and estimate.solved:
            self._correct(self.fusion, sample, estimate)
        return estimate

    def _step(self, sample: Sample) -> Estimate:
        """The next estimate, with its standard deviations if they are wanted."""
        ensemble = self.ensemble
        if ensemble is None:
            self.state, estimate = step(self.model, self.state, sample)
            return estimate
        if self.fusion is None:
            self.state, estimate = ensemble.step(self.state, sample)
            return estimate
        model, is_corrected = self.model, self.state is not self.uncorrected
        if self.state.stamp_ns == NEVER:
            model = self.fusion.start_model()
        if model is self.model:
            self.state, estimate = ensemble.step(self.state, sample)
        else:
            self.state, estimate = step(model, self.state, sample)
            estimate.stddev = ensemble.update(sample, estimate)
        if is_corrected or model is not self.model:
            self.uncorrected, other = step(self.model, self.uncorrected, sample)
            self._uncorrected_values = other.values
        else:
            self.uncorrected, self._uncorrected_values = self.state, estimate.values
        return estimate

    def _note(self, sample: Sample, estimate: Estimate) -> None:
        """Note a sample that is not predicted."""
        self.sample = sample
        self._watch.add(sample)
        if not estimate.solved:
            self.unsolved += 1

    def _correct(self, fusion: SensorFusion, sample: Sample, estimate: Estimate) -> None:
        """Apply other sensors' measurements; if one of these sensors was wrong, undo all of them.

        The uncorrected state then replaces the state, and the ensemble starts anew.
        """
        self.state, wrong = fusion.correct(
            sample, estimate, self._uncorrected_values, self.state, self.corrected_by
        )
        if wrong:
            self.state = self.uncorrected
            self.corrected_by.clear()
            fusion.undo(wrong)
        if wrong or fusion.sensors.contradicted:
            mark_elements_unsure(estimate.values, self._everywhere)

    def _take_predicted(self, sample: Sample) -> Estimate:
        """``take`` for a predicted sample."""
        self._predicted, estimate = step(self.model, self._predicted or self.state, sample)
        if self.ensemble is not None:
            estimate.stddev = self.ensemble.predict(sample, estimate)
        self._mark(sample, estimate)
        if self.fusion is not None and self.fusion.sensors.contradicted:
            mark_elements_unsure(estimate.values, self._everywhere)
        return estimate

    def _take_encoderless(self, encoderless: LiveEncoderless, sample: Sample) -> Estimate:
        """``take`` for a robot with joints without encoder."""
        self._earlier = None
        estimate = encoderless.estimate(sample)
        if not sample.predicted:
            self.state = self.uncorrected = encoderless.state_at(sample.stamp_ns)
            self._note(sample, estimate)
        self._mark(sample, estimate)
        if not self.options.uncertainty:
            estimate.stddev = None
        return estimate

    def _mark(self, sample: Sample, estimate: Estimate) -> None:
        """Set ``UNSURE`` where deviations are too large, or readings or the robot are in doubt."""
        if estimate.stddev is not None:
            share = self.options.unsure_share
            mark_unsure(estimate.values, self._preload, estimate.stddev, share, NO_DOUBTS)
        if sample.doubtful:
            mark_elements_unsure(estimate.values, self._everywhere)
        if self.always_unsure is not None:
            mark_elements_unsure(estimate.values, self.always_unsure)

    def feed_tensions(
        self,
        stamp_ns: int,
        names: Sequence[str],
        tensions: Sequence[float] | Vector,
        stddevs: Sequence[float] | Vector,
    ) -> None:
        """Queue a message of load cells; it is used with the first sample not before its stamp.

        Args:
            stamp_ns: stamp of the message [ns].
            names: ``cable/element``.
            tensions: measured tensions [N].
            stddevs: one standard deviation per name [N]; empty: the robot file's.
        """
        if self.fusion is None:
            return
        if len(names) != len(tensions) or len(stddevs) not in (0, len(names)):
            self.conditioner.refuse("malformed")
            return
        self.fusion.waiting.feed_tensions(stamp_ns, names, tensions, stddevs)

    def wants_efforts(self, stamp_ns: int) -> bool:
        """Whether efforts of this stamp [ns] would be used for any motor, see ``feed_efforts``."""
        if self.encoderless is not None:
            return True
        return self.fusion is not None and self.fusion.waiting.wants_efforts(stamp_ns)

    def feed_efforts(
        self, stamp_ns: int, names: Sequence[str], efforts: Sequence[float] | Vector
    ) -> None:
        """Queue measured efforts of motors [N m]; other names are ignored."""
        if self.encoderless is not None:
            self.encoderless.feed_efforts(stamp_ns, names, efforts)
        elif self.fusion is not None:
            self.fusion.waiting.feed_efforts(stamp_ns, names, efforts)

    def tare(self) -> str:
        """Make the current angles the reference pose.

        Returns:
            A description of the new reference.

        Raises:
            UsageError: no sample yet, or the robot is not at rest.
        """
        if self.sample is None:
            raise UsageError("no angles yet: no reading of every motor and joint has arrived")
        if self.encoderless is not None:
            raise UsageError(f"no reference can be set: {_without_encoder(self.model)}")
        if reason := self._watch.in_motion(self.model.robot):
            raise UsageError(reason)
        change = reference_at(self.model, self.sample)
        self.change(change.values)
        return change.words

    def set_preload(self, preloads: Mapping[str, float]) -> str:
        """Set preloads of cables in the reference pose [N]; the estimate starts anew.

        Raises:
            UsageError: an unknown cable or a tension out of range.
        """
        change = preloads_of(self.model, preloads)
        self.change(change.values)
        return change.words

    def set_numbers(self, values: Mapping[str, float]) -> str:
        """Change numbers of the robot file, by path; friction history and readings are kept.

        Raises:
            UsageError, RobotFileError: a value is invalid; nothing has changed then.
        """
        self.use(with_other_numbers(self.model, values))
        return ", ".join(f"{path} = {value:g}" for path, value in values.items())

    def change(self, values: Mapping[str, float]) -> None:
        """Change reference angles and preloads, by path; the estimate starts anew.

        The changes are written to the state file.  Sensors that wrap keep their count of turns.

        Raises:
            UsageError, RobotFileError: a value is invalid; nothing has changed then.
        """
        model = with_other_numbers(self.model, values)
        self.changes.update(values)
        self.use(model)
        self.conditioner.reset(keep_turns=True)
        self._restart(known=False)

    @property
    def last_ns(self) -> int:
        """Stamp of the last sample [ns]; ``NEVER`` before the first."""
        return self.state.stamp_ns if self.sample is not None else NEVER


def _without_encoder(model: Model) -> str:
    """The joints without encoder, as the subject of a message."""
    names = [model.layout.joints[j] for j in model.robot.unmeasured]
    return f"{', '.join(names)} {'has' if len(names) == 1 else 'have'} no encoder"

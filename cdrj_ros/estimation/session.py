"""The live estimator of a node: readings in, estimates out, with changes at run time.

This module is independent of ROS: a node converts messages, calls it and publishes the results.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from math import inf, nan
from typing import Any, Final

import numpy as np

from cdrj_ros._core import JointStateDecoder, mark_unsure
from cdrj_ros.estimation.breaks import EarlierRun, Unseen
from cdrj_ros.estimation.changes import narrowed, preloads_of, tare, with_other_numbers
from cdrj_ros.estimation.conditioner import TOPICS, Conditioner, Kind, Mode
from cdrj_ros.estimation.corrections import Corrections, exact
from cdrj_ros.estimation.encoderless import LiveEncoderless
from cdrj_ros.estimation.ensemble import NO_STDDEVS, UNSURE_SHARE, Ensemble
from cdrj_ros.estimation.estimator import (
    NEVER,
    NO_DOUBTS,
    Estimate,
    LastKnown,
    Sample,
    State,
    initial_state,
    on_axes,
    step,
)
from cdrj_ros.estimation.sensors import WaitingReadings, sensors_of
from cdrj_ros.estimation.travel import MotorTravel
from cdrj_ros.estimation.verdict_words import Report
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.output import listed
from cdrj_ros.model.packing import INVALID
from cdrj_ros.model.prepared import Model

KEPT: Final = 4_096
"""Last samples that are kept: more than ``REST_NS`` at 10 kHz."""

BEYOND: Final = 0.05
"""Share of readings beyond the joints' ranges from which the others' motion tells no factor."""


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
    ignored_sensors: tuple[str, ...] = ()
    """Load cells, and motors and joints whose efforts are not used, by name; ``*`` for all."""
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


class LiveEstimator:
    """Conditioning, estimate, uncertainty and corrections by sensors of one robot."""

    def __init__(self, model: Model, options: Options | None = None) -> None:
        """Prepare.

        Args:
            model: the prepared robot.
            options: the options; None: the defaults.

        Raises:
            UsageError: options that exclude each other or are out of range.
        """
        options = options or Options()
        sensors = sensors_of(model)
        unknown = set(options.ignored_sensors) - {"*", *sensors}
        if unknown:
            raise UsageError(f"ignored_sensors names no sensor of the robot: {min(unknown)}")
        self.options = options
        self.conditioner = Conditioner(model.robot, options.conditioning, tracking=options.tracking)
        self.unsolved = 0
        """Samples with at least one unsolved element, without predicted ones."""
        self.ensemble: Ensemble | None = None
        self._travel = MotorTravel(model)
        self._unseen = Unseen(model)
        self.readings = WaitingReadings(sensors, options.ignored_sensors)
        """Readings of load cells and efforts that wait for a sample."""
        self.corrections: Corrections | None = None
        """What they say, from the first of them on."""
        self._expected: Corrections | None = None
        """Corrections that are prepared for the first of them."""
        self._verified: set[str] = set()
        """Sensors that a spring scale has confirmed."""
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
        self.model = model
        self._travel.use(model)
        self._unseen.use(model)
        expected, self._expected = self._expected, None
        if options.uncertainty and not model.robot.unmeasured:
            if self.corrections is not None:
                self.corrections = self._new_corrections()
            self._renew_members()
        if self.ensemble is not None:  # with other numbers it had other tensions
            self.ensemble.core.begin_units()
        self._predicted: State | None = None
        """The state after the last predicted sample, if one was taken since the last other one."""
        if expected is not None:
            self.expect_sensors()

    def _new_corrections(self) -> Corrections:
        self.readings.sensors = sensors_of(self.model, self._verified)
        return Corrections(self.model, self.changes, self.readings.sensors)

    def _renew_members(self) -> None:
        """Draw the members anew; with corrections they hold the history alone."""
        known = narrowed(self.model.robot, self.changes)
        if self.corrections is not None:
            known = exact(known)
        before, self.ensemble = self.ensemble, Ensemble(self.model, known=known)
        if before is not None:
            self.ensemble.core.continue_lags(before.core)

    def expect_sensors(self) -> None:
        """Prepare now what the first reading of a sensor needs: for a hand, that takes a second."""
        if self._uses_sensors and self.corrections is None and self.readings.expected:
            self._expected = self._new_corrections()

    def reset(self) -> None:
        """Discard readings, friction history and measurements; the counters are kept."""
        self.conditioner.reset()
        self._restart(known=False)

    def _restart(self, *, known: bool) -> None:
        """Begin anew; ``known`` keeps what is known of preloads and sensors."""
        self._earlier: EarlierRun | None = None
        """The run that the next sample continues."""
        self._jumps = self.conditioner.clock_jumps
        self._last_known = LastKnown(self.model)
        self.state: State = initial_state(self.model)
        self._predicted = None
        self.sample: Sample | None = None
        """The last one that is not predicted, with the last known angles."""
        self._recent: deque[Sample] = deque(maxlen=KEPT)
        """The last samples in which all angles are known: a tare looks for a rest among them, and
        ``misfit`` for poses."""
        self._travel.forget()
        self.readings.forget()
        if self.encoderless is not None:
            self.encoderless.reset()
        if not known:
            self._unseen = Unseen(self.model)
        self._unseen.end()
        if self.ensemble is not None:
            self.ensemble.reset()
            if not known:
                self.ensemble.core.least_variance[:] = 0.0
                self.ensemble.core.begin_units()
        if self.corrections is not None and known:
            self.corrections.restart()
        elif self.corrections is not None:
            self.corrections.forget()

    def resume(self, earlier: EarlierRun) -> None:
        """Continue from the end of an earlier run at the next sample.

        Args:
            earlier: where it ended.
        """
        self._earlier = earlier
        angles = np.concatenate([earlier.motor_angle, earlier.joint_angle])
        self.conditioner.expect(angles, earlier.state.stamp_ns)

    def begin_corrections(self) -> None:
        """Use sensors from now on: their beliefs hold what the file leaves open, not the members.

        The friction history begins anew.
        """
        self.corrections = self._expected or self._new_corrections()
        self._expected = None
        self._renew_members()
        self.corrections.widen(self._unseen.changes)
        self.state = initial_state(self.model)

    def suspend(self) -> None:
        """Discard waiting readings; the next sample continues as after a restart of the process.

        If the robot moves in the meantime, its friction history is unknown, see ``resume``.
        Nothing happens before the first sample.
        """
        if self.sample is None:
            return
        earlier = self._run_so_far(self.sample)
        known = self.conditioner.memory()
        members = None if self.ensemble is None else deepcopy(self.ensemble.memory())
        self.conditioner.reset()
        self._restart(known=True)
        self.conditioner.recall(known)
        if self.ensemble is not None and members is not None:
            self.ensemble.recall(members)
        self.resume(earlier)

    def _run_so_far(self, last: Sample) -> EarlierRun:
        """The run until its last sample, for another to continue."""
        return EarlierRun(self.state, last.motor_angle, last.joint_angle, self.last_tension)

    def _take_up(self, earlier: EarlierRun, sample: Sample) -> None:
        """Continue an earlier run's state at the first sample of this one."""
        state = earlier.state
        late = sample.stamp_ns - state.stamp_ns
        if late <= 0:  # the clock has been set back since
            state = State(sample.stamp_ns - 1_000_000, state.values)
            if self.ensemble is not None:
                self.ensemble.shift_clock(late - 1_000_000)
        self.state = state
        if self.ensemble is not None and earlier.has_moved(sample):
            self.ensemble.reset()
        self._unseen.end_run(earlier.tension)

    def _doubt_change(self, ensemble: Ensemble, sample: Sample) -> None:
        """Doubt what has changed in a break, see ``Unseen.add``."""
        before, now = self._unseen.changes, step(self.model, self.state, sample)[1]
        self._unseen.add(now.tension, now.status, sample)
        if self.corrections is not None:
            self.corrections.widen(np.sqrt(self._unseen.changes**2 - before**2))
        else:
            ensemble.show_at_least(self._unseen.changes)

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
        readings = np.asarray(positions)
        return self._estimates_of(self.conditioner.feed(TOPICS[kind], stamp_ns, names, readings))

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
        estimate = self._step(sample)
        if not sample.predicted:
            whole = estimate.solved or not np.isnan(sample.angles).any()
            self.sample = sample if whole else sample.known_since(self.sample)
            if whole:
                self._recent.append(sample)
        if self.corrections is not None:
            self._believe(self.corrections, sample, estimate)
        self._mark(sample, estimate)
        if estimate.solved:
            self._last_known.keep(estimate)
        else:
            invalid = (estimate.status.astype(np.uint8) & INVALID) != 0
            stddev = None if estimate.stddev is None else estimate.stddev[None]
            unread = np.isnan(sample.angles)[None]
            unknown = self._last_known.hold(unread, estimate.values[None], stddev)
            self.unsolved += not sample.predicted and bool((invalid & ~unknown).any())
        return estimate

    def _step(self, sample: Sample) -> Estimate:
        """The model's estimate, with standard deviations by the members."""
        if self.encoderless is not None:
            return self._step_encoderless(self.encoderless, sample)
        if sample.predicted:
            self._predicted, estimate = step(self.model, self._predicted or self.state, sample)
            if self.ensemble is not None:
                estimate.stddev = self.ensemble.predict(sample, estimate)
            return estimate
        self._predicted = None
        if self._earlier is not None:
            self._take_up(self._earlier, sample)
            self._earlier = None
        if self.ensemble is not None and self._unseen.is_due(sample):
            self._doubt_change(self.ensemble, sample)
        else:
            self._unseen.end()
        if self.ensemble is None:
            self.state, estimate = step(self.model, self.state, sample)
        else:
            if self.corrections is None and self.readings.heard:
                self.begin_corrections()
            self.state, estimate = self.ensemble.step(self.state, sample)
        if sample.after_gap.size or not estimate.solved:
            self._unseen.note(sample, estimate.tension[None], estimate.status[None])
        else:  # which only corrections change
            tension = estimate.tension
            self._unseen.known = tension if self.corrections is None else tension.copy()
        return estimate

    def _step_encoderless(self, encoderless: LiveEncoderless, sample: Sample) -> Estimate:
        """``_step`` of a robot with joints without encoder."""
        self._earlier = None
        estimate = encoderless.estimate(sample)
        if not sample.predicted:
            self.state = encoderless.state_at(sample.stamp_ns)
        return estimate

    def misfit(self) -> str:
        """Why motors and joints do not fit each other, and the key that mends it; or empty.

        It looks at the samples since it was asked last: ask once a second.
        """
        suspected = self._suspected()
        if not (suspected and self.misfitting):
            return ""
        found = self.report()
        return found.message if found is not None else suspected

    def report(self) -> Report | None:
        """What readings say about robot and sensors; None before the first of a sensor.

        Ask once a second, as ``misfit``.
        """
        if self.corrections is None:
            return None
        return self.corrections.report(self._suspected())

    def _suspected(self) -> str:
        """What may be wrong with which motor or joint by their motions, see ``MotorTravel``."""
        latest, names = self.readings.latest, self.model.layout.motors
        efforts = np.array([latest[name].value if name in latest else nan for name in names])
        beyond = self.conditioner.refused["out_of_range"]
        whole = beyond < BEYOND * self.conditioner.accepted
        return self._travel.follow(self._recent, efforts, whole=whole)

    @property
    def misfitting(self) -> list[str]:
        """Axes whose angles may have another unit, sign or name, by what they leave of tensions."""
        names = self.conditioner.misfitting
        if self.ensemble is not None:
            axes = zip(self.model.robot.axes, self.ensemble.core.unit_error, strict=True)
            worth = self.conditioner.worth
            names += [axis.name for (axis, error), w in zip(axes, worth, strict=True) if error > w]
        return names

    def late_elements(self, estimate: Estimate) -> list[str]:
        """Elements whose variance is mostly that of values older than their stamps, (U13)."""
        if self.ensemble is None or estimate.stddev is None:
            return []
        names = self.model.layout.elements
        tensions = slice(len(names))
        late = self.ensemble.core.late[tensions] > 0.5 * estimate.stddev[tensions] ** 2
        return [name for name, is_late in zip(names, late, strict=True) if is_late]

    def _believe(self, corrections: Corrections, sample: Sample, estimate: Estimate) -> None:
        """Add what sensors say to the model's estimate; only a sample that lasts hears them."""
        assert self.ensemble is not None
        if sample.predicted:
            corrections.correct(estimate, self.ensemble.variance)
        else:
            due = self.readings.due(sample.stamp_ns)
            corrections.take(sample, estimate, due, self.ensemble)

    def _mark(self, sample: Sample, estimate: Estimate) -> None:
        """Set ``UNSURE`` where deviations are too large, or readings or the robot are in doubt."""
        stddev = NO_STDDEVS if estimate.stddev is None else estimate.stddev
        doubted = NO_DOUBTS if self.corrections is None else self.corrections.doubted
        if sample.doubtful.size and sample.doubtful.any():
            doubted = on_axes(self.model, sample.doubtful)
            if self.corrections is not None:
                doubted = self.corrections.doubted_beside(doubted)
        if self.corrections is not None and not estimate.solved:  # what sensors said is old
            unsolved = (estimate.status.astype(np.uint8) & INVALID) != 0
            doubted = self.corrections.doubted_beside(
                unsolved | doubted if doubted.size else unsolved
            )
        mark_unsure(self.model.core, estimate.values, stddev, self.options.unsure_share, doubted)
        if not self.options.uncertainty:
            estimate.stddev = None

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
        if len(names) != len(tensions) or len(stddevs) not in (0, len(names)):
            self.conditioner.refuse("malformed")
        elif self._uses_sensors:
            self.readings.feed(stamp_ns, names, tensions, stddevs)

    @property
    def _uses_sensors(self) -> bool:
        return self.options.uncertainty and self.encoderless is None

    def wants_efforts(self, names: Sequence[str], stamp_ns: int) -> bool:
        """Whether efforts of this stamp [ns] would be used for any of these axes."""
        if self.encoderless is not None:
            return True
        return self._uses_sensors and self.readings.wants(names, stamp_ns)

    def feed_efforts(
        self, stamp_ns: int, names: Sequence[str], efforts: Sequence[float] | Vector
    ) -> None:
        """Queue measured efforts of motors and joints [N m]; other names are ignored."""
        if self.encoderless is not None:
            self.encoderless.heard.add(stamp_ns, names, efforts)
        elif self._uses_sensors and len(efforts) == len(names):
            self.readings.feed(stamp_ns, names, efforts)

    def tare(self) -> str:
        """Make the current angles the reference pose, or what sensors have shown of it.

        Returns:
            A description of the new reference.

        Raises:
            UsageError: no sample yet, the robot is not at rest, or sensors contradict.
        """
        if self.sample is None:
            raise UsageError("no angles yet: no reading of every motor and joint has arrived")
        if silent := [*self.conditioner.silent]:
            raise UsageError(f"no reading of {listed(silent)} arrives")
        if self.encoderless is not None:
            hidden = self.model.robot.joints[self.model.robot.unmeasured[0]]
            raise UsageError(f"no reference can be set: {hidden.name} has no encoder")
        measured = self.corrections.changes() if self.corrections is not None else {}
        change = tare(self.model, self._recent, self.changes, measured, self.readings)
        self.change(change.values)
        return change.words

    def set_preload(self, preloads: Mapping[str, float]) -> str:
        """Set preloads of cables in the reference pose [N]; the estimate starts anew.

        Sensors that say the same as the spring scale are doubted less from then on.

        Raises:
            UsageError: an unknown cable or a tension out of range.
        """
        change = preloads_of(self.model, preloads)
        if self.corrections is not None:
            self._verified |= self.corrections.confirmed_by(preloads)
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
        self.ensemble = None  # what the tensions have shown of lags depends on these numbers
        self.use(model)
        self.conditioner.reset(keep_turns=True)
        self._restart(known=False)

    @property
    def last_ns(self) -> int:
        """Stamp of the last sample [ns]; ``NEVER`` before the first."""
        return self.state.stamp_ns if self.sample is not None else NEVER

    @property
    def last_tension(self) -> Vector:
        """Tensions by the model when they were last known [N], see ``Unseen.known``."""
        return self._unseen.known

"""The live estimator of a node: readings in, estimates out, with changes at run time.

This module is independent of ROS: a node converts messages, calls it and publishes the results.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cdrj_ros._core import JointStateDecoder
from cdrj_ros.conditioning.conditioner import TOPICS, Conditioner, Kind, samples_of
from cdrj_ros.conditioning.samples import Sample
from cdrj_ros.estimation.earlier_run import EarlierRun
from cdrj_ros.estimation.ensemble import Spread
from cdrj_ros.estimation.estimator import NEVER, Estimate, State, initial_state, step
from cdrj_ros.estimation.options import Options
from cdrj_ros.estimation.other_numbers import preloads_of, reference_at, with_other_numbers
from cdrj_ros.estimation.other_sensors import OtherSensors
from cdrj_ros.estimation.output import Output, OutputAlone
from cdrj_ros.estimation.preloads import DOUBT
from cdrj_ros.estimation.rest import RestWatch
from cdrj_ros.estimation.unsure import (
    mark_all_unsure,
    mark_some_unsure,
    mark_unsure,
    preload_of_elements,
)
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.tolerances import narrowed

if TYPE_CHECKING:
    from cdrj_ros.estimation.live_alone import LiveAlone

Vector = NDArray[np.float64]


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
        self.conditioner = Conditioner(
            model.robot.as_read, options.conditioning, tracking=options.tracking
        )
        self.unsolved = 0
        """Samples with at least one unsolved element, without predicted ones."""
        self.doubted: NDArray[np.bool_] | None = None
        """Elements that are ``UNSURE`` whatever their standard deviation, shape (elements,); None
        for none.  The health monitor sets it."""
        self.spread: Spread | None = None
        self.other_sensors: OtherSensors | None = None
        """Load cells and motors' efforts, if the options ask for them."""
        self.alone: LiveAlone | None = None
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
        options, spread = self.options, None
        if model.robot.unmeasured:
            from cdrj_ros.estimation.live_alone import LiveAlone  # most robots do without

            self.alone = LiveAlone(model, self.alone)
        elif options.uncertainty:
            known = narrowed(model.robot, self.changes)
            share = DOUBT if options.corrects else 0.0
            spread = Spread(model, preload_share=share, known=known, before=self.spread)
        if spread is not None and options.corrects:
            if self.other_sensors is None:
                self.other_sensors = OtherSensors(spread, options)
            else:
                self.other_sensors.use(spread)
        self.model, self.spread = model, spread
        self._ahead: State | None = None
        """The state after the last predicted sample, if one was taken since the last other one."""
        self._preload = preload_of_elements(model.robot)

    def reset(self) -> None:
        """Discard readings, friction history and measurements; the counters are kept."""
        self.conditioner.reset()
        if self.other_sensors is not None:
            self.other_sensors.fusion.reset()
        self._restart(known=False)

    def _restart(self, *, known: bool) -> None:
        """Begin anew; ``known`` keeps what is known of preloads and sensors."""
        self._earlier: EarlierRun | None = None
        """The run that the next sample continues."""
        self._jumps = self.conditioner.clock_jumps
        self.state: State = initial_state(self.model)
        self.unaided: State = self.state
        """The state without corrections by other sensors."""
        self._ahead = None
        self.taught: set[str] = self.taught if known else set()
        """Sensors whose corrections distinguish ``state`` from ``unaided``."""
        self.sample: Sample | None = None
        self._watch = RestWatch()
        if self.alone is not None:
            self.alone.reset()
        if self.spread is not None:
            self.spread.reset()
        if self.other_sensors is not None:
            self.other_sensors.restart(known=known)

    def resume(self, earlier: EarlierRun, taught: Iterable[str] = ()) -> None:
        """Continue from the end of an earlier run at the next sample.

        Args:
            earlier: where it ended.
            taught: sensors whose corrections distinguish its state from the one without them.
        """
        self._earlier = earlier
        self.taught = set(taught)
        motor, joint = earlier.motor_angle, earlier.joint_angle
        if motor is not None and joint is not None:
            self.conditioner.expect(np.concatenate([motor, joint]), earlier.state.stamp_ns)

    def suspend(self) -> None:
        """Discard waiting readings; the next sample continues as after a restart of the process.

        If the robot moves in the meantime, its friction history is unknown, see ``resume``.
        Nothing happens before the first sample.
        """
        if self.sample is None:
            return
        motor, joint, taught = self.sample.motor_angle, self.sample.joint_angle, self.taught
        earlier = EarlierRun(self.state, motor, joint, self.unaided.values)
        known = self.conditioner.memory()
        members = None if self.spread is None else deepcopy(self.spread.memory())
        self.conditioner.reset()
        self._restart(known=True)
        self.conditioner.recall(known)
        if self.spread is not None and members is not None:
            self.spread.recall(members)
        self.resume(earlier, taught)

    def _take_up(self, earlier: EarlierRun, sample: Sample) -> None:
        """Continue an earlier run's state at the first sample of this one."""
        state = earlier.state
        late = sample.stamp_ns - state.stamp_ns
        if late <= 0:  # the clock has been set back since
            state = State(sample.stamp_ns - 1_000_000, state.values)
            if self.spread is not None:
                self.spread.shift_clock(late - 1_000_000)
        self.state = self.unaided = state
        if earlier.unaided is not None:
            self.unaided = State(state.stamp_ns, earlier.unaided)
        if self.spread is not None and earlier.has_moved(sample):
            self.spread.reset()
        if late > 0 and self.other_sensors is not None:
            self.other_sensors.fusion.pass_unwatched(late * 1e-9)

    def feed(
        self,
        kind: Kind,
        stamp_ns: int,
        names: Sequence[str],
        positions: Sequence[float] | Vector,
    ) -> tuple[bool, list[Output]]:
        """Process a message of angles.

        Args:
            kind: ``motors``, ``joints`` or ``both``.
            stamp_ns: stamp of the message [ns].
            names: names of the axes.
            positions: their angles [rad].

        Returns:
            Whether the clock jumped back, and the estimates that the message completes.
        """
        topic = TOPICS[kind]
        return self._outputs_of(
            samples_of(self.conditioner.feed(topic, stamp_ns, names, positions))
        )

    def feed_message(self, kind: Kind, message: JointStateDecoder) -> tuple[bool, list[Output]]:
        """``feed`` the last message of a decoder."""
        return self._outputs_of(self.conditioner.take(kind, message))

    def _outputs_of(self, samples: list[Sample]) -> tuple[bool, list[Output]]:
        """Whether the clock jumped back before these samples, and the estimates for them."""
        jumped = self.conditioner.clock_jumps != self._jumps
        if jumped:
            self._restart(known=True)
        outputs = []
        for sample in samples:
            output = self.take(sample)
            if not sample.silent:
                outputs.append(output)
        return jumped, outputs

    def finish(self) -> None:
        """Do what the last estimate need not wait for; the next sample does it otherwise."""
        if self.spread is not None:
            self.spread.finish()

    def take(self, sample: Sample) -> Output:
        """Process one sample; ``finish`` can follow once the estimate has been published.

        A predicted sample leaves the memory as it is; only the next predicted one continues it.
        """
        if self.alone is not None:
            return self._take_alone(self.alone, sample)
        if sample.predicted:
            return self._look_ahead(sample)
        return self._take_next(sample)

    def _take_next(self, sample: Sample) -> Output:
        """``take`` for a sample that continues the memory."""
        self._ahead = None
        if self._earlier is not None:
            self._take_up(self._earlier, sample)
            self._earlier = None
        estimate, stddev = self._step(sample)
        self._note(sample, estimate)
        if stddev is not None:
            self._mark(estimate, stddev)
        self._mark_doubts(sample, estimate)
        others = self.other_sensors
        if others is not None and estimate.solved:
            self._correct(others, sample, estimate)
        return Output(estimate, stddev)

    def _step(self, sample: Sample) -> tuple[Estimate, Vector | None]:
        """The next estimate, and its standard deviations if they are wanted."""
        spread, others = self.spread, self.other_sensors
        if others is None:
            if spread is not None:
                self.state, estimate, stddev = spread.step(self.state, sample, at_once=False)
                return estimate, stddev
            self.state, estimate = step(self.model, self.state, sample)
            return estimate, None
        assert spread is not None
        model, untaught = self.model, self.state is self.unaided
        if self.state.stamp_ns == NEVER:
            model = others.fusion.beginning()
        if model is self.model:  # at once, since other sensors correct the members
            self.state, estimate, stddev = spread.step(self.state, sample, at_once=True)
        else:
            self.state, estimate = step(model, self.state, sample)
            stddev = spread.update(sample, estimate)
        same = untaught and model is self.model
        self.unaided = self.state if same else step(self.model, self.unaided, sample)[0]
        return estimate, stddev

    def _note(self, sample: Sample, estimate: Estimate) -> None:
        """Note a sample that is not predicted."""
        self.sample = sample
        self._watch.add(sample)
        if not estimate.solved:
            self.unsolved += 1

    def _correct(self, others: OtherSensors, sample: Sample, estimate: Estimate) -> None:
        """Apply other sensors' measurements; if one of these sensors was wrong, undo all of them.

        The uncorrected state then replaces the state, and the ensemble starts anew.
        """
        others.fusion.remember(sample, estimate)
        self.state, wrong = others.correct(sample, self.state, self.taught)
        if wrong:
            self.state = self.unaided
            self.taught.clear()
            others.take_back(wrong)
        if wrong or others.fusion.contested:
            mark_all_unsure(estimate.values, self._preload.size)

    def _look_ahead(self, sample: Sample) -> Output:
        """``take`` for a predicted sample."""
        self._ahead, estimate = step(self.model, self._ahead or self.state, sample)
        stddev = None
        if self.spread is not None:
            stddev = self.spread.look_ahead(sample, estimate)
            self._mark(estimate, stddev)
        self._mark_doubts(sample, estimate)
        if self.other_sensors is not None and self.other_sensors.fusion.contested:
            mark_all_unsure(estimate.values, self._preload.size)
        return Output(estimate, stddev)

    def _mark(self, estimate: Estimate, stddev: Vector) -> None:
        """Set ``UNSURE`` where standard deviations are too large."""
        mark_unsure(estimate.values, self._preload, stddev, self.options.unsure_share)

    def _mark_doubts(self, sample: Sample, estimate: Estimate) -> None:
        """Set ``UNSURE`` where readings or the robot itself are in doubt."""
        if sample.doubtful:
            mark_all_unsure(estimate.values, self._preload.size)
        if self.doubted is not None:
            mark_some_unsure(estimate.values, self.doubted)

    def _take_alone(self, alone: LiveAlone, sample: Sample) -> OutputAlone:
        """``take`` for a robot with joints without encoder."""
        self._earlier = None
        estimate, stddev, angles = alone.estimate(sample)
        if not sample.predicted:
            self.state = self.unaided = alone.state_at(sample.stamp_ns)
            self._note(sample, estimate)
        mark_unsure(estimate.values, self._preload, stddev, self.options.unsure_share)
        self._mark_doubts(sample, estimate)
        output = OutputAlone(estimate, stddev if self.options.uncertainty else None)
        output.angles = angles
        return output

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
        if self.other_sensors is None:
            return
        if len(names) != len(tensions) or len(stddevs) not in (0, len(names)):
            self.conditioner.refuse("malformed")
            return
        self.other_sensors.feed_tensions(stamp_ns, names, tensions, stddevs)

    def wants_efforts(self, stamp_ns: int) -> bool:
        """Whether efforts of this stamp [ns] would be used for any motor, see ``feed_efforts``."""
        if self.alone is not None:
            return True
        return self.other_sensors is not None and self.other_sensors.wants_efforts(stamp_ns)

    def feed_efforts(
        self, stamp_ns: int, names: Sequence[str], efforts: Sequence[float] | Vector
    ) -> None:
        """Queue measured efforts of motors [N m]; other names are ignored."""
        if self.alone is not None:
            self.alone.feed_efforts(stamp_ns, names, efforts)
        elif self.other_sensors is not None:
            self.other_sensors.feed_efforts(stamp_ns, names, efforts)

    def tare(self) -> str:
        """Make the current angles the reference pose.

        Returns:
            A description of the new reference.

        Raises:
            UsageError: no sample yet, or the robot is not at rest.
        """
        if self.sample is None:
            raise UsageError("no angles yet: no reading of every motor and joint has arrived")
        if self.alone is not None:
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

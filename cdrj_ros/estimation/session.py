"""The live estimator of a node: readings in, estimates out, with changes at run time.

This module is independent of ROS: a node converts messages, calls it and publishes the results.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.conditioner import Conditioner
from cdrj_ros.conditioning.samples import Sample, Samples
from cdrj_ros.conditioning.time_line import Mode
from cdrj_ros.estimation.ensemble import Spread
from cdrj_ros.estimation.estimator import NEVER, Angles, Estimate, State, initial_state, step
from cdrj_ros.estimation.fusion import Fusion
from cdrj_ros.estimation.member_kernels import MOVED, begin_sample, step_members
from cdrj_ros.estimation.motor_alone import HeardEfforts, MotorAlone
from cdrj_ros.estimation.preloads import DOUBT, FREE_DRIFT, SLOW_DRIFT
from cdrj_ros.estimation.rest import RestWatch
from cdrj_ros.estimation.unsure import (
    UNSURE_SHARE,
    mark_all_unsure,
    mark_some_unsure,
    mark_unsure,
    preload_of_elements,
)
from cdrj_ros.estimation.waiting import Measurement, WaitingMeasurements
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.mechanism import advance
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.model.shape import shape
from cdrj_ros.model.status import INVALID
from cdrj_ros.robot.document import LARGEST, document_complaints
from cdrj_ros.robot.parameters import allowed_range, find_number, with_numbers
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.robot.tolerances import narrowed

Vector = NDArray[np.float64]

SMALLEST_NOISE: Final = 1e-6
LARGEST_NOISE: Final = 1e6
"""Outside these limits a load cell's standard deviation is replaced by the robot file's [N]."""

UNWATCHED_NS: Final = 100_000_000
"""After a longer time between two runs, the friction history of a moved robot is unknown [ns]."""


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


def kernels_of(options: Options) -> tuple[Callable[..., Any], ...]:
    """Outermost kernels of a live estimator, whose compilation takes noticeable time."""
    ensemble = (begin_sample, step_members) if options.uncertainty else ()
    return (shape, advance, *ensemble)


class Output(NamedTuple):
    """One estimate and its standard deviations."""

    estimate: Estimate
    stddev: Vector | None
    """In the order of ``spread_columns``; None if no uncertainty is estimated."""


class OutputAlone(Output):
    """An output of a robot with joints without encoder."""

    angles: Angles | None = None
    """Of these joints, one row; None where no effort is heard."""


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
        measured = options.tension_sensors or options.track_preload
        if measured and not options.uncertainty:
            raise UsageError("tension_sensors and track_preload need uncertainty: true")
        if measured and model.robot.unmeasured:
            raise UsageError(
                f"{_unmeasured_names(model)}: tension_sensors and track_preload are not possible "
                "for a robot with joints without encoder"
            )
        self.options = options
        self.conditioner = Conditioner(
            model.robot.as_read, options.conditioning, tracking=options.tracking
        )
        self.heard = HeardEfforts(model.layout.motors)
        """Efforts of the motors, kept only for joints without encoder."""
        self.deaf = False
        """Whether the last sample found no effort although joints have no encoder."""
        self.unsolved = 0
        """Samples with at least one unsolved element, without predicted ones."""
        self.unknown_elements = 0
        """Load cell readings of elements that the robot does not have."""
        self.doubted: NDArray[np.bool_] | None = None
        """Elements that are ``UNSURE`` whatever their standard deviation, shape (elements,); None
        for none.  The health monitor sets it."""
        self.fusion: Fusion | None = None
        self.spread: Spread | None = None
        self._waiting = WaitingMeasurements()
        self.started = model
        """The robot as given at construction."""
        self.changes: dict[str, float] = {}
        """Reference angles and preloads that were set since then, by path [SI]."""
        self.use(model)
        self.reset()

    @property
    def overlooked(self) -> int:
        """Load cell readings and efforts discarded because no sample reached their stamp."""
        return self._waiting.overlooked

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
        measured = options.tension_sensors or options.track_preload
        spread: Spread | None = None
        fusion: Fusion | None = None
        self.alone = MotorAlone(model) if model.robot.unmeasured else None
        if options.uncertainty and self.alone is None:
            known = narrowed(model.robot, self.changes)
            share = DOUBT if measured else 0.0
            spread = Spread(model, preload_share=share, known=known, before=self.spread)
        if spread is not None and measured:
            fusion = Fusion(spread, FREE_DRIFT if options.track_preload else SLOW_DRIFT)
            if self.fusion is not None:  # what is known of sensors and preloads stays known
                fusion.keep(self.fusion)
        self.model, self.spread, self.fusion = model, spread, fusion
        self._ahead: State | None = None
        """The state after the last predicted sample, if one was taken since the last other one."""
        self._clock_offset_ns = {
            motor.name: motor.sensor.clock_offset_ns for motor in model.robot.motors
        }
        self._preload = preload_of_elements(model.robot)

    def reset(self) -> None:
        """Discard readings, friction history and measurements; the counters are kept."""
        self.conditioner.reset()
        if self.fusion is not None:
            self.fusion.reset()
        self._restart(known=False)

    def _restart(self, *, known: bool) -> None:
        """Begin anew; ``known`` keeps what is known of preloads and sensors."""
        self._restart_from: tuple[State, Any, Any, Any] | None = None
        self._jumps = self.conditioner.clock_jumps
        self.state: State = initial_state(self.model)
        self.unaided: State = self.state
        """The state without corrections by other sensors."""
        self._ahead = None
        self.taught: set[str] = self.taught if known else set()
        """Sensors whose corrections distinguish ``state`` from ``unaided``."""
        self.sample: Sample | None = None
        self._waiting.forget()
        self._watch = RestWatch()
        self.heard.clear()
        if self.alone is not None:
            self.alone.reset()
        if self.spread is not None:
            self.spread.reset()
        if self.fusion is not None and known:
            self.fusion.pause()
        elif self.fusion is not None:
            self.fusion.restart()

    def resume(
        self,
        state: State,
        arrays: Mapping[str, NDArray[Any]],
        unaided: Vector | None = None,
        taught: Iterable[str] = (),
    ) -> None:
        """Continue from the state of an earlier run at the next sample.

        Args:
            state: the last state of the earlier run.
            arrays: ``motor_angle`` and ``joint_angle`` at that state, where known.
            unaided: values of the state without other sensors; None: of the state itself.
            taught: sensors whose corrections distinguish the two.
        """
        motor, joint = arrays.get("motor_angle"), arrays.get("joint_angle")
        self._restart_from = (state, motor, joint, unaided)
        self.taught = set(taught)
        if motor is not None and joint is not None:
            self.conditioner.expect(np.concatenate([motor, joint]), state.stamp_ns)

    def suspend(self) -> None:
        """Discard waiting readings; the next sample continues as after a restart of the process.

        If the robot moves in the meantime, its friction history is unknown, see ``resume``.
        Nothing happens before the first sample.
        """
        if self.sample is None:
            return
        state, unaided, taught = self.state, self.unaided, self.taught
        angles = {"motor_angle": self.sample.motor_angle, "joint_angle": self.sample.joint_angle}
        known = self.conditioner.memory()
        members = None if self.spread is None else deepcopy(self.spread.memory())
        self.conditioner.reset()
        self._restart(known=True)
        self.conditioner.recall(known)
        if self.spread is not None and members is not None:
            self.spread.recall(members)
        self.resume(state, angles, unaided.values, taught)

    def _take_up(self, sample: Sample) -> None:
        """Continue an earlier run's state at the first sample of this one."""
        assert self._restart_from is not None
        state, motor, joint, unaided = self._restart_from
        self._restart_from = None
        late = sample.stamp_ns - state.stamp_ns
        if late <= 0:  # the clock has been set back since
            state = State(sample.stamp_ns - 1_000_000, state.values)
            if self.spread is not None:
                self.spread.shift_clock(late - 1_000_000)
        self.state = self.unaided = state
        if unaided is not None:
            self.unaided = State(state.stamp_ns, unaided)
        moved = 0.0
        for before, now in ((motor, sample.motor_angle), (joint, sample.joint_angle)):
            if before is not None and before.shape == now.shape and now.size:
                moved = max(moved, float(np.max(np.abs(now - before))))
        if moved > MOVED and not 0 < late <= UNWATCHED_NS and self.spread is not None:
            self.spread.reset()  # the robot moved between the runs along an unknown path
        if late > 0 and self.fusion is not None:
            self.fusion.pass_unwatched(late * 1e-9)

    def feed(
        self,
        kind: str,
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
        conditioner = self.conditioner
        if kind == "motors":
            samples = conditioner.feed_motors(stamp_ns, names, positions)
        elif kind == "joints":
            samples = conditioner.feed_joints(stamp_ns, names, positions)
        else:
            samples = conditioner.feed_both(stamp_ns, names, positions)
        jumped = conditioner.clock_jumps != self._jumps
        if jumped:
            self._restart(known=True)
        taken = [(self.take(sample), sample.silent) for sample in samples]
        return jumped, [output for output, silent in taken if not silent]

    def finish(self) -> None:
        """Do what the last estimate need not wait for; the next sample does it otherwise."""
        if self.spread is not None:
            self.spread.finish()

    def take(self, sample: Sample) -> Output:
        """Process one sample; ``finish`` can follow once the estimate has been published.

        A predicted sample leaves the memory as it is; only the next predicted one continues it.
        """
        if sample.predicted:
            return self._look_ahead(sample)
        self._ahead = None
        if self.alone is not None:
            self.alone.look_back()
            return self._take_alone(self.alone, sample)
        return self._take_next(sample)

    def _take_next(self, sample: Sample) -> Output:
        """``take`` for a sample that continues the memory."""
        if self._restart_from is not None:
            self._take_up(sample)
        model = self.model
        if self.fusion is not None and self.state.stamp_ns == NEVER:
            model = self.fusion.beginning()
        self.state, estimate = step(model, self.state, sample)
        if self.fusion is not None:
            self.unaided = step(self.model, self.unaided, sample)[0]
        self.sample = sample
        self._watch.add(sample)
        if not estimate.solved:
            self.unsolved += 1
        stddev = None
        spread = self.spread
        if spread is not None:
            stddev = spread.begin(sample, estimate)
            if self.fusion is not None:  # it corrects the members
                spread.finish()
            mark_unsure(estimate.values, self._preload, stddev, self.options.unsure_share)
        self._mark_doubts(sample, estimate)
        if self.fusion is not None and estimate.solved:
            self.fusion.remember(sample, estimate)
            undone = bool(self._waiting) and self._use_waiting(self.fusion, sample)
            if undone or self.fusion.contested:
                mark_all_unsure(estimate.values, self._preload.size)
        return Output(estimate, stddev)

    def _look_ahead(self, sample: Sample) -> Output:
        """``take`` for a predicted sample."""
        if self.alone is not None:
            self.alone.look_ahead()
            return self._take_alone(self.alone, sample)
        self._ahead, estimate = step(self.model, self._ahead or self.state, sample)
        stddev = None
        if self.spread is not None:
            stddev = self.spread.look_ahead(sample, estimate)
            mark_unsure(estimate.values, self._preload, stddev, self.options.unsure_share)
        self._mark_doubts(sample, estimate)
        if self.fusion is not None and self.fusion.contested:
            mark_all_unsure(estimate.values, self._preload.size)
        return Output(estimate, stddev)

    def _mark_doubts(self, sample: Sample, estimate: Estimate) -> None:
        """Set ``UNSURE`` where readings or the robot itself are in doubt."""
        if sample.doubtful:
            mark_all_unsure(estimate.values, self._preload.size)
        if self.doubted is not None:
            mark_some_unsure(estimate.values, self.doubted)

    def _take_alone(self, alone: MotorAlone, sample: Sample) -> OutputAlone:
        """``take`` for a robot with joints without encoder."""
        self._restart_from = None
        efforts = self.heard.at(sample.stamp_ns)
        self.deaf = not bool(np.isfinite(efforts).any())
        one = Samples(
            np.array([sample.stamp_ns]), sample.motor_angle[None, :], sample.joint_angle[None, :]
        )
        found = alone.run(one, efforts[None, :])
        assert found.stddev is not None
        assert found.angles is not None
        values, stddev = np.nan_to_num(found.values[0]), np.nan_to_num(found.stddev[0])
        layout = self.model.layout
        solved = not any(int(flag) & INVALID for flag in values[layout.status])
        if not sample.predicted:
            self.state = self.unaided = State(sample.stamp_ns, alone.state)
            self.sample = sample
            self._watch.add(sample)
            self.unsolved += not solved
        mark_unsure(values, self._preload, stddev, self.options.unsure_share)
        if sample.doubtful:
            mark_all_unsure(values, self._preload.size)
        estimate = Estimate(sample.stamp_ns, values, layout, solved)
        output = OutputAlone(estimate, stddev if self.options.uncertainty else None)
        output.angles = None if self.deaf else found.angles
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
        fusion = self.fusion
        if fusion is None:
            return
        if len(names) != len(tensions) or len(stddevs) not in (0, len(names)):
            self.conditioner.refused["malformed"] += 1
            return
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
        if self.alone is not None:
            return True
        if not self.options.track_preload:
            return False
        return self._waiting.wants_efforts(stamp_ns, len(self.model.layout.motors))

    def feed_efforts(
        self, stamp_ns: int, names: Sequence[str], efforts: Sequence[float] | Vector
    ) -> None:
        """Queue measured efforts of motors [N m]; other names are ignored."""
        if self.alone is not None:
            for name, effort in zip(names, efforts):  # noqa: B905 fewer efforts than names: none
                if name in self._clock_offset_ns:
                    at = stamp_ns + self._clock_offset_ns[name]
                    self.heard.add(at, (name,), (effort,))
            return
        if not self.options.track_preload:
            return
        for name, effort in zip(names, efforts):  # noqa: B905 fewer efforts than names: none
            if name in self.model.layout.motors and not self._waiting.is_early(name, stamp_ns):
                at, noise = stamp_ns + self._clock_offset_ns[name], self.options.effort_noise
                self._waiting.add(Measurement(at, name, float(effort), noise))

    def _use_waiting(self, fusion: Fusion, sample: Sample) -> bool:
        """Apply the measurements up to the sample; True if corrections were undone."""
        for stamp, name, value, noise in self._waiting.due(sample.stamp_ns):
            dropped = fusion.dropped
            correct = fusion.tension if "/" in name else fusion.motor_effort
            state = correct(sample, self.state, stamp, name, value, noise)
            if state is not self.state:
                self.taught.add(name)
            self.state = state
            if fusion.dropped != dropped and name in self.taught:
                self._take_back(fusion, name)
                return True
        return False

    def _take_back(self, fusion: Fusion, name: str) -> None:
        """Undo all corrections by other sensors, because one of these sensors was wrong.

        The uncorrected state replaces the state, and the ensemble starts anew.  Sensors that are
        still trusted then correct both again.
        """
        self._waiting.clear()
        self.taught.clear()
        self.state = self.unaided
        fusion.take_back(name)

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
            raise UsageError(f"no reference can be set: {_unmeasured_names(self.model)}")
        if reason := self._watch.in_motion(self.model.robot):
            raise UsageError(reason)
        values, words = {}, []
        for kind, names, angles in (
            ("motor", self.model.layout.motors, self.sample.motor_angle),
            ("joint", self.model.layout.joints, self.sample.joint_angle),
        ):
            for name, angle in zip(names, angles, strict=True):
                values[f"{kind}s.{name}.reference_angle"] = float(angle)
                words.append(f"{kind} {name} {angle + 0.0:.6g} rad")
        self.change(values)
        preloads = ", ".join(f"{c.name} {c.preload:g} N" for c in self.model.robot.cables)
        return f"reference is now {', '.join(words)}; there the preloads are {preloads}"

    def set_preload(self, preloads: Mapping[str, float]) -> str:
        """Set preloads of cables in the reference pose [N]; the estimate starts anew.

        Raises:
            UsageError: an unknown cable or a tension out of range.
        """
        known = {cable.name: cable.preload for cable in self.model.robot.cables}
        if not preloads:
            raise UsageError(f"name at least one cable of {', '.join(known)}")
        for name, value in preloads.items():
            if name not in known:
                raise UsageError(f"there is no cable {name!r}; there are {', '.join(known)}")
            if not 0.0 <= value < 1e6:
                raise UsageError(f"preload of {name} must be in [0, 1e6) N, got {value:g}")
        self.change({f"cables.{name}.preload": value for name, value in preloads.items()})
        return "; ".join(f"{n}: {known[n]:g} N, now {v:g} N" for n, v in preloads.items())

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


def _unmeasured_names(model: Model) -> str:
    """The joints without encoder, as the subject of a message."""
    names = [model.layout.joints[j] for j in model.robot.unmeasured]
    return f"{', '.join(names)} {'has' if len(names) == 1 else 'have'} no encoder"


def with_other_numbers(model: Model, values: Mapping[str, float]) -> Model:
    """The robot with some numbers of its file replaced, by path [SI].

    Raises:
        UsageError, RobotFileError: a value is invalid.
    """
    document = with_numbers(dict(model.robot.document), values)
    for path, value in values.items():
        if not abs(value) <= LARGEST:
            raise UsageError(f"{path} must be a finite number, got {value:g}")
    if not all(
        value in allowed_range(find_number(document, path).rules) for path, value in values.items()
    ):
        for complaint in document_complaints(document):
            raise UsageError(complaint)
    # friction leaves the geometry as it was when it was checked
    geometry = any("friction." not in path for path in values)
    return prepare(build_robot(document, model.robot.source), check_range=geometry)

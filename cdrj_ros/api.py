"""Functions of the public interface that put together those of several rooms.

Most public names are those of the rooms themselves, see ``cdrj_ros/__init__.py`` and docs/api.md.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from warnings import warn

import numpy as np
from numpy.typing import ArrayLike

from cdrj_ros.estimation.changes import with_other_numbers
from cdrj_ros.estimation.conditioner import Kind
from cdrj_ros.estimation.estimator import Estimate, Estimates
from cdrj_ros.estimation.session import LiveEstimator, Options
from cdrj_ros.foundation.arrays import Series, Stamps
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import Model, load_model
from cdrj_ros.robot.names import known_name

if TYPE_CHECKING:
    from cdrj_ros.evaluation.metrics import Errors
    from cdrj_ros.identification.fit import Identification
    from cdrj_ros.recordings.recording import Recording, Topics
    from cdrj_ros.simulation.assembly import Truth


def load(robot: str | Path, numbers: Mapping[str, float] | None = None) -> Model:
    """Read a robot file and prepare it for estimation.

    Args:
        robot: the file, or the name of an installed robot such as ``"prototype"``.
        numbers: values by path [SI] that replace those of the file, for example
            ``{"cables.upper.preload": 40.0, "friction.mu_c": 0.12}``; see docs/robot_file.md.

    Returns:
        The model: ``model.robot`` is the description, ``model.layout`` names what is estimated.

    Raises:
        RobotFileError: the file is missing, invalid, or describes an impossible robot.
        UsageError: a path that the file does not have, or a value that is not allowed.
    """
    model = load_model(str(robot))
    return with_other_numbers(model, numbers) if numbers else model


def _loaded(model: Model | str | Path) -> Model:
    return model if isinstance(model, Model) else load(model)


class Estimator(LiveEstimator):
    """The estimator of the ROS node: readings in, estimates out, one at a time."""

    def __init__(self, model: Model | str | Path, options: Options | None = None) -> None:
        """Begin without readings.

        Args:
            model: from ``load``, or what ``load`` takes.
            options: of conditioning, uncertainty and further sensors; None: the node's defaults.

        Raises:
            RobotFileError: as ``load``.
            UsageError: options that exclude each other.
        """
        super().__init__(_loaded(model), options)
        self._joints = tuple(joint.name for joint in self.model.robot.as_read.joints)
        motors, readings = self.model.layout.motors, self.readings.sensors
        self._effort_names = (*motors, *(name for name in self._joints if name in readings))
        self.estimates: tuple[Estimate, ...] = ()
        """All estimates that the last ``update`` completed, the oldest first."""

    def update(
        self,
        stamp_ns: int,
        motors: Mapping[str, float] | Sequence[float] | None = None,
        joints: Mapping[str, float] | Sequence[float] | None = None,
        *,
        efforts: Mapping[str, float] | None = None,
        tensions: Mapping[str, float] | None = None,
    ) -> Estimate | None:
        """Take the readings of one time; motors and joints may come in calls of their own.

        Readings that cannot be true (NaN, a jump, a stamp that repeats) are refused one by one and
        counted in ``refused``.  Between the stamps of motors and joints, readings are interpolated,
        see docs/estimation.md.

        Args:
            stamp_ns: when the readings were taken, on one clock for all [ns]; above 0.
            motors: angles by name, or of all motors in the robot's order [rad], as the sensors give
                them: scale, offset and period of the robot file are applied.
            joints: angles, likewise [rad], of prismatic joints positions [m].
            efforts: torques of the cables on motors, and on joints whose file gives
                ``effort_noise``, by name [N m].
            tensions: of load cells by element [N].

        Returns:
            The newest estimate that the readings complete; None if they complete none.
            ``estimates`` has all of them.

        Raises:
            UsageError: a name that the robot does not have, not one value per motor or joint, or a
                stamp that is no integer.
        """
        if not isinstance(stamp_ns, (int, np.integer)):
            raise UsageError(f"stamp_ns must be an integer [ns], got {stamp_ns!r}")
        layout = self.model.layout
        known = self.model.robot.document
        readings = _by_name("motors", motors, layout.motors, known)
        readings |= _by_name("joints", joints, self._joints, known)
        kind: Kind = "joints" if motors is None else "motors" if joints is None else "both"
        cells = _by_name("tensions", tensions, layout.elements, {})
        torques = _by_name("efforts", efforts, self._effort_names, known)
        if cells:
            self.feed_tensions(stamp_ns, list(cells), list(cells.values()), ())
        if torques:
            self.feed_efforts(stamp_ns, list(torques), list(torques.values()))
        self.estimates = ()
        if readings:
            _, made = self.feed(kind, stamp_ns, list(readings), list(readings.values()))
            self.estimates = tuple(made)
        return self.estimates[-1] if self.estimates else None

    @property
    def refused(self) -> dict[str, int]:
        """Number of refused readings by cause, see docs/estimation.md; without zeros."""
        return {cause: n for cause, n in self.conditioner.refused.items() if n}


def _by_name(
    kind: str,
    values: Mapping[str, float] | Sequence[float] | None,
    names: tuple[str, ...],
    document: Mapping[str, Any],
) -> dict[str, float]:
    """Readings by name, which may lack the file's prefix; a sequence has one for each name."""
    if values is None:
        return {}
    if isinstance(values, Mapping):
        readings = {known_name(name, names, document): one for name, one in values.items()}
        for name in readings:
            if name not in names:
                raise UsageError(f"{kind}: there is no {name!r}, only {', '.join(names)}")
        return readings
    if isinstance(values, (int, float)) or len(values) != len(names):
        raise UsageError(f"{kind} must be {len(names)} values, of {', '.join(names)}; got {values}")
    return dict(zip(names, values, strict=True))


def estimate(
    model: Model | str | Path,
    stamp_ns: ArrayLike,
    motors: Mapping[str, ArrayLike] | ArrayLike,
    joints: Mapping[str, ArrayLike] | ArrayLike,
    *,
    joint_stamp_ns: ArrayLike | None = None,
    efforts: Mapping[str, ArrayLike] | ArrayLike | None = None,
    uncertainty: bool = True,
) -> Estimates:
    """Estimate a whole course of readings at once, as the node does with one after another.

    Args:
        model: from ``load``, or what ``load`` takes.
        stamp_ns: when the motors were read, increasing and above 0 [ns], shape (n,).
        motors: angles by name, shape (n,) each, or of all motors in the robot's order [rad], shape
            (n, motors), or (n,) if there is one.
        joints: angles, likewise, of the joints with encoder; positions [m] of prismatic ones.
        joint_stamp_ns: when the joints were read [ns], shape (m,); None: with the motors.
        efforts: torques of the cables on the motors, likewise [N m], read with their angles; needed
            where a joint has no encoder, whose angle is then estimated, and not used otherwise.
        uncertainty: whether to estimate standard deviations, which takes half of the time.

    Returns:
        The estimates at the times at which every motor and joint is known, usually n of them.
        ``refused`` counts the readings that cannot be true.

    Raises:
        UsageError: names or shapes that do not fit, or stamps that are not increasing integers.

    Warns:
        UserWarning: motors do not follow the joints: swapped columns, a unit, a gear or a sign; or
            readings are too sparse.
    """
    from cdrj_ros.estimation.conditioner import condition
    from cdrj_ros.evaluation.estimating import estimate as estimate_segments
    from cdrj_ros.evaluation.inputs import doubts_of

    model = _loaded(model)
    robot = model.robot.as_read
    if model.robot.unmeasured and efforts is None:
        raise UsageError("efforts are missing: a joint has no encoder")
    stamps = _stamps("stamp_ns", stamp_ns)
    later = stamps if joint_stamp_ns is None else _stamps("joint_stamp_ns", joint_stamp_ns)
    document = model.robot.document
    names = tuple(motor.name for motor in robot.motors)
    conditioned = condition(
        model.robot,
        _channels("motors", motors, names, document, stamps),
        _channels("joints", joints, tuple(one.name for one in robot.joints), document, later),
    )
    measured = None if efforts is None else _channels("efforts", efforts, names, document, stamps)
    for doubt in doubts_of(model, conditioned):
        warn(doubt, stacklevel=2)
    found = estimate_segments(model, conditioned, measured, uncertainty=uncertainty)
    refused = {cause: n for cause, n in conditioned.refused.items() if n}
    return replace(found, refused=refused)


def _stamps(what: str, given: ArrayLike) -> Stamps:
    stamps = np.asarray(given)
    if stamps.ndim != 1 or not np.issubdtype(stamps.dtype, np.integer):
        raise UsageError(f"{what} must be integers [ns] of shape (n,), got {stamps.dtype} of shape "
                         f"{stamps.shape}")  # fmt: skip
    if stamps.size and (stamps[0] <= 0 or np.any(stamps[1:] <= stamps[:-1])):
        raise UsageError(f"{what} must be above 0 and increase")
    return stamps.astype(np.int64)


def _channels(
    kind: str,
    given: Mapping[str, ArrayLike] | ArrayLike,
    names: tuple[str, ...],
    document: Mapping[str, Any],
    stamps: Stamps,
) -> dict[str, Series]:
    """Series by name; given names may lack the prefix of the robot file."""
    frame: Any = given
    if hasattr(given, "columns") or isinstance(given, Mapping):
        there = [str(name) for name in getattr(frame, "columns", frame)]
        at = {known_name(name, names, document): name for name in there}
        missing = [name for name in names if name not in at]
        others = not hasattr(given, "columns") and len(at) > len(names)  # a DataFrame may have some
        if missing or others:
            wanted = ", ".join(names)
            raise UsageError(f"{kind} must be {wanted}; got {', '.join(there) or 'none'}")
        columns: list[Any] = [np.asarray(frame[at[name]], dtype=np.float64) for name in names]
    else:
        table = np.asarray(given, dtype=np.float64)
        table = table[:, None] if table.ndim == 1 and len(names) == 1 else table
        if table.ndim != 2 or table.shape[1] != len(names):
            raise UsageError(
                f"{kind} must have the shape ({stamps.size}, {len(names)}), got {table.shape}"
            )
        columns = list(table.T)
    for name, column in zip(names, columns, strict=True):
        if column.shape != stamps.shape:
            raise UsageError(
                f"{kind}: {name} must have one value per stamp, {stamps.size}; "
                f"got the shape {column.shape}"
            )
    return {
        name: Series(stamps, stamps, np.ascontiguousarray(column))
        for name, column in zip(names, columns, strict=True)
    }


def validate(
    model: Model | str | Path,
    bags: str | Path | Recording | Iterable[str | Path | Recording],
    topics: Topics | None = None,
    *,
    uncertainty: bool = True,
) -> Errors:
    """Estimate recordings and compare the estimates with the references that were recorded.

    Several are processed one after another, or as ``joblib.parallel_config`` says.

    Args:
        model: from ``load``, or what ``load`` takes.
        bags: rosbag2 folder or MCAP file, or a recording as of ``read_table``, or several.
        topics: names of the recorded topics; None: ``Topics()``.
        uncertainty: whether to estimate standard deviations and their coverage.

    Returns:
        ``errors.pooled["tension/upper/8"].rmse`` and other figures of every channel, of each bag in
        ``of_bags``; ``bags`` has the compared series.

    Raises:
        BagError: a recording cannot be read, or has no reference or lacks a motor or joint.
    """
    import joblib

    from cdrj_ros.evaluation.metrics import errors_of
    from cdrj_ros.evaluation.validation import validate_bag
    from cdrj_ros.recordings.recording import Recording, Topics

    model = _loaded(model)
    several = [bags] if isinstance(bags, (str, Path, Recording)) else bags
    one = joblib.delayed(validate_bag)
    read = (bag if isinstance(bag, Recording) else str(bag) for bag in several)
    given = topics or Topics()
    return errors_of(joblib.Parallel()(one(model, bag, given, uncertainty) for bag in read))


def draw(model: Model | str | Path, path: str | Path) -> None:
    """Draw the cables of a robot, in space in four views, and write the picture.

    Args:
        model: from ``load``, or what ``load`` takes.
        path: PNG file to write.

    Raises:
        RobotFileError: as ``load``.
        OSError: the file cannot be written; an existing one is then kept.
    """
    from cdrj_ros.inspection.ranges import inspect_robot
    from cdrj_ros.report.drawing import draw_robot, write_png

    model = _loaded(model)
    write_png(draw_robot(inspect_robot(model)), str(path))


def write_recording(
    path: str | Path,
    model: Model | str | Path,
    truth: Truth,
    *,
    rig: str | Path = "",
    seed: int = 0,
) -> None:
    """Write a bag of what a robot's sensors read during a simulation, with references.

    Args:
        path: folder of the new bag.
        model: the robot that was simulated, from ``load``, or what ``load`` takes.
        truth: from ``simulate``.
        rig: rig file that describes the sensors, or the name of an installed one such as
            ``"noisy"``, see docs/simulation.md; empty: sensors that only quantise.
        seed: of all random numbers.

    Raises:
        BagError: the bag exists or cannot be written.
        RobotFileError: the rig file is invalid.
        UsageError: its sensors do not fit the robot.
    """
    from cdrj_ros.simulation.recorder import Recorder
    from cdrj_ros.simulation.rig_file import load_rig

    model = _loaded(model)
    Recorder(model, load_rig(str(rig)).sensors, seed).write(path, truth)


def identify(
    model: Model | str | Path,
    bags: str | Path | Recording | Iterable[str | Path | Recording],
    fit: str,
    *,
    free: Iterable[str] = (),
    only: bool = False,
    topics: Topics | None = None,
) -> Identification:
    """Identify numbers of the robot file by least squares over whole recordings.

    Args:
        model: from ``load``, or what ``load`` takes; its numbers are where the fit starts.
        bags: rosbag2 folder or file, or a recording as of ``read_table``, or several, which are
            fitted together.
        fit: the numbers, as ``identify --fit`` takes them: ``"rho,preload"``, see
            docs/identification.md.
        free: those of which nothing is known before, as ``identify --free`` takes them.
        only: whether to fit these alone, and not along with them those numbers whose accuracy the
            file does not state.
        topics: names of the recorded topics; None: ``Topics()``.

    Returns:
        ``by_path`` has the numbers [SI], for ``load(robot, numbers)``; ``stddev`` and
        ``correlation`` how well they are known; ``findings`` what the recordings cannot tell.

    Raises:
        BagError: a recording cannot be read, or lacks a motor or joint.
        UsageError: ``fit`` names no number of the file, or no reference was recorded.
    """
    from cdrj_ros.evaluation.inputs import read_inputs
    from cdrj_ros.identification.fit import identify as identify_numbers
    from cdrj_ros.identification.observations import Recorded
    from cdrj_ros.identification.priors import chosen_unknowns
    from cdrj_ros.recordings.recording import Recording, Topics

    model = _loaded(model)
    robot, document = model.robot, dict(model.robot.document)
    unknowns = chosen_unknowns(document, robot, fit, free, only=only)
    recordings = []
    for bag in [bags] if isinstance(bags, (str, Path, Recording)) else bags:
        given = bag if isinstance(bag, Recording) else str(bag)
        read = read_inputs(given, topics or Topics(), model)
        recordings.append(Recorded(read.path.name, read.motors, read.joints, read.references))
    return identify_numbers(document, robot.source, unknowns, recordings)

"""What ``identify`` finds on bags that were not fitted: the model's errors, and corrections."""

from __future__ import annotations

from collections.abc import Sequence

from cdrj_ros.commands.identify_task import Task
from cdrj_ros.evaluation.channels import BagComparison
from cdrj_ros.evaluation.validation import validate_bag
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.foundation.output import say
from cdrj_ros.identification.entries import KINDS
from cdrj_ros.identification.observations import Recorded, chosen_channels
from cdrj_ros.identification.residual import FEWEST_BAGS, Learned, learn
from cdrj_ros.identification.residual_statistics import model_error
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.recordings.table import Columns
from cdrj_ros.robot.description import Residual
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.robot.writer import with_section, yaml_number


def model_errors(
    model: Model, unseen: Sequence[BagComparison], topics: Topics | Columns, channels: Sequence[str]
) -> dict[str, float]:
    """Errors of the model by channel [N] or [N m], without channels that the numbers explain.

    Args:
        model: the fitted robot, with the standard deviations of its numbers alone.
        unseen: comparisons of bags with estimates that were not fitted to them.
        topics: topics of the bags.
        channels: the references that were fitted.
    """
    residuals: dict[str, list[Vector]] = {}
    stddevs: dict[str, list[Vector]] = {}
    for one in unseen:
        again = validate_bag(model, one.path, topics, uncertainty=True)
        stddev = {channel.name: channel.stddev for channel in again.channels}
        for channel in one.channels:
            own = stddev.get(channel.name)
            if own is not None and own.size == channel.estimate.size:
                residual = channel.estimate - channel.reference
                residuals.setdefault(channel.name, []).append(residual)
                stddevs.setdefault(channel.name, []).append(own)
    errors = {
        name: model_error(residuals[name], stddevs[name])
        for name in channels
        if name in residuals and name.startswith(KINDS)
    }
    return {name: error for name, error in errors.items() if error > 0.0}


def with_residuals(text: str, task: Task, recordings: Sequence[Recorded]) -> str:
    """The robot file's text with learned corrections, of which a line each is printed.

    Args:
        text: of the robot file, without corrections.
        task: the request.
        recordings: of its bags.
    """
    model = prepare(parse_robot(text, task.source))
    channels = chosen_channels(model.layout, recordings, task.settings.channels)
    outputs = [name for name in channels if name.startswith(KINDS)]
    found = list(learn(model, recordings, outputs, task.settings.settle_s))
    say("\nlearned corrections; errors on bags left out of them")
    for one in found:
        say(_line(one))
    for name in outputs:
        if name not in {one.output for one in found}:
            say(f"{name}: none, because fewer than {FEWEST_BAGS} bags have it")
    residuals = [one.residual for one in found if one.residual is not None]
    return with_section(text, "residual", residual_section(residuals) if residuals else None)


def _line(learned: Learned) -> str:
    if learned.residual is None:
        return (
            f"{learned.output}: none, because its RMSE of {learned.before:.4g} would only become "
            f"{learned.after:.4g}"
        )
    return (
        f"{learned.output}: RMSE {learned.before:.4g} without, {learned.after:.4g} with; at most "
        f"{learned.residual.bound:.4g}"
    )


def residual_section(residuals: Sequence[Residual]) -> str:
    """The entry ``residual`` of the robot file."""
    lines = ["residual:                       # learned corrections on top of the model"]
    for one in residuals:
        lines += [
            f"  - output: {one.output}",
            f"    bound: {yaml_number(one.bound, 3)}",
            f"    stddev: {yaml_number(one.stddev, 3)}  # of the error that is left",
            "    inputs:  # with the range that was seen",
            *(f"      {name}: {_numbers(seen)}" for name, seen in one.inputs.items()),
            "    weights:  # columns: 1, inputs; rows: value, three stops, last motion of each",
            *(f"      - {_numbers(row)}" for row in one.weights.tolist()),
        ]
    return "\n".join(lines)


def _numbers(values: Sequence[float]) -> str:
    return "[" + ", ".join(yaml_number(value, 4) for value in values) + "]"

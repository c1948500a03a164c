"""The identified robot file of a real instrument, and the estimator's errors on its bags."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.commands import identify
from cdrj_ros.evaluation.channels import BagComparison
from cdrj_ros.evaluation.metrics import pooled_errors
from cdrj_ros.evaluation.validation import validate_bag
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.recordings import Topics
from cdrj_ros.robot.parameters import number_at
from cdrj_ros.robot.reader import load_document, load_robot

ROOT = Path(__file__).resolve().parents[2]
ROBOT = ROOT / "config" / "robots" / "davinci_jaw.yaml"
RECORDINGS = ROOT.parent / "shared" / "data" / "davinci"


recordings = pytest.mark.skipif(
    not RECORDINGS.is_dir(),
    reason=f"the recordings are missing: {RECORDINGS.relative_to(ROOT.parent)} beside the "
    "repository (see config/robots/davinci_jaw.yaml for their origin)",
)


@pytest.fixture(scope="module")
def model() -> Model:
    return prepare(load_robot(ROBOT))


def compared(model: Model, folder: str, spread: bool = False) -> list[BagComparison]:
    bags = sorted(entry for entry in (RECORDINGS / folder).iterdir() if entry.is_dir())
    return [validate_bag(model, str(bag), Topics(), spread=spread) for bag in bags]


@pytest.fixture(scope="module")
def held_out(model: Model) -> list[BagComparison]:
    """Runs that were not fitted, with standard deviations."""
    return compared(model, "validate", spread=True)


def r2_of(comparisons: list[BagComparison]) -> tuple[float, float]:
    errors = pooled_errors(comparisons)
    spindle, jaw = errors["effort/spindle"].r2, errors["effort/jaw"].r2
    assert spindle is not None
    assert jaw is not None
    return spindle, jaw


@recordings
def test_held_out_runs_are_explained(held_out: list[BagComparison]) -> None:
    spindle, jaw = r2_of(held_out)
    assert spindle >= 0.991
    assert jaw >= 0.992


@recordings
def test_the_standard_deviation_covers_runs_that_were_not_fitted(
    held_out: list[BagComparison],
) -> None:
    assert len(held_out) >= 6
    for name in ("effort/spindle", "effort/jaw"):
        inside = []
        for one in held_out:
            channel = next(channel for channel in one.channels if channel.name == name)
            assert channel.stddev is not None
            error = np.abs(channel.estimate - channel.reference)
            inside.append(float(np.mean(error <= 2.0 * channel.stddev)))
        assert 0.90 <= np.mean(inside) <= 0.985, (name, inside)
        assert min(inside) >= 0.80, (name, inside)


@recordings
def test_identify_returns_to_the_values_of_the_file(tmp_path: Path) -> None:
    """A fit to two runs from values 10 % off recovers the best-determined numbers."""
    bags = [str(RECORDINGS / "train" / f"Tool_4_Maryland_L_4_{run}") for run in ("02", "28")]
    out = tmp_path / "again.yaml"
    document, _ = load_document(ROBOT)
    stiffness = number_at(document, "cables.b.axial_stiffness")
    assert identify.main(
        [*bags, "--robot", str(ROBOT), "--quick", "--out", str(out), "--fit",
         "cables.b.axial_stiffness,joints.jaw.reference_angle",
         "--start", f"cables.b.axial_stiffness={1.1 * stiffness}"]
    ) == 0  # fmt: skip
    again, _ = load_document(out)
    assert number_at(again, "cables.b.axial_stiffness") == pytest.approx(stiffness, rel=0.05)


@recordings
def test_a_file_of_one_pose_gives_one_of_another_by_two_of_its_runs(tmp_path: Path) -> None:
    """Judged on the two runs that were not fitted; zeroing alone leaves 12 and 6 mN m."""
    runs = [
        str(RECORDINGS / "other_wrist_pose" / f"Tool_4_Maryland_L_Pitch_3_00{k}") for k in range(4)
    ]
    out = tmp_path / "posed.yaml"
    command = [runs[0], runs[3], "--from", str(ROBOT), "--quick", "--out", str(out)]
    assert identify.main(command) == 0
    posed = prepare(load_robot(out))
    judged = [validate_bag(posed, run, Topics(), spread=True) for run in runs[1:3]]
    errors = pooled_errors(judged)
    for name, most in (("effort/spindle", 0.010), ("effort/jaw", 0.0055)):
        assert errors[name].rmse is not None
        assert errors[name].rmse < most
    for one in judged:
        for channel in one.channels:
            assert channel.stddev is not None
            error = np.abs(channel.estimate - channel.reference)
            assert np.mean(error <= 2.0 * channel.stddev) >= 0.85, (one.path, channel.name)

"""The identified robot file of a real instrument, and the estimator's errors on its bags."""

import numpy as np
import pytest
from support.places import ROBOTS, ROOT

from cdrj_ros.commands import identify
from cdrj_ros.evaluation.metrics import pooled_errors
from cdrj_ros.evaluation.validation import validate_bag
from cdrj_ros.model.prepared import prepare
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.robot.reader import load_robot

ROBOT = ROBOTS / "davinci_jaw.yaml"
RECORDINGS = ROOT.parent / "shared" / "data" / "davinci"


recordings = pytest.mark.skipif(
    not RECORDINGS.is_dir(),
    reason=f"the recordings are missing: {RECORDINGS.relative_to(ROOT.parent)} beside the "
    "repository (see config/robots/davinci_jaw.yaml for their origin)",
)


@pytest.fixture(scope="module")
def model():
    return prepare(load_robot(ROBOT))


def compared(model, folder, uncertainty=False):
    bags = sorted(entry for entry in (RECORDINGS / folder).iterdir() if entry.is_dir())
    return [validate_bag(model, str(bag), Topics(), uncertainty=uncertainty) for bag in bags]


@pytest.fixture(scope="module")
def held_out(model):
    """Runs that were not fitted, with standard deviations."""
    return compared(model, "validate", uncertainty=True)


def r2_of(comparisons):
    errors = pooled_errors(comparisons)
    spindle, jaw = errors["effort/spindle"].r2, errors["effort/jaw"].r2
    return spindle, jaw


@recordings
def test_held_out_runs_are_explained(held_out):
    spindle, jaw = r2_of(held_out)
    assert spindle >= 0.991
    assert jaw >= 0.992


@recordings
def test_a_learned_correction_explains_more_of_runs_that_were_not_fitted(held_out, tmp_path):
    """A fifth of the spindle's squared error is learned, and less of the jaw's, which drifts."""
    out = tmp_path / "corrected.yaml"
    bags = sorted(str(entry) for entry in (RECORDINGS / "train").iterdir() if entry.is_dir())
    assert identify.main([*bags, "--robot", str(ROBOT), "--residual", "--out", str(out)]) == 0
    after = compared(prepare(load_robot(out)), "validate", uncertainty=True)
    (spindle, jaw), (spindle_before, jaw_before) = r2_of(after), r2_of(held_out)
    assert 1.0 - spindle < 0.8 * (1.0 - spindle_before)
    assert 1.0 - jaw < 0.95 * (1.0 - jaw_before)
    for one in after:
        channel = next(channel for channel in one.channels if channel.name == "effort/spindle")
        error = np.abs(channel.estimate - channel.reference)
        assert np.mean(error <= 2.0 * channel.stddev) >= 0.85


@recordings
def test_the_standard_deviation_covers_runs_that_were_not_fitted(held_out):
    assert len(held_out) >= 6
    for name in ("effort/spindle", "effort/jaw"):
        inside = []
        for one in held_out:
            channel = next(channel for channel in one.channels if channel.name == name)
            error = np.abs(channel.estimate - channel.reference)
            inside.append(float(np.mean(error <= 2.0 * channel.stddev)))
        assert np.mean(inside) >= 0.90, (name, inside)
        assert min(inside) >= 0.80, (name, inside)

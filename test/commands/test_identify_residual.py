"""Tests of learned corrections, from the option of identify to the estimates of the new file.

The simulated robot has friction that its file lacks: of a bearing, and of one pulley.
"""

import numpy as np
import pytest
from support.places import PROTOTYPE, ROBOT

from cdrj_ros.commands import identify, simulate
from cdrj_ros.evaluation.validation import validate_bag
from cdrj_ros.model.prepared import load_model
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.robot.writer import with_numbers_in_text

LACKING = {
    "motors.winch.bearing_torque": 0.03,
    "motors.winch.bearing_stiffness": 20.0,
    "cables.upper.nodes.7.friction.rho": 0.35,
}
OUTPUTS = ("effort/winch", "tension/upper/8")


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Four motions of the robot; the last one is left to the tests."""
    folder = tmp_path_factory.mktemp("rig")
    text = PROTOTYPE.read_text(encoding="utf-8")
    truth = folder / "truth.yaml"
    truth.write_text(with_numbers_in_text(text, LACKING, ROBOT), encoding="utf-8")
    made = []
    for k, (amplitude, hertz) in enumerate(((0.3, 0.2), (0.45, 0.25), (0.6, 0.15), (0.5, 0.22))):
        motion = ["--amplitude", str(amplitude), "--frequency", str(hertz), "--seed", str(k)]
        made.append(str(folder / f"run{k}"))
        options = ["--robot", str(truth), "--rig", "fast", "--duration", "9", "--cells", "2"]
        assert simulate.main([made[-1], *options, *motion]) == 0
    return made


@pytest.fixture(scope="module")
def settings(tmp_path_factory):
    path = tmp_path_factory.mktemp("settings") / "settings.yaml"
    path.write_text(f"channels: [{', '.join((*OUTPUTS, 'tension/lower/1'))}]\n", encoding="utf-8")
    return str(path)


@pytest.fixture(scope="module")
def corrected(bags, settings, tmp_path_factory):
    out = tmp_path_factory.mktemp("corrected") / "robot.yaml"
    words = ["--robot", ROBOT, "--settings", settings, "--residual", "--out", str(out)]
    assert identify.main([*bags[:-1], *words]) == 0
    return out


def compared(robot, bag):
    model = load_model(str(robot))
    return {one.name: one for one in validate_bag(model, bag, Topics(), uncertainty=True).channels}


def rms(channel):
    return float(np.sqrt(np.mean((channel.estimate - channel.reference) ** 2)))


def test_what_the_model_lacks_is_learned_for_a_run_that_was_not_used(bags, corrected):
    """Measured efforts and tensions come nearer, within bands that are not wider; others stay."""
    before, after = compared(PROTOTYPE, bags[-1]), compared(corrected, bags[-1])
    learned = {one.output for one in load_model(str(corrected)).robot.residuals}
    assert set(OUTPUTS) <= learned  # the error of tension/lower/1 is little more than its cell's
    for name, share in zip(OUTPUTS, (0.25, 0.8), strict=True):
        assert rms(after[name]) < share * rms(before[name])
        error = np.abs(after[name].estimate - after[name].reference)
        assert np.mean(error <= 2.0 * after[name].stddev) >= 0.93
    for name in before.keys() - learned:
        np.testing.assert_array_equal(after[name].estimate, before[name].estimate)


def test_two_bags_are_too_few_for_a_correction(bags, settings, tmp_path, capsys):
    out = tmp_path / "robot.yaml"
    words = ["--robot", ROBOT, "--settings", settings, "--residual", "--out", str(out)]
    assert identify.main([*bags[:2], *words]) == 0
    assert "effort/winch: none, because fewer than 3 bags have it" in capsys.readouterr().out
    assert load_model(str(out)).robot.residuals == ()


def test_a_fit_of_numbers_drops_what_was_learned_with_others(
    bags, settings, corrected, tmp_path, capsys
):
    out = tmp_path / "robot.yaml"
    words = ["--robot", str(corrected), "--settings", settings, "--quick", "--out", str(out)]
    assert identify.main([bags[0], *words, "--fit", "motors.winch.bearing_torque"]) == 0
    assert "left out: residual" in capsys.readouterr().out
    assert load_model(str(out)).robot.residuals == ()


def test_options_that_belong_to_a_fit_are_refused_without_one(bags, capsys):
    assert identify.main([bags[0], "--robot", ROBOT, "--residual", "--cross-validate"]) == 2
    assert "--cross-validate needs --fit" in capsys.readouterr().err

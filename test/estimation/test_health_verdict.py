"""Which elements a verdict calls into question, and what their status then says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cdrj_ros.estimation.ensemble import mark_elements_unsure
from cdrj_ros.estimation.estimator import Sample
from cdrj_ros.estimation.health_changes import GAIN, Change, changes_of, sensor_changes
from cdrj_ros.estimation.health_evaluation import Evaluation, Found
from cdrj_ros.estimation.health_verdict import report, unsure_elements
from cdrj_ros.estimation.session import LiveEstimator, Options
from cdrj_ros.model.packing import INVALID, OK, SLACK, UNSURE
from cdrj_ros.model.prepared import Model

UPPER, LOWER = slice(0, 8), slice(8, 16)


@pytest.fixture(scope="module")
def changes(model: Model) -> dict[str, Change]:
    known = [make() for make in changes_of(model.robot, None)]
    return {one.what: one for one in [*known, *sensor_changes(model.robot, ["winch"])]}


def verdict(*changes: Change, times: float = 2.0, others: tuple[str, ...] = ()) -> Evaluation:
    """A verdict that names changes by a multiple of their smallest reported amount."""
    found = tuple(Found(one, times * one.size, 0.1, others) for one in changes)
    return Evaluation(found, 200.0, 1.0, {})


@pytest.mark.parametrize("what", ["preload of upper", "cable upper"])
def test_a_change_of_one_cable_concerns_that_cable_unless_something_else_explains_it(
    model: Model, changes: dict[str, Change], what: str
) -> None:
    alone = unsure_elements(model.robot, verdict(changes[what]), corrected=False)
    assert alone[UPPER].all()
    assert not alone[LOWER].any()
    standing = verdict(changes[what], others=("zero of joint elbow",))
    assert unsure_elements(model.robot, standing, corrected=False).all()


@pytest.mark.parametrize(
    "what",
    ["preload of all cables", "zero of joint elbow", "friction of the pulleys (drag)",
     "friction of the pulleys (coefficients)", "friction of motor winch",
     "scale of effort of winch"],
)  # fmt: skip
def test_every_other_verdict_concerns_all_elements(
    model: Model, changes: dict[str, Change], what: str
) -> None:
    assert unsure_elements(model.robot, verdict(changes[what]), corrected=False).all()


def test_changes_too_small_to_report_are_no_reason(
    model: Model, changes: dict[str, Change]
) -> None:
    standing = verdict(changes["preload of all cables"], times=0.5)
    assert not unsure_elements(model.robot, standing, corrected=False).any()


def test_a_preload_that_is_corrected_is_no_reason_but_a_broken_cable_is(
    model: Model, changes: dict[str, Change]
) -> None:
    lost = verdict(changes["preload of upper"], others=("preload of lower",))
    assert not unsure_elements(model.robot, lost, corrected=True).any()
    broken = verdict(changes["cable upper"])
    assert unsure_elements(model.robot, broken, corrected=True)[UPPER].all()


def test_a_wrong_scale_of_an_effort_is_answered_with_the_key_and_its_value(
    model: Model, changes: dict[str, Change]
) -> None:
    motor = replace(model.robot.motors[0], effort_scale=0.5)
    robot = replace(model.robot, motors=(motor,))
    # readings of 1/2.7 of what is expected, with the scale of the file
    standing = verdict(changes["scale of effort of winch"], times=(1 / 2.7 - 1.0) / GAIN)
    found = report(robot, ["winch"], 3, standing, [standing])
    assert "63 +- 0.1 % too low" in found.message
    assert found.message.endswith("effort_scale: 1.35 mends it")


def test_unsure_elements_are_unsure_until_the_doubt_ends(model: Model) -> None:
    live = LiveEstimator(model, Options(uncertainty=False))
    rest = Sample(1_000_000_000, np.zeros(1), np.zeros(1))
    assert set(live.take(rest).status) == {OK}
    live.always_unsure = np.arange(16) < 8
    found = live.take(rest._replace(stamp_ns=1_001_000_000))
    assert set(found.status[UPPER]) == {UNSURE}
    assert set(found.status[LOWER]) == {OK}
    live.always_unsure = None
    assert set(live.take(rest._replace(stamp_ns=1_002_000_000)).status) == {OK}


def test_the_other_flags_of_unsure_elements_are_kept() -> None:
    before = [OK, SLACK, INVALID, UNSURE | SLACK, SLACK]
    values = np.array([1.0, 2.0, 3.0, 4.0, 5.0, *before, 7.0])
    mark_elements_unsure(values, np.array([True, True, True, True, False]))
    after = [UNSURE, SLACK | UNSURE, INVALID, UNSURE | SLACK, SLACK]
    assert values.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, *after, 7.0]


def test_readings_that_no_change_explains_concern_all_elements(model: Model) -> None:
    standing = Evaluation((), 0.0, 100.0, {"winch": (0.3, 0.3)})
    assert unsure_elements(model.robot, standing, corrected=True).all()

"""Kinds of guides, laws and motions: the same words in the core, in Python and in the schema."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, get_args

import numpy as np
import pytest

from cdrj_ros import _core
from cdrj_ros.estimation.estimator import initial_state, run
from cdrj_ros.estimation.samples import Samples
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.description import Robot, StribeckForm, friction_law
from cdrj_ros.robot.document import schema
from cdrj_ros.robot.space import GUIDES, ContactKind, FrameMotion

Variant = Callable[..., Robot]
Drive = Callable[..., Samples]


@pytest.mark.parametrize(
    ("kinds", "words"),
    [
        (_core.Guide, get_args(ContactKind)), (_core.Guide, GUIDES),
        (_core.Law, schema()["$defs"]["friction"]["properties"]["law"]["enum"]),
        (_core.FrameMotion, get_args(FrameMotion)), (_core.Stribeck, get_args(StribeckForm)),
    ],
    ids=lambda one: getattr(one, "__name__", type(one).__name__),
)  # fmt: skip
def test_every_kind_has_the_same_name_in_the_core(kinds: Any, words: Any) -> None:
    assert set(kinds.__members__) == set(words)
    assert sorted(kind.value for kind in kinds) == list(range(len(words)))


FAMILIES: dict[str, dict[str, Any]] = {
    "sliding": {"mu_c": 0.1},
    "static": {"mu_s": 0.5},
    "bearing": {"bearing_friction": 0.02},
    "bristles": {"bristle_stiffness": 1e5},
}


@pytest.mark.parametrize("law", _core.Law.__members__)
@pytest.mark.parametrize("family", FAMILIES)
def test_a_law_takes_the_constants_that_it_says(
    law: str, family: str, variant: Variant, drive: Drive
) -> None:
    time = np.linspace(0.0, 0.5, 200)
    samples = drive(time, 0.2 * np.sin(9.0 * time), 0.3 * np.sin(7.0 * time))
    usual = {"mu_c": 0.15, "mu_s": 0.2, "rho": 0.5, "stribeck_speed": 0.05}
    usual["bearing_friction"] = 0.01
    answers = []
    for constants in (usual, usual | FAMILIES[family]):
        model = prepare(variant(law, **constants))
        answers.append(run(model, initial_state(model), samples)[1].values)
    assert np.array_equal(*answers) is not getattr(friction_law(law), family)

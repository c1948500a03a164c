"""A prepared robot: found by its name, with the words of the core, and with equal answers."""

from typing import get_args

import numpy as np
import pytest
from support.places import PROTOTYPE, ROBOTS

from cdrj_ros import _core
from cdrj_ros.estimation.estimator import initial_state, run
from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.model.packing import INVALID, OVERLOAD, SLACK
from cdrj_ros.model.prepared import prepare, robot_path
from cdrj_ros.robot.description import StribeckForm, friction_law
from cdrj_ros.robot.document import schema
from cdrj_ros.robot.reader import load_robot, parse_robot
from cdrj_ros.robot.space import GUIDES, ContactKind, FrameMotion

FILES = sorted(ROBOTS.glob("*.yaml"))

MIXED = """
name: mixed
motors: [{name: m}]
joints: [{name: q, range: [-1, 1]}]
frames: [{name: arm, motion: revolute, joint: q, origin: [0.3, 0, 0], axis: [0, 1, 0]}]
friction: {mu_c: 0.1}
cables:
  - name: by_tables
    axial_stiffness: 1e4
    preload: 10
    nodes:
      - {type: winch, motor: m, winding: 1, radius: 0.02}
      - {type: pulley, radius: 0.02, wrap_angle: 1.0}
      - {type: anchor}
    spans: [0.1, 0.1]
  - name: by_positions
    axial_stiffness: 1e4
    preload: 10
    nodes:
      - {type: anchor, position: [0, 0, 0]}
      - {type: sphere, radius: 0.05, position: [0.2, 0.1, 0]}
      - {type: anchor, position: [0.1, 0, 0], frame: arm}
"""


def results(model, odd):
    """State and estimate after two samples; before each, others of this angle, if it is given."""
    robot = model.robot
    motor, joint = robot.reference_motors, robot.reference_pose
    state = initial_state(model)
    for k in range(2):
        if odd is not None:
            model.core.step(state, 10**9, 0.0 * motor + odd, 0.0 * joint + odd)
        stamp_ns = 10**6 * k
        state, estimate, solved = model.core.step(state, stamp_ns, motor + 1e-3 * k, joint)
        assert solved
    return np.concatenate([state.values, estimate])


@pytest.mark.parametrize(
    "robot", [*map(load_robot, FILES), parse_robot(MIXED)], ids=lambda robot: robot.name
)
def test_what_memory_held_before_does_not_count(robot):
    """A sample writes every number of the state and of the estimate."""
    model = prepare(robot, check_range=False)
    first = results(model, None)
    assert np.isfinite(first).all()
    np.testing.assert_array_equal(first, results(model, np.nan))
    np.testing.assert_array_equal(first, results(model, 0.07))


@pytest.mark.parametrize(
    ("kinds", "words"),
    [
        (_core.Guide, get_args(ContactKind)), (_core.Guide, GUIDES),
        (_core.Law, schema()["$defs"]["friction"]["properties"]["law"]["enum"]),
        (_core.FrameMotion, get_args(FrameMotion)), (_core.Stribeck, get_args(StribeckForm)),
    ],
    ids=lambda one: getattr(one, "__name__", type(one).__name__),
)  # fmt: skip
def test_every_kind_has_the_same_name_in_the_core(kinds, words):
    assert set(kinds.__members__) == set(words)
    assert sorted(kind.value for kind in kinds) == list(range(len(words)))


FAMILIES = {
    "sliding": {"mu_c": 0.1},
    "static": {"mu_s": 0.5},
    "bearing": {"bearing_friction": 0.02},
    "bristles": {"bristle_stiffness": 1e5},
}


@pytest.mark.parametrize("law", _core.Law.__members__)
@pytest.mark.parametrize("family", FAMILIES)
def test_a_law_takes_the_constants_that_it_says(law, family, variant, drive):
    time = np.linspace(0.0, 0.5, 200)
    samples = drive(time, 0.2 * np.sin(9.0 * time), 0.3 * np.sin(7.0 * time))
    usual = {"mu_c": 0.15, "mu_s": 0.2, "rho": 0.5, "stribeck_speed": 0.05}
    usual["bearing_friction"] = 0.01
    answers = []
    for constants in (usual, usual | FAMILIES[family]):
        model = prepare(variant(law, **constants))
        answers.append(run(model, initial_state(model), samples)[1].values)
    assert np.array_equal(*answers) is not getattr(friction_law(law), family)


def test_a_pulley_has_the_flags_of_both_of_its_elements():
    layout = prepare(load_robot(PROTOTYPE)).layout
    status = np.zeros((3, len(layout.elements)), np.uint8)
    status[0, layout.elements.index("upper/1")] = SLACK
    status[1, layout.elements.index("upper/3")] = OVERLOAD
    status[1, layout.elements.index("upper/4")] = INVALID
    last = [name for name in layout.elements if name.startswith("upper/")][-1]
    status[2, layout.elements.index(last)] = SLACK
    found = [
        {name: int(flag) for name, flag in zip(layout.pulleys, row, strict=True) if flag}
        for row in layout.pulley_status(status)
    ]
    assert found[0] == {"upper/2": SLACK}
    assert found[1] == {
        "upper/3": OVERLOAD, "upper/4": OVERLOAD | INVALID, "upper/5": INVALID,
    }  # fmt: skip
    last_pulley = [name for name in layout.pulleys if name.startswith("upper/")][-1]
    assert found[2] == {last_pulley: SLACK}
    assert layout.pulley_status(status[0]).tolist() == layout.pulley_status(status)[0].tolist()


def test_an_installed_robot_is_found_by_its_name():
    assert robot_path("prototype").name == "prototype.yaml"


def test_a_misspelt_name_is_answered_with_the_nearest_one():
    with pytest.raises(RobotFileError, match=r"did you mean prototype[?]"):
        robot_path("protoype")
    with pytest.raises(RobotFileError, match=r"is installed; there are cdpr, "):
        robot_path("xyzzy")

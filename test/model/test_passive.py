"""A passive cable equals a winch that is held still, and is slack below its rest length."""

import numpy as np
import pytest
from support.refusal import refusal

import cdrj_ros
from cdrj_ros import _core
from cdrj_ros.commands import simulate, validate
from cdrj_ros.estimation.estimator import Sample, initial_state, step
from cdrj_ros.model.packing import INVALID, SLACK
from cdrj_ros.model.prepared import load_model, prepare, shape_at
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.simulation.assembly import make_rig

STIFFNESS = 350.0
REST = 0.09

ROBOT = """
name: spring
motors: [{motors}]
joints: [{{name: q, range: [-1, 1], reference_angle: {reference}}}]
frames: [{{name: arm, motion: revolute, joint: q, origin: [0.08, 0, 0], axis: [0, 0, 1]}}]
friction: {{mu_c: 0.2}}
cables:
  - name: c
    axial_stiffness: {ea!r}
    {tension}
    nodes:
      - {{type: {first}, position: [0, 0.02, 0]}}
      - {{type: eyelet, position: [0.03, 0.03, 0]}}
      - {{type: cylinder, radius: 0.01, position: [0.08, 0, 0], axis: [0, 0, 1], turn: cw}}
      - {{type: anchor, frame: arm, position: [0.04, -0.01, 0.002]}}
"""


def passive(reference=0.3, rest=REST):
    return prepare(
        parse_robot(
            ROBOT.format(
                motors="", reference=reference, ea=STIFFNESS * rest,
                tension=f"rest_length: {rest!r}", first="anchor",
            )
        )
    )  # fmt: skip


def held(preload):
    return prepare(
        parse_robot(
            ROBOT.format(
                motors="{name: m}", reference=0.3, ea=STIFFNESS * REST,
                tension=f"preload: {preload!r}",
                first="winch, motor: m, winding: 1, radius: 0.01",
            )
        )
    )  # fmt: skip


def tensions(model, angles):
    state, found = initial_state(model), []
    still = np.zeros(len(model.robot.motors))
    for k, angle in enumerate(angles):
        sample = Sample(10**9 + k * 10**7, still, np.array([angle]))
        state, estimate = step(model, state, sample)
        assert estimate.solved
        found.append([*estimate.tension, *estimate.joint_effort])
    return np.array(found)


MOTION = 0.3 + 0.6 * np.sin(0.05 * np.arange(300))


def test_a_passive_cable_is_a_winch_held_still():
    spring = passive()
    (cable,) = spring.robot.cables
    winch = held(cable.preload)
    np.testing.assert_allclose(tensions(spring, MOTION), tensions(winch, MOTION), rtol=1e-12)


def test_its_tension_without_friction_is_stiffness_times_the_length_beyond_rest():
    for reference in (-0.9, 0.3, 0.9):
        model = passive(reference)
        length = shape_at(model, model.robot.reference_pose).length.sum()
        (cable,) = model.robot.cables
        assert cable.preload == pytest.approx(max(STIFFNESS * (length - REST), 0.0), rel=1e-12)
        _, estimate = step(
            model, initial_state(model),
            Sample(10**9, np.zeros(0), model.robot.reference_pose),
        )  # fmt: skip
        np.testing.assert_allclose(estimate.tension, cable.preload, atol=1e-10)


def test_it_is_slack_where_it_is_shorter_than_its_rest_length_whatever_the_reference_pose():
    lengths = {q: shape_at(passive(), np.array([q])).length.sum() for q in (-0.9, 0.9)}
    slack, taut = sorted(lengths, key=lambda q: lengths[q])
    rest = float(0.5 * (lengths[slack] + lengths[taut]))
    for reference in (slack, taut):
        model = passive(reference, rest)
        state = initial_state(model)
        for k, q in enumerate((slack, taut)):
            state, estimate = step(
                model, state, Sample(10**9 * (k + 1), np.zeros(0), np.array([q]))
            )
            expected = max(STIFFNESS * (lengths[q] - rest), 0.0)
            # the mean over the elements: friction holds differences between them
            assert estimate.tension.mean() == pytest.approx(expected, rel=0.2)
            assert (estimate.status == SLACK).all() == (q == slack)


SLACKENED = """
name: slackened
motors: []
joints: [{name: q, range: [-1.2, 1.2], reference_angle: 1.1}]
frames: [{name: f, motion: revolute, joint: q, origin: [0.05, 0, 0], axis: [0, 0, 1]}]
friction: {mu_c: 0.15}
cables:
  - name: c
    axial_stiffness: 10000
    preload: 6
    nodes:
      - {type: anchor, frame: f, position: [0.03, 0.004, 0]}
      - {type: cylinder, radius: 0.0025, frame: f, position: [0.015, 0.0012, 0], axis: [0, 0, 1],
         side: [0.015, 0.01, 0]}
      - {type: eyelet, frame: f, position: [0.012, 0.0035, 0]}
      - {type: cylinder, radius: 0.003, position: [0.05, 0, 0], axis: [0, 0, 1],
         side: [0.05, -0.01, 0]}
      - {type: anchor, position: [0.03, 0.004, 0]}
"""


def test_a_cable_that_stays_slack_has_no_tension_wherever_its_material_lies():
    """Nothing decides where it lies; one of a thousand of these samples would not be solved."""
    model = make_rig(parse_robot(SLACKENED), 8).fine
    angle = np.random.default_rng(0).uniform(-1.2, 1.1, (16000, 1))
    estimates = np.empty((len(angle), model.layout.size))
    model.core.run(
        _core.State(_core.NEVER, np.zeros(model.state_size)), 10**6 * np.arange(len(angle)),
        np.zeros((len(angle), 0)), angle, estimates,
    )  # fmt: skip
    slack = (estimates[:, model.layout.tension] <= 0.0).all(axis=1)
    invalid = estimates[:, model.layout.status].astype(int) & INVALID
    assert 0.2 < slack.mean() < 0.8
    assert not invalid.any()


def test_its_standard_deviation_follows_from_rest_length_and_stiffness():
    uncertainty = passive().robot.uncertainty
    assert uncertainty.stddev["cables.c.rest_length"] == pytest.approx(0.01 * REST)
    assert "cables.c.preload" not in uncertainty.stddev


def test_a_robot_of_passive_cables_alone_needs_joints_alone(tmp_path, capsys):
    path = tmp_path / "spring.yaml"
    path.write_text(
        ROBOT.format(
            motors="", reference=0.3, ea=STIFFNESS * REST, tension=f"rest_length: {REST}",
            first="anchor",
        ).replace("mu_c: 0.2", "mu_c: 0")
    )  # fmt: skip
    angle = 0.3 + 0.2 * np.sin(0.02 * np.arange(200))
    stamps = 10**9 + 10**7 * np.arange(200)
    found = cdrj_ros.estimate(path, stamps, np.zeros((200, 0)), {"q": angle})
    model = load_model(path)
    for k in (50, 199):
        length = shape_at(model, angle[k : k + 1]).length.sum()
        np.testing.assert_allclose(found.tension[k], STIFFNESS * (length - REST), rtol=1e-3)
    bag = str(tmp_path / "bag")
    robot = ["--robot", str(path)]
    assert simulate.main([*robot, "--duration", "3", "--mode", "follow", bag]) == 0
    assert validate.main([*robot, bag]) == 0
    assert "c/1" in capsys.readouterr().out


def test_preloads_given_to_a_command_leave_it_as_it_is(tmp_path):
    path = tmp_path / "spring.yaml"
    path.write_text(
        ROBOT.format(
            motors="", reference=0.3, ea=STIFFNESS * REST, tension=f"rest_length: {REST}",
            first="anchor",
        )
    )  # fmt: skip
    own = load_model(str(path)).robot.cables[0].preload
    assert load_model(str(path), [99.0]).robot.cables[0].preload == own


@pytest.mark.parametrize(
    ("tension", "first", "message"),
    [
        ("rest_length: 1\n    preload: 3", "anchor", "cables[0].preload and rest_length are both"),
        ("slack_tension: 0.1", "anchor", "cables[0].preload is missing"),
        ("rest_length: 0", "anchor", "cables[0].rest_length must be greater than 0"),
        (
            "rest_length: 0.1", "winch, motor: m, winding: 1, radius: 0.01",
            "cables[0].rest_length is that of a cable between two points: nodes[0] must be",
        ),
    ],
)  # fmt: skip
def test_a_wrong_passive_cable_is_one_clear_line(tension, first, message):
    text = ROBOT.format(motors="{name: m}", reference=0.3, ea=30.0, tension=tension, first=first)
    assert message in refusal(parse_robot, text)

"""A mistake in file or readings is named by its key before a wrong tension has status OK."""

import re

import numpy as np
import pytest
from support.heard import heard
from support.places import ROBOTS

import cdrj_ros as cdrj
from cdrj_ros.estimation.refusals import range_words
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import parse_robot

TEXT = (ROBOTS / "finger.yaml").read_text("utf-8")
TIME = np.arange(0.0, 10.0, 0.01)
STAMPS = range(1_000_000_000, 11_000_000_000, 10_000_000)
NOISE = 0.003
"""Standard deviation of an effort [N m]."""


@pytest.fixture(scope="module")
def truth():
    """Half a second at rest, then both joints move."""
    model = prepare(parse_robot(TEXT))
    grown = np.clip((TIME - 0.5) / 2.0, 0.0, 1.0)
    swing = np.radians([30.0, 25.0]) * np.sin(2.0 * np.pi * TIME[:, None] * [0.4, 0.3])
    joints = (np.radians([35.0, 35.0]) + swing) * grown[:, None]
    return cdrj.simulate(model.robot, TIME, joints)


def noisy(efforts):
    return efforts + np.random.default_rng(0).normal(0.0, NOISE, efforts.shape)


def drum(motor, radius):
    return lambda text: re.sub(rf"(motor: {motor}, .*radius_mm: )6,", rf"\g<1>{radius},", text)


def same(text):
    return text


def motor_key(motor, key):
    return lambda text: text.replace(f"name: {motor},", f"name: {motor}, {key},")


def preloads(factor, *cables):
    """The text with the preloads of some cables in another unit."""

    def change(text):
        for name in cables:
            entry = rf"(- name: {name}\s[^§]*?preload: )([\d.]+)"
            text = re.sub(entry, lambda found: f"{found[1]}{factor * float(found[2]):g}", text)
        return text

    return change


def exchanged(a, b, *, angles):
    order = np.arange(3)
    order[[a, b]] = b, a

    def change(given):
        motors, joints, efforts = given
        return (motors[:, order] if angles else motors), joints, efforts[:, order]

    return change


def reversed_(given, motor):
    sense = np.where(np.arange(3) == motor, -1.0, 1.0)
    return sense * given[0], given[1], sense * given[2]


def kept(given):
    return given


QUIET = ("", "too few readings of sensors", "agrees with the robot file")
"""What is said of a robot that is right."""

SWAPPED = "the readings of {} and {} seem to be swapped: exchange their names"


@pytest.mark.parametrize(
    ("file", "readings", "words"),
    [
        pytest.param(same, kept, "", id="none"),
        pytest.param(drum("deep_motor", 9), kept, "radius_mm: 6 would fit", id="drum"),
        pytest.param(
            lambda text: text.replace("motor: extensor_motor, winding: 1",
                                      "motor: extensor_motor, winding: -1"),
            kept, "motors.extensor_motor.effort_sign: -1 fits, or the other winding", id="winding",
        ),
        pytest.param(motor_key("deep_motor", "scale: 1.5"), kept, "scale: 1", id="gear"),
        pytest.param(
            motor_key("superficial_motor", "effort_sign: -1"), kept,
            "motors.superficial_motor.effort_sign: +1 fits", id="sign of one effort",
        ),
        pytest.param(
            motor_key("extensor_motor", "effort_scale: -1"), kept,
            "motors.extensor_motor.effort_sign: -1 fits", id="reversed current",
        ),
        pytest.param(
            lambda text: text.replace("_motor, max", "_motor, effort_scale: 0.05, max"), kept,
            "scale of all efforts", id="efforts before the gear",
        ),
        pytest.param(
            same, lambda given: (given[0], given[1], 1e3 * given[2]),
            "times what the cables' pull gives: effort_scale: 0.001", id="currents in mA",
        ),
        pytest.param(
            preloads(2.0, "deep"), kept, "preload of deep has lost 1", id="doubled preload"
        ),
        pytest.param(
            preloads(1.0 / 9.81, "deep", "superficial", "extensor"), kept,
            "preload of all cables has risen by", id="preloads in kgf",
        ),
        pytest.param(
            same, exchanged(0, 1, angles=True),
            SWAPPED.format("deep_motor", "superficial_motor"), id="motors",
        ),
        pytest.param(
            motor_key("extensor_motor", "scale: -1, effort_scale: -1"),
            lambda given: exchanged(0, 2, angles=True)(reversed_(given, 2)),
            "effort_sign: -1 fits, or the other winding, or their readings are swapped",
            id="motors of which one is reversed",
        ),
        pytest.param(
            same, exchanged(0, 1, angles=False),
            SWAPPED.format("deep_motor", "superficial_motor"), id="efforts",
        ),
        pytest.param(
            same, lambda given: (given[0], given[1][:, ::-1], given[2]),
            SWAPPED.format("mcp", "pip"), id="joints",
        ),
    ],
)  # fmt: skip
def test_it_is_named_before_a_wrong_tension_is_ok(truth, file, readings, words):
    live = LiveEstimator(prepare(parse_robot(file(TEXT)), check_range=False))
    layout = live.model.layout
    efforts = noisy(truth.motor_effort)
    motors, joints, efforts = readings((truth.motor_angle, truth.joint_angle, efforts))
    efforts = efforts * [live.model.robot.effort_scale[name] for name in layout.motors]
    wrong, first = 0, ""
    for k, found in enumerate(heard(live, STAMPS, motors, joints, efforts)):
        report = live.report()
        said = live.misfit() + (report.message if report else "")
        if said not in QUIET:
            first = first or said
        for one in found:
            assert one.stddev is not None
            sure = one.status == 0
            assert not (sure.any() and live.misfit()), "a misfit takes the status OK away"
            error = np.abs(one.tension - truth.tension[k]) > 5.0 * one.stddev[: len(sure)]
            wrong += int((sure & error).sum())
    # a verdict takes half a second
    assert wrong <= 0.001 * TIME.size * len(layout.elements)
    assert (words in first) if words else not first, first
    if not words:
        assert live.misfit() == ""
        assert report is not None
        assert report.level == "ok", report.message


@pytest.mark.parametrize(
    ("motor", "factor"),
    [("deep_motor", 1.1), ("superficial_motor", 0.9), ("extensor_motor", 1.05)],
)
def test_a_gear_some_percent_off_is_named_where_efforts_are_heard(truth, motor, factor):
    """Tensions that stretch the cable as far would be read."""
    live = LiveEstimator(prepare(parse_robot(motor_key(motor, f"scale: {factor}")(TEXT))))
    readings = truth.motor_angle, truth.joint_angle, noisy(truth.motor_effort)
    for k, _ in enumerate(heard(live, STAMPS, *readings)):
        if k % 100 == 0:
            report = live.report()
    words = rf"{motor} turns {factor:g}\d* times as far as its cables allow: scale: (\S*) or a drum"
    assert float(re.search(words, report.message)[1]) == pytest.approx(1.0, abs=0.005)


NECK = """
name: neck
motors: [{name: left}, {name: right}, {name: nod}]
joints: [{name: pitch, range_deg: [-45, 45]}, {name: head, range_deg: [-30, 30]}]
frames:
  - {name: stem, motion: revolute, joint: pitch}
  - {name: skull, parent: stem, motion: revolute, joint: head, origin_mm: [0, 90]}
cables:
  - name: front
    axial_stiffness: 25000
    preload: 40
    nodes:
      - {type: winch, motor: left, winding: 1, radius_mm: 10, position_mm: [90, -50], turn: cw}
      - {type: anchor, frame: skull, position_mm: [42, 10]}
  - name: rear
    axial_stiffness: 25000
    preload: 35
    nodes:
      - {type: winch, motor: right, winding: 1, radius_mm: 10, position_mm: [-90, -50], turn: ccw}
      - {type: anchor, frame: skull, position_mm: [-42, 10]}
  - name: base
    axial_stiffness: 25000
    preload: 15
    nodes:
      - {type: winch, motor: nod, winding: 1, radius_mm: 10, position_mm: [100, -50], turn: cw}
      - {type: anchor, frame: stem, position_mm: [28, 55]}
uncertainty: {others: exact, drums: hold}
"""
"""Its moment arms depend on the joints' angles."""


def said_of_the_neck(swing_deg, swing_hz, read):
    """What health says once a second of a motion whose joints are read as given."""
    model, seconds = prepare(parse_robot(NECK)), np.arange(0.0, 12.0, 0.02)
    swing = np.radians(swing_deg) * np.sin(2.0 * np.pi * seconds[:, None] * swing_hz)
    motion = cdrj.simulate(model.robot, seconds, swing)
    live, said = LiveEstimator(model), []
    readings = motion.motor_angle, read(motion.joint_angle), noisy(motion.motor_effort)
    stamps = range(1_000_000_000, 13_000_000_000, 20_000_000)
    for k, _ in enumerate(heard(live, stamps, *readings)):
        if k % 50 == 0:
            said.append(live.report().message)
    return said


@pytest.mark.parametrize("zero", [-0.1, 0.1])
def test_a_zero_is_named_beside_a_motor_that_seems_to_turn_too_far(zero):
    """With moment arms of other angles, motors follow the joints as through other gears."""
    said = said_of_the_neck([15.0, 12.0], [0.4, 0.25], lambda angle: angle + np.array([zero, 0.0]))
    both = [one for one in said if re.search("^zero of joint pitch .*; or nod turns .* fit", one)]
    assert both, "\n".join(said)


@pytest.mark.parametrize("zeros", [(0.2, 0.0), (-0.2, 0.0), (0.0, 0.2), (0.0, -0.2)])
def test_a_zero_far_off_is_no_broken_cable(zeros):
    """Of the hundreds of newtons that the model gives then, the friction history is unknown."""
    said = said_of_the_neck([15.0, 12.0], [0.4, 0.25], lambda angle: angle + np.array(zeros))
    assert not any("carries nothing" in one for one in said), "\n".join(said)


def test_joints_that_swing_together_are_named_as_swapped_before_a_gear_that_fits_as_well():
    """The motor that pulls one of them seems to turn by the ratio of their amplitudes."""
    said = said_of_the_neck([15.0, 13.0], [0.4, 0.4], lambda angle: angle[:, ::-1])
    assert said[-1].startswith(SWAPPED.format("pitch", "head") + "; or nod turns 1.15")


@pytest.mark.parametrize(
    "readings",
    [
        pytest.param(lambda given: (given[0], given[1] + 0.01, given[2]), id="tare elsewhere"),
        pytest.param(lambda given: (given[0] - 0.02, given[1], given[2]), id="motors displaced"),
        pytest.param(lambda given: (given[0], given[1] + 0.2, given[2]), id="slack by the model"),
        pytest.param(lambda given: (given[0] - 0.5, given[1], given[2]), id="motors not tared"),
    ],
)
def test_efforts_that_contradict_the_file_from_the_first_leave_no_wrong_tension_ok(truth, readings):
    """No filter explains the first readings of the efforts, nor may they be single wrong ones."""
    text = TEXT + "uncertainty: {others: exact, drums: hold}\n"
    live = LiveEstimator(prepare(parse_robot(text), check_range=False))
    given = readings((truth.motor_angle, truth.joint_angle, truth.motor_effort))
    for k, found in enumerate(heard(live, STAMPS[:500], *given)):
        for one in found:
            assert one.stddev is not None
            error = np.abs(one.tension - truth.tension[k]) / one.stddev[: one.tension.size]
            assert not ((one.status == 0) & (error > 5.0)).any(), f"{0.01 * k:.2f} s"


def test_of_explanations_that_are_as_good_one_stays(truth):
    """Doubled preloads and halved efforts read alike."""
    text = preloads(2.0, "deep", "superficial", "extensor")(TEXT)
    live = LiveEstimator(prepare(parse_robot(text), check_range=False))
    readings, said = (truth.motor_angle, truth.joint_angle, noisy(truth.motor_effort)), []
    for _ in heard(live, STAMPS, *readings):
        named = [*live.corrections.report().named][:1]
        if named and named != said[-1:]:
            said += named
    assert len(said) == 1, said


def test_a_sliding_joint_far_beyond_its_range_may_be_in_millimetres():
    robot = parse_robot(
        "{name: r, motors: [{name: m}], joints: [{name: q, range: [0, 0.2]}],"
        " frames: [{name: f, motion: prismatic, joint: q}], cables: [{name: c,"
        " axial_stiffness: 1000, preload: 10, nodes: [{type: winch, motor: m, winding: 1,"
        " radius: 0.01, position: [-0.3, 0], turn: cw},"
        " {type: anchor, frame: f, position: [0, 0]}]}]}"
    )
    words = "joint q at 120, its range is 0 to 0.2: in mm? scale: 0.001; or another axis's name?"
    assert range_words(robot, {"q": 120.0}) == [words]


def test_a_joint_whose_file_reads_degrees_may_be_published_in_radians():
    robot = parse_robot(
        "{name: r, motors: [{name: m}], joints: [{name: q, scale_deg: 1, offset_deg: 1,"
        " range_deg: [-70, -20], reference_angle_deg: -40}],"
        " cables: [{name: c, axial_stiffness: 1000, preload: 10,"
        " spans: [{joint: q, offset: 0.3, slope: 0.01}],"
        " nodes: [{type: winch, motor: m, winding: 1, radius: 0.01}, {type: anchor}]}]}"
    )
    read = np.radians(-0.7 + 1.0)  # by the file's scale and offset, of an angle of -0.7 rad
    (words,) = range_words(robot, {"q": read})
    assert words.endswith("-0.3491: in radians? scale: 1 in place of scale_deg")
    (words,) = range_words(robot, {"q": np.radians(-10.0)})
    assert words.endswith("-0.3491")


def test_two_joints_that_fit_only_each_others_ranges_are_named_as_a_swap():
    robot = parse_robot(
        "{name: r, motors: [{name: m}], "
        "joints: [{name: hip, scale: 0.1, range: [-0.5, 0.5]},"
        " {name: knee, scale: -0.1, range: [-1.2, -0.7], reference_angle: -0.8}],"
        " cables: [{name: c, axial_stiffness: 1000, preload: 10,"
        " spans: [[{joint: knee, offset: 0.3, slope: 0.01}, {joint: hip, slope: 0.01}]],"
        " nodes: [{type: winch, motor: m, winding: 1, radius: 0.01}, {type: anchor}]}]}"
    )
    swapped, *_ = range_words(robot, {"hip": 0.8, "knee": -0.3})  # hip 0.3, knee -0.8
    assert swapped == "the readings of hip and knee seem to be swapped: exchange their names"
    for other in ({"hip": 0.8}, {"hip": -0.8, "knee": -0.3}, {"hip": 0.8, "knee": -0.65}):
        assert not any("swapped" in one for one in range_words(robot, other)), other

"""Tests of the command check_robot and of its suspicions."""

import json

import numpy as np
import pytest
import yaml
from support.places import PROTOTYPE, ROBOT, ROBOTS

from cdrj_ros.commands import check_robot
from cdrj_ros.commands.check_printed import mapping
from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.inspection.ranges import inspect_robot
from cdrj_ros.inspection.shares import uncertainty_shares
from cdrj_ros.inspection.suspicions import find_suspicions
from cdrj_ros.model.prepared import load_model, prepare
from cdrj_ros.robot.parameters import with_numbers
from cdrj_ros.robot.reader import build_robot, load_robot, parse_robot
from cdrj_ros.robot.writer import with_section

HAND = ROBOTS / "hand.yaml"
NAMES = sorted(path.stem for path in ROBOTS.glob("*.yaml"))

PLAIN = """\
name: plain
motors: [{name: m}]
joints: [{name: q, range: [-0.5, 0.5]}]
friction: {mu_c: 0.1, rho: 0.2, bearing_friction: 0.005}
cables:
  - name: a
    youngs_modulus_gpa: 100
    diameter_mm: 1
    preload: 20
    max_tension: 300
    nodes:
      - {type: winch, motor: m, winding: 1, radius: 0.01}
      - {type: pulley, radius: 0.02, bearing_diameter: 0.01, wrap_angle: 1.5}
      - {type: anchor}
    spans: [0.5, {joint: q, offset: 0.4, slope: -0.02}]
  - name: b
    youngs_modulus_gpa: 100
    diameter_mm: 1
    preload: 20
    max_tension: 300
    nodes:
      - {type: winch, motor: m, winding: -1, radius: 0.01}
      - {type: pulley, radius: 0.02, bearing_diameter: 0.01, wrap_angle: 1.5}
      - {type: anchor}
    spans: [0.5, {joint: q, offset: 0.4, slope: 0.02}]
"""


def found(text):
    return find_suspicions(inspect_robot(prepare(parse_robot(text))))


def written(path):
    def refuse(text):
        raise AssertionError(f"{text} is no JSON number")

    return json.loads(path.read_text(), parse_constant=refuse)


@pytest.mark.parametrize("name", NAMES)
def test_every_robot_is_checked_and_written(name, tmp_path, capsys):
    out = tmp_path / "robot.json"
    assert check_robot.main([str(ROBOTS / f"{name}.yaml"), "--json", str(out), "--all"]) == 0
    printed = capsys.readouterr().out
    robot = load_robot(ROBOTS / f"{name}.yaml")
    for cable in robot.cables:
        assert cable.name in printed
    for heading in ("length [mm]", "wrap [°]", "η at rest", "passes [mm]"):
        assert heading in printed, heading
    document = written(out)
    assert document["robot"] == name
    assert [cable["name"] for cable in document["cables"]] == [c.name for c in robot.cables]
    for entry in document["suspicions"]:
        assert entry["text"] in printed


def test_a_hand_is_shown_in_a_line_per_cable_the_worst_first(capsys):
    assert check_robot.main(["hand"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) < 60
    shown = [line.split()[0] for line in lines if "%" in line]
    model = load_model("hand")
    shares, checks = uncertainty_shares(model), inspect_robot(model).cables
    relative = {
        check.name: shares.stddev[part].max() / check.followed.high
        for check, part in zip(checks, model.robot.parts, strict=True)
    }
    assert shown == sorted(relative, key=lambda name: -relative[name])
    assert "--all" in lines[-1]
    assert "--cable" in lines[-1]


def test_one_cable_is_shown_in_detail(capsys):
    assert check_robot.main(["finger", "--cable", "superficial"]) == 0
    printed = capsys.readouterr().out
    for heading in ("length [mm]", "wrap [°]", "η at rest", "passes [mm]", "superficial: shares"):
        assert heading in printed
    assert "extensor" not in printed
    assert check_robot.main(["finger", "--cable", "superfical"]) == 2
    assert "there are deep, extensor, superficial" in capsys.readouterr().err


def fingers(count):
    """The shipped finger several times."""
    finger = yaml.safe_load((ROBOTS / "finger.yaml").read_text(encoding="utf-8"))
    kinds = ("motors", "joints", "frames", "cables")
    uses = [{"prefix": f"f{k}_"} for k in range(count)]
    part = {kind: finger[kind] for kind in kinds} | {"name": "finger", "used": uses}
    empty = {kind: [] for kind in kinds}
    document = {"name": "fingers", "friction": finger["friction"], "parts": [part]}
    return parse_robot(yaml.safe_dump(empty | document))


def test_another_finger_changes_nothing_that_is_found_about_the_first():
    one, two = (prepare(fingers(count)) for count in (1, 2))
    alone, beside = (inspect_robot(model) for model in (one, two))
    for before, after in zip(alone.cables, beside.cables, strict=False):
        assert after.worst.high == before.worst.high
        assert after.worst.high_at[:2] == before.worst.high_at
        assert after.length.low == before.length.low
    found = [uncertainty_shares(model) for model in (one, two)]
    size = len(one.layout.elements)
    assert np.array_equal(found[1].stddev[:size], found[0].stddev)
    shares = {cause.what: cause.share for cause in found[1].causes}
    for cause in found[0].causes:
        assert np.array_equal(shares[cause.what][:size], cause.share)


def test_an_impossible_pose_is_told_by_the_joints_of_its_cable_alone():
    text = HAND.read_text(encoding="utf-8").replace("[38, 0, 0]", "[4, 0, 0]")
    with pytest.raises(RobotFileError) as error:
        prepare(parse_robot(text))
    message = str(error.value)
    for name in ("thumb_pip_flexor", "deviation = ", "wrist = ", "thumb_side = ", "thumb_pip = "):
        assert name in message
    assert "index_" not in message
    assert "..." not in message


def test_figures_of_an_installed_robot_go_to_the_terminal(capsys):
    assert check_robot.main(["finger", "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["robot"] == "finger"


def test_slips_of_an_encoder_that_no_reading_shows_are_named_with_their_size(capsys, tmp_path):
    """An encoder of a plain cable: E A r / L newtons per radian, counts of 1 mrad."""
    text = PLAIN.replace("{name: m}", "{name: m, resolution: 0.001}")
    path = tmp_path / "plain.yaml"
    path.write_text(text)
    assert check_robot.main([str(path), "--all"]) == 0
    stiffness = 100e9 * np.pi / 4 * 1e-6 / 0.93 * 0.01
    slip, unsure = 0.002, 2.0 / stiffness
    words = f"up to {slip:.2g} rad ({slip * stiffness:.2g} N) is not seen, beyond {unsure:.2g} rad"
    assert f"m: a slip of its encoder {words}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["no_such_robot"], ["no_such_robot"]),
        (["hoist", "--json", "/no/such/folder/x"], ["--json", "/no/such/folder"]),
    ],
)
def test_a_wrong_command_line_is_one_line_and_exit_code_2(arguments, words, capsys):
    assert check_robot.main(arguments) == 2
    error = capsys.readouterr().err
    assert len(error.strip().splitlines()) == 1
    assert all(word in error for word in words), error


def test_the_worst_tension_of_the_hoist_is_that_of_the_textbook():
    hoist = (ROBOTS / "hoist.yaml").read_text("utf-8").replace("preload: 0", "preload: 125")
    (rope,) = inspect_robot(prepare(parse_robot(hoist))).cables
    assert (rope.followed.low, rope.followed.high) == pytest.approx((125.0, 125.0))
    eta = (30.0 - 0.6) / (30.0 + 0.6)
    assert rope.worst.high == pytest.approx(125.0 / eta**4)


def test_a_preload_is_lost_after_the_motion_that_releases_its_elongation():
    inspection = inspect_robot(prepare(parse_robot(PLAIN)))
    cable = inspection.cables[0]
    assert cable.slack_after[0] == pytest.approx(20.0 / (cable.stiffness * 0.02))


def test_the_cable_that_passes_a_pulley_is_the_change_of_length_behind_it():
    inspection = inspect_robot(prepare(parse_robot(PLAIN)))
    assert inspection.cables[0].pulleys[0].passing == pytest.approx(0.02)
    assert inspection.motors[0].angle.width == pytest.approx(2.0)


WINCH_B = "- {type: winch, motor: m, winding: -1, radius: 0.01}"
JOINT = "{name: q, range: [-0.5, 0.5]}"
STATIC = "mu_c: 0.1, law: euler, mu_s: 0.2, stribeck_speed: 0.1"
FIRST_SPANS = "spans: [0.5, {joint: q, offset: 0.4, slope: -0.02}]"

ODD = [
    ("wrap_angle: 1.5}", "wrap_angle: {joint: q, offset: 0.51, slope: 1}}",
     "a/2", "about to leave"),
    ("wrap_angle: 1.5}", "wrap_angle: 6.5}", "a/2", "a whole turn"),
    ("wrap_angle: 1.5}", "wrap_angle: {joint: q, offset: 1.5, slope: 0.5}}",
     "a/2", "no moving_end says at which end"),
    ("offset: 0.4, slope: -0.02", "offset: 0.021, slope: -0.04", "a/2", "free span shrinks"),
    (FIRST_SPANS, "spans: [{joint: q, offset: 0.5, slope: -0.02}, 0.4]",
     "a/2", "slips only if the tension changes"),
    ("mu_c: 0.1", STATIC, "a/2", "mu_s = 0.2 is without effect"),
    ("mu_c: 0.1,", "mu_c: 0.1, stribeck_speed: 0.1,", "a/2", "stribeck_speed is without effect"),
    ("rho: 0.2, ", "", "a/2", "rho is 1"),
    ("rho: 0.2", "rho: 0", "a/2", "mu_c = 0.1 is without effect"),
    ("bearing_diameter: 0.01, ", "", "a/2", "bearing_diameter is 0"),
    ("mu_c: 0.1, rho: 0.2, bearing_friction: 0.005", "rho: 0.2", "a/2", "no friction at all"),
    ("offset: 0.4, slope: -0.02", "angle: [-0.5, 0, 0.5], value: [0.4, 0.39, 0.4]",
     "a", "changes sign"),
    (JOINT, "{name: q, range: [-18, 18]}", "m", "turns over the joint range"),
    ("mu_c: 0.1, rho: 0.2", "mu_c: 0.9, rho: 0.9", "a", "friction may reduce its tension"),
    ("winding: -1", "winding: 1", "b", "although the motors follow"),
    (WINCH_B, "- {type: anchor}", "b", "has no winch"),
    ("max_tension: 300", "max_tension: 20", "a", "above max_tension"),
    ("    max_tension: 300\n", "", "a", "without max_tension"),
    ("diameter_mm: 1", "diameter_mm: 0.05", "a", "stretches it by"),
    ("diameter_mm: 1", "diameter: 1", "a", "diameter is 1000 mm"),
    ("youngs_modulus_gpa: 100", "youngs_modulus_gpa: 2000", "a", "youngs_modulus is 2e+03 GPa"),
    ("diameter_mm: 1", "diameter_mm: 4.1", "a", "bends around a radius of 10 mm"),
    ("{name: m}", "{name: m}, {name: idle}", "idle", "moves no cable"),
    (JOINT, f"{JOINT}, {{name: idle, range: [0, 1]}}", "idle", "not moved by any cable"),
    ("[{name: m}]", "[{name: m, effort_sign: -1}, {name: n}]", "m", "effort_sign is -1"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "where", "words"), ODD, ids=[one[3] for one in ODD])
def test_every_suspicious_value_is_reported(old, new, where, words):
    assert old in PLAIN
    suspicions = found(PLAIN.replace(old, new, 1))
    matching = [one for one in suspicions if words in one.text]
    assert where in [one.where for one in matching], suspicions
    assert all("\n" not in one.text for one in suspicions)


@pytest.mark.parametrize(
    ("signs", "whose"),
    [
        ("scale: -0.02, effort_scale: -2.7", "torques of the cables"),
        ("scale: -0.02, effort_scale: 2.7", "the motor's torques"),
        ("scale: -0.02, effort_scale: -2.7, effort_sign: -1", "the motor's torques"),
        ("scale: 0.02, effort_scale: 2.7, effort_sign: -1", "the motor's torques"),
        ("scale: 0.02, effort_scale: 2.7", "torques of the cables"),
    ],
)
def test_what_exerts_published_efforts_follows_from_the_signs_of_a_motor(signs, whose):
    text = PLAIN.replace("[{name: m}]", f"[{{name: m, {signs}}}]")
    (said,) = mapping(parse_robot(text))
    assert said.endswith(f"efforts are {whose} in the sense of the published position")
    assert not any("effort_sign" in one.text for one in found(text)), "there is one motor"
    assert not [*mapping(parse_robot(PLAIN))], "nothing is converted"


def test_windings_that_contradict_the_turns_are_reported():
    text = (ROBOTS / "prototype_positions.yaml").read_text("utf-8")
    assert not any("contradict" in entry.text for entry in found(text))
    wrong = text.replace("winding: -1", "winding: 1")
    assert any(
        entry.where == "winch" and "contradict" in entry.text and entry.grave
        for entry in found(wrong)
    )


def test_a_dead_point_of_all_cables_is_reported():
    dead = PLAIN
    for slope in ("-0.02", "0.02"):
        dead = dead.replace(
            f"offset: 0.4, slope: {slope}", "angle: [-0.5, 0, 0.5], value: [0.4, 0.39, 0.4]"
        )
    (loose,) = (one for one in found(dead) if "without changing any cable's length" in one.text)
    assert loose.where == "q"
    assert "at q = 0.0°" in loose.text
    assert loose.grave


def test_a_stiffening_cable_is_inspected_with_its_own_law(tmp_path, capsys):
    key = "    preload: 20\n"
    text = PLAIN.replace(key, f"    bedding_strain: 0.002\n    bedding_tension: 10\n{key}")
    checks = inspect_robot(prepare(parse_robot(text))).cables
    plain = inspect_robot(prepare(parse_robot(PLAIN))).cables
    stiffness = 100e9 * np.pi * 1e-3**2 / 4.0
    for check, linear in zip(checks, plain, strict=True):
        length = check.elements[0].length.low + 0.4 + 0.5 * 0.02 * 1.5
        slope = 1.0 / (1.0 / stiffness + 0.002 * 10.0 / 30.0**2)
        assert check.stiffness == pytest.approx(slope / length, rel=1e-9)
        strain = 20.0 / stiffness + 0.002 * 20.0 / 30.0
        assert check.slack_after[0] == pytest.approx(strain * length / 0.02, rel=1e-9)
        assert check.slack_after[0] > 5.0 * linear.slack_after[0]
    path = tmp_path / "soft.yaml"
    path.write_text(text, "utf-8")
    check_robot.main([str(path), "--cable", "a"])
    assert "EA 7.854e+04 N, bedding 0.002 at 10 N" in capsys.readouterr().out


def test_a_moving_end_does_not_matter_without_friction():
    wrap = "wrap_angle: {joint: q, offset: 1.5, slope: 0.5}}"
    for law in ("law: none", "rho: 0, bearing_friction: 0"):
        text = PLAIN.replace("mu_c: 0.1, rho: 0.2, bearing_friction: 0.005", f"mu_c: 0.1, {law}")
        assert not any("moving_end" in one.text
                       for one in found(text.replace("wrap_angle: 1.5}", wrap)))  # fmt: skip


def test_an_unknown_argument_is_escaped_on_the_terminal(capsys):
    with pytest.raises(SystemExit, match="2"):
        check_robot.main(["hoist", "--red\x1b[31m"])
    assert "unrecognized arguments: --red\\x1b[31m" in capsys.readouterr().err


TEXT = PROTOTYPE.read_text(encoding="utf-8")


def report(tmp_path, uncertainty):
    robot, out = tmp_path / "robot.yaml", tmp_path / "figures.json"
    robot.write_text(with_section(TEXT, "uncertainty", uncertainty), encoding="utf-8")
    assert check_robot.main([str(robot), "--json", str(out)]) == 0
    return json.loads(out.read_text(encoding="utf-8"))["uncertainty"]


def test_a_fresh_file_is_wide_and_names_three_numbers(tmp_path, capsys):
    found = report(tmp_path, None)
    assert found["stddev"]["upper/8"] > 10.0
    assert found["causes"][0]["share"]["upper/8"] > 0.4
    for element in found["stddev"]:
        assert sum(cause["share"][element] for cause in found["causes"]) == pytest.approx(1.0)
    text = " ".join(capsys.readouterr().out.split())
    for cause in found["causes"][:3]:
        assert f"{cause['what']}: {cause['measure']}" in text
    assert found["causes"][0]["what"] == "zero of joint elbow"
    assert "~/tare" in found["causes"][0]["measure"]


def test_an_exact_file_has_nothing_to_reduce(tmp_path):
    assert report(tmp_path, "uncertainty: {others: exact}") is None


def test_the_contribution_of_one_number_is_its_effect():
    """A preload known to 0.4 N changes every tension of a frictionless cable by as much."""
    model = load_model(ROBOT)
    document = dict(model.robot.document)
    document["uncertainty"] = {
        "others": "exact", "parameters": ["cables.upper.preload"], "stddev": [0.4],
    }  # fmt: skip
    loose = with_numbers(document, {"friction.mu_c": 0.0, "friction.mu_s": 0.0,
                                    "friction.bearing_friction": 0.0})  # fmt: skip
    shares = uncertainty_shares(prepare(build_robot(loose, "test")))
    assert shares.stddev[:8] == pytest.approx(0.4, rel=0.02)
    assert np.all(shares.stddev[8:] == 0.0)
    assert [cause.what for cause in shares.causes] == ["cables.upper.preload"]


def test_errors_that_cancel_make_no_tension_uncertain():
    """A tare: the error of the reference angle is that of the encoder's zero, here 3 degrees."""
    document = dict(load_model("finger").robot.document)
    zero = ["joints.mcp.offset", "joints.mcp.reference_angle"]
    document["uncertainty"] = {
        "others": "exact", "parameters": zero, "stddev": [0.05, 0.05], "correlation": [[1], [1, 1]],
    }  # fmt: skip
    shares = uncertainty_shares(prepare(build_robot(document, "test")))
    alone = {**document["uncertainty"], "correlation": [[1], [0, 1]]}
    apart = uncertainty_shares(prepare(build_robot({**document, "uncertainty": alone}, "test")))
    assert np.all(shares.stddev < 0.02 * apart.stddev.max())

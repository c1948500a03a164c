"""Access to numbers of a robot file by path, and replacement in its text."""

import re
from dataclasses import fields
from math import pi

import pytest
from support.places import PROTOTYPE, ROBOTS
from support.refusal import refusal

from cdrj_ros.foundation.errors import RobotFileError, UsageError
from cdrj_ros.robot.description import Anchor, Cable, Friction, Pulley, Sensor
from cdrj_ros.robot.document import allowed_range, parse_document, schema, whole
from cdrj_ros.robot.parameters import find_number, matching_paths, number_at, with_numbers
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.robot.writer import with_numbers_in_text, with_section

TEXT = PROTOTYPE.read_text(encoding="utf-8")
DOCUMENT = parse_document(TEXT, "prototype.yaml")


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("friction.rho", 0.2),
        ("cables.upper.preload", 36.85),
        ("cables.upper.axial_stiffness", 200e9 * pi * 0.2e-3**2 / 4.0),
        ("cables.lower.nodes.1.radius", 0.015),
        ("cables.upper.nodes.3.wrap_angle", 105.4 * pi / 180.0),
        ("cables.upper.nodes.6.wrap_angle.value.2", 78.5 * pi / 180.0),
        ("cables.upper.spans.2", 0.10),
        ("cables.upper.spans.6.sine", -0.06),
        ("joints.elbow.range.2", 40.0 * pi / 180.0),
    ],
)
def test_a_path_leads_to_a_number_in_si(path, value):
    assert number_at(DOCUMENT, path) == pytest.approx(value)


def test_every_number_that_is_set_is_read_again():
    values = {
        "friction.mu_c": 0.11,
        "cables.upper.friction.mu_c": 0.12,
        "cables.upper.nodes.3.friction.mu_c": 0.13,
        "cables.lower.axial_stiffness": 6000.0,
        "joints.elbow.clock_offset": 0.002,
        "cables.lower.spans.1": 0.21,
    }
    changed = with_numbers(DOCUMENT, values)
    for path, value in values.items():
        assert number_at(changed, path) == pytest.approx(value, rel=1e-12)
    upper, lower = build_robot(changed, "").cables
    assert [p.friction.mu_c for p in upper.pulleys[:3]] == [0.12, 0.13, 0.12]
    assert lower.pulleys[0].friction.mu_c == 0.11
    assert lower.axial_stiffness == pytest.approx(6000.0)
    assert number_at(DOCUMENT, "friction.mu_c") == 0.15, "the document itself must not change"


def test_a_star_forms_one_group_and_braces_form_one_group_each():
    tied = matching_paths(DOCUMENT, "cables.*.preload")
    assert tied == (("cables.upper.preload", "cables.lower.preload"),)
    apart = matching_paths(DOCUMENT, "cables.{*}.preload")
    assert apart == (("cables.upper.preload",), ("cables.lower.preload",))
    (group,) = matching_paths(DOCUMENT, "cables.[lower,upper].nodes.[3,4].radius")
    assert group[0] == "cables.lower.nodes.3.radius"
    assert len(group) == 4


@pytest.mark.parametrize(
    ("path", "taught"),
    [
        ("friction.roh", "did you mean rho?"),
        ("cables.uper.preload", "did you mean upper?"),
        ("cables.upper", "continue with one of axial_stiffness"),
        ("friction.law", "there are mu_c"),
        ("friction.rho.x", "nothing follows"),
        ("cables.upper.nodes.1.bearing_torque", "there are radius"),
        ("cables.upper.nodes.99.radius", "cables.upper.nodes has no '99'"),
        ("cables.upper.nodes.0.radius", "cables.upper.nodes has no '0'"),
        ("cables.upper.max_tension2", "did you mean max_tension?"),
        ("cables.upper.spans.6", "continue with one of"),
        ("", "'empty name'"),
        ("motors.winch.bearing_stiffness", "has no default"),
        ("cables.*.nonsense", "has no 'nonsense'"),
    ],
)
def test_a_wrong_path_is_refused_with_the_existing_names(path, taught):
    def found():
        return [find_number(DOCUMENT, x) for xs in matching_paths(DOCUMENT, path) for x in xs]

    assert taught in refusal(found, error=UsageError)


def test_new_numbers_leave_every_other_line_of_the_text_as_it_was():
    values = {
        "friction.rho": 0.1114,
        "cables.upper.preload": 35.5,
        "cables.upper.axial_stiffness": 6000.0,
        "cables.lower.nodes.1.radius": 0.0151,
    }
    text = with_numbers_in_text(TEXT, values, "prototype.yaml")
    before, after = TEXT.splitlines(), text.splitlines()
    changed = [(a, b) for a, b in zip(before, after, strict=True) if a != b]
    assert len(changed) == len(values)
    for old, new in changed:
        assert old.partition("#")[2] == new.partition("#")[2], "comments are kept"
    assert any("radius_mm: 15.1," in new for _, new in changed), "units are kept"
    document = parse_document(text, "")
    for path, value in values.items():
        assert number_at(document, path) == pytest.approx(value, rel=1e-6)


def test_missing_numbers_are_written_at_their_place():
    values = {
        "cables.upper.friction.rho": 0.1,
        "cables.upper.friction.mu_c": 0.14,
        "cables.upper.nodes.6.friction.mu_c": 0.13,
        "cables.lower.nodes.3.bearing_torque": 1e-6,
        "joints.elbow.clock_offset": -0.0015,
        "motors.winch.spring_stiffness": 0.1,
    }
    text = with_numbers_in_text(TEXT, values, "prototype.yaml")
    kept = [line for line in TEXT.splitlines() if "#" in line]
    assert all(line in text for line in kept)
    document = parse_document(text, "")
    assert {path: number_at(document, path) for path in values} == pytest.approx(values)


def test_a_missing_number_that_is_set_to_its_default_needs_no_place():
    values = {"motors.winch.reference_angle": 0.0, "cables.lower.preload": 20.0}
    text = with_numbers_in_text(TEXT, values, "prototype.yaml")
    assert number_at(parse_document(text, "x"), "motors.winch.reference_angle") == 0.0
    assert number_at(parse_document(text, "x"), "cables.lower.preload") == 20.0


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_flow_and_block_mappings_take_new_numbers(end):
    lines = [
        "name: x", "motors: [{name: m}]", "joints:", "  - name: j", "    range: [0, 1]  # r",
        "cables:", "- name: c", "  preload: 3   # p", "  axial_stiffness: 5", "  nodes:",
        "  - type: anchor", "  - {type: anchor}", "  spans: [{joint: j, offset: 1}]",
    ]  # fmt: skip
    values = {
        "joints.j.offset": 0.1,
        "motors.m.offset": 2.0,
        "cables.c.nodes.1.radius": 0.2,
        "cables.c.nodes.2.radius": 0.3,
        "cables.c.spans.1.slope": -0.01,
        "cables.c.preload": 0.004,
    }
    text = with_numbers_in_text(end.join(lines), values, "x")
    assert "preload: 0.004 # p" in text.replace("  #", " #")
    document = parse_document(text, "x")
    assert {path: number_at(document, path) for path in values} == pytest.approx(values)


def test_a_change_of_a_number_with_an_alias_is_refused():
    text = TEXT.replace("preload: 36.85 ", "preload: &p 36.85 ").replace("26.26", "*p")
    with pytest.raises(RobotFileError, match="alias"):
        with_numbers_in_text(text, {"cables.lower.preload": 20.0}, "x")


def test_a_section_is_put_at_the_end_in_place_of_the_old_one():
    once = with_section(
        TEXT, "uncertainty", "uncertainty:\n  parameters: [friction.rho]\n  stddev: [1]"
    )
    twice = with_section(
        once, "uncertainty", "uncertainty:\n  parameters: [friction.rho]\n  stddev: [2]"
    )
    assert twice.startswith(TEXT.split("uncertainty:")[0].rstrip())
    assert parse_document(twice, "x")["uncertainty"]["stddev"] == [2]
    assert (
        with_section(twice, "uncertainty", None).rstrip()
        == with_section(TEXT, "uncertainty", None).rstrip()
    )


def test_all_robot_files_can_be_written_with_their_own_numbers():
    for file in ROBOTS.glob("*.yaml"):
        text = file.read_text(encoding="utf-8")
        document = parse_document(text, str(file))
        paths = [f"cables.{cable['name']}.preload" for cable in document["cables"]]
        again = with_numbers_in_text(text, {p: number_at(document, p) for p in paths}, str(file))
        assert parse_document(again, str(file)) == document


@pytest.mark.parametrize("kind", ["friction", "joint", "motor", "pulley", "anchor", "cable"])
def test_the_defaults_of_the_schema_are_those_of_the_classes(kind):
    checked = 0
    values = {"friction": Friction, "joint": Sensor, "motor": Sensor, "pulley": Pulley,
              "anchor": Anchor, "cable": Cable}[kind]  # fmt: skip
    defaults = {field.name: field.default for field in fields(values)}
    for key, rule in whole(schema()["$defs"][kind])["properties"].items():
        told = re.search(r"Default:? ([-+0-9.e]*\d)(?=[. ]|$)", rule.get("description", ""))
        if told and key in defaults:
            assert float(told[1]) == defaults[key], key
            checked += 1
    assert checked or kind == "anchor"


@pytest.mark.parametrize(
    ("path", "inside", "outside"),
    [
        ("cables.upper.friction.mu_c", (0.0, 2.0), (-1e-9, 2.1, float("nan"))),
        ("cables.upper.friction.bearing_friction", (0.0, 0.99), (1.0,)),
        ("cables.upper.friction.bristle_stiffness", (1e-3, 1e9), (0.0, 1.1e9)),
        ("cables.upper.preload", (0.0, 1e15), (-1.0, float("inf"))),
    ],
)
def test_the_range_of_a_number_is_the_one_that_holds(path, inside, outside):
    allowed = allowed_range(find_number(DOCUMENT, path).rules)
    assert all(value in allowed for value in inside)
    assert not any(value in allowed for value in outside)

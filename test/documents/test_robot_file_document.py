"""docs/robot_file.md: valid example, correct error messages, complete list of keys."""

from __future__ import annotations

import importlib.util
import json
import re
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.inspection.ranges import inspect_robot
from cdrj_ros.inspection.suspicions import find_suspicions
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.document import schema
from cdrj_ros.robot.reader import parse_robot

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "docs" / "robot_file.md").read_text("utf-8")
FIRST, SPANS, ENDS, SPACE = re.findall(r"```yaml\n(.*?)```", TEXT, re.DOTALL)


@pytest.fixture(scope="module")
def generator() -> ModuleType:
    spec = importlib.util.spec_from_file_location("keys", ROOT / "tools" / "robot_file_keys.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_key_reference_is_that_of_the_schema(generator: ModuleType) -> None:
    assert generator.updated(TEXT) == TEXT, "run python tools/robot_file_keys.py"


def test_every_key_of_the_schema_is_in_the_reference(generator: ModuleType) -> None:
    def keys(rule: object) -> set[str]:
        found: set[str] = set()
        if isinstance(rule, Mapping):
            for name, inner in rule.items():
                if name == "properties" and isinstance(inner, Mapping):
                    found |= set(inner)
                found |= keys(inner)
        elif isinstance(rule, tuple):
            for inner in rule:
                found |= keys(inner)
        return found

    reference = generator.reference()
    assert len(keys(schema())) > 50
    for key in keys(schema()):
        assert f"| `{key}` |" in reference, key


def test_a_new_key_reaches_the_reference_with_unit_default_and_range(
    generator: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    added = {
        "type": "number", "exclusiveMinimum": 0, "maximum": 5,
        "description": "Mass per length [kg/m]. Default 0.25.",
    }  # fmt: skip
    document = json.loads((ROOT / "cdrj_ros" / "robot" / "robot.schema.json").read_text("utf-8"))
    document["$defs"]["cable"]["properties"]["mass"] = added
    monkeypatch.setattr(generator, "schema", lambda: document)
    line = next(one for one in generator.reference().splitlines() if one.startswith("| `mass`"))
    assert line == "| `mass` | number | kg/m | 0.25 | > 0, ≤ 5 | Mass per length. |"
    assert generator.updated(TEXT) != TEXT


def test_the_first_example_is_a_robot_without_suspicious_values() -> None:
    model = prepare(parse_robot(FIRST, "one_joint.yaml"))
    assert model.layout.elements == ("flexor/1", "flexor/2", "extensor/1", "extensor/2")
    inspection = inspect_robot(model)
    assert find_suspicions(inspection) == ()
    flexor, extensor = inspection.cables
    # a cable that bends the joint has a positive arm
    assert flexor.moment_arm[0].low == pytest.approx(0.040)
    assert extensor.moment_arm[0].high == pytest.approx(-0.040)


def test_a_wrong_sense_around_a_pulley_is_suspicious() -> None:
    wrong = FIRST.replace("[150, 60], turn: cw", "[150, 60], turn: ccw")
    assert wrong != FIRST
    found = find_suspicions(inspect_robot(prepare(parse_robot(wrong))))
    assert any(one.where == "flexor/2" and "other way round" in one.text for one in found)


def test_the_spans_of_the_second_example_can_be_read() -> None:
    text = f"""
name: shown
motors: [{{name: m}}]
joints: [{{name: elbow, range_deg: [-40, 40]}}, {{name: wrist, range_deg: [-60, 60]}}]
cables:
  - name: c
    axial_stiffness: 5000
    preload: 20
    nodes:
      - {{type: winch, motor: m, winding: 1, radius_mm: 10}}
      - {{type: pulley, radius_mm: 5, wrap_angle_deg: 90}}
      - {{type: pulley, radius_mm: 5, wrap_angle_deg: 90}}
      - {{type: anchor}}
{"".join(f"    {line}" for line in SPANS.splitlines(keepends=True))}"""
    model = prepare(parse_robot(text))
    pose = {"elbow": 0.5, "wrist": np.pi / 3}
    from cdrj_ros.model.prepared import shape_at

    length = shape_at(model, np.array(list(pose.values()))).length
    arc = 0.005 * np.pi / 4
    np.testing.assert_allclose(
        length, [0.2 + arc, 0.08 - 0.06 * np.sin(0.5) + 2 * arc, 0.055 + arc], atol=1e-6
    )


def test_the_example_of_a_moving_end_is_a_pulley_whose_arc_grows_there() -> None:
    text = f"""
name: shown
motors: [{{name: m}}]
joints: [{{name: elbow, range_deg: [-39, 39]}}]
cables:
  - name: c
    axial_stiffness: 5000
    preload: 20
    nodes:
      - {{type: winch, motor: m, winding: 1, radius_mm: 10}}
      {ENDS.strip()}
      - {{type: anchor}}
    spans: [0.1, 0.1]
"""
    (pulley,) = parse_robot(text).cables[0].pulleys
    assert pulley.moving_end == "after"
    np.testing.assert_allclose(np.degrees(pulley.wrap[0].value[[0, -1]]), [1.0, 79.0], atol=0.01)


MISTAKES = re.findall(
    r"^\| `(.+?)` → `(.+?)` \| `(.+?)` \|$",
    TEXT[TEXT.index("<!-- mistakes") : TEXT.index("<!-- end of mistakes")],
    re.MULTILINE,
)


def test_the_document_has_enough_mistakes() -> None:
    assert len(MISTAKES) >= 8


@pytest.mark.parametrize(("given", "changed", "answer"), MISTAKES, ids=lambda text: text[:30])
def test_the_error_for_a_mistake_is_the_one_in_the_document(
    given: str, changed: str, answer: str
) -> None:
    assert given in FIRST
    with pytest.raises(RobotFileError) as error:
        prepare(parse_robot(FIRST.replace(given, changed, 1), "one_joint.yaml"))
    message = str(error.value)
    assert message.startswith(answer), message
    assert message.endswith("(one_joint.yaml)")


def test_every_file_that_the_document_names_is_there() -> None:
    for name in re.findall(r"`(\w+\.yaml)`", TEXT):
        assert (ROOT / "config" / "robots" / name).exists(), name


def test_the_example_in_space_is_a_valid_robot() -> None:
    head = FIRST.partition("frames:")[0] + "friction: {mu_c: 0.1}\n"
    model = prepare(parse_robot(head + SPACE))
    assert not model.robot.planar
    assert [pulley.kind for pulley in model.robot.cables[0].pulleys] == ["sphere", "eyelet"]

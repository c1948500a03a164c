"""docs/robot_file.md: valid example, correct error messages, complete list of keys."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest

from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.inspection.ranges import inspect_robot
from cdrj_ros.inspection.suspicions import find_suspicions
from cdrj_ros.model.prepared import prepare
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


def test_the_first_example_is_a_robot_without_suspicious_values() -> None:
    model = prepare(parse_robot(FIRST, "one_joint.yaml"))
    assert model.layout.elements == ("flexor/1", "flexor/2", "extensor/1", "extensor/2")
    inspection = inspect_robot(model)
    assert find_suspicions(inspection) == ()
    flexor, extensor = inspection.cables
    # a cable that bends the joint has a positive arm
    assert flexor.moment_arm[0].low == pytest.approx(0.040)
    assert extensor.moment_arm[0].high == pytest.approx(-0.040)


def test_the_example_in_space_is_a_valid_robot() -> None:
    head = FIRST.partition("frames:")[0] + "friction: {mu_c: 0.1}\n"
    model = prepare(parse_robot(head + SPACE))
    assert not model.robot.planar
    assert [pulley.kind for pulley in model.robot.cables[0].pulleys] == ["sphere", "eyelet"]


MISTAKES = re.findall(
    r"^\| `(.+?)` → `(.+?)` \| `(.+?)` \|$",
    TEXT[TEXT.index("<!-- mistakes") : TEXT.index("<!-- end of mistakes")],
    re.MULTILINE,
)


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

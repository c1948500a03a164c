"""docs/robot_file.md: valid example, correct error messages, complete list of keys."""

from __future__ import annotations

import re

import numpy as np
import pytest
from support.page_lines import ROOT, loaded_tool

from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.inspection.ranges import inspect_robot
from cdrj_ros.inspection.suspicions import find_suspicions
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import parse_robot

TEXT = (ROOT / "docs" / "robot_file.md").read_text("utf-8")
FIRST, SPANS, ENDS, COUPLED, SPACE, PARTS = re.findall(r"```yaml\n(.*?)```", TEXT, re.DOTALL)


def test_the_key_reference_is_that_of_the_schema() -> None:
    generator = loaded_tool(ROOT / "tools" / "robot_file_keys.py")
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


def test_the_example_of_coupled_joints_is_read_as_the_page_says() -> None:
    head, _, rest = FIRST.partition("joints:\n")
    moved = rest.replace("joint: shoulder", "joint: dip").partition("\n")[2]
    robot = parse_robot(f"{head}{COUPLED}{moved}")
    assert [joint.name for joint in robot.joints] == ["pip", "left", "right"]
    (arm,) = [frame for frame in robot.frames if frame.name == "arm"]
    assert (arm.joint, arm.multiplier) == ("pip", 0.7)
    assert arm.offset == pytest.approx(np.radians(5.0))


def test_the_example_in_space_is_a_valid_robot() -> None:
    head = FIRST.partition("frames:")[0] + "friction: {mu_c: 0.1}\n"
    model = prepare(parse_robot(head + SPACE))
    assert not model.robot.planar
    assert [pulley.kind for pulley in model.robot.cables[0].pulleys] == ["sphere", "eyelet"]


def test_the_example_of_parts_is_a_robot_with_the_cables_that_the_page_names() -> None:
    model = prepare(parse_robot(f"name: hand\n{PARTS}"))
    assert [cable.name for cable in model.robot.cables] == ["index_flexor", "thumb_flexor"]
    assert "index_finger" in [frame.name for frame in model.robot.frames]
    flexors = inspect_robot(model).cables
    assert all(cable.moment_arm[c].low > 0.0 for c, cable in enumerate(flexors))
    wrong = PARTS.replace("preload: 7.5", "preload: -7")
    line = f"name: hand\n{wrong}".partition("with:")[0].count("\n") + 1
    with pytest.raises(RobotFileError) as error:
        parse_robot(f"name: hand\n{wrong}")
    said = " ".join(TEXT.partition("line: `")[2].partition("`")[0].split())
    assert str(error.value).startswith(re.sub("line [0-9]+", f"line {line}", said))


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

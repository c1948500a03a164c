"""docs/robot_file.md: valid example, correct error messages, complete list of keys."""

import re
from textwrap import indent

import numpy as np
import pytest
import yaml
from support.page_lines import ROOT, blocks, loaded_tool

from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.inspection.ranges import inspect_robot
from cdrj_ros.inspection.suspicions import find_suspicions
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import parse_robot

TEXT = (ROOT / "docs" / "robot_file.md").read_text("utf-8")
BLOCKS = blocks("docs/robot_file.md", "yaml")
FIRST, SPANS, ENDS, COUPLED, SPACE, PARTS, PASSIVE, UNMEASURED = BLOCKS


def test_the_key_reference_is_that_of_the_schema():
    generator = loaded_tool(ROOT / "tools" / "robot_file_keys.py")
    assert generator.updated(TEXT) == TEXT, "run python tools/robot_file_keys.py"


def test_the_first_example_is_a_robot_without_suspicious_values():
    model = prepare(parse_robot(FIRST, "one_joint.yaml"))
    assert model.layout.elements == ("flexor/1", "flexor/2", "extensor/1", "extensor/2")
    inspection = inspect_robot(model)
    assert find_suspicions(inspection) == ()
    flexor, extensor = inspection.cables
    # a cable that bends the joint has a positive arm
    assert flexor.moment_arm[0].low == pytest.approx(0.040)
    assert extensor.moment_arm[0].high == pytest.approx(-0.040)


def test_the_examples_of_spans_and_wraps_that_follow_a_joint_are_read():
    head = (
        "name: arm\nmotors: [{name: m}]\n"
        "joints: [{name: elbow, range_deg: [-30, 30]}, {name: wrist, range_deg: [-30, 30]}]\n"
        "cables:\n  - name: c\n    axial_stiffness: 8000\n    preload: 5\n    nodes:\n"
        "      - {type: winch, motor: m, winding: 1, radius_mm: 9}\n"
    )
    tail = "      - {type: pulley, radius_mm: 4, wrap_angle_deg: 60}\n      - {type: anchor}\n"
    robot = parse_robot(f"{head}{indent(ENDS, '      ')}{tail}{indent(SPANS, '    ')}")
    assert len(robot.cables[0].pulleys) == 2


def test_the_example_of_a_joint_without_encoder_is_read():
    jaw = (ROOT / "config" / "robots" / "davinci_jaw.yaml").read_text()
    document = {**yaml.safe_load(jaw), **yaml.safe_load(UNMEASURED)}
    robot = parse_robot(yaml.safe_dump(document))
    assert list(robot.unmeasured) == [0]
    assert robot.motors[0].effort_noise == 0.01
    assert robot.joints[0].load_drift == 0.01


def test_the_example_of_coupled_joints_is_read_as_the_page_says():
    head, _, rest = FIRST.partition("joints:\n")
    moved = rest.replace("joint: shoulder", "joint: dip").partition("\n")[2]
    robot = parse_robot(f"{head}{COUPLED}{moved}")
    assert [joint.name for joint in robot.joints] == ["pip", "left", "right"]
    (arm,) = [frame for frame in robot.frames if frame.name == "arm"]
    assert (arm.joint, arm.multiplier) == ("pip", 0.7)
    assert arm.offset == pytest.approx(np.radians(5.0))


def test_the_example_of_a_passive_cable_is_read():
    text = FIRST.replace("cables:\n", f"cables:\n{indent(PASSIVE, '  ')}", 1)
    (spring, *_) = prepare(parse_robot(text), check_range=False).robot.cables
    assert spring.rest_length == 0.06
    assert spring.axial_stiffness == pytest.approx(350.0 * spring.rest_length)


def test_the_example_in_space_is_a_valid_robot():
    head = FIRST.partition("frames:")[0] + "friction: {mu_c: 0.1}\n"
    model = prepare(parse_robot(head + SPACE))
    assert not model.robot.planar
    assert [pulley.kind for pulley in model.robot.cables[0].pulleys] == ["sphere", "eyelet"]


def test_the_example_of_parts_is_a_robot_with_the_cables_that_the_page_names():
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
def test_the_error_for_a_mistake_names_key_value_and_remedy(given, changed, answer):
    assert given in FIRST
    with pytest.raises(RobotFileError) as error:
        prepare(parse_robot(FIRST.replace(given, changed, 1), "one_joint.yaml"))
    message = str(error.value)
    assert message.startswith(answer), message
    assert message.endswith("(one_joint.yaml)")

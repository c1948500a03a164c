"""What the README shows must work as it stands there."""

import re
from pathlib import Path

from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import parse_robot

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()


def test_the_robot_file_of_the_readme_is_a_possible_robot() -> None:
    (text,) = re.findall(r"```yaml\n(.*?)```", README, re.DOTALL)
    model = prepare(parse_robot(text, "README.md"))
    assert model.layout.elements == ("flexor/1", "flexor/2")


def test_every_file_that_the_readme_names_is_there() -> None:
    named = re.findall(r"`((?:docs|config|bags|cdrj_ros)/[\w./]+)`|\]\(([\w./]+)\)", README)
    assert named
    for one, other in named:
        assert (ROOT / (one or other)).exists(), one or other


def test_the_two_commands_are_targets_of_the_makefile() -> None:
    makefile = (ROOT / "Makefile").read_text()
    for target in re.findall(r"^make (\w+)", README, re.MULTILINE):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target

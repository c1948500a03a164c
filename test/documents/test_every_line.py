"""Every line of bash on the pages is run by a test, or belongs to a program that is not here."""

from __future__ import annotations

import re

import pytest
from support.page_lines import ROOT, blocks

PAGES = ("README.md", "bags/README.md", *sorted(f"docs/{p.name}" for p in ROOT.glob("docs/*.md")))

SCRIPTS = "documents/test_page_scripts.py"
COMMANDS = "documents/test_page_commands.py"
TUTORIAL = "documents/test_tutorial.py"
LINES = "nodes/test_page_lines.py"
RUN_BY = {
    "README.md": "documents/test_readme.py",
    "bags/README.md": SCRIPTS,
    "docs/conditioning.md": SCRIPTS,
    "docs/controllers.md": LINES,
    "docs/health.md": "documents/test_page_tools.py",
    "docs/identification.md": COMMANDS,
    "docs/importing.md": TUTORIAL,
    "docs/install.md": LINES,
    "docs/recordings.md": f"{COMMANDS} {LINES}",
    "docs/rig.md": COMMANDS,
    "docs/rig_node.md": LINES,
    "docs/robot_file.md": TUTORIAL,
    "docs/tutorial.md": f"{TUTORIAL} {LINES}",
    "docs/uncertainty.md": COMMANDS,
    "docs/validation.md": SCRIPTS,
    "docs/view.md": LINES,
}
"""The tests that run a page's lines of our own commands and nodes."""

ELSEWHERE = {
    r"python tools/": "documents/test_page_tools.py",
    r"python examples/mujoco_bridge": "project/test_mujoco_bridge.py",
    r"pip wheel|pip install dist": "project/test_wheel.py",
    r"ros2 launch": "nodes/test_launch.py",
    r"make (demo|test)": "documents/test_readme.py",
    r"make bench|python -m bench": "documents/test_speed_page.py",
    r"python -m pytest|CDRJ_MJCF=": "documents/test_cross_references.py",
    r"eval \"\$\(register-python": "commands/test_completion.py",
}
"""Lines that other tests run, or check where they take hours."""

OTHERS = (
    r"rviz2|ros2 run plotjuggler|rosdep|git clone|pip install (mujoco|'viser)|source|colcon"
    r"|ros2 pkg executables|ros2 interface show|cd \$\(ros2 pkg|\. tools/env"
)
"""Programs that are not of this project; `make` itself builds with colcon and sources the rest."""


def lines_of(page: str) -> list[str]:
    """Lines that run something, without functions and assignments of variables."""
    text = re.sub(r"<<'END'\n.*?\nEND\n", "\n", "".join(blocks(page)), flags=re.DOTALL)
    text = re.sub(r"\\\n", " ", text)
    text = re.sub(r"^EITHER=\(.*?\)\n", "", text, flags=re.DOTALL | re.MULTILINE)
    lines = [line.strip() for line in text.splitlines()]
    return [one for one in lines if one and not re.match(r"#|[A-Z]+=|\w+\(\) ", one)]


@pytest.mark.parametrize("page", PAGES)
def test_every_line_is_run_by_a_test_or_is_another_programs(page: str) -> None:
    for line in lines_of(page):
        if re.match(OTHERS, line):
            continue
        found = [name for start, name in ELSEWHERE.items() if re.match(start, line)]
        assert found or page in RUN_BY, line
        for name in found or RUN_BY[page].split():
            test = (ROOT / "test" / name).read_text("utf-8")
            assert found or page.rpartition("/")[2] in test, (line, name)


def test_the_pages_have_such_lines() -> None:
    assert sum(len(lines_of(page)) for page in PAGES) > 100

"""Every block of every page is read: settings by their reader, commands by bash, programs run.

Further tests of this folder run what is shown: of pages with commands those of the simulated rig,
of identification, of validations, of the tutorial and of the README.
"""

import re
import subprocess

import yaml
from support.page_lines import PAGES, ROOT, blocks, fenced, shown_files, write_files

from cdrj_ros.commands.identify_task import load_settings
from cdrj_ros.evaluation.limits import parse_limits
from cdrj_ros.recordings.table import Columns
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.simulation.rig_file import parse_rig

READ_ELSEWHERE = {"README.md", "docs/robot_file.md"}
"""Pages whose YAML test_readme.py and test_robot_file_document.py read, every block of it."""


def test_bash_can_read_every_line_of_commands():
    for page in PAGES:
        for language, text in fenced(page):
            if language == "bash":
                read = subprocess.run(
                    ["bash", "-n"], input=text, text=True, capture_output=True, check=False
                )
                assert read.returncode == 0, (page, read.stderr)


def test_programs_in_python_stand_on_the_page_whose_programs_a_test_runs():
    """test_api.py and test_tables_page.py run them, test_parallel.py what recordings.md shows."""
    with_programs = {page.name for page in PAGES for kind, _ in fenced(page) if kind == "python"}
    assert with_programs == {"api.md", "recordings.md", "tables.md"}


def test_settings_of_every_page_are_taken_by_their_reader(tmp_path):
    read = {
        "docs/identification.md": lambda text: load_settings(_saved(tmp_path, text)),
        "docs/recordings.md": lambda text: parse_limits(text, "limits.yaml"),
        "docs/simulation.md": parse_rig,
        "docs/tutorial.md": lambda text: _gripper(tmp_path, text),
        "docs/estimation.md": _with_uncertainty,
        "docs/tables.md": lambda text: Columns.of(yaml.safe_load(text), "columns.yaml"),
        "docs/ros2_control.md": _prefixed,
    }
    pages = {str(page.relative_to(ROOT)) for page in PAGES}
    with_settings = {page for page in pages if blocks(page, "yaml")}
    assert with_settings == {*read, *READ_ELSEWHERE}
    for page, reader in read.items():
        for text in blocks(page, "yaml"):
            reader(text)


def _saved(folder, text):
    path = folder / "settings.yaml"
    path.write_text(text)
    return str(path)


def _gripper(folder, text):
    write_files(shown_files("docs/tutorial.md"), folder)
    parse_robot(text, str(folder / "gripper.yaml"))


def _with_uncertainty(text):
    source = ROOT / "config" / "robots" / "davinci_jaw.yaml"
    document = yaml.safe_load(source.read_text())
    document["uncertainty"] = yaml.safe_load(text)["uncertainty"]
    parse_robot(yaml.safe_dump(document), str(source))


def _prefixed(text):
    source = (ROOT / "config" / "robots" / "prototype.yaml").read_text()
    document = yaml.safe_load(source.replace("joint: elbow", "joint: left/elbow"))
    within_tables = yaml.safe_load(text.replace("[-50, 50]", "[-40, 40]"))
    robot = parse_robot(yaml.safe_dump({**document, **within_tables}))
    published = re.findall(r"# published: (\S+)", text)
    assert [axis.name for axis in (*robot.motors, *robot.joints)] == published

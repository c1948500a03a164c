"""Facts that are repeated in several files must agree."""

import re
import subprocess
import sys
from xml.etree import ElementTree

import pytest
from support.places import ROOT

import cdrj_ros

MESSAGES = ROOT / "msg_defs" / "cdrj_msgs"


def requirement_names(path):
    lines = (line for line in path.read_text().splitlines() if line and not line.startswith("#"))
    return {re.split(r"[\[<>=~! ]", line)[0].lower().replace(".", "-") for line in lines}


@pytest.mark.parametrize("folder", [ROOT, MESSAGES])
def test_both_packages_carry_the_version_of_the_library(folder):
    manifest = ElementTree.parse(folder / "package.xml").getroot()
    assert manifest.findtext("version") == cdrj_ros.__version__


@pytest.mark.parametrize("name", ["build", "ros", "runtime", "view", "dev", "mujoco"])
def test_every_requirement_is_pinned(name):
    pinned = requirement_names(ROOT / "requirements" / "constraints.txt")
    assert requirement_names(ROOT / "requirements" / f"{name}.txt") <= pinned


def test_both_messages_have_the_same_status_flags_of_one_bit_each():
    flags = [
        dict(
            re.findall(r"^uint8 (\w+)=(\d+)$", (MESSAGES / "msg" / name).read_text(), re.MULTILINE)
        )
        for name in ("CableTensions.msg", "NodalForces.msg")
    ]
    assert flags[0] == flags[1]
    assert list(flags[0].values()) == ["0", "1", "2", "4", "8", "16"]


def test_every_message_is_built():
    listed = re.findall(r"msg/\w+\.msg", (MESSAGES / "CMakeLists.txt").read_text())
    assert sorted(listed) == sorted(f"msg/{path.name}" for path in MESSAGES.glob("msg/*.msg"))


def test_a_command_handles_interrupts_before_it_imports_anything_slow():
    """Python's own traceback is printed until then."""
    program = (
        f"import sys; sys.path.insert(0, {str(ROOT)!r}); import cdrj_ros.commands.entry\n"
        "print({'pathlib', 'importlib.metadata', 'numpy'} & set(sys.modules))\n"
        "import cdrj_ros; print(cdrj_ros.__version__)\n"
    )
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", program], capture_output=True, text=True, check=True
    )
    imported, version = done.stdout.splitlines()
    assert imported == "set()"
    assert version == cdrj_ros.__version__

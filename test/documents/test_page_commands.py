"""Commands on the pages that need nothing but this repository run as printed, only shorter.

Those of README and tutorial have tests of their own; options of all others are checked in
test_cross_references.py, names on lines of `ros2` in test_ros_commands.py.
"""

import json
import re
import shlex
import subprocess

import pytest
from support.page_lines import ROOT, command_lines

from cdrj_ros.commands.check_robot import main as check_robot
from cdrj_ros.commands.identify import main as identify
from cdrj_ros.commands.simulate import main as simulate
from cdrj_ros.commands.validate import main as validate
from cdrj_ros.recordings.recording import read_recording

SHORT = ["--duration", "3", "--cells", "1"]


def lines(page, command):
    """Lines of a page that begin with a command."""
    found = command_lines(ROOT / "docs" / page)
    return [line for line in found if line.startswith(f"{command} ")]


@pytest.mark.parametrize("line", lines("simulation.md", "simulate"))
def test_simulations_of_the_page_on_the_rig_run(line, tmp_path):
    words = shlex.split(re.sub(r"@\d+:", "@2:", line), comments=True)[1:]
    assert words[0] == "OUT"
    bag = tmp_path / "OUT"
    assert simulate([str(bag), *words[1:], *SHORT]) == 0
    assert len(read_recording(bag).motors["winch"].value) > 2_000


@pytest.mark.parametrize("line", lines("estimation.md", "check_robot"))
def test_checks_of_the_page_on_uncertainty_run(line, monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    assert check_robot(shlex.split(line, comments=True)[1:]) == 0
    assert "16 elements" in capsys.readouterr().out


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """A folder with the files that the pages on recordings speak of."""
    folder = tmp_path_factory.mktemp("lab")
    robot = (ROOT / "config" / "robots" / "prototype.yaml").read_text()
    (folder / "config" / "robots").mkdir(parents=True)
    for name in ("arm.yaml", "R.yaml", "config/robots/prototype.yaml"):
        (folder / name).write_text(robot)
    page = (ROOT / "docs" / "recordings.md").read_text()
    (folder / "limits.yaml").write_text(re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)[0])
    page = (ROOT / "docs" / "identification.md").read_text()
    (folder / "settings.yaml").write_text(re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)[0])
    for name in ("recordings/one", "recordings/two", "other"):
        (folder / name).parent.mkdir(exist_ok=True)
        arguments = ["--robot", "prototype", "--duration", "4", "--cells", "1"]
        assert simulate([str(folder / name), *arguments]) == 0
    return folder


def arguments_of(line, lab):
    """The words after the command; those that stand for recordings are replaced."""
    both = [str(lab / "recordings" / name) for name in ("one", "two")]
    meant = {"BAG...": both[:1], "BAG": both[:1], "OTHER_BAG": [str(lab / "other")]}
    meant |= {"recordings/*": both, "bags/*": both}
    words = shlex.split(line, comments=True)[1:]
    return [part for word in words for part in meant.get(word, [word])]


@pytest.mark.usefixtures("short_fits", "few_members")
@pytest.mark.parametrize("line", lines("identification.md", "identify"))
def test_fits_of_the_page_on_identification_run(line, lab, monkeypatch, capsys):
    monkeypatch.chdir(lab)
    assert identify([*arguments_of(line, lab), "--quick"]) == 0
    wanted = {"--from": "reference_angle", "--residual": "fewer than 3 bags"}
    assert next((wanted[word] for word in wanted if word in line), "rho") in capsys.readouterr().out


@pytest.mark.usefixtures("few_pictures", "few_members")
@pytest.mark.parametrize("line", lines("recordings.md", "validate"))
def test_validations_of_the_pages_run(line, lab, monkeypatch, capsys):
    monkeypatch.chdir(lab)
    words = arguments_of(line, lab)
    code = validate(words)
    said = capsys.readouterr()
    assert code == (1 if "--limits" in words else 0), said.err  # a short bag has too few samples
    if "--json" in words:
        figures = json.loads((lab / words[words.index("--json") + 1]).read_text())
        assert [bag["path"] for bag in figures["bags"]] == [w for w in words if w.startswith("/")]
    if "--html" in words:
        page = (lab / words[words.index("--html") + 1]).read_text()
        assert page.count("recorded and estimated over") >= 3, "the pictures of a channel"
        assert page.count("Not drawn") > 40
        for shown in ("tension/upper/8: rec", 'class="drawing"'):
            assert shown in page
    assert ("outside the limits" if "--limits" in words else "Tension") in said.out + said.err


def test_a_joint_without_encoder_is_made_as_the_page_shows(lab, monkeypatch, capsys):
    monkeypatch.chdir(lab)
    text = (ROOT / "docs" / "validation.md").read_text()
    made = next(one for one in re.findall(r"^sed .*", text, re.MULTILINE) if "alone.yaml" in one)
    subprocess.run(made, shell=True, check=True)
    words = next(
        one for one in lines("validation.md", "validate") if "alone.yaml" in one and "bags" in one
    )
    assert validate([str(lab / "recordings" / "one"), *shlex.split(words)[2:]]) == 0
    assert "Angle" in capsys.readouterr().out

"""Whole blocks of the pages on recordings run in bash as printed, on made-up recordings.

bash expands the lines; the commands themselves run in this process, shortened: recordings of some
seconds, ensembles of eight, and fits of two steps.
"""

from __future__ import annotations

import runpy
import shutil
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.optimize
from support.page_lines import ROOT, blocks, calls

from cdrj_ros.commands.identify import main as identify
from cdrj_ros.commands.simulate import main as simulate
from cdrj_ros.commands.validate import main as validate
from cdrj_ros.estimation.estimator import initial_state, run
from cdrj_ros.estimation.samples import Samples
from cdrj_ros.model.prepared import prepare
from cdrj_ros.recordings import Topics
from cdrj_ros.recordings.writer import BagWriter
from cdrj_ros.robot.description import Pulley
from cdrj_ros.robot.parameters import with_numbers
from cdrj_ros.robot.reader import build_robot, load_document, load_robot
from cdrj_ros.simulation.faults import drums_of
from cdrj_ros.simulation.follow import follow_joints

COMMANDS: dict[str, Callable[[list[str]], int]] = {
    "simulate": simulate,
    "identify": identify,
    "validate": validate,
}
SHORT = {
    "simulate": ["--duration", "4", "--cells", "1"],
    "identify": ["--quick"],
    "validate": ["--quiet"],
}
PAGES = (
    "bags/README.md", "docs/conditioning.md", "docs/validation.md",
)  # fmt: skip
JAW_FILE = "config/robots/davinci_jaw.yaml"
RUN = "Tool_4_Maryland_L_4_"
JAW = {
    **{
        f"train/{RUN}{k}": 1.2 for k in ("00", "02", "04", "06", "08", "20", "22", "24", "26", "28")
    },
    **{f"validate/{RUN}{k}": 1.2 for k in (11, 15, 19, 31, 35)},
    f"validate/{RUN}39": 9.0,
}
"""Made-up recordings of the jaw, and their durations [s]."""
FURTHER = sorted({f"{k:02}" for k in range(50)} - {path[-2:] for path in JAW})
POSES = {f"other_wrist_pose/Tool_4_Maryland_L_Pitch_3_00{k}": 1.2 for k in range(4)}
DAY = "2024-11-15-"
WIRES = {
    f"train/{DAY}{k}": 1.2
    for k in (
        "09-23-39_sinewave_all", "10-55-14_sinewave_random", "10-57-45_-60", "10-58-56_-50",
        "11-00-38_-40", "11-05-21_-20", "11-10-18_0", "11-14-56_+20", "11-15-57_+40",
        "11-16-51_+60", "11-19-07_no_payload",
    )
} | {f"test/{DAY}11-20-13_testset_dynamic": 1.2}  # fmt: skip
START_NS = 1_700_000_000_000_000_000
RATE = 100.0


def elsewhere(words: list[str]) -> bool:
    """Whether a command fetches or converts recordings, or draws the fetched ones.

    test_convert_continuum.py and test_convert_davinci.py convert some.
    """
    return words[0] == "git" or words[1:2] in (
        ["tools/convert_continuum.py"], ["tools/continuum_figures.py"],
        ["tools/convert_davinci.py"],
    )  # fmt: skip


def record(path: Path, numbers: dict[str, Any], name: str, seconds: float, phase: float) -> None:
    """Write what a robot's own model computes from joints and motors that swing."""
    document, source = load_document(ROOT / "config" / "robots" / f"{name}.yaml")
    model = prepare(build_robot(with_numbers(document, numbers), source))
    robot, layout = model.robot, model.layout
    time = np.arange(0.0, seconds, 1.0 / RATE)
    ends = np.array([(joint.lower, joint.upper) for joint in robot.joints])
    joint = ends.mean(axis=1) + np.outer(np.sin(4.0 * time + phase), 0.2 * np.ptp(ends, axis=1))
    drums = {motor: np.sign(radius) for _, _, motor, radius in drums_of(robot)}
    wound = 0.2 + 0.3 * np.outer(np.sin(3.0 * time), [drums[k] for k in range(len(robot.motors))])
    motor = follow_joints(model, joint).motor_angle + wound
    stamps = START_NS + np.round(1e9 * time).astype(np.int64)
    values = run(model, initial_state(model), Samples(stamps, motor, joint))[1].values
    topics = Topics()
    with BagWriter(path) as bag:
        bag.write_joint_states(topics.motors, stamps, layout.motors, motor)
        late_ns = robot.joints[0].sensor.clock_offset_ns
        bag.write_joint_states(topics.joints, stamps - late_ns, layout.joints, joint)
        if name == "continuum":
            first = [k for k, one in enumerate(layout.elements) if one.endswith("/1")]
            tension = values[:, layout.tension][:, first]
            bag.write_tensions(
                "/reference/tensions", stamps, [layout.elements[k] for k in first], tension
            )
        else:
            effort = values[:, layout.motor_effort.start : layout.joint_effort.stop]
            bag.write_joint_states(
                "/reference/efforts", stamps, (*layout.motors, *layout.joints), effort=effort
            )


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the shipped robot files and all recordings that the pages speak of."""
    folder = tmp_path_factory.mktemp("lab")
    (folder / "bags").symlink_to(ROOT / "bags")
    (folder / "config").symlink_to(ROOT / "config")
    (folder / "tools").symlink_to(ROOT / "tools")
    other = {
        "joints.jaw.range.1": 1.3,
        "joints.jaw.range.2": 2.6,
        "joints.jaw.reference_angle": 2.1,
    }
    for group, root, name, numbers in (
        (JAW, "DATA", "davinci_jaw", {}),
        (POSES, "DATA", "davinci_jaw", other),
        (WIRES, "BAGS", "continuum", {}),
    ):
        for k, (path, seconds) in enumerate(group.items()):
            (folder / root / path).parent.mkdir(parents=True, exist_ok=True)
            record(folder / root / path, numbers, name, seconds, 0.3 * k)
    (folder / "ALL").mkdir()
    for k in FURTHER:
        (folder / "ALL" / f"{RUN}{k}").symlink_to(folder / "DATA" / "validate" / f"{RUN}11")
    for k, path in enumerate(POSES):
        for frequency, of in (("0", path), ("1", f"validate/{RUN}11")):
            run = folder / "ALL" / f"Tool_4_Maryland_L_Pitch_1_0{frequency}{k}"
            run.symlink_to(folder / "DATA" / of)
    return folder


class BeganError(Exception):
    """A fit has computed its first residuals."""


def shortened(monkeypatch: pytest.MonkeyPatch, steps: int) -> None:
    """Let fits end after some steps, or with an error when they begin."""
    solve = scipy.optimize.least_squares

    def short(*given: Any, **options: Any) -> Any:
        if steps == 0:
            raise BeganError
        return solve(*given, **(options | {"max_nfev": steps}))

    monkeypatch.setattr(scipy.optimize, "least_squares", short)


def play(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Run one command in this process; fits of many structures only as far as their first step."""
    name, *rest = words
    with monkeypatch.context() as patch:
        if name == "python":
            patch.setattr(sys, "argv", rest)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)  # means of no samples
                runpy.run_path(rest[0], run_name="__main__")
        elif name == "identify" and {"--quick", "--cross-validate"} & set(rest):
            shortened(patch, 0)
            with pytest.raises(BeganError):
                identify(rest)
            if "--out" in rest:  # a later line may use it
                source = "--from" if "--from" in rest else "--robot"
                shutil.copyfile(*(rest[rest.index(name) + 1] for name in (source, "--out")))
        else:
            shortened(patch, 2)
            if name == "simulate":
                shutil.rmtree(rest[0], ignore_errors=True)
            whole = name == "validate" and "--duration" not in rest  # of a shipped bag
            short = [*SHORT[name], *(["--duration", "3"] if whole else [])]
            refused = rest[0].startswith("DATA/other") and rest[-1] == JAW_FILE
            code = 2 if name == "validate" and refused else 0
            assert COMMANDS[name]([*rest, *short]) == code, words


@pytest.mark.usefixtures("few_members")
@pytest.mark.parametrize("page", PAGES)
def test_the_lines_of_a_page_run(
    page: str, lab: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(lab)
    before = set(lab.glob("*.yaml"))
    found = [words for words in calls("".join(blocks(page)), lab) if not elsewhere(words)]
    assert len(found) > 1
    shipped = [path.read_text() for path in (ROOT / "config" / "robots").glob("*.yaml")]
    for made in set(lab.glob("*.yaml")) - before:
        assert made.read_text() not in shipped, f"{made.name} is a copy: its line changes nothing"
    for words in found:
        play(words, monkeypatch)
    assert "Traceback" not in capsys.readouterr().err


def test_the_line_that_adds_drag_adds_it_to_every_pulley(tmp_path: Path) -> None:
    """It replaces two things, and the page goes on with a file in which only one was found."""
    (tmp_path / "config").symlink_to(ROOT / "config")
    (block,) = (block for block in blocks("docs/validation.md") if "> drag.yaml" in block)
    calls(block, tmp_path)
    for cable in load_robot(tmp_path / "drag.yaml").cables:
        assert {one.bearing_torque for one in cable.nodes if isinstance(one, Pulley)} == {0.002}

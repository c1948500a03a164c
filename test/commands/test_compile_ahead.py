"""Kernels compiled ahead of use: estimating and simulating compile nothing afterwards."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import pytest

from cdrj_ros.commands import compile_ahead
from cdrj_ros.commands.compile_ahead import PARTS
from cdrj_ros.commands.parts import OUTERMOST

ROOT = Path(__file__).parents[2]

# names what is compiled, kernels and what numba compiles for them alike
COUNTING = """
from numba.core import event

class Names(event.Listener):
    def on_start(self, event):
        print("compiled:", event.data["dispatcher"].py_func.__qualname__)

    def on_end(self, event):
        pass

event.register("numba:compile", Names())
"""

USING = """
import numpy as np
from cdrj_ros.conditioning.samples import Samples
from cdrj_ros.estimation.ensemble import Spread
from cdrj_ros.estimation.estimator import initial_state, run
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.model.loading import load_model
from cdrj_ros.rig.live import LiveRig, LiveSettings
from cdrj_ros.rig.prescribed import follow

for robot in ("prototype", "parallel", "finger3d"):
    model = load_model(robot)
    joints, motors = len(model.layout.joints), len(model.layout.motors)
    stamps = 1_000_000_000 + 1_000_000 * np.arange(5)
    samples = Samples(stamps, np.zeros((5, motors)), np.zeros((5, joints)))
    live = LiveEstimator(model)
    for k in range(5):
        live.take(samples.at(k))
    run(model, initial_state(model), samples)
    Spread(model).run(initial_state(model), samples)
model = load_model("prototype")
follow(model.robot, np.arange(5) * 1e-3, np.zeros((5, 1)), cells=2)
for robot in ("prototype", "parallel", "finger3d"):
    rig = LiveRig(load_model(robot).robot, LiveSettings(cells=2))
    for _ in range(3):
        rig.step(rig.motor_angle)
print("used")
"""

LOADING = """
import sys
from cdrj_ros.commands.compile_ahead import PARTS
from cdrj_ros.commands.parts import INDEPENDENT

# those compiled without the kernels that they call come last: they must not be run afterwards
for name in sorted(PARTS, key=lambda name: name in INDEPENDENT):
    PARTS[name]()
for module in [module for name, module in sys.modules.items() if name.startswith("cdrj_ros.")]:
    for value in vars(module).values():
        if getattr(value, "overloads", None):
            print(f"{value.__module__}.{value.__name__}")
"""

RUNNING = """
import sys
from contextlib import redirect_stdout
from cdrj_ros.commands import check_robot, simulate, validate

bag, out = "bags/prototype_preload_36_26", sys.argv[1]
with redirect_stdout(sys.stderr):
    assert check_robot.main(["hoist"]) == 0
    assert simulate.main([out, "--robot", "prototype", "--duration", "0.2"]) == 0
    assert validate.main([bag, "--robot", "prototype", "--duration", "0.5"]) == 0
print("run")
"""


@pytest.fixture(scope="module")
def built() -> None:
    """Compile as a build does; where this tree has been built, this finds everything on disk."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["compile_ahead", "--missing"])
        assert compile_ahead.main() == 0


@pytest.fixture(scope="module")
def compiled_in_use(built: None, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """What the library compiles, and afterwards what the commands do, in one process."""
    bag = tmp_path_factory.mktemp("written") / "bag"
    done = subprocess.run(
        [sys.executable, "-c", COUNTING + USING + RUNNING, str(bag)],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    by_library, _, by_commands = done.stdout.partition("used\n")
    return by_library, by_commands


def test_after_a_build_nothing_is_compiled(compiled_in_use: tuple[str, str]) -> None:
    assert compiled_in_use[0] == ""


@pytest.mark.usefixtures("built")
def test_the_kernels_that_python_calls_are_all_named() -> None:
    # kernels on disk are loaded without those that they call
    done = subprocess.run(
        [sys.executable, "-c", COUNTING + LOADING],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    named = {f"cdrj_ros.{kernel}" for kernels in OUTERMOST.values() for kernel in kernels}
    assert set(OUTERMOST) == set(PARTS)
    assert set(done.stdout.splitlines()) == named


def test_only_parts_that_are_not_on_disk_are_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[list[str]] = []

    def note(parts: Iterable[str]) -> bool:
        asked.append(list(parts))
        return True

    monkeypatch.setattr(compile_ahead, "compile_together", note)
    monkeypatch.setattr(compile_ahead, "is_compiled", lambda part: part not in ("rig", "geometry"))
    for arguments in (["--missing"], ["--missing", "--start"], []):
        monkeypatch.setattr(sys, "argv", ["compile_ahead", *arguments])
        assert compile_ahead.main() == 0
    assert asked[:4] == [["geometry"], ["rig"], ["geometry"], []]
    assert sorted(asked[4] + asked[5]) == sorted(PARTS)


@pytest.mark.parametrize("changed", ["", "def loose() -> None:\n    pass\n"])
def test_a_part_is_on_disk_until_its_sources_change(tmp_path: Path, changed: str) -> None:
    folder = tmp_path / "cdrj_ros"
    shutil.copytree(ROOT / "cdrj_ros", folder)
    with (folder / "estimation" / "unsure.py").open("a", encoding="utf-8") as file:
        file.write(changed)
    program = (
        "from cdrj_ros.commands.parts import OUTERMOST, is_compiled\n"
        "print([part for part in OUTERMOST if not is_compiled(part)])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, env={**os.environ, "PYTHONPATH": ""},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.strip() == ("['members', 'recordings']" if changed else "[]")


def test_commands_compile_nothing_after_a_build(compiled_in_use: tuple[str, str]) -> None:
    assert compiled_in_use[1].splitlines() == ["run"]


def test_the_hook_that_counts_sees_a_compilation(tmp_path: Path) -> None:
    program = "from cdrj_ros.model.friction import stribeck_share\n" + "stribeck_share(0.1, 1.0)\n"
    done = subprocess.run(
        [sys.executable, "-c", COUNTING + program],
        cwd=ROOT, env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.splitlines() == ["compiled: stribeck_share"]


STANDING_IN = """
import sys
from pathlib import Path
Path(__file__).with_name("compiled here").write_text(sys.executable)
sys.exit({code})
"""


@pytest.fixture
def sources(tmp_path: Path) -> Path:
    """What setup.py needs of the sources; compiling leaves a note only."""
    folder = tmp_path / "sources"
    for name in ("setup.py", "setup.cfg", "package.xml", "requirements", "resource"):
        made = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        folder.mkdir(exist_ok=True)
        made(ROOT / name, folder / name)
    commands = folder / "cdrj_ros" / "commands"
    commands.mkdir(parents=True)
    for file in (commands.parent / "__init__.py", commands / "__init__.py"):
        file.touch()
    (commands / "compile_ahead.py").write_text(STANDING_IN.format(code=0), encoding="utf-8")
    core = commands.parent / "core" / "bind.cpp"
    core.parent.mkdir()
    core.write_text('extern "C" void* PyInit__core() { return nullptr; }\n', encoding="utf-8")
    return folder


def set_up(sources: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run setup.py, with paths like those that colcon sets."""
    prefix = sources.parent / "prefix"
    packages = prefix / "lib" / f"python3.{sys.version_info[1]}" / "site-packages"
    packages.mkdir(parents=True)
    return subprocess.run(
        [sys.executable, "-W", "ignore", "setup.py", *arguments],
        cwd=sources,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(packages), os.environ["PYTHONPATH"]])
             if "PYTHONPATH" in os.environ else str(packages)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip


# the commands that colcon runs without and with --symlink-install
INSTALL = (
    "install", "--prefix", "../prefix", "--single-version-externally-managed", "--record", "list",
)  # fmt: skip
DEVELOP = (
    "develop", "--prefix", "../prefix", "--editable", "--build-directory", "../build", "--no-deps",
)  # fmt: skip


def test_a_build_compiles_in_the_installed_package(sources: Path) -> None:
    done = set_up(sources, *INSTALL)
    assert done.returncode == 0, done.stderr
    (note,) = (sources.parent / "prefix").rglob("compiled here")
    assert note.parent.name == "commands"
    assert note.read_text(encoding="utf-8") == sys.executable


def test_a_build_with_links_compiles_beside_the_sources(sources: Path) -> None:
    done = set_up(sources, *DEVELOP)
    assert done.returncode == 0, done.stderr
    assert (sources / "cdrj_ros" / "commands" / "compiled here").exists()


def test_a_build_for_other_machines_compiles_nothing(sources: Path) -> None:
    done = set_up(sources, "install", "--root", "../root", "--record", "list")
    assert done.returncode == 0, done.stderr
    assert not list(sources.parent.rglob("compiled here"))


def test_a_build_compiles_nothing_if_the_caller_does(
    sources: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CDRJ_KERNELS", "later")
    done = set_up(sources, *INSTALL)
    assert done.returncode == 0, done.stderr
    assert not list(sources.parent.rglob("compiled here"))


def test_a_build_without_numba_succeeds_and_says_so(sources: Path) -> None:
    stand_in = sources / "cdrj_ros" / "commands" / "compile_ahead.py"
    stand_in.write_text(STANDING_IN.format(code=1), encoding="utf-8")
    done = set_up(sources, *INSTALL)
    assert done.returncode == 0, done.stderr
    assert "the kernels could not be compiled: the first start will do it" in done.stderr

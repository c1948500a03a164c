"""The wheel: built from the source archive, installed without ROS, and used."""

import os
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from dataclasses import dataclass
from pathlib import Path

import pytest
from support.places import ROOT, ROS

import cdrj_ros

COMMANDS = ("check_robot", "commission", "identify", "import_robot", "simulate", "validate", "view")
NOT_SOURCES = (
    ".git", ".venv", "build", "install", "log", "test", "bench", "docs", "__pycache__", ".*_cache",
)  # fmt: skip


@dataclass(frozen=True)
class Installation:
    """A virtual environment with the wheel and the packages of this environment, without ROS."""

    wheel: Path
    folder: Path
    elsewhere: Path
    """An empty working directory."""

    def run(self, name, *arguments):
        """Run a program with few environment variables and return what it prints."""
        done = subprocess.run(
            [self.folder / "bin" / name, *arguments], cwd=self.elsewhere, text=True, check=False,
            env={"PATH": "/usr/bin:/bin", "HOME": str(self.elsewhere)},
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout
        return done.stdout


def build(hook, sources, target):
    """Call a build hook as `python -m build` does; returns the created file."""
    program = f"import setuptools.build_meta as b; b.{hook}({str(target)!r})"
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=sources,
        env={key: value for key, value in os.environ.items() if key != "PYTHONPATH"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    (made,) = target.iterdir()
    return made


@pytest.fixture(scope="module")
def installation(tmp_path_factory):
    work = tmp_path_factory.mktemp("wheel")
    for name in ("sdist", "unpacked", "wheels", "elsewhere"):
        (work / name).mkdir()
    sources = work / "sources"
    shutil.copytree(ROOT, sources, symlinks=True, ignore=shutil.ignore_patterns(*NOT_SOURCES))
    archive = build("build_sdist", sources, work / "sdist")
    subprocess.run(["tar", "-xf", archive, "-C", work / "unpacked"], check=True)
    (unpacked,) = (work / "unpacked").iterdir()
    cores = [tree / "cdrj_ros" / "core" for tree in (unpacked, ROOT)]
    assert len({frozenset(path.name for path in core.iterdir()) for core in cores}) == 1
    if (ROOT / "build" / "core").is_dir():  # of `make setup`: what is the same is not compiled anew
        made = f"temp.{sysconfig.get_platform()}-{sys.implementation.cache_tag}"
        shutil.copytree(ROOT / "build" / "core", unpacked / "build" / made)
    wheel = build("build_wheel", unpacked, work / "wheels")

    folder = work / "venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
    paths = sysconfig.get_paths(vars={"base": str(folder), "platbase": str(folder)})
    site = Path(paths["purelib"])
    shared = (path for path in sys.path if Path(path).name in ("site-packages", "dist-packages"))
    others = [path for path in shared if not (Path(path) / "cdrj_ros").exists()]
    (site / "packages.pth").write_text("\n".join(others) + "\n")
    (site / "without_ros.pth").write_text(f"import sys; sys.modules.update(dict.fromkeys({ROS}))\n")
    subprocess.run(
        [
            sys.executable, "-m", "pip", "--disable-pip-version-check",
            "--python", folder / "bin" / "python", "install", "-q", "--no-deps", "--no-index",
            "--no-compile", wheel,
        ],
        env={key: value for key, value in os.environ.items() if key != "PYTHONPATH"},
        check=True,
    )  # fmt: skip
    return Installation(wheel, folder, work / "elsewhere")


def test_the_wheel_contains_the_commands_and_requires_what_they_import(installation):
    with zipfile.ZipFile(installation.wheel) as archive:
        names = set(archive.namelist())
        (about,) = (name for name in names if name.endswith(".dist-info/METADATA"))
        metadata = archive.read(about).decode().splitlines()
    wanted = [
        f"{line}{condition}"
        for name, condition in (
            ("runtime", ""),
            ("view", '; extra == "view"'),
            ("mujoco", '; extra == "mujoco"'),
        )
        for line in (ROOT / "requirements" / f"{name}.txt").read_text().splitlines()
        if line and not line.startswith("#")
    ]
    required = [line.partition(": ")[2] for line in metadata if line.startswith("Requires-Dist")]
    assert sorted(required) == sorted(wanted)
    assert len(wanted) >= 10
    assert {"cdrj_ros/py.typed", "cdrj_ros/_core.pyi"} <= names
    scripts = {path.name for path in (installation.folder / "bin").iterdir()}
    assert set(COMMANDS) <= scripts
    assert not {"estimator", "markers", "replay", "watch"} & scripts


def test_every_command_loads_and_prints_its_help_without_ros(installation):
    """All commands run in one process, because they share most imports."""
    program = (
        "from contextlib import suppress\n"
        "from importlib import import_module\n"
        "from importlib.metadata import distribution\n"
        "for script in sorted(distribution('cdrj_ros').entry_points, key=lambda one: one.name):\n"
        "    assert callable(script.load())\n"
        "    with suppress(SystemExit):\n"
        "        import_module('cdrj_ros.commands.' + script.name).main(['--help'])\n"
    )
    output = installation.run("python", "-c", program)
    assert [line.split()[1] for line in output.splitlines() if line.startswith("usage: ")] == [
        *COMMANDS
    ]


def test_the_installed_robots_are_found_by_name(installation):
    assert "hoist: 1 motor" in installation.run("check_robot", "hoist")


def test_the_installed_library_reads_the_sample_bag_and_knows_its_messages(installation):
    program = (
        "import cdrj_ros, sys\n"
        "from importlib.metadata import version\n"
        "from cdrj_ros.recordings.recording import read_recording\n"
        "from cdrj_ros.recordings.definitions import own_definition\n"
        "assert cdrj_ros.__file__.startswith(sys.prefix), cdrj_ros.__file__\n"
        "assert cdrj_ros.__version__ == version('cdrj_ros')\n"
        "bag = sys.prefix + '/share/cdrj_ros/bags/prototype_preload_36_26'\n"
        "print(cdrj_ros.__version__, len(read_recording(bag).references))\n"
        "print(own_definition('cdrj_msgs/msg/CableTensions').text)\n"
        "print(own_definition('cdrj_msgs/msg/NodalForces').text)\n"
    )
    output = installation.run("python", "-c", program)
    assert output.startswith(f"{cdrj_ros.__version__} 32\n")
    assert "float64[] tension" in output
    assert "float64[] slip_speed" in output

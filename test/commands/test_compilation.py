"""Commands announce a compilation before they start it."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from time import monotonic, sleep

import numpy as np
import pytest

from cdrj_ros.commands import compilation, compile_ahead
from cdrj_ros.conditioning.samples import Sample
from cdrj_ros.estimation.estimator import initial_state, step
from cdrj_ros.model.compiled import kernels_are_compiled
from cdrj_ros.model.loading import load_model, robot_path
from cdrj_ros.model.mechanism import advance
from cdrj_ros.model.shape import shape

ROOT = Path(__file__).parents[2]
PATIENCE_S = 30.0


@pytest.fixture
def on_disk(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], list[tuple[str, ...]]]:
    """Declare what is missing on disk; gives what is compiled instead, at once and afterwards."""

    class Noted(compilation.Compilation):
        def __init__(self, parts: Iterable[str], *, quiet: bool) -> None:
            super().__init__((), quiet=quiet)
            self.parts = tuple(parts)
            asked.append(self.parts)
            lacking.difference_update(self.parts)

        def runs(self) -> bool:
            return bool(self.parts)

    asked: list[tuple[str, ...]] = []
    lacking: set[str] = set()
    monkeypatch.setattr(compilation, "Compilation", Noted)
    monkeypatch.setattr(compilation, "is_compiled", lambda part: part not in lacking)

    def declare(absent: str) -> list[tuple[str, ...]]:
        lacking.clear()
        lacking.update(absent.split())
        return asked

    return declare


def test_no_notice_is_printed_if_the_kernels_are_compiled(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    on_disk: Callable[[str], list[tuple[str, ...]]],
) -> None:
    every = " ".join(compilation.OF_EVERY_START)
    for absent, words in (("", ""), (every, compilation.COMPILING + "\n")):
        asked = on_disk(absent)
        compilation.ensure_compilation("prototype")
        assert capsys.readouterr().err == words
    assert asked == [compilation.OF_EVERY_START]
    monkeypatch.setattr(compilation, "kernels_can_be_kept", lambda *_: False)
    compilation.ensure_compilation(
        "prototype"
    )  # other processes could not hand over what they compile
    assert len(asked) == 1


@pytest.mark.parametrize(
    ("robot", "absent", "compiled"),
    [
        ("finger3d", "", None),
        ("finger3d", "space", ("space",)),
        ("finger3d", "step", ("step",)),
        ("finger3d", "step geometry space", ("step", "geometry", "space")),
        ("prototype", "space", None),
        ("prototype", "geometry space", ("geometry",)),
        ("/no/such.yaml", "space", None),
    ],
)
def test_commands_compile_what_is_missing_and_the_part_in_space_for_robots_that_need_it(
    robot: str,
    absent: str,
    compiled: tuple[str, ...] | None,
    on_disk: Callable[[str], list[tuple[str, ...]]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    asked = on_disk(absent)
    compilation.ensure_compilation(robot)
    assert asked == ([] if compiled is None else [compiled])
    assert capsys.readouterr().err == ("" if compiled is None else compilation.COMPILING + "\n")


def test_a_robot_whose_urdf_is_still_to_come_is_in_space(
    tmp_path: Path, on_disk: Callable[[str], list[tuple[str, ...]]]
) -> None:
    installed = robot_path("finger3d").read_text(encoding="utf-8")
    assert installed.count("urdf: finger3d.urdf") == 1
    named = installed.replace("urdf: finger3d.urdf", "urdf: robot_description")
    (tmp_path / "named.yaml").write_text(named, encoding="utf-8")
    on_disk("space")
    assert compilation.parts_of_file(str(tmp_path / "named.yaml")) == ("space",)


def _with_cache(folder: Path) -> list[int]:
    """Processes that keep their kernels in a folder."""
    found = []
    for environment in Path("/proc").glob("[0-9]*/environ"):
        with suppress(OSError):
            if f"NUMBA_CACHE_DIR={folder}".encode() in environment.read_bytes().split(b"\0"):
                found.append(int(environment.parent.name))
    return found


def test_parts_are_the_names_of_what_is_compiled() -> None:
    assert {*compilation.OF_EVERY_START, compilation.IN_SPACE} < set(compile_ahead.PARTS)


def test_a_part_that_fails_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compilation, "_PROGRAM", "import sys; sys.exit({part!r} == 'geometry')")
    assert compilation.compile_together(["step", "space"])
    assert not compilation.compile_together(["step", "geometry", "space"])


def test_where_no_process_can_be_started_this_one_compiles(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    monkeypatch.setattr(compilation, "is_compiled", lambda _: False)
    assert not compilation.compile_together(["step"])
    compilation.ensure_compilation("prototype")  # leaves it to the first use


def test_a_compilation_ends_when_it_is_told_to(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compilation, "_PROGRAM", "import sys; sys.stdin.read()  # {path} {part}")
    with compilation.Compilation(["step", "space"], quiet=True) as running:
        assert running.runs()
        running.end()
        assert not running.runs()
        assert not running.succeeds()


def test_without_compiled_kernels_the_first_line_says_so_before_the_wait(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "cdrj_ros.commands.check_robot", "prototype"],
        cwd=ROOT,
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stderr is not None
        assert process.stderr.readline() == compilation.COMPILING + "\n"
        assert not list(tmp_path.rglob("*advance-*.nbc"))  # not compiled yet
    finally:
        process.kill()
        process.communicate()
    deadline = monotonic() + PATIENCE_S
    while _with_cache(tmp_path):  # those that compile for it end with it
        assert monotonic() < deadline
        sleep(0.05)


def test_a_kernel_counts_as_compiled_once_it_is_cached() -> None:
    model = load_model("prototype")
    step(model, initial_state(model), Sample(1_000_000_000, np.zeros(1), np.zeros(1)))
    assert kernels_are_compiled(shape, advance)

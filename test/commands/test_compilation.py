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
from cdrj_ros.model.spatial_shape import shape_in_space

ROOT = Path(__file__).parents[2]
PATIENCE_S = 30.0


def test_no_notice_is_printed_if_the_kernels_are_compiled(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[Iterable[str]] = []
    monkeypatch.setattr(compilation, "compile_together", lambda parts, **_: asked.append(parts))
    for there, words in ((True, ""), (False, compilation.COMPILING + "\n")):
        monkeypatch.setattr(compilation, "kernels_are_compiled", lambda *_, there=there: there)
        compilation.ensure_compilation("prototype")
        assert capsys.readouterr().err == words
    assert asked == [compilation.OF_EVERY_START]
    monkeypatch.setattr(compilation, "kernels_can_be_kept", lambda *_: False)
    compilation.ensure_compilation(
        "prototype"
    )  # other processes could not hand over what they compile
    assert len(asked) == 1


@pytest.mark.parametrize(
    ("robot", "missing", "compiled"),
    [
        ("finger3d", "", None),
        ("finger3d", "shape_in_space", (compilation.IN_SPACE,)),
        ("finger3d", "advance", compilation.OF_EVERY_START),
        ("finger3d", "advance shape_in_space", (*compilation.OF_EVERY_START, compilation.IN_SPACE)),
        ("prototype", "shape_in_space", None),
        ("prototype", "advance shape_in_space", compilation.OF_EVERY_START),
        ("/no/such.yaml", "shape_in_space", None),
    ],
)
def test_the_kernel_in_space_is_compiled_with_the_others_for_robots_that_need_it(
    robot: str,
    missing: str,
    compiled: tuple[str, ...] | None,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def are_compiled(*kernels: Callable[..., object]) -> bool:
        return not {kernel.__name__ for kernel in kernels} & set(missing.split())

    asked: list[Iterable[str]] = []
    monkeypatch.setattr(compilation, "compile_together", lambda parts, **_: asked.append(parts))
    monkeypatch.setattr(compilation, "kernels_are_compiled", are_compiled)
    compilation.ensure_compilation(robot)
    assert asked == ([] if compiled is None else [compiled])
    assert capsys.readouterr().err == ("" if compiled is None else compilation.COMPILING + "\n")


def test_a_robot_whose_urdf_is_still_to_come_is_in_space(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    installed = robot_path("finger3d").read_text(encoding="utf-8")
    assert installed.count("urdf: finger3d.urdf") == 1
    named = installed.replace("urdf: finger3d.urdf", "urdf: robot_description")
    (tmp_path / "named.yaml").write_text(named, encoding="utf-8")
    monkeypatch.setattr(compilation, "kernels_are_compiled", lambda *_: False)
    assert compilation.kernels_of_file(str(tmp_path / "named.yaml")) == (shape_in_space,)


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
    assert compilation.compile_together(["step", "members"])
    assert not compilation.compile_together(["step", "geometry", "members"])


def test_where_no_process_can_be_started_this_one_compiles(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    monkeypatch.setattr(compilation, "kernels_are_compiled", lambda *_: False)
    assert not compilation.compile_together(["step"])
    compilation.compile_for_start()  # leaves it to the first use


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

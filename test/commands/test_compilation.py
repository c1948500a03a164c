"""Commands announce a compilation before they start it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.commands import compilation
from cdrj_ros.conditioning.samples import Sample
from cdrj_ros.estimation.estimator import initial_state, step
from cdrj_ros.model.compiled import kernels_are_compiled
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.mechanism import advance
from cdrj_ros.model.shape import shape

ROOT = Path(__file__).parents[2]


def test_no_notice_is_printed_if_the_kernels_are_compiled(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for there, words in ((True, ""), (False, compilation.COMPILING + "\n")):
        monkeypatch.setattr(compilation, "kernels_are_compiled", lambda *_, there=there: there)
        compilation.announce_compilation()
        assert capsys.readouterr().err == words


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


def test_a_kernel_counts_as_compiled_once_it_is_cached() -> None:
    model = load_model("prototype")
    step(model, initial_state(model), Sample(1_000_000_000, np.zeros(1), np.zeros(1)))
    assert kernels_are_compiled(shape, advance)

"""The cache of compiled kernels follows every source of the model, not only a kernel's own file."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import cdrj_ros.model
from cdrj_ros.model.compiled import source_digest

MODEL = Path(cdrj_ros.model.__file__).parent

# (37) in friction.py, called by a kernel of mechanism.py
PROGRAM = """
import numpy as np
from cdrj_ros.model import cable, mechanism, packing

plan = np.zeros(packing.HEADER + 2, dtype=np.int64)
plan[packing.PULLEYS] = 1
plan[packing.AT_PULLEYS] = packing.HEADER
numbers = np.zeros(cable.PULLEY_COLUMNS)
numbers[[cable.RHO, cable.MU_C, cable.MU_S, cable.STRIBECK_SPEED, cable.CELLS]] = 1, 0.1, 0.1, 1, 1
work = np.zeros((1, cable.WORK_COLUMNS))
mechanism.friction_losses(plan, numbers, np.ones(1), np.zeros(1), work)
stats = mechanism.friction_losses.stats
print(work[0, cable.LOSS], sum(stats.cache_hits.values()), sum(stats.cache_misses.values()))
"""


def run_copy(folder: Path) -> tuple[float, int, int]:
    """Loss at a pulley, kernels found in the cache, kernels compiled."""
    environment = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("NUMBA_", "PYTHONDONTWRITE"))
    }
    environment["PYTHONPATH"] = str(folder)
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    loss, hits, misses = done.stdout.split()
    return float(loss), int(hits), int(misses)


def test_a_change_in_one_source_reaches_kernels_of_other_sources(tmp_path: Path) -> None:
    copy = tmp_path / "cdrj_ros" / "model"
    shutil.copytree(MODEL, copy, ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "cdrj_ros" / "__init__.py").touch()
    friction = copy / "friction.py"

    loss, hits, misses = run_copy(tmp_path)
    assert loss == pytest.approx(0.0951625819640404)  # 1 - exp(-0.1)
    assert (hits, misses) == (0, 1)
    assert run_copy(tmp_path) == (loss, 1, 0), "the second time it comes from the cache"

    text = friction.read_text(encoding="utf-8")
    old = "return exp(-mu * wrap_angle)"
    assert text.count(old) == 1
    friction.write_text(text.replace(old, "return exp(-2.0 * mu * wrap_angle)"), encoding="utf-8")
    changed, hits, _ = run_copy(tmp_path)
    assert changed == pytest.approx(0.1812692469220182)  # 1 - exp(-0.2)
    assert hits == 0


def test_the_stamp_covers_every_source_and_those_named(tmp_path: Path) -> None:
    stamp = source_digest()
    assert source_digest() == stamp
    assert source_digest(MODEL / "friction.py") == stamp, "it is among them already"
    more = tmp_path / "kernel.py"
    more.write_text("x = 1\n", encoding="utf-8")
    first = source_digest(more)
    assert first != stamp
    more.write_text("x = 2\n", encoding="utf-8")
    assert source_digest(more) not in (first, stamp)

"""The standard deviations of the tutorial's table are those that a reader gets."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from support.page_lines import ROOT, shown_files, write_files

import cdrj_ros as cdrj

SHOWN = dict(
    re.findall(r"^\| (the start|`tare`|`set_preload`).*?\| 5\.0 ± ([\d.]+) \|",
               (ROOT / "docs" / "tutorial.md").read_text(), re.MULTILINE)
)  # fmt: skip


def largest_at_rest(estimator: cdrj.Estimator, begin_s: int) -> float:
    """Largest standard deviation after four seconds at rest in the reference pose [N]."""
    for k in range(400):
        stamp_ns = begin_s * 10**9 + k * 10**7
        estimate = estimator.update(stamp_ns, [0.0], [0.0, 0.0])
    assert estimate is not None
    return max(estimate.tension_stddevs.values())


def test_the_table_of_the_tutorial_shows_what_the_estimator_gives(tmp_path: Path) -> None:
    write_files(shown_files("docs/tutorial.md"), tmp_path)
    estimator = cdrj.Estimator(cdrj.load(tmp_path / "gripper.yaml"))
    found = {"the start": largest_at_rest(estimator, 100)}
    estimator.tare()
    found["`tare`"] = largest_at_rest(estimator, 200)
    estimator.set_preload({"flexor": 5.0})
    found["`set_preload`"] = largest_at_rest(estimator, 300)
    assert {name: float(value) for name, value in SHOWN.items()} == pytest.approx(found, rel=0.05)

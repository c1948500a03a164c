"""A recording of a finger, compared by a file in which two names stand for each other's axis."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.places import ROBOTS

import cdrj_ros as cdrj
from cdrj_ros.commands import simulate


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("finger") / "bag"
    assert simulate.main([str(path), "--robot", "finger", "--duration", "8", "--cells", "1"]) == 0
    return path


@pytest.mark.parametrize(("one", "other"), [("mcp", "pip"), ("deep_motor", "extensor_motor")])
def test_the_first_note_names_the_swap(bag: Path, tmp_path: Path, one: str, other: str) -> None:
    text = (ROBOTS / "finger.yaml").read_text("utf-8")
    swapped = tmp_path / "swapped.yaml"
    swapped.write_text(text.replace(one, "?").replace(other, one).replace("?", other), "utf-8")
    (compared,) = cdrj.validate(swapped, bag, uncertainty=False).bags
    words = [f"{a} and {b} seem to be swapped" for a, b in ((one, other), (other, one))]
    assert any(word in compared.notes[0] for word in words)
    assert not any("its preload is" in note for note in compared.notes), "it is not the reason"
    (right,) = cdrj.validate("finger", bag, uncertainty=False).bags
    assert not any(note.startswith("Readings do not fit") for note in right.notes)

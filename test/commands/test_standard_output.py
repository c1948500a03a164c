"""Commands in a process of their own, whose standard output nobody reads."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from cdrj_ros.commands import simulate
from cdrj_ros.robot.reader import load_robot


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bags") / "bag"
    assert simulate.main([str(folder), "--robot", "prototype", "--duration", "2"]) == 0
    return folder


@pytest.fixture(params=["a pipe without a reader", "closed"])
def output(request: pytest.FixtureRequest) -> Iterator[int | None]:
    """A descriptor that nothing can be written to; None for none at all."""
    if request.param == "closed":
        yield None
        return
    reading, writing = os.pipe()
    os.close(reading)
    yield writing
    os.close(writing)


def test_identify_writes_its_files_whatever_becomes_of_standard_output(
    bag: Path, tmp_path: Path, output: int | None
) -> None:
    """As ``identify … | true`` and ``identify … >&-`` do."""
    robot, figures = tmp_path / "new.yaml", tmp_path / "new.json"
    module = [sys.executable, "-m", "cdrj_ros.commands.identify", str(bag)]
    options = ["--robot", "prototype", "--fit", "friction.rho", "--quick"]
    written = ["--out", str(robot), "--json", str(figures)]
    command = [*module, *options, *written]
    if output is None:
        command = ["sh", "-c", 'exec "$@" >&-', "sh", *command]
    ended = subprocess.run(
        command, stdout=output, stderr=subprocess.PIPE, text=True, check=False,
        env={**os.environ, "PYTHONIOENCODING": "ascii", "PYTHONUNBUFFERED": ""},
    )  # fmt: skip
    assert ended.returncode == 0, ended.stderr
    assert "Traceback" not in ended.stderr
    assert load_robot(robot).uncertainty is not None
    assert json.loads(figures.read_text())["parameters"]

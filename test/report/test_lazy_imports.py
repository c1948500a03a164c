"""Imports: what is slow to import is imported only where it is used."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.fixture(scope="module")
def imported() -> list[list[str]]:
    """What is slow of the imports of the report, and after these of validate, in one process."""
    code = (
        "import sys; "
        "from cdrj_ros.report import html, pictures, results_json, scene, table, verdict; "
        "print(*sorted({'matplotlib', 'rich', 'rclpy'} & set(sys.modules))); "
        "import cdrj_ros.commands.validate; "
        "print(*sorted({'rosbags', 'mcap.writer', 'rich', 'matplotlib'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    return [line.split() for line in done.stdout.splitlines()]


def test_matplotlib_and_rich_are_imported_only_where_something_is_drawn(
    imported: list[list[str]],
) -> None:
    assert imported[0] == []


def test_validate_imports_nothing_that_only_writing_a_bag_needs(imported: list[list[str]]) -> None:
    assert imported[1] == []


def test_the_estimator_node_imports_nothing_that_it_does_not_need() -> None:
    """Nothing of recordings, and no libraries for other work."""
    code = (
        "import sys, cdrj_ros.nodes.estimator; "
        "from cdrj_ros.model.loading import load_model; load_model('prototype'); "
        "slow = {'matplotlib', 'rich', 'jinja2', 'rosbags', 'mcap', 'lz4', 'zstandard'}; "
        "slow |= {'ruamel.yaml', 'scipy.interpolate', 'scipy.optimize', 'scipy.signal', 'sympy'}; "
        "rooms = ('recordings', 'evaluation', 'report', 'simulation'); "
        "slow |= {f'cdrj_ros.{room}' for room in rooms}; "
        "print(*sorted(slow & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.split() == []

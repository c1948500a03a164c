"""Imports: what is slow to import is imported only where it is used."""

from __future__ import annotations

import subprocess
import sys


def test_matplotlib_and_rich_are_imported_only_where_something_is_drawn() -> None:
    modules = "table, results_json, html, verdict, series"
    code = (
        f"import sys; from cdrj_ros.report import {modules}; "
        "assert not {'matplotlib', 'rich', 'rclpy'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_validate_imports_nothing_that_only_writing_a_bag_needs() -> None:
    code = (
        "import sys, cdrj_ros.commands.validate; "
        "print(*sorted({'rosbags', 'mcap.writer', 'rich', 'matplotlib'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.split() == []


def test_the_estimator_node_imports_nothing_that_only_recordings_need() -> None:
    code = (
        "import sys, cdrj_ros.nodes.estimator_command; "
        "from cdrj_ros.model.loading import load_model; load_model('prototype'); "
        "slow = {'matplotlib', 'rich', 'jinja2', 'rosbags', 'mcap', 'lz4', 'zstandard'}; "
        "slow |= {'scipy.interpolate', 'scipy.optimize', 'scipy.signal', 'sympy'}; "
        "slow |= {f'cdrj_ros.{room}' for room in ('bag', 'judgement', 'report', 'rig', 'replay')}; "
        "print(*sorted(slow & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.split() == []

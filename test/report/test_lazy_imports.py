"""Imports of commands that draw nothing."""

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

"""The first line of a node's log."""

from __future__ import annotations

import subprocess
import sys

PROGRAM = """
import os
from cdrj_ros.nodes.spinning import ros_context
from cdrj_ros.nodes import watch
from rclpy.logging import get_logger
from rclpy.impl import rcutils_logger

resolved = []
realpath = os.path.realpath

def counting(path, **options):
    resolved.append(path)
    return realpath(path, **options)

with ros_context(["test"]):
    os.path.realpath = counting
    code = compile('get_logger("test").info("hello")', watch.__file__, "exec")
    exec(code, globals())
print(len(resolved))
"""


def test_the_first_log_line_does_not_search_all_modules_for_its_caller() -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], check=True, capture_output=True, text=True
    )
    assert "hello" in done.stderr
    assert int(done.stdout) < 20

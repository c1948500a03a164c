"""The example that reads tensions uses reliable tensions and refuses all others."""

import signal
import subprocess
import sys
import time

from cdrj_msgs.msg import CableTensions
from support.places import ROOT

PATIENCE_S = 60.0


def test_it_uses_reliable_tensions_and_refuses_all_others(node, tmp_path):
    publisher = node.create_publisher(CableTensions, "/cdrj/tensions", 10)
    log = tmp_path / "log"
    with log.open("wb") as stream:
        process = subprocess.Popen(
            [sys.executable, ROOT / "examples" / "read_tensions.py"], stdout=stream, stderr=stream
        )
    sure = CableTensions(
        name=["upper/1", "lower/1"], tension=[40.0, 39.0], stddev=[1.5, 3.0], status=[0, 1]
    )
    unsure = CableTensions(name=sure.name, tension=sure.tension, stddev=sure.stddev, status=[0, 4])
    plain = CableTensions(name=sure.name, tension=sure.tension, status=[0, 0])

    def says(text, message):
        deadline = time.monotonic() + PATIENCE_S
        begin = len(log.read_text())
        while text not in log.read_text()[begin:]:
            assert process.poll() is None, log.read_text()
            assert time.monotonic() < deadline, log.read_text()
            if message is not None:
                publisher.publish(message)
            time.sleep(0.01)

    try:
        says("lower/1: 45.00 N", sure)  # slack is no reason to refuse
        says("refused: lower/1", unsure)
        says("refused: no standard deviations", plain)
        says("refused: nothing for 0.5 s", None)
        says("lower/1: 45.00 N", sure)
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 0
    finally:
        process.kill()
        process.wait()
    assert "Traceback" not in log.read_text()

"""Isolate the ROS traffic of the tests.

The environment is set before rclpy is imported, and processes started by tests inherit it: every
run and, under pytest-xdist, every worker has its own ROS domain, and discovery is limited to this
machine, so parallel runs do not receive each other's messages. NumPy calculates in one thread, as
in every command; workers beside each other would otherwise wait for each other's processors.
Hypothesis has no deadline, because the duration of an example depends on the load of the machine.

Python's garbage collector looks at every object again and again, most of which are modules and
tests: it waits until these are loaded, leaves them out, and runs less often afterwards.
"""

import gc
import os
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import HealthCheck, settings

from cdrj_ros.foundation.interruption import BLAS_THREADS

if TYPE_CHECKING:
    pass

DOMAINS = 101
"""Domains 1 to 101; Linux may give the ports of higher domains to any program."""


def _domain():
    """Domain of this worker; runs that are started at the same time have different domains."""
    worker = os.environ.get("PYTEST_XDIST_WORKER", "")
    run = os.getppid() if worker else os.getpid()  # the workers' parent is their run
    return 1 + (8 * run + int(worker.removeprefix("gw") or 0)) % DOMAINS


gc.disable()
os.environ["ROS_DOMAIN_ID"] = str(_domain())
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ.setdefault(BLAS_THREADS, "1")
os.environ["TERM"] = "xterm"  # what the terminals are that tests open

settings.register_profile(
    "steady", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("steady")

LONGEST_FIRST = (
    "estimation/test_driver_faults.py", "estimation/test_campaign.py", "nodes/test_replay_node.py",
    "commands/test_commission_poses.py",
    "commands/test_commission.py",
    "evaluation/test_parallel.py", "estimation/test_prediction.py", "recordings/test_bombs.py",
    "nodes/test_view.py", "estimation/test_conditioner.py", "commands/test_identify.py",
    "nodes/test_watch.py", "truth/test_surfaces.py",
    "paper/test_command.py", "model/test_reference.py",
    "documents/test_readme.py", "report/test_html.py", "commands/test_simulate.py",
    "project/test_aarch64.py", "project/test_wheel.py", "project/test_controllers.py",
    "estimation/test_unseen.py", "estimation/test_session.py", "project/test_api.py",
    "evaluation/test_recorded_verdict.py",
)  # fmt: skip
"""Each takes more than 1.2 % of all tests: one started last would keep a single worker busy.  Of
three neighbours one waits for messages a good part of its time, and two calculate."""


def pytest_collection_modifyitems(items):
    """Begin with the longest files; a single process with the shortest, to fail early."""

    def rank(item):
        file = "/".join(item.path.parts[-2:])
        return LONGEST_FIRST.index(file) if file in LONGEST_FIRST else len(LONGEST_FIRST)

    items.sort(key=rank, reverse="PYTEST_XDIST_WORKER" not in os.environ)


def pytest_collection_finish():
    """Collect garbage again, but neither modules nor tests, and after 20 000 new objects."""
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)
    gc.enable()


SAMPLE = Path(__file__).parents[1] / "bags" / "prototype_preload_36_26"


@pytest.fixture(scope="session")
def recorded():
    """Angles of the sample recording, six cycles at 1.5 kHz, of which every n-th is kept."""
    from cdrj_ros.estimation.estimator import Samples
    from cdrj_ros.evaluation.inputs import condition_recording, read_inputs
    from cdrj_ros.recordings.recording import Topics

    def every(model, step):
        recording = read_inputs(str(SAMPLE), Topics(), model)
        samples = condition_recording(model, recording).segments[0]
        return Samples(*(column[::step].copy() for column in vars(samples).values()))

    return every


@pytest.fixture(scope="session", autouse=True)
def drawn_once():
    """Members of one robot are drawn once: to read 32 robot files takes 40 ms and more."""
    from cdrj_ros.estimation import encoderless, ensemble

    draw, drawn = ensemble.draw, {}

    def again(model, members, seed=0, known=None):
        unsure = known and (known.parameters, known.covariance.tobytes(), known.stated)
        key = id(model), members, seed, unsure
        if key not in drawn:
            drawn[key] = model, draw(model, members, seed, known)  # keeps the id in use
        return drawn[key][1]

    ensemble.draw = encoderless.draw = again


@pytest.fixture
def few_pictures(monkeypatch):
    """Reports have the pictures of a few channels only, where a test does not look at them.

    Drawing those of all channels of the prototype takes five seconds.
    """
    from cdrj_ros.report import html

    monkeypatch.setattr(html, "PICTURE_BUDGET", 50_000)


@pytest.fixture
def few_members(monkeypatch):
    """Ensembles have eight members, where a test does not look at standard deviations.

    Drawing the 32 of a robot whose cables have a path in space takes up to 0.3 s.
    """
    from cdrj_ros.estimation.encoderless import EncoderlessEstimator
    from cdrj_ros.estimation.ensemble import MEMBERS, Ensemble

    for kind in (Ensemble, EncoderlessEstimator):
        assert kind.__init__.__defaults__[0] == MEMBERS
        defaults = (8, *kind.__init__.__defaults__[1:])
        monkeypatch.setattr(kind.__init__, "__defaults__", defaults)


@pytest.fixture
def short_fits(monkeypatch):
    """Fits end after two steps, where a test does not look at what they find."""
    from cdrj_ros.identification import solver

    monkeypatch.setattr(solver, "MOST_STEPS", 2)

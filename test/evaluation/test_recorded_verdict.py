"""The verdict over a recording: the node's, from the sensors that a bag has."""

import json
from itertools import pairwise

import numpy as np
import pytest
from support.places import ROBOT

from cdrj_ros.commands import simulate
from cdrj_ros.commands.validate import main
from cdrj_ros.estimation.group import TICK_NS
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.evaluation.inputs import condition_recording, read_inputs
from cdrj_ros.evaluation.recorded_verdict import RecordedVerdict
from cdrj_ros.evaluation.validation import BagTask, compare_bag
from cdrj_ros.model.prepared import load_model
from cdrj_ros.recordings.recording import Topics

SECONDS = 28.0
FAST = "drives: {max_speed: 60}\n"
HEARD = """
motor_efforts: {noise: 0.01}
load_cells: {elements: [upper/8, lower/8], noise: 0.1}
"""
LOOSE = "29.48,26.26"
"""Preloads [N]; the upper cable has lost a fifth of its own."""


def simulated(folder, preload, heard=HEARD):
    """A bag of six cycles of the rig after a rest, which its sensors may hear."""
    (folder / "rig.yaml").write_text(heard + FAST)
    words = ["--robot", ROBOT, "--preload", preload, "--rig", str(folder / "rig.yaml")]
    motion = ["--duration", f"{SECONDS:g}", "--frequency", "0.25", "--amplitude", "0.6"]
    assert simulate.main([str(folder / "bag"), *words, *motion, "--cells", "1"]) == 0
    return str(folder / "bag")


@pytest.fixture(scope="module")
def loose(tmp_path_factory):
    return simulated(tmp_path_factory.mktemp("loose"), LOOSE)


@pytest.fixture(scope="module")
def unheard(tmp_path_factory):
    """As ``loose``, without efforts and load cells."""
    return simulated(tmp_path_factory.mktemp("unheard"), LOOSE, heard="")


@pytest.mark.usefixtures("few_pictures")
def test_a_lost_preload_is_named_with_its_time_in_every_output(loose, tmp_path, capsys):
    figures, page = tmp_path / "figures.json", tmp_path / "report.html"
    assert main([loose, "--robot", ROBOT, "--json", str(figures), "--html", str(page)]) == 0
    health = json.loads(figures.read_text(encoding="utf-8"))["bags"][0]["health"]
    (alarm,) = health["alarms"]
    assert alarm["message"].startswith("preload of upper has lost 7.")
    assert health["level"] == alarm["level"] == "warn"
    assert 0.0 < alarm["begin_s"] < 10.0
    assert alarm["begin_s"] < alarm["end_s"] <= SECONDS
    span = f"{alarm['begin_s']:.1f} to {alarm['end_s']:.1f} s"
    for text in (capsys.readouterr().out, page.read_text(encoding="utf-8")):
        assert alarm["message"] in text
        assert span in text


@pytest.mark.parametrize(("health", "runs"), [("auto", False), ("references", True)])
def test_references_are_compared_on_request_only(unheard, health, runs):
    found = compare_bag(BagTask(unheard, Topics(), ROBOT, health=health))
    assert (found.health is not None) is runs
    if found.health is not None:
        assert "winch" in found.health.sensors
        assert any("preload of" in one.message for one in found.health.alarms)


def test_the_verdict_does_not_depend_on_whether_coverage_is_asked_for(loose):
    """As for a file whose numbers are exact: readings have errors that are part of the verdict."""
    found = [
        compare_bag(BagTask(loose, Topics(), ROBOT, uncertainty=asked, health="auto")).health
        for asked in (False, True)
    ]
    assert found[0] is not None
    assert found[0] == found[1]


def test_the_verdict_is_that_of_an_estimator_which_hears_all(loose):
    model = load_model(ROBOT)
    recording = read_inputs(loose, Topics(), model, motor_efforts=True)
    (samples,) = condition_recording(model, recording).segments
    efforts = recording.motor_efforts
    recorded = RecordedVerdict(model, efforts, {})
    for begin in range(0, samples.stamp_ns.size, 700):  # in pieces, as in validation
        recorded.follow(samples.part(slice(begin, begin + 700)))
    live = LiveEstimator(model)
    until = np.searchsorted(efforts["winch"].stamp_ns, samples.stamp_ns, side="right")
    taken = 0
    for k, (first, last) in enumerate(pairwise((0, *until.tolist()))):
        for n in range(first, last):
            effort = efforts["winch"].value[n : n + 1]
            live.feed_efforts(int(efforts["winch"].stamp_ns[n]), ("winch",), effort)
        if samples.stamp_ns[k] - taken >= TICK_NS:
            taken = int(samples.stamp_ns[k])
            live.take(samples.alone(k))
    assert recorded.verdict().alarms
    assert recorded.verdict().message == live.corrections.report().message
    assert recorded.verdict().values == live.corrections.report().values

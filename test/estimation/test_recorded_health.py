"""The health monitor over a recording: the node's verdict, from the sensors that a bag has."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.commands.validate import main
from cdrj_ros.estimation.estimator import initial_state, run
from cdrj_ros.estimation.health_monitor import HealthMonitor
from cdrj_ros.estimation.recorded_health import RecordedHealth
from cdrj_ros.estimation.samples import Samples
from cdrj_ros.evaluation.validation import BagTask, Health, compare_bag
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.recordings import Topics
from cdrj_ros.recordings.writer import BagWriter
from cdrj_ros.robot.description import Robot

ROBOT = str(Path(__file__).parents[2] / "config" / "robots" / "prototype.yaml")
EPOCH_NS = 1_700_000_000_000_000_000
RATE = 100.0
SECONDS = 24.0
CELLS = ("upper/8", "lower/8")


def motion() -> Samples:
    """Six cycles."""
    time = np.arange(round(SECONDS * RATE)) / RATE
    joint = 0.6 * np.sin(2.0 * np.pi * 0.25 * time)
    motor = 8.0 * np.sin(joint) + 0.08 * np.sin(1.7 * time)
    stamps = EPOCH_NS + np.round(time * 1e9).astype(np.int64)
    return Samples(stamps, motor[:, None].copy(), joint[:, None].copy())


def slackened(robot: Robot) -> Robot:
    """The upper cable has lost a fifth of its preload."""
    upper, lower = robot.cables
    return replace(robot, cables=(replace(upper, preload=0.8 * upper.preload), lower))


def readings(model: Model, robot: Robot, samples: Samples) -> np.ndarray:
    """Motor effort [N m], noise 10 mN m, and both load cells [N], noise 0.1 N, shape (n, 3)."""
    real = prepare(robot, check_range=False)
    values = run(real, initial_state(real), samples)[1].values
    names = real.layout.elements
    columns = [real.layout.motor_effort.start] + [
        real.layout.tension.start + names.index(cell) for cell in CELLS
    ]
    noise = np.random.default_rng(3).normal(size=(samples.stamp_ns.size, 3))
    return np.asarray(values[:, columns] + noise * (0.01, 0.1, 0.1))


def written(path: Path, model: Model, robot: Robot, *, heard: bool = True) -> str:
    """A bag of a robot; its effort and cells are what the node hears, or references."""
    samples = motion()
    measured = readings(model, robot, samples)
    stamps = samples.stamp_ns
    with BagWriter(path) as bag:
        bag.write_joint_states(
            "/cdrj/motor_states", stamps, ["winch"], samples.motor_angle,
            effort=measured[:, :1] if heard else None,
        )  # fmt: skip
        bag.write_joint_states("/cdrj/joint_states", stamps, ["elbow"], samples.joint_angle)
        if heard:
            bag.write_tensions("/cdrj/tension_sensors", stamps, CELLS, measured[:, 1:])
        bag.write_joint_states("/reference/efforts", stamps, ["winch"], effort=measured[:, :1])
    return str(path)


@pytest.fixture(scope="module")
def sound(model: Model, tmp_path_factory: pytest.TempPathFactory) -> str:
    return written(tmp_path_factory.mktemp("bags") / "sound", model, model.robot)


@pytest.fixture(scope="module")
def loose(model: Model, tmp_path_factory: pytest.TempPathFactory) -> str:
    return written(tmp_path_factory.mktemp("bags") / "loose", model, slackened(model.robot))


def test_a_sound_robot_raises_no_alarm(sound: str) -> None:
    found = compare_bag(BagTask(sound, Topics(), ROBOT, health="auto"))
    assert found.health is not None
    assert found.health.level == "ok"
    assert not found.health.alarms
    assert found.health.cycles >= 4
    assert found.health.sensors == ("winch", *CELLS)


def test_a_lost_preload_is_named_with_its_cycles_in_every_output(
    loose: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    figures, page = tmp_path / "figures.json", tmp_path / "report.html"
    assert main([loose, "--robot", ROBOT, "--json", str(figures), "--html", str(page)]) == 0
    health = json.loads(figures.read_text(encoding="utf-8"))["bags"][0]["health"]
    (alarm,) = health["alarms"]
    assert alarm["message"].startswith("preload of upper has lost 7.")
    assert health["level"] == alarm["level"] == "warn"
    assert 1 <= alarm["first_cycle"] <= 3
    assert alarm["last_cycle"] == health["cycles"] >= 4
    assert 0.0 < alarm["begin_s"] < alarm["end_s"] <= SECONDS
    cycles = f"cycles {alarm['first_cycle']} to {alarm['last_cycle']}"
    for text in (capsys.readouterr().out, page.read_text(encoding="utf-8")):
        assert alarm["message"] in text
        assert cycles in text


@pytest.mark.parametrize(
    ("health", "runs"), [("off", False), ("auto", False), ("references", True)]
)
def test_references_are_compared_on_request_only(
    model: Model, tmp_path: Path, health: Health, runs: bool
) -> None:
    bag = written(tmp_path / "bag", model, slackened(model.robot), heard=False)
    found = compare_bag(BagTask(bag, Topics(), ROBOT, health=health))
    assert (found.health is not None) is runs
    if found.health is not None:
        assert found.health.sensors == ("winch",)
        assert any("preload of" in one.message for one in found.health.alarms)


def test_the_verdict_is_that_of_the_node_which_passes_on_every_sample(model: Model) -> None:
    samples = motion()
    measured = readings(model, slackened(model.robot), samples)
    efforts = {"winch": Series(samples.stamp_ns, samples.stamp_ns, measured[:, 0].copy())}
    recorded = RecordedHealth(model, ["winch"])
    recorded.begin_pass(efforts, {})
    for begin in range(0, samples.stamp_ns.size, 700):  # in pieces, as in validation
        recorded.follow(samples.part(slice(begin, begin + 700)), None)
    live = HealthMonitor(model, model.robot.uncertainty)
    live.prepare()
    for k in range(samples.stamp_ns.size):
        live.read_efforts(int(samples.stamp_ns[k]), ("winch",), (measured[k, 0],))
        live.follow(samples.at(k))
    verdict, report = recorded.verdict(), live.report()
    assert verdict.alarms
    assert verdict.cycles == live.cycles
    assert verdict.message == report.message
    assert verdict.values == report.values

"""Whether cable slips on its drums: truths that hold or forget, and recordings that do not tell."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import yaml
from support.made_up import recording
from support.places import PROTOTYPE

from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.identification.alternatives import Misfit, finding
from cdrj_ros.identification.entries import fitted_numbers, uncertainty_section
from cdrj_ros.identification.fit import identify
from cdrj_ros.identification.problem import Settings
from cdrj_ros.identification.unknowns import parse_unknowns
from cdrj_ros.model.packing import channel_columns
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.parameters import with_numbers
from cdrj_ros.robot.reader import build_robot, load_document
from cdrj_ros.simulation.assembly import divide_contacts

SETTINGS = Settings(channels=("tension/*/8", "effort/*"), coarse=True, compares_drums=True)
TRUE = {"cables.upper.preload": 34.0, "cables.lower.preload": 28.0}


@pytest.fixture(scope="module")
def fresh():
    """The prototype without what is known of the accuracy of its numbers."""
    whole = load_document(PROTOTYPE)[0]
    return {key: value for key, value in whole.items() if key != "uncertainty"}


def samples_of(recorded):
    motor, joint = recorded.motors["winch"], recorded.joints["elbow"]
    return Samples(motor.stamp_ns, motor.value[:, None].copy(), joint.value[:, None].copy())


def with_cells(document, recorded, *, slips):
    """The recording with references of the rig, which has four contact cells per pulley."""
    fine = prepare(divide_contacts(build_robot(document, "rig"), 4))
    advance = partial(run, slipping=np.array([slips, slips]))
    values = advance(fine, initial_state(fine), samples_of(recorded))[1].values
    tension = values[:, fine.layout.tension]
    names = fine.layout.elements
    columns = {f"tension/{name}": column for name, column in zip(names, tension.T, strict=True)}
    efforts = (name for name in channel_columns(fine.layout) if name.startswith("effort/"))
    columns |= {name: values[:, channel_columns(fine.layout)[name]] for name in efforts}
    stamps = recorded.motors["winch"].stamp_ns
    generator = np.random.default_rng(3)
    noise = {name: 5e-4 if name.startswith("effort/") else 0.02 for name in columns}
    return replace(
        recorded,
        references={
            name: Series(stamps, stamps, column + generator.normal(0.0, noise[name], stamps.size))
            for name, column in columns.items()
        },
    )


def judged(document, *, slips, seconds=8.0):
    """A fit of the preloads, which are wrong in the file, over cycles of 4 s."""
    real = with_numbers(document, TRUE)
    plain = recording(real, seconds, frequency=0.25)
    recorded = with_cells(real, plain, slips=slips)
    return identify(document, "test", parse_unknowns(document, "preload"), [recorded], SETTINGS)


def drums_written(found):
    text = uncertainty_section(fitted_numbers(found, {}), {"drums": "may_slip"}, {}, found.drums)
    return str(yaml.safe_load(text)["uncertainty"]["drums"])


def test_a_rig_whose_drum_holds_is_recognised(fresh):
    found = judged(fresh, slips=False)
    assert drums_written(found) == "hold"
    assert "holds on its drums" in found.findings[-1]


def test_a_rig_whose_drum_holds_no_memory_is_recognised(fresh):
    found = judged(fresh, slips=True)
    assert drums_written(found) == "may_slip"
    assert "The cable slips on its drums" in found.findings[-1]


def test_less_than_a_whole_cycle_shows_nothing(fresh):
    found = judged(fresh, slips=False, seconds=1.2)
    assert drums_written(found) == "may_slip"
    assert "whole cycle" in found.findings[-1]


def test_a_verdict_needs_residuals_and_not_the_priors_alone():
    def misfit(squares, strain):
        return Misfit(squares, np.empty(0), strain, np.zeros(1))

    strained = finding(misfit(770.0, 1.0), misfit(7.9, 71.0), 8)
    assert strained.comment == "the recordings do not decide"
    strained = finding(misfit(7.9, 71.0), misfit(770.0, 1.0), 8)
    assert strained.comment == "the recordings do not decide"
    assert finding(misfit(770.0, 1.0), misfit(7.9, 3.0), 8).drums == "hold"
    slips = finding(misfit(7.9, 3.0), misfit(770.0, 1.0), 8)
    assert slips.sentence.startswith("The cable slips")
    assert "9.9 times as large" in slips.sentence

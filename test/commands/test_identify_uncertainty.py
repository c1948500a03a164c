"""The block ``uncertainty`` that ``identify`` writes."""

from itertools import product

import numpy as np
import yaml

from cdrj_ros.identification.entries import COVARIANCE_LIMIT, fitted_numbers, uncertainty_section
from cdrj_ros.identification.fit import Identification
from cdrj_ros.identification.nuisance import nuisance_correlation
from cdrj_ros.identification.unknowns import Unknown
from cdrj_ros.robot.stated import stated_numbers

FITTED = (
    Unknown(("friction.rho",), (1,), 0.2, 0.0, 1.0, 0.1),
    Unknown(("cables.a.spans.2.slope", "cables.b.spans.2.slope"), (1, -1), 0.01, 0.0, 1.0, 0.1),
)
STDDEV = np.array([0.1, 2e-4])
CAUSES = (
    {"cables.a.preload": 2.0},
    {"cables.a.nodes.2.radius": 1e-4, "cables.a.nodes.3.radius": -2e-4},
    {"joints.elbow.reference_angle": 0.01},
)
ABSORBED = np.array([[0.06, 0.05, 1e-6], [-1e-4, 0.0, 0.0]])
"""Change of the fitted numbers by one standard deviation of each cause."""


def found(others):
    return Identification(
        FITTED, np.array([0.2, 0.01]), STDDEV, np.array([[1.0, -0.3], [-0.3, 1.0]]), (), (), 1, 1,
        0.0, 1, (False, False), others,
    )  # fmt: skip


def written(others, before):
    block = yaml.safe_load(
        uncertainty_section(fitted_numbers(found(others), before), before, {}, {})
    )
    return dict(block["uncertainty"])


def covariance(block):
    known = stated_numbers(block)
    pairs = product(enumerate(known.paths), repeat=2)
    return {(a, b): known.covariance[i, j] for (i, a), (j, b) in pairs}


def test_what_the_fit_left_alone_is_written_with_its_covariance():
    stated = {"parameters": ["cables.a.preload"], "stddev": [2.0]}
    block = written(nuisance_correlation(CAUSES, ABSORBED, STDDEV), stated)
    radii = ["cables.a.nodes.2.radius", "cables.a.nodes.3.radius"]
    assert block["parameters"] == [
        "friction.rho", "cables.a.spans.2.slope", "cables.b.spans.2.slope", "cables.a.preload",
        *radii,
    ], "fitted, kept, and those of the others on which the fit depends"  # fmt: skip
    got = covariance(block)
    assert np.isclose(got["friction.rho", "cables.a.preload"], 0.06 * 2.0, rtol=1e-3)
    assert np.isclose(got["friction.rho", radii[0]], 0.05 * 1e-4, rtol=1e-3)
    assert np.isclose(got["friction.rho", radii[1]], -0.05 * 2e-4, rtol=1e-3)
    assert np.isclose(got[radii[0], radii[1]], -2e-8, rtol=1e-3)
    assert np.isclose(got["cables.a.spans.2.slope", "cables.a.preload"], -2e-4, rtol=1e-3)
    assert np.isclose(got["cables.b.spans.2.slope", "cables.a.preload"], 2e-4, rtol=1e-3), "sign"
    assert got["cables.a.preload", radii[0]] == 0.0
    assert [len(row) for row in block["correlation"]] == [1, 2, 3, 4, 5, 6]


def test_numbers_that_deviate_together_are_taken_whole_or_not_at_all():
    many = {f"cables.a.nodes.{k}.radius": 1e-4 for k in range(2, 2 + COVARIANCE_LIMIT - 3)}
    causes = (many, {"cables.a.preload": 2.0})
    others = nuisance_correlation(causes, np.array([[0.06, 0.05], [0.0, 0.0]]), STDDEV)
    assert len(written(others, {})["parameters"]) == COVARIANCE_LIMIT
    more = ({**many, "cables.a.nodes.999.radius": 1e-4}, causes[1])
    others = nuisance_correlation(more, np.array([[0.06, 0.05], [0.0, 0.0]]), STDDEV)
    assert written(others, {})["parameters"][3:] == ["cables.a.preload"]


def test_without_inexact_others_only_the_fit_and_what_was_stated_is_written():
    stated = {"parameters": ["friction.rho", "cables.a.preload"], "stddev": [0.3, 2.0]}
    for others in (None, nuisance_correlation((), np.empty((2, 0)), STDDEV)):
        block = written(others, {**stated, "others": "exact"})
        assert block["others"] == "exact"
        assert block["parameters"][3:] == ["cables.a.preload"]
        assert block["stddev"] == [0.1, 2e-4, 2e-4, 2.0]
        assert block["correlation"][3] == [0.0, 0.0, 0.0, 1.0]

"""Residuals in chunks and in parallel: the same bits as at once, and no run twice."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from support.fingers import finger, hand
from support.fingers import recorded as motion_of
from support.places import PROTOTYPE

from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.identification import problem as module
from cdrj_ros.identification.observations import Extent, Recorded, noise_of, observe, samples_of
from cdrj_ros.identification.priors import unknown_causes
from cdrj_ros.identification.problem import Problem, residuals_of_one
from cdrj_ros.identification.solver import STEP, jacobian
from cdrj_ros.identification.unknowns import parse_unknowns, values_by_path
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.document import document_complaints
from cdrj_ros.robot.parameters import with_numbers
from cdrj_ros.robot.reader import build_robot, load_document

SIGMAS = {"tension/upper/8": 2.0, "tension/lower/8": 3.0, "effort/elbow": 0.1}


@pytest.fixture(scope="module")
def document():
    return load_document(PROTOTYPE)[0]


@pytest.fixture(scope="module")
def model(document):
    return prepare(build_robot(document, "test"))


@pytest.fixture(scope="module")
def recorded():
    """3 s, with tensions at stamps of their own and efforts at those of the joint."""
    stamps = 1_700_000_000_000_000_000 + np.arange(600) * 5_000_000
    time = np.arange(600) * 0.005
    motor, joint = 4.0 * np.sin(time), 0.4 * np.sin(time)
    own = stamps[3:-3:4] + 1_234_567
    generator = np.random.default_rng(3)
    tension = 30.0 + generator.normal(0.0, 1.0, own.size)
    return Recorded(
        "made up",
        {"winch": Series(stamps, stamps, motor)},
        {"elbow": Series(stamps, stamps, joint)},
        {
            "tension/upper/8": Series(own, own, tension),
            "tension/lower/8": Series(own, own, tension + 1.0),
            "effort/elbow": Series(stamps, stamps, generator.normal(0.0, 0.1, stamps.size)),
        },
    )


def observed(model, recorded, mean_s=0.0, *, moving=False):
    extent = Extent(mean_s=mean_s)
    return observe(model, recorded, samples_of(model, recorded), SIGMAS, extent, moving=moving)


@pytest.mark.parametrize("chunk", [1, 7, 599, 600, 10_000])
def test_residuals_are_those_of_one_run_whatever_the_chunk(model, recorded, monkeypatch, chunk):
    samples = samples_of(model, recorded)
    whole = Samples(samples.stamp_ns, samples.motor_angle, samples.joint_angle)
    _, estimates = run(model, initial_state(model), whole)
    monkeypatch.setattr(module, "CHUNK", chunk)
    one = observed(model, recorded)
    found = residuals_of_one(model, one)
    np.testing.assert_array_equal(
        found, residuals_of_one(model, observed(model, recorded, moving=True))
    )
    at = 0
    for channel in one.channels:
        wanted = np.interp(
            (channel.stamp_ns - samples.stamp_ns[0]).astype(float),
            (samples.stamp_ns - samples.stamp_ns[0]).astype(float),
            estimates.values[:, channel.column],
        )
        part = found[at : at + channel.reference.size]
        np.testing.assert_allclose(
            part, (wanted - channel.reference) / channel.sigma, rtol=1e-12, atol=1e-12
        )
        at += channel.reference.size
    assert at == found.size == one.size > 800


def test_no_point_is_run_twice_and_threads_do_not_change_a_bit(document, model, recorded):
    unknowns = parse_unknowns(document, "friction.rho,friction.mu_c")
    found = []
    for threads in (1, 3):
        with ThreadPoolExecutor(threads) as pool:
            fine = Problem(document, "test", unknowns, [observed(model, recorded)], pool)
            rough = Problem(document, "test", unknowns, [observed(model, recorded)], pool)
            here = np.array([0.1, -0.2])
            beside = here + np.array([STEP, 0.0])
            both = [fine.residuals(here), *rough.residuals_of([here, beside, here])]
            assert (fine.evaluations, rough.evaluations) == (1, 2)
            one_sided = jacobian(rough, here)
            assert rough.evaluations == 3, "two of its three points were known"
            both_sided = jacobian(rough, here, central=True)
            assert rough.evaluations == 5
            found.append([*both, one_sided, both_sided])
    for one, two in zip(*found, strict=True):
        np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(found[0][1], found[0][3])
    assert np.any(found[0][1] != found[0][2])


@pytest.mark.parametrize("central", [False, True])
def test_only_the_cables_of_an_unknown_are_computed_and_no_slope_changes(central):
    robot = hand(finger("a"), finger("b", cables=3))
    document, model, own = dict(robot.document), prepare(robot), motion_of(robot)
    unknowns = parse_unknowns(document, "friction.mu_c,preload,joint_offset,effort_scale")
    fitted = observe(model, own, samples_of(model, own), dict.fromkeys(own.references, 0.01),
                     Extent(), moving=False)  # fmt: skip
    with ThreadPoolExecutor(1) as pool:
        problem = Problem(document, "test", unknowns, [fitted], pool)
        cables = [cable.name for cable in robot.cables]
        for unknown, moved in zip(unknowns, problem.moved, strict=True):
            name = unknown.paths[0].split(".")[1]
            own = name.replace("mu_c", "").replace("motor", "").replace("_mcp", "")
            own = own.replace("pip", "0")  # of the first cable alone
            assert moved.tolist() == [one.startswith(own) for one in cables], unknown.name
        here = np.array([0.1 if one.name == "friction.mu_c" else 0.0 for one in unknowns])
        slopes = jacobian(problem, here, central=central)
        for k, unit in enumerate(np.eye(here.size)):
            there, back = (problem.residuals(here + way * STEP * unit) for way in (1.0, -central))
            wanted = (there - back) / (STEP * (1.0 + central))
            np.testing.assert_allclose(
                slopes[:, k], wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max(),
                err_msg=unknowns[k].name,
            )  # fmt: skip


@pytest.mark.parametrize("key", ["rho", "mu_c", "stribeck_speed", "bristle_stiffness"])
def test_no_cause_of_error_takes_a_number_out_of_its_range(document, key):
    path = f"friction.{key}"
    value = document["friction"][key]
    (cause,) = unknown_causes(document, [{path: 0.3 * value}])
    for end in (cause.lower, cause.upper):
        changed = with_numbers(document, values_by_path([cause], [end]))
        assert 0.0 < changed["friction"][key] <= 2.5 * value
        assert not list(document_complaints(changed))


@pytest.mark.parametrize("times", [1, 2, 5])
def test_noise_is_that_of_the_sensor_however_often_a_reading_is_published(times):
    smooth = np.sin(np.linspace(0.0, 6.0, 3000))
    readings = smooth + np.random.default_rng(4).normal(0.0, 0.02, 3000)
    assert noise_of(np.repeat(readings, times)) == pytest.approx(0.02, rel=0.1)


def test_readings_that_rarely_leave_a_count_have_the_noise_of_their_quantisation():
    count = 0.05
    slow = np.round(np.sin(np.linspace(0.0, 6.0, 3000)) / count) * count
    assert noise_of(slow) == pytest.approx(count / np.sqrt(12.0))
    assert noise_of(np.full(3000, 7.0)) < 1e-6


def test_means_of_estimates_are_compared_with_means_of_references(model, recorded):
    single, means = (observed(model, recorded, seconds) for seconds in (0.0, 0.1))
    parts = np.split(residuals_of_one(model, single), np.cumsum(_sizes(single))[:-1])
    averaged = np.split(residuals_of_one(model, means), np.cumsum(_sizes(means))[:-1])
    for channel, short, part, found in zip(
        single.channels, means.channels, parts, averaged, strict=True
    ):
        label = (channel.stamp_ns - channel.stamp_ns[0]) // 100_000_000
        wanted = np.bincount(label, part * channel.sigma) / np.bincount(label)
        np.testing.assert_allclose(found * short.sigma, wanted, rtol=1e-9, atol=1e-9)
        count = np.median(np.bincount(label))
        assert short.sigma == pytest.approx(channel.sigma / np.sqrt(count))


def _sizes(one):
    return [channel.reference.size for channel in one.channels]

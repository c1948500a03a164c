"""The public interface: its names, its page, and estimates that equal those of everything else."""

import ast
import io
import re
import subprocess
import sys
from contextlib import redirect_stdout
from dataclasses import replace

import numpy as np
import pytest
from support.motor_alone import motion, only_measured, truth_of, without_encoder
from support.places import ROOT, SAMPLE

import cdrj_ros as cdrj
from cdrj_ros.evaluation.estimating import estimate as estimate_recording
from cdrj_ros.evaluation.inputs import condition_recording

PAGE = ROOT / "docs" / "api.md"
DOOR = ROOT / "cdrj_ros" / "__init__.py"
FIRST_NS = 1_000_000_000
SLIP = 15_000
"""The motor's reading from which on its encoder has slipped."""


@pytest.fixture(scope="module")
def model():
    return cdrj.load("prototype")


@pytest.fixture(scope="module")
def recording():
    """With a gap in the joint's readings, and an encoder of the motor that slips later."""
    read = cdrj.read_recording(SAMPLE)
    motor, joint = read.motors["winch"].part(slice(20_000)), read.joints["elbow"]
    heard = np.r_[0:6000, 6600:9000]
    slipped = motor.value + np.where(np.arange(20_000) < SLIP, 0.0, 0.6)
    return replace(
        read, motors={"winch": replace(motor, value=slipped)}, joints={"elbow": joint.part(heard)}
    )


@pytest.fixture(scope="module")
def offline(model, recording):
    """The estimates that ``validate`` makes of the recording."""
    return estimate_recording(model, condition_recording(model, recording), uncertainty=True)


def imported(tree):
    """The modules below ``cdrj_ros`` that a program imports."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add(node.module or "")
    return {name for name in found if name.startswith("cdrj_ros.")}


def test_every_public_name_is_listed_typed_found_and_on_the_page():
    typed = {
        alias.name
        for node in ast.walk(ast.parse(DOOR.read_text("utf-8")))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("cdrj_ros")
        for alias in node.names
    }
    assert {*typed, "__version__"} == set(cdrj.__all__) == set(dir(cdrj))
    for name in cdrj.__all__:
        assert getattr(cdrj, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'estimator_'"):
        _ = cdrj.estimator_
    page = PAGE.read_text("utf-8")
    named = set(re.findall(r"^::: cdrj_ros\.(\w+)$", page, re.MULTILINE))
    flags = {name for name in cdrj.__all__ if name.isupper()}
    assert named | flags | {"__version__"} == set(cdrj.__all__)
    assert all(name in page for name in flags)


def test_importing_the_package_imports_nothing_else():
    code = (
        "import sys; before = set(sys.modules); import cdrj_ros; print(*set(sys.modules) - before)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert set(done.stdout.split()) <= {"__future__", "cdrj_ros"}


def test_examples_and_pages_import_only_public_names():
    programs = {
        str(path.relative_to(ROOT)): path.read_text("utf-8")
        for path in (ROOT / "examples").glob("*.py")
    }
    for path in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        text = path.read_text("utf-8")
        scripts = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
        scripts += re.findall(r"^python - .*<<'END'\n(.*?)^END$", text, re.DOTALL | re.MULTILINE)
        programs |= {f"{path.name} {k}": script for k, script in enumerate(scripts)}
    assert len(programs) > 10
    assert {name: sorted(found) for name, text in programs.items()
            if (found := imported(ast.parse(text)))} == {}  # fmt: skip


def test_the_page_runs_as_printed(tmp_path, monkeypatch):
    """Its blocks in order, each with the output that follows it; one draws a picture."""
    import matplotlib as mpl

    mpl.use("Agg")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bags").symlink_to(ROOT / "bags")
    names = {}
    blocks = re.findall(
        r"```python\n(.*?)```\n(?:\n```text\n(.*?)```)?", PAGE.read_text("utf-8"), re.DOTALL
    )
    assert len(blocks) >= 6
    for program, output in blocks:
        printed = io.StringIO()
        with redirect_stdout(printed):
            exec(compile(program, str(PAGE), "exec"), names)  # noqa: S102 our own page
        assert printed.getvalue() == output
    picture = (tmp_path / "tensions.png").read_bytes()
    shown = (ROOT / "docs" / "figures" / "api.png").read_bytes()
    assert picture[:24] == shown[:24]  # format and size


def in_order_of_arrival(recording):
    """All readings: kind, name, stamp [ns], value."""
    readings = [
        (int(log), kind, name, int(stamp), float(value))
        for kind, channels in (("motors", recording.motors), ("joints", recording.joints))
        for name, one in channels.items()
        for stamp, log, value in zip(one.stamp_ns, one.log_ns, one.value, strict=True)
    ]
    return [reading[1:] for reading in sorted(readings, key=lambda reading: reading[0])]


def test_updates_give_the_estimates_of_validate_bit_for_bit(model, recording, offline):
    estimator = cdrj.Estimator(model)
    found = []
    for kind, name, stamp_ns, value in in_order_of_arrival(recording):
        newest = estimator.update(stamp_ns, **{kind: {name: value}})
        assert newest is (estimator.estimates[-1] if estimator.estimates else None)
        found += estimator.estimates
    assert [one.stamp_ns for one in found] == offline.stamp_ns.tolist()
    assert np.array_equal(np.array([one.values for one in found]), offline.values)
    assert np.array_equal(np.array([one.stddev for one in found]), offline.stddev)
    last, elements = found[-1], model.layout.elements
    assert last.tensions == dict(zip(elements, offline.tension[-1].tolist(), strict=True))
    assert last.statuses == dict(zip(elements, offline.status[-1].astype(int), strict=True))
    assert set(estimator.refused) == {"implausible"}, "the first readings after the slip"
    unsure = (offline.status.astype(int) & cdrj.UNSURE > 0).mean(axis=1)
    slipped = offline.stamp_ns > recording.motors["winch"].stamp_ns[SLIP]
    assert slipped.sum() > 3000
    assert np.all(unsure[slipped] == 1.0)
    assert 0.0 < unsure[~slipped].mean() < 0.5


def test_arrays_give_the_estimates_of_validate_bit_for_bit(model, recording, offline):
    motor, joint = recording.motors["winch"], recording.joints["elbow"]
    found = cdrj.estimate(
        model, motor.stamp_ns, motor.value, {"elbow": joint.value}, joint_stamp_ns=joint.stamp_ns
    )
    assert np.array_equal(found.stamp_ns, offline.stamp_ns)
    assert np.array_equal(found.values, offline.values)
    assert np.array_equal(found.stddev, offline.stddev)
    columns = found.columns()
    assert np.array_equal(columns["tension/upper/8"], offline.tension[:, 7])
    assert {len(column) for column in columns.values()} == {found.stamp_ns.size}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"stamp_ns": [1.0, 2.0]}, "integers"),
        ({"stamp_ns": [5, 5]}, "increase"),
        ({"stamp_ns": [0, 5]}, "above 0"),
        ({"motors": np.zeros((2, 2))}, r"must have the shape \(2, 1\), got \(2, 2\)"),
        ({"joints": {"wrist": np.zeros(2)}}, "joints must be elbow; got wrist"),
        ({"joints": {"elbow": np.zeros(3)}}, r"elbow must have one value per stamp, 2"),
    ],
)
def test_arrays_that_do_not_fit_are_refused_with_what_is_allowed(model, change, message):
    given = {"stamp_ns": [1, 2], "motors": np.zeros(2), "joints": np.zeros(2)} | change
    with pytest.raises(cdrj.UsageError, match=message):
        cdrj.estimate(model, **given)


def test_a_robot_may_be_named_and_its_numbers_replaced_and_refused_readings_are_counted():
    stamps = FIRST_NS + np.arange(200) * 1_000_000
    angle = 0.1 * np.sin(0.01 * np.arange(200))
    broken = 8.0 * angle  # as far as the joint turns
    broken[50] = np.nan
    tighter = cdrj.load("prototype", {"cables.upper.preload": 50.0})
    assert [cable.preload for cable in tighter.robot.cables] == [50.0, 26.26]
    found = cdrj.estimate(tighter, stamps, broken, angle)
    assert found.refused == {"not_finite": 1}
    assert np.isfinite(found.values).all()
    assert found.stamp_ns.size >= stamps.size - 1
    assert found.tension[0, 0] == pytest.approx(50.0, abs=0.5)
    with pytest.raises(cdrj.UsageError, match="must be 1 values, of winch"):
        cdrj.Estimator("prototype").update(FIRST_NS, motors=[0.0, 0.0])
    with pytest.raises(cdrj.UsageError, match=r"must be 1 values, of elbow; got 0\.1"):
        cdrj.Estimator("prototype").update(FIRST_NS, joints=0.1)
    with pytest.raises(cdrj.UsageError, match=r"stamp_ns must be an integer \[ns\], got 1\.5"):
        cdrj.Estimator("prototype").update(1.5, motors=[0.0])
    for options in ({"unsure_share": 0.0}, {"unsure_share": np.nan}, {"tracking": -1.0}):
        with pytest.raises(cdrj.UsageError, match=f"{next(iter(options))} must be"):
            cdrj.Options(**options)
    for wrong in ({"efforts": {"elbow": 1.0}}, {"tensions": {"upper/9": 1.0}}):
        with pytest.raises(cdrj.UsageError, match="there is no"):
            cdrj.Estimator("prototype").update(FIRST_NS, motors=[0.0], joints=[0.0], **wrong)
    with pytest.raises(cdrj.CdrjError, match="preload"):
        cdrj.load("prototype", {"cables.upper.preloads": 50.0})


def test_a_joint_without_encoder_is_estimated_from_efforts():
    model = without_encoder("finger", "pip")
    samples = motion(model, 600)
    _, efforts = truth_of(model, samples)
    measured = only_measured(model, samples).joint_angle
    found = cdrj.estimate(model, samples.stamp_ns, samples.motor_angle, measured, efforts=efforts)
    hidden = samples.joint_angle[:, model.robot.unmeasured[0]]
    error = np.abs(found.angles.value[100:, 0] - hidden[100:])
    assert np.mean(error < 3.0 * found.angles.stddev[100:, 0]) > 0.95
    estimator = cdrj.Estimator(model)
    for k, stamp_ns in enumerate(samples.stamp_ns.tolist()):
        named = dict(zip(model.layout.motors, efforts[k], strict=True))
        one = estimator.update(stamp_ns, samples.motor_angle[k], measured[k], efforts=named)
        assert np.array_equal(one.values, found.values[k])
        assert one.joint_angles == dict(zip(found.angles.names, found.angles.value[k], strict=True))
    with pytest.raises(cdrj.UsageError, match="efforts are missing"):
        cdrj.estimate(model, samples.stamp_ns, samples.motor_angle, measured)

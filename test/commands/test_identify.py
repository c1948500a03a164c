"""Tests of the command identify, run in this process on bags of the simulated rig."""

import json

import numpy as np
import pytest
from support.places import PROTOTYPE, ROBOT, ROOT, SAMPLE

from cdrj_ros.commands import identify, simulate, validate
from cdrj_ros.commands.identify_task import load_settings, parser, task_of
from cdrj_ros.identification.problem import LOSSES
from cdrj_ros.recordings.recording import Topics, read_recording
from cdrj_ros.recordings.writer import BagWriter
from cdrj_ros.robot.document import load_schema
from cdrj_ros.robot.parameters import number_at
from cdrj_ros.robot.reader import load_document, load_robot


def rig_bag(path, amplitude, frequency, seconds):
    """A bag of the simulated rig, whose truth has four contact cells per pulley."""
    motion = ["--amplitude", amplitude, "--frequency", frequency, "--duration", seconds]
    assert simulate.main([str(path), "--robot", ROBOT, *motion, "--cells", "4"]) == 0
    return path


@pytest.fixture(scope="session")
def fitted_bag(tmp_path_factory):
    return rig_bag(tmp_path_factory.mktemp("rig") / "slow", "0.62", "0.125", "11")


@pytest.fixture(scope="session")
def other_motion(tmp_path_factory):
    return rig_bag(tmp_path_factory.mktemp("rig") / "fast", "0.45", "0.25", "9")


def test_five_numbers_twenty_percent_off_are_recovered_and_another_motion_is_followed(
    fitted_bag, other_motion, tmp_path, capsys
):
    """The truth has contact cells, unlike the model; the standard errors must cover this."""
    out = tmp_path / "identified.yaml"
    off = {
        "cables.upper.friction.rho": 0.24,
        "cables.lower.friction.rho": 0.16,
        "cables.upper.preload": 36.85 * 0.8,
        "cables.lower.preload": 26.26 * 1.2,
        "cables.*.axial_stiffness": 6283.2 * 0.8,
    }
    starts = [word for name, value in off.items() for word in ("--start", f"{name}={value}")]
    code = identify.main(
        [
            str(fitted_bag), "--robot", ROBOT, "--fit", ",".join(off), *starts,
            "--out", str(out), "--hold-out", str(other_motion),
        ]
    )  # fmt: skip
    assert code == 0
    truth, _ = load_document(PROTOTYPE)
    found, _ = load_document(out)
    known = found["uncertainty"]
    stddevs = dict(zip(known["parameters"], known["stddev"], strict=True))
    for path in (name.replace("*", "upper") for name in off):
        value, right = number_at(found, path), number_at(truth, path)
        assert abs(value - right) < 2.0 * stddevs[path], path
        assert abs(value / right - 1.0) < 0.02, path
        assert stddevs[path] < 0.05 * right, "the standard error itself is small"
    checked = tmp_path / "validate.json"
    assert validate.main([str(other_motion), "--robot", str(out), "--json", str(checked)]) == 0
    channels = json.loads(checked.read_text())["all"]["channels"]
    errors = [c["mean_relative_error"] for n, c in channels.items() if n.startswith("tension/")]
    assert len(errors) == 16
    assert np.mean(errors) <= 0.015
    held_out = found["identified"]["hold_out"]
    assert "tension/upper/8" in held_out
    for name, figure in held_out.items():
        assert figure["rmse"] == pytest.approx(channels[name]["rmse"], rel=1e-3)
    assert "errors on bags held out" in capsys.readouterr().out


def test_the_written_file_keeps_its_comments_and_says_where_its_numbers_come_from(
    fitted_bag, tmp_path
):
    out = tmp_path / "identified.yaml"
    assert identify.main(
        [str(fitted_bag), "--robot", ROBOT, "--fit", "friction.rho,cables.*.preload",
         "--quick", "--start", "cables.*.preload=30", "--out", str(out)]
    ) == 0  # fmt: skip
    text = out.read_text()
    for line in PROTOTYPE.read_text().splitlines():
        if "#" in line:
            assert line.partition("#")[2] in text
    robot = load_robot(out)
    assert robot.uncertainty.parameters == (
        "friction.rho", "cables.upper.preload", "cables.lower.preload",
        "cables.upper.axial_stiffness", "cables.lower.axial_stiffness", "friction.mu_c",
    ), "what the file stated about other numbers is kept"  # fmt: skip
    assert np.sqrt(np.diag(robot.uncertainty.covariance))[3:] == pytest.approx([60.0, 60.0, 0.005])
    assert not robot.uncertainty.may_slip, "others: exact is kept"
    covariance = robot.uncertainty.covariance
    assert covariance[1, 2] == pytest.approx(covariance[1, 1], rel=1e-3), "tied: one number"
    document, _ = load_document(out)
    story = document["identified"]
    assert story["bags"] == ["slow"]
    assert story["tool"].startswith("cdrj_ros ")
    assert set(story["fit"]) == set(story["references"])
    assert str(tmp_path) not in text


def test_bags_are_evaluated_with_fits_that_left_them_out(
    fitted_bag, other_motion, tmp_path, capsys
):
    out = tmp_path / "identified.yaml"
    assert identify.main(
        [str(fitted_bag), str(other_motion), "--robot", ROBOT, "--fit", "friction.rho",
         "--quick", "--cross-validate", "--out", str(out)]
    ) == 0  # fmt: skip
    printed = capsys.readouterr().out
    assert "without slow" in printed
    assert "without fast" in printed
    story = load_document(out)[0]["identified"]
    assert story["cross_validation"].keys() == story["fit"].keys()
    assert story["cross_validation"]["tension/upper/8"]["rmse"] < 1.0


@pytest.mark.parametrize(
    ("arguments", "taught"),
    [
        (["--fit", "roh"], "did you mean"),
        (["--fit", "cables.uper.preload"], "did you mean upper?"),
        (["--fit", "friction.rho", "--start", "friction.rho=x"], "is not a number"),
        (["--fit", "friction.rho", "--start", "friction.rho=3"], "rho must be at most 1"),
        (["--fit", "friction.rho", "--hold-out", str(SAMPLE)], "fitted and held out at once"),
        (["--fit", "friction.rho", "--robot", "no_such_robot"], "no robot file no_such_robot"),
        (["--fit", "friction.rho", "--cross-validate", "x*"], "must match some of the bags"),
    ],
)
def test_a_mistake_is_answered_in_one_line_with_its_remedy(arguments, taught, capsys):
    assert identify.main([str(SAMPLE), "--robot", ROBOT, "--quick", *arguments]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    # on a slow machine, progress is printed too
    (error,) = [line for line in lines if not line.startswith(("reading: ", "fitting: "))]
    assert error.startswith("identify: ")
    assert taught in error


@pytest.mark.parametrize(
    ("settings", "taught"),
    [
        ("bounds: {friction.rho: [1, 0]}", "bounds of friction.rho: 1 must be less than 0"),
        ("bounds: {rhoo: [0, null]}", "rhoo is not among the fitted numbers (friction.rho"),
        ("priors: {friction.rho: {mean: 1, stddev: 0}}", "stddev must be greater than 0, got 0"),
        ("channels: [tension/upper/99]", "there are tension/upper/1"),
        ("settle: .nan", "settle must be a finite number"),
        ("setle: 3", "setle is not a known key; did you mean settle?"),
        ("[1]", "must hold a mapping with settings of identify"),
    ],
)
def test_a_mistake_in_the_settings_is_answered_by_its_key(settings, taught, tmp_path, capsys):
    file = tmp_path / "settings.yaml"
    file.write_text(settings)
    words = [str(SAMPLE), "--robot", ROBOT, "--fit", "friction.rho", "--quick"]
    assert identify.main([*words, "--settings", str(file)]) == 2
    assert taught in capsys.readouterr().err


def test_the_shipped_settings_are_the_defaults_and_name_every_key():
    shipped = load_settings(str(ROOT / "config" / "identify.yaml"))
    schema = load_schema("cdrj_ros.commands", "identify.schema.json")["properties"]
    assert list(shipped) == list(schema)
    assert schema["loss"]["enum"] == list(LOSSES)
    words = [str(SAMPLE), "--robot", ROBOT, "--fit", "friction.rho"]
    usual = task_of(parser().parse_args(words))
    stated = task_of(
        parser().parse_args([*words, "--settings", str(ROOT / "config" / "identify.yaml")])
    )
    assert stated.unknowns == usual.unknowns
    assert stated.settings == usual.settings


@pytest.fixture
def nothing_is_read(monkeypatch):
    """Make the test fail if a bag is read before the arguments are refused."""

    def fail(*_):
        raise AssertionError("a bag is read before the refusal")

    monkeypatch.setattr("cdrj_ros.commands.identify._read", fail)


@pytest.mark.usefixtures("nothing_is_read")
@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--out", "{robot}"], "exists already; --force replaces it"),
        (["--out", "{bag}/metadata.yaml", "--force"], "would overwrite the input bag"),
        (["--hold-out", "{held}", "--out", "{held}/x.yaml"], "would overwrite the input held"),
        (["--cross-validate", "other"], "must match some of the bags and not all"),
    ],
)
def test_an_output_that_would_destroy_something_is_refused_before_the_work(
    tmp_path, capsys, options, words
):
    places = {name: tmp_path / name for name in ("bag", "held", "robot")}
    for name in ("bag", "held"):
        places[name].mkdir()
    (places["bag"] / "metadata.yaml").write_text("kept")
    places["robot"].write_bytes(PROTOTYPE.read_bytes())
    given = [option.format(**{name: str(path) for name, path in places.items()})
             for option in options]  # fmt: skip
    begin = [str(places["bag"]), "--robot", str(places["robot"]), "--fit", "friction.rho"]
    assert identify.main([*begin, *given]) == 2
    (error,) = capsys.readouterr().err.strip().splitlines()
    assert words in error
    assert places["robot"].read_bytes() == PROTOTYPE.read_bytes()
    assert (places["bag"] / "metadata.yaml").read_text() == "kept"


def test_force_replaces_the_robot_file_itself_whole_or_not_at_all(
    fitted_bag, tmp_path, monkeypatch
):
    robot = tmp_path / "robot.yaml"
    robot.write_bytes(PROTOTYPE.read_bytes())
    command = [str(fitted_bag), "--robot", str(robot), "--fit", "friction.rho", "--quick",
               "--out", str(robot), "--force"]  # fmt: skip
    with monkeypatch.context() as patched:
        patched.setattr("os.fsync", _full_disc)
        assert identify.main(command) == 2
    assert robot.read_bytes() == PROTOTYPE.read_bytes()
    assert list(tmp_path.iterdir()) == [robot], "no draft is left"
    assert identify.main(command) == 0
    assert load_robot(robot).uncertainty is not None


def _full_disc(_):
    raise OSError(28, "No space left on device")


def alone(folder):
    """Settings by which the named numbers alone are fitted."""
    path = folder / "settings.yaml"
    path.write_text("only: true")
    return path


def test_the_scale_of_efforts_is_fitted_to_those_that_the_motors_publish(
    fitted_bag, tmp_path, capsys
):
    """A stack publishes currents with the angles, and nothing else: 0.37 N m/A before a gear."""
    recording = read_recording(fitted_bag)
    motor, effort = recording.motors["winch"], recording.references["effort/winch"]
    current = np.interp(motor.stamp_ns, effort.stamp_ns, effort.value) / 0.37
    with BagWriter(tmp_path / "stack") as bag:
        bag.copy(fitted_bag, [Topics().joints])
        bag.write_joint_states(
            Topics().motors, motor.stamp_ns, ("winch",), position=motor.value[:, None],
            effort=current[:, None], log_ns=motor.log_ns,
        )  # fmt: skip
    words = [str(tmp_path / "stack"), "--robot", ROBOT, "--fit", "effort_scale",
             "--settings", str(alone(tmp_path))]  # fmt: skip
    assert identify.main(words) == 2
    refused = capsys.readouterr().err
    assert f"efforts that the motors publish themselves: --reference {Topics().motors}" in refused
    out = tmp_path / "robot.yaml"
    words += ["--reference", Topics().motors, "--out", str(out)]
    assert identify.main(words) == 0
    assert load_robot(out).motors[0].effort_scale == pytest.approx(0.37, rel=0.03)
    assert "effort_scale" in capsys.readouterr().out

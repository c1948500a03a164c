"""Tests of validate: its figures, its options, and defective recordings."""

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from support.places import PROTOTYPE, ROBOT, ROOT, SAMPLE

import cdrj_ros as cdrj
from cdrj_ros.commands import simulate, validate
from cdrj_ros.evaluation import metrics
from cdrj_ros.evaluation.channels import estimate_channels
from cdrj_ros.evaluation.estimating import OUTPUTS, estimate
from cdrj_ros.evaluation.inputs import condition_recording, read_inputs
from cdrj_ros.model.prepared import load_model
from cdrj_ros.recordings.recording import Topics, read_recording
from cdrj_ros.recordings.source import read_messages
from cdrj_ros.recordings.writer import BagWriter

SECONDS = 1_000_000_000
LOW = ROOT / "bags" / "prototype_preload_23_6"
MEASURED = {
    topic: topic
    for topic in (Topics().motors, Topics().joints, "/reference/tensions", "/reference/efforts")
}
"""Topics by their own names."""


def refuse(text):
    raise AssertionError(f"{text} is no JSON number")


def write(path, bag=SAMPLE, *, until_s=4.0, topics=MEASURED, shifts_ns=(0,)):
    """Write the first seconds of topics by other names, once for every shift of the log times."""
    with BagWriter(path) as writer:
        for one, other in topics.items():
            found = list(read_messages(bag, (one,)))
            part = [m for m in found if m.log_ns < found[0].log_ns + until_s * SECONDS]
            copies = [(m.log_ns + shift, m.data) for shift in shifts_ns for m in part]
            writer.write_messages(other, found[0].msgtype, copies)
    return path


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    return write(tmp_path_factory.mktemp("bags") / "short")


def run(out, *arguments):
    """Exit code and figures."""
    json_file = out / "figures.json"
    code = validate.main([*map(str, arguments), "--robot", ROBOT, "--json", str(json_file)])
    return code, json.loads(json_file.read_text()) if json_file.exists() else {}


def one_line(capsys, words):
    error = capsys.readouterr().err
    lines = [line for line in error.splitlines() if not line.startswith("validating: ")]
    assert len(lines) == 1, error
    for word in words:
        assert word in lines[0]


@pytest.mark.parametrize(
    ("bag", "preload", "last_element", "all_elements"),
    [(SAMPLE, [], 0.005, 0.004), (LOW, ["--preload", "23.52,6.66"], 0.015, 0.01)],
)
def test_errors_on_the_sample_recordings_are_far_below_those_of_the_source(
    bag, preload, last_element, all_elements, tmp_path, capsys
):
    out = tmp_path / "figures.json"
    assert validate.main([str(bag), "--robot", ROBOT, "--json", str(out), *preload]) == 0
    figures = json.loads(out.read_text(), parse_constant=refuse)
    assert figures["bags"][0]["duration_s"] == pytest.approx(60.0, abs=0.1)
    left_out = capsys.readouterr().out.splitlines()[0]
    assert left_out.endswith(" reference values before the first or after the last estimate")
    channels = figures["all"]["channels"]
    assert all(set(channel) == {"unit", "n", *metrics.FIGURES} for channel in channels.values())
    tensions = {name: c for name, c in channels.items() if name.startswith("tension/")}
    assert len(tensions) == 16
    assert tensions["tension/upper/8"]["mean_relative_error"] <= last_element
    assert tensions["tension/lower/8"]["mean_relative_error"] <= last_element
    mean = math.fsum(c["mean_relative_error"] for c in tensions.values()) / 16
    assert mean <= all_elements
    assert channels["nodal_force/upper/3"]["unit"] == "N"
    assert channels["effort/winch"]["r2"] > 0.999


def test_of_a_recording_whose_clock_goes_back_the_longest_part_is_compared(short, tmp_path):
    looped = write(tmp_path / "looped", shifts_ns=(0, 5 * SECONDS, 10 * SECONDS))
    code, figures = run(tmp_path, looped, "--write-bag", tmp_path / "written")
    assert code == 0
    once = run(tmp_path, short)[1]["bags"][0]["channels"]
    (bag,) = figures["bags"]
    assert any("The clock went back 2 times" in note for note in bag["notes"])
    for name, channel in bag["channels"].items():
        # between passes, readings that wait for the other topic may be lost
        assert channel["n"] == pytest.approx(once[name]["n"], abs=6)
        assert channel["rmse"] == pytest.approx(once[name]["rmse"], rel=0.02)


@pytest.mark.usefixtures("few_pictures")
def test_limits_decide_the_exit_code_and_violations_are_listed(short, tmp_path, capsys):
    limits = tmp_path / "limits.yaml"
    limits.write_text("channels: {tension/*: {mean_relative_error: {max: 0.05}, r2: {max: 1.0}}}")
    code, figures = run(tmp_path, short, "--limits", limits)
    assert code == 0
    assert figures["limits"] == {"file": str(limits), "checked": 32, "outside": []}
    capsys.readouterr()
    limits.write_text("channels: {tension/upper/8: {rmse: {max: 1.0e-6}}}")
    code, figures = run(tmp_path, short, "--limits", limits, "--html", tmp_path / "r.html")
    assert code == 1
    (outside,) = figures["limits"]["outside"]
    rmse = figures["all"]["channels"]["tension/upper/8"]["rmse"]
    assert outside == {
        "where": str(short), "channel": "tension/upper/8", "figure": "rmse",
        "value": rmse, "max": 1e-6, "by": pytest.approx(rmse - 1e-6),
    }  # fmt: skip
    printed = capsys.readouterr().out
    assert "1 of 1 figures is outside" in printed
    assert "tension/upper/8" in printed
    assert "1 of 1 figures is outside" in (tmp_path / "r.html").read_text()
    limits.write_text("channels: {tension/*: {rsme: {max: 0.05}}}")  # before any bag is read
    assert run(tmp_path, "/no/such/bag", "--limits", limits)[0] == 2
    one_line(capsys, ["channels.tension/*.rsme is not a known key", "mean rmse"])


@pytest.fixture(scope="module")
def second(tmp_path_factory):
    return write(tmp_path_factory.mktemp("bags") / "second", until_s=1.0)


def test_the_truth_of_the_rig_s_node_is_a_reference_and_other_topics_are_named(
    second, tmp_path, capsys
):
    default = run(tmp_path, second)[1]["all"]["channels"]
    own = ("/reference/tensions", "/reference/efforts")
    for folder, names in (
        ("truth", ("/cdrj/truth/tensions", "/cdrj/truth/states")),
        ("others", ("/arm/tensions", "/arm/states")),
    ):
        inputs = (Topics().motors, Topics().joints)
        topics = dict(zip((*inputs, *own), (*inputs, *names), strict=True))
        write(tmp_path / folder, second, topics=topics)
    assert run(tmp_path, tmp_path / "truth")[1]["all"]["channels"] == default
    capsys.readouterr()
    assert run(tmp_path, tmp_path / "others")[0] == 2
    one_line(capsys, ["--reference", "/arm/states (JointState), /arm/tensions (CableTensions)"])


def test_the_written_bag_holds_the_original_and_the_estimates_on_its_stamps(tmp_path):
    late = 1_000_000 * SECONDS + 5_000_000  # log times of another clock
    original = write(tmp_path / "original", shifts_ns=(late,))
    out = tmp_path / "out"
    code, figures = run(tmp_path, original, "--write-bag", out)
    assert code == 0
    assert figures["all"]["channels"]["tension/upper/8"]["mean_relative_error"] < 0.02
    model = load_model(ROBOT)
    read = read_inputs(str(original), Topics(), model)
    expected = estimate(model, condition_recording(model, read))
    named = estimate_channels(model.layout, expected.values)
    again = read_recording(out, Topics(references=OUTPUTS), force_vectors=True)
    assert again.notes == ()
    for name, series in again.references.items():
        np.testing.assert_array_equal(series.stamp_ns, expected.stamp_ns)
        np.testing.assert_array_equal(series.log_ns, expected.stamp_ns + late)
        np.testing.assert_array_equal(series.value, named[name])
    assert set(again.references) == set(named)
    before, after = read_recording(original), read_recording(out)
    assert set(before.references) == set(after.references)
    for name, series in before.references.items():
        np.testing.assert_array_equal(after.references[name].value, series.value)


def test_a_written_bag_replaces_older_estimates_and_no_folder(second, tmp_path, capsys):
    once, several = tmp_path / "once", tmp_path / "several"
    assert run(tmp_path, second, "--write-bag", once)[0] == 0
    assert run(tmp_path, second, once, "--write-bag", several)[0] == 0
    topics = Topics(references=OUTPUTS)
    one, other = (read_recording(path, topics).references for path in (once, several / "once"))
    assert one["tension/upper/1"].value.size == other["tension/upper/1"].value.size
    assert {path.name for path in several.iterdir()} == {"second", "once"}
    capsys.readouterr()
    assert run(tmp_path, second, "--write-bag", several)[0] == 2
    one_line(capsys, [f"{several} exists already"])


def test_a_prefix_chooses_one_of_several_robots(tmp_path, capsys):
    both = tmp_path / "both"
    with BagWriter(both) as bag:
        for side, until_s in (("left", 4.0), ("right", 2.0)):
            topics = {topic: f"/{side}{topic}" for topic in MEASURED}
            bag.copy(write(tmp_path / side, until_s=until_s, topics=topics))
    counts = [
        run(tmp_path, both, "--topic-prefix", side)[1]["all"]["channels"]["effort/winch"]["n"]
        for side in ("/left", "right/")
    ]
    assert counts[0] > 1.8 * counts[1]
    capsys.readouterr()
    assert run(tmp_path, both, "--topic-prefix", "left", "--reference", "/nothing")[0] == 2
    one_line(capsys, ["no references", "publish themselves: --reference /left/cdrj/motor_states"])
    assert run(tmp_path, both)[0] == 2
    one_line(capsys, ["no topic /cdrj/motor_states", "/left/cdrj/motor_states"])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["/no/such/bag"], ["/no/such/bag", "does not exist"]),
        (["--motor-topic", "/x"], ["no topic /x", "/cdrj/motor_states"]),
        (["--motor-topic", "/reference/tensions"], ["JointState", "CableTensions"]),
        (["--reference", "/nothing"], ["no references", "--reference"]),
        (["--preload", "1,2,3"], ["preload needs 2"]),
        (["--html", "/no/such/folder/f.html"], ["/no/such/folder"]),
        (["--start", "-1"], ["--start must be at least 0"]),
        (["--start", "nan"], ["--start must be at least 0"]),
        (["--duration", "0"], ["--duration must be more than 0"]),
        (["--start", "1000"], ["no references in that time"]),
        (["--jobs", "-1"], ["--jobs must be from 0 to"]),
        (["--limits", "/no/such/file"], ["cannot read the file of limits /no/such/file"]),
    ],
)
def test_invalid_arguments_are_refused_in_one_line(second, arguments, words, tmp_path, capsys):
    bags = [] if arguments[0].startswith("/") else [second]
    assert run(tmp_path, *bags, *arguments)[0] == 2
    one_line(capsys, words)


def test_a_bag_whose_readings_are_all_refused_is_an_error(tmp_path, capsys):
    with BagWriter(tmp_path / "bag") as bag:
        stamps = [1, 2, 3]
        nan = [[math.nan]] * 3
        bag.write_joint_states("/cdrj/motor_states", stamps, ("winch",), position=nan)
        bag.write_joint_states("/cdrj/joint_states", stamps, ("elbow",), position=nan)
        bag.write_tensions("/reference/tensions", stamps, ("upper/1",), [[1.0]] * 3)
    assert validate.main([str(tmp_path / "bag"), "--robot", ROBOT]) == 2
    one_line(capsys, ["not one sample"])


def test_every_bag_may_have_its_own_preloads(second, short, tmp_path, capsys):
    low = write(tmp_path / "low", LOW)
    code, one = run(tmp_path, short, low)
    assert code == 0
    assert one["all"]["channels"]["tension/lower/8"]["mean_relative_error"] > 0.3
    (note,) = (note for note in one["bags"][1]["notes"] if "cable lower" in note)
    assert "its preload is 26.26 N here" in note
    assert not any("preload" in note for note in one["bags"][0]["notes"])
    preloads = ["--preload", "36.85,26.26", "--preload", "23.52,6.66"]
    code, both = run(tmp_path, short, low, *preloads)
    assert code == 0
    assert both["all"]["channels"]["tension/lower/8"]["mean_relative_error"] < 0.02
    assert [bag["facts"]["preload"] for bag in both["bags"]] == ["36.85,26.26 N", "23.52,6.66 N"]
    capsys.readouterr()
    assert run(tmp_path, short, low, second, *preloads)[0] == 2
    one_line(capsys, ["--preload must be given once, or once for each of the 3 bags; got 2"])


def test_standard_deviations_give_coverage_and_change_no_error(short, tmp_path, capsys):
    found = [cdrj.validate(PROTOTYPE, short, uncertainty=known) for known in (False, True)]
    assert [one.bags[0].judged > 0 for one in found] == [False, True]
    assert 0 <= found[1].bags[0].ok <= found[1].bags[0].judged
    off, on = (one.pooled for one in found)
    for name, error in off.items():
        assert error.coverage is None
        assert 0.0 <= (on[name].coverage or 0.0) <= 1.0
        assert error == replace(on[name], coverage=None)
    assert run(tmp_path, short)[0] == 0
    (said,) = re.findall(r"status OK: ([\d.]+)", capsys.readouterr().out)
    assert float(said) == pytest.approx(
        100.0 * found[1].bags[0].ok / found[1].bags[0].judged, abs=5e-3
    )


def test_encoders_whose_counts_are_worth_much_are_named_where_the_file_states_no_resolution(
    tmp_path, capsys
):
    text = PROTOTYPE.read_text()
    left_out = ("resolution", "tracking")
    lines = [one for one in text.splitlines() if not any(key in one for key in left_out)]
    robot, bag = tmp_path / "robot.yaml", tmp_path / "bag"
    robot.write_text("\n".join(lines))
    coarse = tmp_path / "coarse.yaml"
    coarse.write_text("joints: {counts: 4096}\n")
    simulated = [str(bag), "--robot", str(robot), "--rig", str(coarse), "--duration", "5"]
    assert simulate.main([*simulated, "--cells", "1"]) == 0
    assert validate.main([str(bag), "--robot", str(robot)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "elbow is read in counts of 0.00153, each worth" in said
    assert "state its resolution, and a tracking_bandwidth" in said
    assert "winch is read in counts" not in said, "those of the motor are worth little"
    assert validate.main([str(bag), "--robot", str(PROTOTYPE)]) == 0
    assert "is read in counts" not in capsys.readouterr().out

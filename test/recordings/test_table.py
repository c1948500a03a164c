"""Logs without ROS: names, units and times of their columns, and what is refused."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support.places import PROTOTYPE

import cdrj_ros as cdrj
from cdrj_ros.evaluation.inputs import of_robot
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import parse_robot

COUNT = 500
TIME = np.arange(COUNT) * 0.005
ELBOW = 0.3 * np.sin(3.0 * TIME)
WINCH = 8.0 * np.sin(ELBOW)
WHERE = {"time": "t", "motors": {"winch": "m"}, "joints": {"elbow": "j"}}


def csv_of(path, columns, delimiter=","):
    rows = [delimiter.join(columns)]
    rows += [delimiter.join(map(str, row)) for row in zip(*columns.values(), strict=True)]
    path.write_text("\n".join(rows) + "\n")
    return path


class Frame(dict[str, Any]):
    """What a DataFrame is here: columns by name; pandas is no requirement."""

    @property
    def columns(self):
        return list(self)


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_a_csv_file_gives_the_readings_that_the_arrays_give(tmp_path, delimiter):
    columns = {"t": TIME, "other": TIME, "j": ELBOW, "m": WINCH}
    path = csv_of(tmp_path / "log.csv", columns, delimiter)
    one, other = (cdrj.read_table(source, **WHERE) for source in (path, columns))
    for kind, name in (("motors", "winch"), ("joints", "elbow")):
        a, b = getattr(one, kind)[name], getattr(other, kind)[name]
        np.testing.assert_array_equal(a.stamp_ns, b.stamp_ns)
        np.testing.assert_array_equal(a.value, b.value)
    assert one.motors["winch"].stamp_ns[0] > 0


def test_times_may_be_seconds_or_nanoseconds_and_these_stay_exact(tmp_path):
    begin = 1_700_000_000_123_456_789
    exact = begin + 5_000_001 * np.arange(COUNT)
    path = csv_of(tmp_path / "log.csv", {"t": exact, "m": WINCH, "j": ELBOW})
    np.testing.assert_array_equal(cdrj.read_table(path, **WHERE).motors["winch"].stamp_ns, exact)
    seconds = cdrj.read_table({"t": 100.0 + TIME, "m": WINCH, "j": ELBOW}, **WHERE)
    assert np.all(np.diff(seconds.motors["winch"].stamp_ns) == 5_000_000)
    assert seconds.start_ns == 100_000_000_000


@pytest.mark.parametrize("factor", [1e3, 1e-3])
def test_times_in_another_unit_are_noted(factor):
    (note,) = cdrj.read_table({"t": factor * TIME, "m": WINCH, "j": ELBOW}, **WHERE).notes
    assert note.startswith(f"Rows are {factor * 0.005:.3g} s apart: column t must be in seconds")
    assert not cdrj.read_table({"t": TIME, "m": WINCH, "j": ELBOW}, **WHERE).notes


def test_an_empty_cell_is_no_reading(tmp_path):
    sparse = [repr(float(value)) if k % 3 == 0 else "" for k, value in enumerate(ELBOW)]
    path = csv_of(tmp_path / "log.csv", {"t": TIME, "m": WINCH, "j": sparse})
    read = cdrj.read_table(path, **WHERE)
    assert read.motors["winch"].value.size == COUNT
    np.testing.assert_array_equal(read.joints["elbow"].value, ELBOW[::3])


def test_short_names_and_the_scales_of_the_robot_file_hold_for_tables():
    robot = SimpleNamespace(
        axes=[SimpleNamespace(name="arm1_winch"), SimpleNamespace(name="arm1_elbow")],
        cables=(), document={"prefix": "arm1_"}, effort_scale={"arm1_winch": 2.0},
    )  # fmt: skip
    log = {"t": TIME, "m": WINCH, "j": ELBOW, "e": np.ones(COUNT)}
    read = of_robot(cdrj.read_table(log, **WHERE, efforts={"winch": "e"}), robot)
    assert list(read.motors) == ["arm1_winch"]
    assert list(read.joints) == ["arm1_elbow"]
    assert set(read.references["effort/arm1_winch"].value) == {2.0}
    long = {**WHERE, "motors": {"arm1_winch": "m"}}
    assert list(of_robot(cdrj.read_table(log, **long), robot).motors) == ["arm1_winch"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"m": None}, "has no column m; it has t, j"),
        (
            {"t": TIME[::-1]},
            "column 't' must increase by whole nanoseconds; row 2 has 2.49 after 2.495",
        ),
        ({"m": [*WINCH[:-1], "12,5"]}, "row 500 is no number: '12,5'; the decimal mark is a point"),
    ],
)
def test_a_mistake_is_answered_in_one_line(tmp_path, change, words):
    columns = {"t": TIME, "m": WINCH, "j": ELBOW} | change
    columns = {name: column for name, column in columns.items() if column is not None}
    path = csv_of(tmp_path / "log.csv", columns, ";")
    with pytest.raises(cdrj.CdrjError, match=words) as error:
        cdrj.read_table(path, **WHERE)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("where", "words"),
    [
        ({"tensions": {"upper/9": "m"}}, "there is no element upper/9; did you mean upper/8?"),
        ({"efforts": {"wimch": "m"}}, "there is no axis wimch; did you mean winch?"),
    ],
)
def test_a_reference_that_the_robot_does_not_have_is_refused(where, words):
    log = {"t": TIME, "m": WINCH, "j": ELBOW}
    recording = cdrj.read_table(log, **(WHERE | where))
    with pytest.raises(cdrj.BagError, match=words):
        cdrj.validate("prototype", recording, uncertainty=False)


def test_estimate_takes_a_frame_by_the_names_of_its_columns():
    """The order of columns does not count, and a missing one is named."""
    model = cdrj.load(PROTOTYPE)
    stamps = 1_000_000_000 + (1e9 * TIME).astype(np.int64)
    frame = Frame(elbow=ELBOW, t=TIME, winch=WINCH)
    one = cdrj.estimate(model, stamps, frame, frame)
    other = cdrj.estimate(model, stamps, {"winch": WINCH}, {"elbow": ELBOW})
    np.testing.assert_array_equal(one.values, other.values)
    with pytest.raises(cdrj.UsageError, match="motors must be winch; got elbow, t"):
        cdrj.estimate(model, stamps, Frame(elbow=ELBOW, t=TIME), frame)


def test_estimate_and_update_take_the_names_of_the_file_without_its_prefix():
    text = PROTOTYPE.read_text("utf-8")
    model = prepare(parse_robot(f"prefix: arm1_\n{text}"))
    stamps = 1_000_000_000 + np.round(1e9 * TIME).astype(np.int64)
    log = Frame({"t": TIME, "elbow": ELBOW, "winch": WINCH})
    long = {"winch": "arm1_winch", "elbow": "arm1_elbow"}
    short, full = (
        cdrj.estimate(model, stamps, Frame(one), Frame(one)).tension
        for one in (log, {long.get(name, name): value for name, value in log.items()})
    )
    np.testing.assert_array_equal(short, full)
    estimator = cdrj.Estimator(model)
    assert estimator.update(int(stamps[0]), {"winch": 0.0}, {"arm1_elbow": 0.0}) is not None


def test_columns_that_cannot_be_those_of_the_robot_are_a_warning():
    model = cdrj.load("prototype")
    stamps = 10**9 + np.round(1e9 * TIME).astype(np.int64)
    with pytest.warns(UserWarning, match="the motors seem to be in degrees"):
        cdrj.estimate(model, stamps, np.degrees(0.1 * WINCH), 0.1 * ELBOW)


def test_a_plot_has_the_last_element_of_every_cable_unless_told_otherwise():
    model = cdrj.load(PROTOTYPE)
    stamps = 1_000_000_000 + (1e9 * TIME).astype(np.int64)
    found = cdrj.estimate(model, stamps, {"winch": WINCH}, {"elbow": ELBOW})
    labels = [axes.get_ylabel() for axes in found.plot().axes]
    assert labels == ["upper/8 [N]", "lower/8 [N]"]
    assert len(found.plot(["upper/2"]).axes) == 1
    with pytest.raises(cdrj.UsageError, match="there is no element upper/99"):
        found.plot(["upper/99"])

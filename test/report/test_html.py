"""The report is one small self-contained page with all names escaped."""

import re
from dataclasses import replace

import numpy as np
import pytest
from support.compared import compare
from support.html import Html, shown
from support.places import PROTOTYPE

from cdrj_ros.evaluation.channels import Angle, BagComparison, Channel, PulleyFriction
from cdrj_ros.evaluation.limits import LimitCheck, Outside
from cdrj_ros.evaluation.metrics import ChannelError, errors_of
from cdrj_ros.evaluation.recorded_verdict import Alarm, Verdict
from cdrj_ros.inspection.ranges import inspect_robot
from cdrj_ros.model.prepared import prepare
from cdrj_ros.report import html
from cdrj_ros.report.html import key_channels, write_report
from cdrj_ros.robot.reader import load_robot


@pytest.fixture(scope="module")
def inspection():
    return inspect_robot(prepare(load_robot(PROTOTYPE)))


@pytest.fixture(scope="module")
def written(inspection, tmp_path_factory):
    def write(*bags):
        path = tmp_path_factory.mktemp("report") / "report.html"
        write_report(
            path, errors_of(bags), title="A title", inspection=inspection,
            versions={"cdrj_ros": "1.2.3"},
        )  # fmt: skip
        return path.read_text(encoding="utf-8")

    return write


def test_the_page_has_every_channel_is_well_formed_and_asks_no_network(written, comparison):
    keys = key_channels([channel.name for channel in comparison.channels])
    names = {*keys, "tension/upper/1", "nodal_force/lower/2"}
    channels = tuple(channel for channel in comparison.channels if channel.name in names)
    page = written(replace(comparison, channels=channels))
    for channel in channels:
        assert f">{channel.name} <" in page
    for text in ("A title", "1.2.3", "rate achieved", "1000 Hz", comparison.notes[0]):
        assert text in page
    assert "motor sample not finite: 3" in page
    assert page.count("<svg") == 3 * len(keys) + (len(channels) - len(keys)) + 1
    assert not re.search(r"https?:|src=|@import|<script|<link|url\((?!#)", page)
    assert "default-src 'none'" in page
    parser = Html(page)
    assert {link.lstrip("#") for link in parser.links} <= parser.ids
    folded = page.index("<details>")
    for name in ("tension/upper/8", "nodal_force/lower/3", "effort/spindle"):
        assert page.index(f">{name} <") < folded
    for name in ("tension/upper/1", "nodal_force/lower/2"):
        assert page.index(f">{name} <") > folded


@pytest.mark.usefixtures("few_pictures")
def test_a_low_r2_beside_a_small_error_is_explained(written, comparison):
    stamps = np.arange(1, 1001, dtype=np.int64) * 1_000_000
    noise = 0.05 * np.random.default_rng(0).standard_normal((2, stamps.size))
    steady = compare(
        stamps, {"tension/upper/1": 30.0 + noise[0]},
        {"tension/upper/1": (stamps, 30.0 + noise[1])}, max_gap_ns=20_000_000,
    )  # fmt: skip
    explained = "R² of tension/upper/1 is low although its error is 0."
    assert explained in written(replace(comparison, channels=tuple(steady)))
    assert explained not in written(comparison)


NASTY = (
    "<script>ran()</script>", "<iframe srcdoc='<script>ran()</script>'>",
    "<img src=x onerror=ran()>", '" onmouseover="ran()" x="', "' onclick='ran()",
    "</style><svg onload=ran()>", "]]><b>", "--><b>", "</title></textarea><b>",
    "{{ 7 * 7 }} {% raw %}", "&lt;b&gt;&#60;b&#62;", "$title$ \\frac{",
    "javascript:ran()", "\x1b[31m\x00\u202e", "a\nb",
)  # fmt: skip


def test_every_field_that_a_bag_or_robot_file_fills_is_plain_text(
    tmp_path, comparison, inspection, written
):
    stamps = np.arange(50, dtype=np.int64) * 1_000_000
    values, nasty = np.sin(stamps * 1e-7), "".join(NASTY)
    name = f"tension/{nasty}/1"
    channels = compare(
        stamps, {name: values}, {name: (stamps, values)}, max_gap_ns=10_000_000,
        angle=Angle(nasty, stamps, values),
    )  # fmt: skip
    alarm = Alarm("warn", nasty, 0.0, 1.0)
    bag = replace(
        BagComparison(nasty, 0.5, channels, {nasty: 1}, (f"effort/{nasty}", nasty), {nasty: nasty}),
        friction=(PulleyFriction(f"{nasty}/2", 1.0, 2.0, 0.1, 0.2),),
        health=Verdict("warn", nasty, (nasty,), (alarm,), {nasty: nasty}),
    )
    robot = inspection.model.robot
    cables = tuple(replace(one, name=nasty, law=nasty) for one in robot.cables)
    axes = tuple(replace(one, name=nasty) for one in robot.joints)
    document = {**robot.document, "identified": {nasty: [nasty, {nasty: nasty}]}}
    robot = replace(robot, name=nasty, cables=cables, joints=axes, document=document)
    write_report(
        tmp_path / "r.html", errors_of([bag, bag]), title=nasty, versions={nasty: nasty},
        inspection=replace(inspection, model=replace(inspection.model, robot=robot)),
        limit_check=LimitCheck(nasty, 1, (Outside(nasty, nasty, "rmse", 1.0, 0.5, False),)),
    )  # fmt: skip
    plain = Html(written(replace(comparison, channels=comparison.channels[:2])))
    parser = Html((tmp_path / "r.html").read_text(encoding="utf-8"))
    allowed = plain.tags | {"a", "ul", "li", "dl", "dt", "dd", "details", "summary", "div", "span"}
    assert parser.tags <= allowed
    assert parser.attributes <= plain.attributes | {"title", "aria-label"}
    assert not any(one.startswith("on") for one in parser.attributes)
    assert all(link.startswith("#") for link in parser.links)
    assert parser.text.count(shown(nasty)) > 20


def test_a_page_does_not_grow_with_the_recording_and_has_a_limit(written, made_up, monkeypatch):
    random, bag = np.random.default_rng(3), made_up(seconds=60, per_cable=1)
    channels = tuple(
        replace(c, stddev=0.3 + 0.1 * random.random(len(c.stamp_ns))) for c in bag.channels
    )
    page = written(replace(bag, channels=channels))
    assert page.count("var(--band)") >= 2 * len(channels)
    assert "within ±2σ" in page
    assert len(page) < 350_000  # four of 32 channels
    monkeypatch.setattr(html, "PICTURE_BUDGET", 50_000)
    names = [channel.name for channel in bag.channels]
    page = written(replace(bag, path="one"), replace(bag, path="two"))
    assert 0 < page.count("Not drawn, to keep the page small.") < 2 * len(names)
    assert all(page.count(f">{name} <") == 2 for name in names)


@pytest.mark.parametrize("n", [0, 1, 2, 3])
def test_a_page_is_made_from_hardly_any_samples(n, written):
    values = np.arange(n, dtype=np.float64)
    stamps = np.arange(n, dtype=np.int64) * 1_000_000
    channel = Channel("tension/a/1", "N", stamps, values, values, values, "rolling")
    vectors = replace(
        channel, name="force_vector/a/2", estimate=np.ones((n, 3)), reference=np.zeros((n, 3))
    )
    page = written(BagComparison("a", 0.0, (channel, vectors)))
    assert ">tension/a/1 <" in page
    assert ">force_vector/a/2 <" in page


def test_a_page_without_channels_has_the_drawing_alone(written):
    assert written(BagComparison("a", 0.0, ())).count("<svg") == 1


@pytest.mark.usefixtures("few_pictures")
def test_of_many_channels_the_worst_are_shown_and_all_are_folded(written):
    stamps = np.arange(1, 4, dtype=np.int64) * 1_000_000
    true = np.linspace(9.0, 10.0, 3)
    names = {f"tension/c{c}/{e}": 0.1 * e for c in range(25) for e in (1, 2)}
    many = compare(
        stamps, {name: true + off for name, off in names.items()},
        dict.fromkeys(names, (stamps, true)), max_gap_ns=20_000_000,
    )  # fmt: skip
    page = written(BagComparison("hand", 1.0, many))
    shown, _, folded = page.partition("<summary>All channels</summary>")
    assert [f'title="tension/c7/{e}"' in shown for e in (1, 2)] == [False, True]
    assert all(f'title="{name}"' in folded for name in names)
    assert "The worst element of every cable" in shown


@pytest.mark.usefixtures("few_pictures")
def test_the_share_of_usable_tensions_stands_beside_the_errors(made_up, written):
    bag = made_up(seconds=1)
    assert "Status OK" not in written(bag), "nothing is known without standard deviations"
    page = written(replace(bag, judged=300, ok=300), replace(bag, judged=100, ok=0))
    head = page[page.index("<header>") : page.index("</header>")]
    assert ">75.00 %<" in head
    assert head.index("Status OK") > head.index("element tensions") > 0


def test_the_first_number_of_a_quantity_is_an_error_with_its_coverage():
    """R² of efforts that hardly vary tells nobody anything."""
    effort = ChannelError(100, 0.01, 0.02, 0.012, 0.03, -1.2, coverage=0.97, unit="N·m")
    (shown,) = html.key_numbers({"effort/winch": effort})
    assert shown["meaning"] == "mean error"
    assert "97.00 % in ±2σ" in shown["detail"]


def test_efforts_of_sliding_and_of_turning_joints_are_not_averaged():
    turns, slides = (
        ChannelError(100, e, e, e, e, 0.9, unit=u) for e, u in ((0.01, "N·m"), (2.0, "N"))
    )
    shown = html.key_numbers({"effort/a": turns, "effort/lift": slides, "effort/b": turns})
    assert [(one["label"], one["detail"].split(" mean")[0]) for one in shown] == [
        ("2 efforts", "10 mN·m"), ("Effort", "2.0 N"),
    ]  # fmt: skip

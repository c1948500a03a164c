"""The report is one small self-contained page with all names escaped."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from markupsafe import Markup
from matplotlib.figure import Figure

from cdrj_ros.estimation.recorded_health import Alarm, Verdict
from cdrj_ros.evaluation.channels import Angle, BagComparison, Channel
from cdrj_ros.evaluation.comparison import compare, summed_up
from cdrj_ros.evaluation.limits import LimitCheck, Outside
from cdrj_ros.evaluation.metrics import errors_of
from cdrj_ros.evaluation.pulley_friction import PulleyFriction
from cdrj_ros.report import html
from cdrj_ros.report.canvas import PALETTE
from cdrj_ros.report.html import RobotShown, write_report
from cdrj_ros.report.parameters import robot_summary
from cdrj_ros.report.pictures import Picture
from cdrj_ros.report.table import Beside
from cdrj_ros.report.verdict import key_channels
from cdrj_ros.robot.reader import load_robot

ROBOT = Path(__file__).parents[2] / "config" / "robots" / "prototype.yaml"
VOID = {"meta", "link", "br", "img", "hr", "input"}


class Strict(HTMLParser):
    """Parser that rejects unclosed tags and duplicate ids."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: set[str] = set()
        self.tags: set[str] = set()
        self.attributes: set[str] = set()
        self.text = ""
        self.links: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.attributes |= {name for name, _ in attrs}
        for name, value in attrs:
            if name == "id":
                assert value not in self.ids, f"id {value} twice"
                self.ids.add(str(value))
            if name == "href":
                self.links.add(str(value))
            if name == "clip-path":
                self.links.add(str(value)[4:-1])
        if tag not in VOID:
            self.open.append(tag)

    def handle_data(self, data: str) -> None:
        self.text += data

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def written(path: Path, *comparisons: BagComparison, **more: object) -> str:
    write_report(
        path / "report.html",
        errors_of(comparisons),
        title=str(more.get("title", "A title")),
        robot=RobotShown(str(more.get("robot_summary", "A robot"))),
        versions={"cdrj_ros": "1.2.3"},
        beside=Beside("published", {"tension/upper/8": "4.44 %"}),
    )
    return (path / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def shown(comparison: BagComparison) -> BagComparison:
    """The key channels and three others, because a channel takes 0.3 s to draw."""
    names = {*key_channels([channel.name for channel in comparison.channels])}
    names |= {"tension/upper/1", "nodal_force/upper/7", "nodal_force/lower/2"}
    assert len(names) == 9
    channels = tuple(channel for channel in comparison.channels if channel.name in names)
    return replace(comparison, channels=channels)


@pytest.fixture(scope="module")
def page(shown: BagComparison, tmp_path_factory: pytest.TempPathFactory) -> str:
    return written(tmp_path_factory.mktemp("report"), shown)


def test_the_page_has_every_channel_with_its_pictures_and_asks_no_network(
    page: str, shown: BagComparison
) -> None:
    for channel in shown.channels:
        assert f">{channel.name} <" in page
    for text in ("A title", "A robot", "1.2.3", "4.44 %", "published", "rate achieved", "1000 Hz"):
        assert text in page
    assert "motor sample not finite: 3" in page
    assert shown.notes[0] in page
    assert page.count("<svg") == 3 * len(shown.channels)
    assert not re.search(r"https?:|src=|@import|<script|<link|url\((?!#)", page)
    assert "default-src &#39;none&#39;" in page or "default-src 'none'" in page


def test_the_page_is_well_formed_and_the_targets_of_its_links_exist(page: str) -> None:
    parser = Strict()
    parser.feed(page)
    parser.close()
    assert parser.open == []
    assert {link.lstrip("#") for link in parser.links} <= parser.ids


def test_the_key_channels_are_shown_and_the_others_are_collapsed(page: str) -> None:
    folded = page.index("<details>")
    for name in ("tension/upper/8", "nodal_force/lower/3", "effort/spindle"):
        assert page.index(f">{name} <") < folded
    for name in ("tension/upper/1", "nodal_force/lower/2"):
        assert page.index(f">{name} <") > folded
    assert page.index("tension/upper/8 <") < page.index("nodal_force/upper/3 <")


def test_collapsed_sections_are_printed_without_a_script(page: str) -> None:
    assert "<script" not in page
    style = page[page.index("<style>") : page.index("</style>")]
    paper = style[style.index("@media print") : style.index("@supports")]
    opened = re.search(r"details::details-content \{(.*?)\}", paper)
    assert opened is not None
    assert "content-visibility: visible" in opened[1]
    assert "::details-content" not in style[: style.index("@media print")]
    lacking = style[style.index("@supports not selector(::details-content)") :]  # older browsers
    assert re.search(r"@media print \{\s*details:not\(\[open\]\) > summary::after", lacking)
    assert page.count("<details>") == page.count("<details><summary>") > 0


NASTY = (
    "<script>ran()</script>", "<iframe srcdoc='<script>ran()</script>'>",
    "<img src=x onerror=ran()>", '" onmouseover="ran()" x="', "' onclick='ran()",
    "</style><svg onload=ran()>", "]]><b>", "--><b>", "</title></textarea><b>",
    "{{ 7 * 7 }} {% raw %}", "&lt;b&gt;&#60;b&#62;", "$title$ \\frac{",
    "javascript:ran()", "\x1b[31m\x00\u202e", "a\nb",
)  # fmt: skip


@pytest.mark.parametrize("nasty", NASTY)
def test_every_field_that_a_bag_or_robot_file_fills_is_plain_text(
    tmp_path: Path, nasty: str, comparison: BagComparison
) -> None:
    stamps = np.arange(50, dtype=np.int64) * 1_000_000
    values = np.sin(stamps * 1e-7)
    name = f"tension/{nasty}/1"
    channels = compare(
        stamps, {name: values}, {name: (stamps, values)}, max_gap_ns=10_000_000,
        angle=Angle(nasty, stamps, values),
    )  # fmt: skip
    alarm = Alarm("warn", nasty, 0.0, 1.0, 1, 1)
    bag = replace(
        summed_up(nasty, 0.5, channels, (f"effort/{nasty}",), {nasty: 1}, (nasty,), {nasty: nasty}),
        friction=(PulleyFriction(f"{nasty}/2", 1.0, 2.0, 0.1, 0.2, values, values),),
        health=Verdict("warn", nasty, 1, (nasty,), (alarm,), {nasty: nasty}),
    )
    robot = load_robot(ROBOT)
    cables = tuple(replace(one, name=nasty, law=nasty) for one in robot.cables)  # type: ignore[arg-type]
    axes = tuple(replace(one, name=nasty) for one in robot.joints)
    document = {**robot.document, "identified": {nasty: [nasty, {nasty: nasty}]}}
    robot = replace(robot, name=nasty, cables=cables, joints=axes, document=document)
    write_report(
        tmp_path / "r.html", errors_of([bag, bag]), title=nasty, versions={nasty: nasty},
        robot=RobotShown(robot_summary(robot), robot), beside=Beside(nasty, {name: nasty}),
        limit_check=LimitCheck(nasty, 1, (Outside(nasty, nasty, "rmse", 1.0, 0.5, False),)),
    )  # fmt: skip
    text = (tmp_path / "r.html").read_text(encoding="utf-8")
    plain, parser = Strict(), Strict()
    plain.feed(written(tmp_path, comparison_of_two(comparison)))
    parser.feed(text)
    parser.close()
    allowed = plain.tags | {"a", "ul", "li", "dl", "dt", "dd", "details", "summary", "div", "span"}
    assert parser.tags <= allowed
    assert parser.attributes <= plain.attributes | {"title", "aria-label"}
    assert not any(one.startswith("on") for one in parser.attributes)
    assert all(link.startswith("#") for link in parser.links)
    shown = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in nasty)
    assert parser.text.count(shown) > 25


def comparison_of_two(comparison: BagComparison) -> BagComparison:
    return replace(comparison, channels=comparison.channels[:2])


def test_ten_minutes_with_bands_and_friction_stay_below_three_megabytes(
    tmp_path: Path, made_up: Callable[..., BagComparison]
) -> None:
    """Six of 32 channels stay below a sixth of it, what they have in common included."""
    random, bag = np.random.default_rng(3), made_up(duration_s=600.0, elements=1, nodes=1)
    channels = tuple(
        replace(c, stddev=0.3 + 0.1 * random.random(len(c.stamp_ns))) for c in bag.channels
    )
    walk = np.cumsum(random.normal(size=600_000))
    loop = PulleyFriction("upper/2", 1.0, 2.0, 0.1, 0.2, walk, random.normal(size=600_000))
    text = written(tmp_path, replace(bag, channels=channels, friction=(loop,)))
    assert text.count("<svg") == 3 * 6 + 2
    assert (tmp_path / "report.html").stat().st_size < 500_000


def test_two_recordings_stay_below_three_megabytes_and_have_their_key_pictures(
    tmp_path: Path, made_up: Callable[..., BagComparison], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With pictures of 100 kB per channel, which are too many."""
    drawn: list[tuple[str, str]] = []

    def draw(channel: Channel, _: str, __: int, label: str, ___: object) -> tuple[Picture, ...]:
        drawn.append((label, channel.name))
        return (Picture(Markup("." * 100_000), ""),)

    monkeypatch.setattr(html, "channel_pictures", draw)
    bags = [made_up(duration_s=1.0, rate_hz=100.0, path=path) for path in ("one", "two")]
    text = written(tmp_path, *bags)
    assert 2_000_000 < (tmp_path / "report.html").stat().st_size < 3_000_000
    names = [channel.name for channel in bags[0].channels]
    first = {(f"{path}, ", name) for path in ("one", "two") for name in key_channels(names)}
    assert set(drawn[: len(first)]) == first
    assert text.count("Not drawn, to keep the page small.") == 2 * len(names) - len(drawn) > 0
    assert all(f">{name} <" in text for name in names)


def test_a_spike_of_one_sample_is_in_the_picture(tmp_path: Path) -> None:
    n = 100_000
    stamps = np.arange(n, dtype=np.int64) * 1_000_000
    flat = np.full(n, 10.0)
    spiked = flat.copy()
    spiked[77_777] = 90.0
    channel = Channel("tension/a/1", "N", stamps, spiked, flat, np.full(n, np.nan), "")
    text = written(tmp_path, BagComparison("a", 100.0, (channel,)))
    assert "largest 80.0 N at 77.78 s" in text


@pytest.mark.parametrize("n", [0, 1, 2, 3])
def test_a_page_is_made_from_hardly_any_samples(tmp_path: Path, n: int) -> None:
    values = np.arange(n, dtype=np.float64)
    stamps = np.arange(n, dtype=np.int64) * 1_000_000
    channel = Channel("tension/a/1", "N", stamps, values, values, values, "rolling")
    text = written(tmp_path, BagComparison("a", 0.0, (channel,)))
    assert ">tension/a/1 <" in text
    assert written(tmp_path, BagComparison("a", 0.0, ())).count("<svg") == 0


def test_page_and_pictures_share_their_colours() -> None:
    css = html.style()
    light = css[: css.index("@media")]
    for role, colour in PALETTE.items():
        assert f"--{role}: {colour};" in light


def test_a_report_does_not_touch_the_callers_matplotlib(
    tmp_path: Path, comparison: BagComparison
) -> None:
    import matplotlib

    before = dict(matplotlib.rcParams)
    few = BagComparison(comparison.path, comparison.duration_s, comparison.channels[:1])
    first = written(tmp_path, few)
    assert dict(matplotlib.rcParams) == before
    assert written(tmp_path, few) == first


def test_the_page_has_bands_friction_parameters_and_limits(
    tmp_path: Path, comparison: BagComparison
) -> None:
    banded = [replace(c, stddev=np.full(len(c.stamp_ns), 0.5)) for c in comparison.channels[:3]]
    banded[1].stddev[1000:2000] = np.nan  # type: ignore[index]
    swing = np.sin(np.linspace(0.0, 20.0, 500))
    friction = tuple(
        PulleyFriction(f"upper/{k}", 1.0, 2.0, 0.01 * k, 0.05 * k) for k in range(2, 9)
    )
    looped = replace(friction[-1], passed=swing, friction=np.sign(swing))
    bag = replace(comparison, channels=tuple(banded), friction=(*friction[:-1], looped))
    outside = Outside("bags/<one>", "tension/upper/8", "rmse", 0.2, 0.1, least=False)
    robot = load_robot(ROBOT)
    drawing = Figure(figsize=(6.0, 3.0))
    write_report(
        tmp_path / "r.html", errors_of([bag]), title="t", versions={},
        limit_check=LimitCheck("limits.yaml", 3, (outside,)), robot=RobotShown("r", robot, drawing),
    )  # fmt: skip
    text = (tmp_path / "r.html").read_text(encoding="utf-8")
    parser = Strict()
    parser.feed(text)
    assert parser.open == []
    assert text.count("var(--band)") >= 3 * 2 * 2
    assert "within ±2σ" in text
    assert "1 of 3 figures is outside the limits of limits.yaml." in text
    assert text.index("1 of 3 figures") < text.index("<h2>")
    assert "bags/&lt;one&gt;" in text
    assert "Friction at the pulleys" in text
    assert text.count("<svg") == 3 * 3 + 2 + 1
    assert 'viewBox="0 0 432 216"' in text
    for row in ("upper/2–4", "μ_c", "6283 N", "elbow (joint)"):
        assert row in text


def test_of_many_pulleys_those_with_the_most_friction_have_a_bar(tmp_path: Path) -> None:
    many = tuple(PulleyFriction(f"a/{k}", 1.0, 2.0, 1e-3 * k, 2e-3 * k) for k in range(2, 200))
    text = written(tmp_path, BagComparison("a", 0.0, (), friction=many))
    assert "the 24 that hold most" in text

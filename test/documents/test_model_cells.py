"""What docs/model.md says of contact cells is what the model computes."""

from __future__ import annotations

import re
from math import degrees, pi, radians
from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.estimation.estimator import initial_state, run
from cdrj_ros.estimation.samples import Samples
from cdrj_ros.model.prepared import Model, prepare, shape_at
from cdrj_ros.robot.reader import load_robot, parse_robot

ROOT = Path(__file__).parents[2]
DOCUMENT = (ROOT / "docs" / "model.md").read_text(encoding="utf-8")

ROBOT = """
name: arc
motors: [{name: m}]
joints: [{name: q, range: [-0.1, 0.1]}]
frames:
  - {name: guide, motion: prismatic, joint: q, GUIDE}
cables:
  - name: c
    axial_stiffness: 1e4
    preload: 20
    nodes:
      - {type: winch, motor: m, winding: 1, radius: 0.01, position: [0, -0.01, 0], axis: [0, 0, 1], turn: cw}
      - {BODY, friction: {mu_c: MU, rho: 1}CELLS}
      - {type: anchor, frame: guide, position: [0, 0, 0]}
"""  # noqa: E501
AHEAD = "origin: [0.55, 0, 0], axis: [1, 0, 0]"
SHEATH = "type: sheath, position: [0.05, 0, 0], exit: [0.4, 0, 0], length: 0.35, bend: "
PULLEY = "type: pulley, radius: 0.01, position: [0.3, -0.01, 0], axis: [0, 0, 1], turn: cw"
CYLINDER = "type: cylinder, radius: 0.05, position: [0.3, -0.05, 0], axis: [0, 0, 1], turn: cw"
CASES = [
    (f"{SHEATH}{radians(100.0)}", 0.1, AHEAD),
    (f"{SHEATH}{radians(157.0)}", 0.1, AHEAD),
    (f"{SHEATH}{radians(157.0)}", 0.2, AHEAD),
    (PULLEY, 0.2, "origin: [0, -0.02, 0], axis: [-1, 0, 0]"),
    (f"{CYLINDER}, turns: 1", 0.2, "origin: [0.6, 0, 0.02], axis: [1, 0, 0]"),
]
"""Bodies, coefficients and guides of the table's rows."""

ROWS = re.findall(
    r"^\|[^|]*\| (\d+)° \| ([\d.]+) \| ([\d.]+) % \| (\d+) cells \| ([\d.]+) % \|$",
    DOCUMENT,
    re.MULTILINE,
)


def robot(case: tuple[str, float, str], cells: int | None = None) -> Model:
    body, mu, guide = case
    text = ROBOT.replace("BODY", body).replace("MU", str(mu)).replace("GUIDE", guide)
    text = text.replace("CELLS", "" if cells is None else f", cells: {cells}")
    return prepare(parse_robot(text), check_range=False)


def tensions(model: Model) -> np.ndarray:
    """Tensions while the anchor moves and the drum follows with the page's deviations [N]."""
    time = np.arange(10_000) * 1e-3
    joint = 0.02 * np.sin(2.0 * pi * 0.25 * time)
    drawn = -joint + 0.0005 * np.sin(2.0 * pi * 0.11 * time)
    drawn += 0.0003 * np.sin(2.0 * pi * 0.7 * time)
    stamps = 1_000_000 * np.arange(time.size, dtype=np.int64)
    samples = Samples(stamps, (drawn / 0.01)[:, None], joint[:, None])
    values = run(model, initial_state(model), samples)[1].values
    return np.asarray(values[:, model.layout.tension])


def test_the_page_has_a_row_for_every_case() -> None:
    assert len(ROWS) == len(CASES)


@pytest.mark.parametrize(("case", "row"), list(zip(CASES, ROWS, strict=False)))
def test_the_errors_on_the_page_are_those_of_one_contact_and_of_the_default(
    case: tuple[str, float, str], row: tuple[str, ...]
) -> None:
    wrap, exponent, one, cells, left = row
    chosen = robot(case)
    angle = shape_at(chosen, np.zeros(1)).wrap[0]
    assert round(degrees(angle)) == int(wrap)
    assert case[1] * angle == pytest.approx(float(exponent), abs=0.0051)
    assert chosen.robot.cables[0].pulleys[0].cells == int(cells)
    fine = tensions(robot(case, 60))
    assert fine.min() > 1.0, "the cable stays taut"
    for printed, model in ((one, robot(case, 1)), (left, chosen)):
        error = 100.0 * np.mean(np.abs(tensions(model) / fine - 1.0))
        places = len(printed.partition(".")[2])
        assert float(printed) == pytest.approx(error, abs=0.51 * 10.0**-places)


def test_the_page_names_the_robots_of_the_package_with_divided_pulleys() -> None:
    named = re.search(
        r"only\s+`config/robots/(\w+).yaml` \((\d+) cells on one pulley\) and\s+"
        r"`config/robots/(\w+).yaml` \((\d+) in its sheath\)",
        DOCUMENT,
    )
    assert named is not None
    divided = {}
    for path in (ROOT / "config" / "robots").glob("*.yaml"):
        cables = prepare(load_robot(path)).robot.cables
        cells = [pulley.cells for cable in cables for pulley in cable.pulleys if pulley.cells > 1]
        if cells:
            divided[path.stem] = cells
    first, count, second, other = named.groups()
    assert divided == {first: [int(count)], second: [int(other)]}

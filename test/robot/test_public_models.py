"""Every spatial tendon of a folder of public MJCF models against MuJoCo.

The models are not part of the project: docs/validation.md names them.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path
from types import ModuleType

import pytest

from cdrj_ros.foundation.errors import CdrjError

pytest.importorskip("mujoco", reason="the test extra mujoco is not installed")

FOLDER = os.environ.get("CDRJ_MJCF", "")
MODELS = sorted(Path(FOLDER).rglob("*.xml")) if FOLDER else []
POSES = 1000


def comparing() -> ModuleType:
    path = Path(__file__).parents[2] / "tools" / "compare_mujoco.py"
    spec = importlib.util.spec_from_file_location("compare_mujoco", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.skipif(not MODELS, reason="CDRJ_MJCF names no folder of MJCF models")
@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_lengths_and_moment_arms_are_those_of_mujoco(path: Path) -> None:
    try:
        found = comparing().compare(path, POSES)
    except CdrjError as error:  # no model of its own, or one without spatial tendons
        pytest.skip(str(error)[:200])
    assert found.compared > 0
    assert found.length <= 1e-9
    assert found.arm <= 1e-6  # at rings MuJoCo's iteration ends at 1e-6
    assert found.slope <= 1e-7
    assert found.impossible == 0


ARM = """
<mujoco>
  <worldbody>
    <site name="a" pos="0 0.05 0"/> <site name="side" pos="0.1 0.15 0.02"/>
    <body name="arm" pos="0.1 0 0">
      <joint name="q" axis="0 0 1" range="-40 40"/>
      <geom name="ring" type="cylinder" size="0.03 0.1" pos="0.05 0.06 0"/>
      <geom name="ball" size="0.04" pos="0.15 0 0"/>
      <site name="in" pos="0.05 0.06 0"/> <site name="b" pos="0.09 0.02 0.01"/>
      <site name="near" pos="0.13 0 0"/> <site name="c" pos="0.25 0 0"/>
    </body>
  </worldbody>
  <tendon>
    <spatial name="through"><site site="a"/><geom geom="ring" sidesite="in"/><site site="b"/></spatial>
    <spatial name="beside"><site site="b"/><geom geom="ball" sidesite="side"/><site site="c"/></spatial>
    <spatial name="within"><site site="near"/><geom geom="ball"/><site site="c"/></spatial>
  </tendon>
</mujoco>
"""  # noqa: E501


def test_rings_foreign_side_sites_and_sites_within_a_body_are_those_of_mujoco(
    tmp_path: Path,
) -> None:
    (tmp_path / "arm.xml").write_text(ARM)
    found = comparing().compare(tmp_path / "arm.xml", 300)
    assert (found.tendons, found.compared, found.impossible) == (3, 3, 0)
    assert found.touched >= 2
    assert found.length <= 1e-9
    assert found.arm <= 1e-7
    assert any("ball (within)" in remark for remark in found.remarks)

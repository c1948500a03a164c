"""No model of less than 1 MB takes more than 500 MB or 20 s, and each ends in one clear line."""

import os
import subprocess
import sys
import time

import pytest

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.robot import mjcf

pytest.importorskip("mujoco", reason="the test extra mujoco is not installed")

SITES = '<site name="a"/><site name="b" pos="0 0 1"/>'
TENDON = '<tendon><spatial name="t"><site site="a"/><site site="b"/></spatial></tendon>'
BODY = '<body><geom size="1"/></body>'


def model(body="", *, assets="", rest=""):
    world = f"<worldbody>{SITES}{body}</worldbody>"
    return f"<mujoco><asset>{assets}</asset>{world}{rest}{TENDON}</mujoco>"


PROGRAM = """
import re, resource, sys
from pathlib import Path
from cdrj_ros.commands.import_robot import main
code = main(sys.argv[1:])
# the largest size that getrusage reports may be that of the process that started this one
own, = re.findall("VmHWM:[^0-9]*([0-9]+)", Path("/proc/self/status").read_text())
usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
print(code, round(sum(one.ru_utime + one.ru_stime for one in usages)), own, usages[1].ru_maxrss)
"""

HOSTILE = {
    "height field": (
        model(assets='<hfield name="h" nrow="20000" ncol="20000" size="1 1 1 1"/>'),
        "needs more than 350 MB",
    ),
    "nested replication": (
        model(f'<replicate count="100000"><replicate count="1000">{BODY}</replicate></replicate>'),
        "needs more than 350 MB",
    ),
    "deep nesting": (model("<body>" * 70_000 + "</body>" * 70_000), "nesting is too deep"),
    "pipe included": (model(rest='<include file="pipe.xml"/>'), "pipe.xml: it is not a regular"),
    "device included": (model(rest='<include file="/dev/zero"/>'), "zero: it is not a regular"),
    "including itself": (model(rest='<include file="../here/model.xml"/>'), "already included"),
    "too many tendons": (
        model()[:-18] + TENDON[8:-9].replace(' name="t"', "") * 10_000 + "</tendon></mujoco>",
        "at most 1000000",
    ),
    "uncertain numbers": (
        model()[:-18] + TENDON[8:-9].replace(' name="t"', "") * 1000 + "</tendon></mujoco>",
        "at most 7000 are kept",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_model_is_refused_in_one_line_within_bounds(name, tmp_path):
    text, message = HOSTILE[name]
    folder = tmp_path / "here"
    folder.mkdir()
    os.mkfifo(folder / "pipe.xml")
    path = folder / "model.xml"
    path.write_text(text)
    assert path.stat().st_size < 1_000_000
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, path, "--out", tmp_path / "robot.yaml"],
        capture_output=True, text=True, timeout=300.0, check=True,
    )  # fmt: skip
    code, cpu_s, *memory_kb = map(int, done.stdout.split())
    assert code == 2
    assert cpu_s < 20
    assert max(memory_kb) < 500_000
    assert message in done.stderr
    assert done.stderr.startswith("import_robot: ")
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "robot.yaml").exists()


def test_files_of_meshes_height_fields_and_textures_are_not_needed(tmp_path):
    assets = (
        '<mesh name="m" file="none.stl"/><mesh file="pipe.stl"/>'
        '<hfield name="h" file="none.png" size="1 1 1 1"/>'
        '<texture name="t" type="2d" file="none.png"/><material name="c" texture="t"/>'
    )
    body = (
        '<geom type="hfield" hfield="h"/><body><joint range="0 1"/>'
        '<geom name="g" type="mesh" mesh="m" material="c"/><site name="moving" pos="0.1 0 0"/>'
        '<body><joint/><geom type="cylinder" size="0.01 0.1" material="c"/></body></body>'
    )
    rest = (
        '<contact><pair geom1="g" geom2="g"/></contact><keyframe><key qpos="0 0"/></keyframe>'
        '<tendon><spatial name="s"><site site="a"/><site site="moving"/></spatial></tendon>'
        '<actuator><muscle tendon="s"/></actuator><sensor><tendonpos tendon="s"/></sensor>'
    )
    os.mkfifo(tmp_path / "pipe.stl")
    path = tmp_path / "model.xml"
    path.write_text(model(body, assets=assets, rest=rest))
    found = mjcf.read_mjcf(path)
    assert [cable["name"] for cable in found.document["cables"]] == ["s", "t"]
    assert [joint["name"] for joint in found.document["joints"]] == ["joint_0"]


def test_a_model_that_takes_too_long_is_given_up(tmp_path, monkeypatch):
    assert mjcf.TIME_S < 20.0
    monkeypatch.setattr(mjcf, "TIME_S", 2.0)
    (tmp_path / "many.xml").write_text(model(BODY * 10_000 + "<body/>" * 90_000))
    begin = time.monotonic()
    with pytest.raises(UsageError, match="MuJoCo needs more than 2 s"):
        mjcf.read_mjcf(tmp_path / "many.xml")
    assert time.monotonic() - begin < 4.0 + mjcf.PATIENCE * 2.0

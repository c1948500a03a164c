"""The core on another processor: aarch64 gives the numbers of this one.

The core is cross-compiled without its bindings, as for a Raspberry Pi or a Jetson, and run by an
emulator.  Its own arithmetic has the same bits; functions of the C library may differ in the last.
"""

import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import load_robot

ROOT = Path(__file__).parents[2]
CORE = ROOT / "cdrj_ros" / "core"
COMPILER, EMULATOR = "aarch64-linux-gnu-g++", "qemu-aarch64"
ROBOTS = sorted((ROOT / "config" / "robots").glob("*.yaml"))
SAMPLES = 200


@pytest.fixture(scope="module")
def program():
    """The program, which is kept below build/ until something in it changes."""
    for name, package in ((COMPILER, "g++-aarch64-linux-gnu"), (EMULATOR, "qemu-user")):
        if shutil.which(name) is None:
            pytest.skip(f"{name} is not installed (Debian package {package})")
    folder, main = ROOT / "build" / "aarch64", ROOT / "test" / "support" / "run_robot.cpp"
    made = folder / "run"
    used = [*CORE.glob("*.?pp"), main, Path(__file__)]
    if made.exists() and all(one.stat().st_mtime < made.stat().st_mtime for one in used):
        return made
    folder.mkdir(parents=True, exist_ok=True)
    flags = ["-std=c++20", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror", f"-I{CORE}"]

    def compiled(source):
        target = folder / f"{source.stem}.o"
        subprocess.run([COMPILER, *flags, "-c", source, "-o", target], check=True)
        return target

    sources = [path for path in CORE.glob("*.cpp") if not path.name.startswith("bind")]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        objects = list(pool.map(compiled, [*sources, main]))
    subprocess.run([COMPILER, "-static", *objects, "-o", made], check=True)
    return made


@pytest.mark.skipif(sys.byteorder != "little", reason="the program reads little-endian numbers")
@pytest.mark.parametrize("path", ROBOTS, ids=lambda path: path.stem)
def test_aarch64_gives_the_numbers_of_this_processor(program, path):
    model = prepare(load_robot(path))
    robot = model.robot
    time = np.linspace(0.0, 0.2, SAMPLES)[:, None]
    low = np.array([joint.lower for joint in robot.joints])
    high = np.array([joint.upper for joint in robot.joints])
    middle = robot.reference_pose
    swing = 0.2 * (high - low) * np.sin(20.0 * time + np.arange(len(low)))
    joint = np.ascontiguousarray(np.clip(middle + swing, low, high))
    rest = robot.reference_motors
    motor = np.ascontiguousarray(rest + 0.02 * np.sin(30.0 * time + np.arange(len(rest))))
    dt = np.append(0.0, np.full(SAMPLES - 1, 1e-3))
    stamp_ns = 10**6 * np.arange(SAMPLES)
    expected = run(model, initial_state(model), Samples(stamp_ns, motor, joint))[1].values

    sizes = np.array([model.topology.size, model.constants.size, SAMPLES])
    given = b"".join(
        one.tobytes() for one in (sizes, model.topology, model.constants, motor, joint, dt)
    )
    done = subprocess.run([EMULATOR, program], input=given, stdout=subprocess.PIPE, check=True)
    found = np.frombuffer(done.stdout).reshape(expected.shape)
    assert np.abs(expected).max() > 1.0
    size = np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12 * size)
    assert np.mean(found == expected) > 0.9, "no product and sum are contracted to one rounding"

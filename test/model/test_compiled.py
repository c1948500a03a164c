"""Compiled kernels: their cache follows every source of the model and survives failing disks."""

from __future__ import annotations

import ast
import os
import pickle
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numba
import pytest
from support.warm import Ended, Programs

import cdrj_ros.model
from cdrj_ros.model.compiled import kernel_sources, source_digest

MODEL = Path(cdrj_ros.model.__file__).resolve().parent

# a kernel of mechanism.py calls (37) in friction.py
PROGRAM = """
import numba
import numpy as np
from cdrj_ros.model.mechanism import friction_losses
from cdrj_ros.model.packing import Sizes, empty_robot, number_views, plan_views
from cdrj_ros.model.state import scratch_size, scratch_views

sizes = Sizes(motors=0, joints=0, cables=0, elements=0, pulleys=1, contacts=1, frames=0, nodes=0,
    terms=0, spatial_frames=0, spatial_nodes=0, drums=0)
plan, numbers = empty_robot(sizes)
plan, numbers = plan_views(plan), number_views(sizes, numbers)
plan.pulleys[0].wrap_changes, plan.pulleys[0].cells = 1, 1
pulley = numbers.pulleys[0]
pulley.rho, pulley.mu_c, pulley.mu_s, pulley.stribeck_speed = 1, 0.1, 0.1, 1
scratch = scratch_views(sizes, np.zeros(scratch_size(sizes)))
scratch.wrap[0] = 1
contacts = scratch.contacts
contacts[0].share = 1

@numba.njit
def losses(plan, numbers, lagged_speed, scratch):
    friction_losses(plan, numbers, lagged_speed, scratch)

losses(plan, numbers, np.zeros(1), scratch)
stats = friction_losses.stats
print(contacts[0].loss, sum(stats.cache_hits.values()), sum(stats.cache_misses.values()))
"""


def clean_environment(**more: str) -> dict[str, str]:
    """This process's environment without what directs numba and Python's bytecode."""
    ours = ("NUMBA_", "PYTHONDONTWRITE")
    return {k: v for k, v in os.environ.items() if not k.startswith(ours)} | more


def run_copy(warm: Programs, folder: Path) -> tuple[float, int, int]:
    """Loss at a pulley, kernels found in the cache, kernels compiled."""
    done = warm.run(folder, PROGRAM, clean_environment())
    assert done.returncode == 0, done.stderr
    loss, hits, misses = done.stdout.split()
    return float(loss), int(hits), int(misses)


def test_a_change_in_one_source_reaches_kernels_of_other_sources(
    warm: Programs, tmp_path: Path
) -> None:
    ignored = shutil.ignore_patterns("__pycache__", "assets", "msg")
    shutil.copytree(MODEL.parent, tmp_path / "cdrj_ros", ignore=ignored)
    shutil.copy(MODEL.parents[1] / "package.xml", tmp_path)  # the package's version is in it
    friction = tmp_path / "cdrj_ros" / "model" / "friction.py"

    loss, hits, misses = run_copy(warm, tmp_path)
    assert loss == pytest.approx(0.0951625819640404)  # 1 - exp(-0.1)
    assert (hits, misses) == (0, 1)
    assert run_copy(warm, tmp_path) == (loss, 1, 0), "the second time it comes from the cache"

    text = friction.read_text(encoding="utf-8")
    old = "return exp(-mu * wrap_angle)"
    assert text.count(old) == 1
    friction.write_text(text.replace(old, "return exp(-2.0 * mu * wrap_angle)"), encoding="utf-8")
    changed, hits, _ = run_copy(warm, tmp_path)
    assert changed == pytest.approx(0.1812692469220182)  # 1 - exp(-0.2)
    assert hits == 0


def test_the_stamp_covers_every_source_and_those_named(tmp_path: Path) -> None:
    stamp = source_digest()
    assert source_digest() == stamp
    assert source_digest(MODEL / "friction.py") == stamp, "it is among them already"
    more = tmp_path / "kernel.py"
    more.write_text("x = 1\n", encoding="utf-8")
    first = source_digest(more)
    assert first != stamp
    more.write_text("x = 2\n", encoding="utf-8")
    assert source_digest(more) not in (first, stamp)


def test_kernels_of_one_folder_follow_each_other(tmp_path: Path) -> None:
    room = tmp_path / "room"
    room.mkdir()
    first, second, third = (room / f"{name}.py" for name in ("first", "second", "third"))
    first.write_text("from cdrj_ros.room.second import (\n    f,\n)\n", encoding="utf-8")
    second.write_text(
        "from cdrj_ros.room.third import g\nfrom cdrj_ros.room.first import h\n", encoding="utf-8"
    )
    third.write_text("from cdrj_ros.model.status import SLACK\n", encoding="utf-8")
    assert kernel_sources(first) == {first, second, third}
    assert kernel_sources(third) == {third}


KERNEL = {"compiled", "lean", "stage", "usable_in_kernels"}


def imported_into_kernels(file: Path) -> dict[str, str]:
    """Names from the package that kernels in a file use, and the modules they come from."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    kernels = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
        and any(isinstance(d, ast.Name) and d.id in KERNEL for d in node.decorator_list)
    ]
    used = {node.id for one in kernels for node in ast.walk(one) if isinstance(node, ast.Name)}
    found = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            found |= {a.asname or a.name: str(node.module) for a in node.names}
        elif isinstance(node, ast.Import):
            found |= {(a.asname or a.name).split(".")[0]: a.name for a in node.names}
    return {n: found[n] for n in used - KERNEL if found.get(n, "").startswith("cdrj_ros")}


def test_kernels_use_nothing_that_their_stamp_does_not_cover() -> None:
    package = MODEL.parent
    checked = 0
    for file in package.rglob("*.py"):
        if file.parent == MODEL:
            continue
        for name, module in imported_into_kernels(file).items():
            source = package.parent.joinpath(*module.split(".")).with_suffix(".py")
            known = source.parent == MODEL or source in kernel_sources(file)
            assert known, f"{name} of {module} is in a kernel of {file}, but not in its stamp"
            checked += source.parent != MODEL
    assert checked > 20, "kernels for joints without encoder call each other"


RunLeast = Callable[..., Ended]

# the smallest program that compiles a kernel, on a copy of the package
LEAST = """
import logging, sys
logging.basicConfig(format="%(message)s")
{before}
from cdrj_ros.model.compiled import kernels_are_compiled
from cdrj_ros.model.friction import sliding_transmission
before = kernels_are_compiled(sliding_transmission)
print(
    sliding_transmission(0.0, 0.1, 0.1, 1.0, 1.0, 0),
    before, kernels_are_compiled(sliding_transmission),
)
print(sum(sliding_transmission.stats.cache_hits.values()) if hasattr(
    sliding_transmission.stats, "cache_hits") else 0)
"""


def run_program(folder: Path, program: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Start Python as a user does."""
    return subprocess.run(
        [sys.executable, "-c", program],
        cwd=folder,
        env=clean_environment(**{"PYTHONPATH": str(folder), **environment}),
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture(scope="module")
def run_least(warm: Programs) -> RunLeast:
    """Run ``LEAST``: the transmission, whether it was and is compiled, kernels found on disk."""

    def run(folder: Path, before: str = "", **environment: str) -> Ended:
        return warm.run(folder, LEAST.format(before=before), clean_environment(**environment))

    return run


def copy_package(folder: Path) -> Path:
    """Copy the package without compiled kernels."""
    ignored = shutil.ignore_patterns("__pycache__", "assets", "msg")
    shutil.copytree(MODEL.parent, folder / "cdrj_ros", ignore=ignored)
    shutil.copy(MODEL.parents[1] / "package.xml", folder)
    return folder


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    """A copy of the package without compiled kernels."""
    return copy_package(tmp_path)


@pytest.fixture(scope="module")
def built_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = copy_package(tmp_path_factory.mktemp("built"))
    done = run_program(folder, LEAST.format(before=""))
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[0].split()[1:] == ["False", "True"]
    return folder


@pytest.fixture
def built(tmp_path: Path, built_once: Path) -> Path:
    """A copy of the package with the kernels of ``LEAST`` beside their sources."""
    shutil.copytree(built_once, tmp_path / "package")
    return tmp_path / "package"


NOWHERE = {"HOME": "/dev/null/home", "XDG_CACHE_HOME": "/dev/null/cache"}


def test_without_a_place_for_kernels_they_are_compiled_in_memory_and_it_is_said(
    run_least: RunLeast,
    copied: Path,
) -> None:
    (copied / "cdrj_ros" / "model" / "__pycache__").touch()  # a file: not writable
    done = run_least(copied, **NOWHERE)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("0.9048374180359595")
    assert done.stderr.count("there is no place for compiled kernels") == 1
    assert len(done.stderr.splitlines()) == 1


def test_a_full_disk_does_not_stop_a_kernel(run_least: RunLeast, copied: Path) -> None:
    full = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))"
    done = run_least(copied, full)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("0.9048374180359595")
    assert done.stderr.count("compiled kernels cannot be kept in") == 1
    assert len(done.stderr.splitlines()) == 1


def test_installed_kernels_run_where_nothing_can_be_written(
    run_least: RunLeast, built: Path
) -> None:
    refused = """
import tempfile
def refuse(*_, **__): raise PermissionError("read-only")
tempfile.TemporaryFile = refuse
"""
    done = run_least(built, refused, **NOWHERE)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[1] == "1", "loaded, not compiled"
    assert not done.stderr


# another user: nothing can be written beside the sources
NOT_HERE = """
import tempfile
really = tempfile.TemporaryFile
def refuse(*arguments, dir=None, **options):
    if "cdrj_ros" in str(dir):
        raise PermissionError("read-only")
    return really(*arguments, dir=dir, **options)
tempfile.TemporaryFile = refuse
"""


def another_user(folder: Path) -> dict[str, str]:
    """Variables of a user with a home and a cache folder of their own."""
    home = folder / "another home"
    home.mkdir()
    return {"HOME": str(home), "XDG_CACHE_HOME": str(home / "cache")}


def kept_by(user: dict[str, str]) -> list[str]:
    """Kernels in a user's own folder."""
    return sorted(path.name for path in Path(user["HOME"]).rglob("*.nbc"))


def test_kernels_that_the_build_left_serve_every_user(run_least: RunLeast, built: Path) -> None:
    user = another_user(built)
    done = run_least(built, NOT_HERE, **user)
    assert done.returncode == 0, done.stderr
    first, hits = done.stdout.splitlines()
    assert first.split()[1:] == ["True", "True"], "nothing to be announced"
    assert hits == "1", "loaded, not compiled"
    assert not done.stderr
    assert not kept_by(user)


def test_what_the_build_did_not_leave_is_kept_in_the_users_folder(
    run_least: RunLeast, copied: Path
) -> None:
    user = another_user(copied)
    assert run_least(copied, NOT_HERE, **user).stdout.splitlines()[1] == "0"
    assert any(name.startswith("friction.sliding_transmission-") for name in kept_by(user))
    again = run_least(copied, NOT_HERE, **user)
    assert again.stdout.splitlines()[1] == "1"
    assert not again.stderr


def test_kernels_of_another_version_of_numba_are_ignored_and_it_is_said(
    run_least: RunLeast, built: Path
) -> None:
    folder = built / "cdrj_ros" / "model" / "__pycache__"
    (index,) = folder.glob("friction.sliding_transmission-*.nbi")
    with index.open("rb") as file:
        pickle.load(file)  # noqa: S301 - the version of numba
        rest = file.read()
    index.write_bytes(pickle.dumps("0.1.2", protocol=-1) + rest)
    user = another_user(built)
    done = run_least(built, NOT_HERE, **user)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[0].split() == ["0.9048374180359595", "False", "True"]
    (line,) = done.stderr.splitlines()
    assert f"in {folder} are of numba 0.1.2, this is {numba.__version__}" in line
    assert not run_least(built, NOT_HERE, **user).stderr, "now there are newer ones"


def test_kernels_for_another_processor_are_ignored_and_it_is_said(
    run_least: RunLeast, built: Path
) -> None:
    user = another_user(built)
    other = {**user, "NUMBA_CPU_NAME": "core2", "NUMBA_CPU_FEATURES": "+sse2"}
    done = run_least(built, NOT_HERE, **other)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[0].split() == ["0.9048374180359595", "False", "True"]
    (line,) = done.stderr.splitlines()
    assert f"in {built / 'cdrj_ros' / 'model' / '__pycache__'} are for another processor" in line
    assert any(name.startswith("friction.sliding_transmission-") for name in kept_by(user))
    assert not run_least(built, NOT_HERE, **other).stderr


@pytest.mark.parametrize("ending", ["nbi", "nbc"])
def test_damaged_kernels_of_the_build_are_compiled_into_the_users_folder(
    run_least: RunLeast, built: Path, ending: str
) -> None:
    folder = built / "cdrj_ros" / "model" / "__pycache__"
    (damaged,) = folder.glob(f"friction.sliding_transmission-*.{ending}")
    damaged.write_bytes(damaged.read_bytes()[:40])
    user = another_user(built)
    done = run_least(built, NOT_HERE, **user)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("0.9048374180359595")
    assert done.stderr.count("is discarded and compiled anew") == 1
    assert len(done.stderr.splitlines()) == 1
    assert len(damaged.read_bytes()) == 40, "it is not this user's"
    assert run_least(built, NOT_HERE, **user).stdout.splitlines()[1] == "1"


@pytest.mark.parametrize("ending", ["nbi", "nbc"])
@pytest.mark.parametrize("left", [0, 40])
def test_a_damaged_kernel_is_discarded_and_compiled_anew(
    run_least: RunLeast, built: Path, ending: str, left: int
) -> None:
    folder = built / "cdrj_ros" / "model" / "__pycache__"
    (damaged,) = folder.glob(f"friction.sliding_transmission-*.{ending}")
    damaged.write_bytes(damaged.read_bytes()[:left])
    done = run_least(built)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("0.9048374180359595")
    assert done.stderr.count("is discarded and compiled anew") == 1
    assert len(done.stderr.splitlines()) == 1
    again = run_least(built)
    assert again.stdout.splitlines()[1] == "1"
    assert not again.stderr


def test_kernels_are_compiled_once_all_of_them_are_on_disk(
    run_least: RunLeast, warm: Programs, copied: Path
) -> None:
    assert run_least(copied).stdout.splitlines()[0].split()[1:] == ["False", "True"]
    assert run_least(copied).stdout.splitlines()[0].split()[1:] == ["True", "True"]
    more = "from cdrj_ros.model.mechanism import advance, advance_all"
    missing = "kernels_are_compiled(sliding_transmission, advance)"
    program = LEAST.replace("kernels_are_compiled(sliding_transmission)", missing)
    done = warm.run(copied, program.format(before=more), clean_environment())
    assert done.stdout.splitlines()[0].split()[1:] == ["False", "False"]


def test_python_stands_in_for_a_kernel_until_it_is_to_be_compiled(
    warm: Programs, copied: Path
) -> None:
    program = """
from cdrj_ros.model.compiled import compile_at_calls, interpret
from cdrj_ros.model.friction import stribeck_share

def share():
    return stribeck_share(0.1, 1.0), len(stribeck_share.overloads)

for change in (interpret, compile_at_calls, interpret):
    change(stribeck_share)
    print(*share())
"""
    done = warm.run(copied, program, clean_environment())
    shares, overloads = zip(*(line.split() for line in done.stdout.splitlines()), strict=True)
    assert len(set(shares)) == 1, done.stderr
    assert overloads == ("0", "1", "1")  # once compiled, it stays so


def test_kernels_without_a_place_on_disk_do_not_count_as_compiled(
    run_least: RunLeast, copied: Path
) -> None:
    (copied / "cdrj_ros" / "model" / "__pycache__").touch()
    done = run_least(copied, **NOWHERE)
    assert done.stdout.splitlines()[0].split()[1:] == ["False", "False"]


def test_without_compilation_nothing_is_left_to_compile(run_least: RunLeast, copied: Path) -> None:
    done = run_least(copied, NUMBA_DISABLE_JIT="1")
    assert done.stdout.splitlines()[0].split()[1:] == ["True", "True"], done.stderr


# runs every kernel of estimation in one process
EVERYTHING = """
import numpy as np
from cdrj_ros.conditioning.samples import Sample, Samples
from cdrj_ros.estimation.ensemble import Spread
from cdrj_ros.estimation.estimator import initial_state, run, step
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.prepared import shape_at
from cdrj_ros.rig.follow import follow_joints
from cdrj_ros.rig.prescribed import follow
from support.signatures import count_signatures

model = load_model("prototype")
time = np.arange(40) * 1e-3
joint = 0.1 * np.sin(40.0 * time)[:, None]
motor = follow_joints(model, joint).motor_angle
stamps = (1e9 * (1.0 + time)).astype(np.int64)
unseen = np.zeros((time.size, 2, 2))
unseen[20:, :, 0] = 1e-3
shape_at(model, joint[1])
for samples in (Samples(stamps, motor, joint), Samples(stamps, motor, joint, unseen)):
    state, spread = initial_state(model), Spread(model)
    for k in range(time.size):
        state, estimate = step(model, state, samples.at(k))
        spread.update(samples.at(k), estimate)
    spread.catch_up(samples.at(time.size - 1), estimate)
    Spread(model).step(initial_state(model), samples.at(0))
    run(model, initial_state(model), samples)
    spread.run(initial_state(model), samples)
backwards = Samples(stamps, motor[::-1], joint[::-1])  # neither contiguous ...
stamps.flags.writeable = joint.flags.writeable = False  # ... nor writable arrays
unwritable = Samples(stamps, motor, joint)
for samples in (backwards, unwritable):
    run(model, initial_state(model), samples)
    Spread(model).run(initial_state(model), samples)
    Spread(model).step(initial_state(model), samples.at(1))
    step(model, initial_state(model), Sample(stamps[0], np.repeat(motor[0], 2)[::2], joint[0]))
follow(model.robot, time, joint, cells=2)
for name, count in count_signatures().items():
    print(name, count)
"""


def test_every_kernel_is_compiled_for_one_signature() -> None:
    root = MODEL.parents[1]
    paths = os.pathsep.join([str(root), str(root / "test")])
    done = run_program(root, EVERYTHING, PYTHONPATH=paths, PYTHONWARNINGS="ignore")
    assert done.returncode == 0, done.stderr
    counts = {name: int(count) for name, count in map(str.split, done.stdout.splitlines())}
    compiled_twice = {name: count for name, count in counts.items() if count > 1}
    assert not compiled_twice
    outermost = (
        "model.mechanism.advance_all",
        "model.shape.shape",
    )
    for name in (*outermost, "model.cable._walk"):
        assert counts[f"cdrj_ros.{name}"] == 1


PARTS = """
from cdrj_ros.model.compiled import callee, lean, stage

@stage
def doubled(x):
    return 2.0 * x

@callee
def quadrupled(x):
    return doubled(doubled(x))

@lean
def more(x):
    return quadrupled(x) + 1.0

for part in (doubled, quadrupled):  # before and after a kernel uses them
    for _ in range(2):
        try:
            part(1.0)
        except TypeError as error:
            print(error)
        print(more(1.0))
"""


def test_python_cannot_call_what_only_kernels_call(warm: Programs, tmp_path: Path) -> None:
    (tmp_path / "parts.py").write_text(PARTS, encoding="utf-8")
    done = warm.run(tmp_path, "import parts", {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)})
    assert done.returncode == 0, done.stderr
    expected = [
        line
        for name in ("doubled", "quadrupled")
        for line in 2 * (f"only kernels can call {name}", "5.0")
    ]
    assert done.stdout.splitlines() == expected

"""Reading of MuJoCo models (MJCF) in bounded time and memory.

A few hundred bytes of MJCF can ask MuJoCo's compiler for gigabytes, by a height field, a grid of
bodies or nested replication.  Therefore it runs in a process of its own, with limits, which also
converts what it has compiled; a model that is too large, or that ends the compiler, ends only that
process.  XML files that a model names must be regular ones, since reading others might not end.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import numpy as np

from cdrj_ros.foundation.errors import CdrjError, UsageError
from cdrj_ros.foundation.files import InputError, parse_xml, read_regular
from cdrj_ros.foundation.output import printable
from cdrj_ros.robot.mjcf_tendons import Imported, convert

LARGEST_XML: Final = 20_000_000
"""Largest accepted size of a model's XML files, each [bytes]."""

MEMORY: Final = 350_000_000
"""Memory of the process that compiles [bytes]."""

TIME_S: Final = 15.0
"""Time of the processor in which a model must be compiled and converted [s]."""

PATIENCE: Final = 4.0
"""Time that this may last on a busy computer, over ``TIME_S``."""

LARGEST_RESULT: Final = 8_000_000
"""Largest accepted size of what is converted, as JSON [bytes]; a robot file has 1e6 at most."""

FARTHEST_M: Final = 1e6
"""Maximum coordinate or size that is read [m]."""


def load_mujoco() -> ModuleType:
    """The ``mujoco`` package.

    Raises:
        UsageError: it is not installed, or not whole.
    """
    try:
        import mujoco
    except ImportError as error:
        raise UsageError(
            f"reading MJCF needs the package mujoco ({printable(str(error).splitlines()[0])}): "
            "pip install mujoco"
        ) from error
    module: ModuleType = mujoco
    return module


def read_mjcf(path: str | Path, tendons: Sequence[str] | None = None) -> Imported:
    """Read a MuJoCo model's spatial tendons, in a process of its own.

    Args:
        path: MJCF file.
        tendons: names of those that become cables; None for all.

    Raises:
        UsageError: the model cannot be read within the limits, or none of its tendons can be
            represented.
    """
    name = printable(str(path))
    _check_files(Path(path))
    wanted = None if tendons is None else [*tendons]
    arguments = json.dumps([str(Path(path).absolute()), name, wanted, round(TIME_S)])
    folders = [str(Path(entry).absolute()) for entry in sys.path]  # "" is the current folder
    with tempfile.TemporaryDirectory() as folder:  # MuJoCo writes a log into the current folder
        late = f"cannot read {name}: MuJoCo needs more than {TIME_S:g} s for it"
        try:
            done = subprocess.run(
                [sys.executable, "-m", "cdrj_ros.robot.mjcf", arguments],
                cwd=folder,
                env={**os.environ, "PYTHONPATH": os.pathsep.join(folders)},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                timeout=PATIENCE * TIME_S,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise UsageError(late) from None
    if done.returncode == -signal.SIGXCPU:
        raise UsageError(late)
    if not done.stdout:
        raise UsageError(
            f"cannot read {name}: MuJoCo gave up, or needs more than {MEMORY / 1e6:.0f} MB for it"
        )
    found: dict[str, Any] = json.loads(done.stdout)
    if "error" in found:
        raise UsageError(found["error"])
    return Imported(**found)


def _check_files(model: Path) -> None:
    """Refuse a model with XML files that are not regular, too large together, or no XML.

    Raises:
        UsageError: names the file.
    """
    left, waiting, seen = LARGEST_XML, [model.absolute()], set[Path]()
    while waiting:
        path = waiting.pop()
        try:
            data = read_regular(path, left)
            root = parse_xml(data)
        except InputError as error:
            raise UsageError(f"cannot read {printable(str(path))}: {error}") from error
        left -= len(data)
        named = [one.get("file", "") for one in root.iter() if one.tag in ("include", "model")]
        places = {
            folder / name for folder in (model.absolute().parent, path.parent) for name in named
        }
        found = {one for one in map(_existing, places) if one} - seen
        seen |= found
        waiting += found


def _existing(place: Path) -> Path | None:
    """The path without links; None where there is no file, which MuJoCo will say."""
    try:
        found = place.resolve(strict=True)
    except (OSError, ValueError, RuntimeError):
        return None
    return None if found.is_dir() else found


def _check_numbers(model: Any, name: str) -> None:
    """Raise UsageError if a position or size is not finite, or too large for a robot file."""
    for what, one, values in (
        ("body", model.body, model.body_pos),
        ("joint", model.jnt, model.jnt_pos),
        ("site", model.site, model.site_pos),
        ("geom", model.geom, np.hstack([model.geom_pos, model.geom_size])),
    ):
        wrong = ~(np.abs(values) <= FARTHEST_M).all(axis=1)
        if wrong.any():
            k = int(np.flatnonzero(wrong)[0])
            raise UsageError(
                f"{printable(name)}: position or size of {what} {printable(one(k).name)!r} "
                f"must be finite and at most {FARTHEST_M:g} m, got {values[k].tolist()}"
            )


def compiled(mujoco: ModuleType, path: str | Path) -> Any:
    """The ``MjModel`` of a file, without what tendons do not need.

    Meshes, height fields and textures are left out with all that uses them, so that their files
    may be missing; masses, which they give, do not count for lengths.
    """
    spec = mujoco.MjSpec.from_file(str(path))
    kinds = mujoco.mjtGeom
    shaped = (kinds.mjGEOM_MESH, kinds.mjGEOM_HFIELD, kinds.mjGEOM_SDF)
    left_out = [*spec.sensors, *spec.pairs, *spec.tuples, *spec.keys, *spec.skins, *spec.hfields]
    left_out += [*spec.textures, *(geom for geom in spec.geoms if geom.type in shaped)]
    fitted = {geom.meshname for geom in spec.geoms if geom.type not in shaped}
    left_out += [mesh for mesh in spec.meshes if mesh.name not in fitted]
    for one in left_out:
        spec.delete(one)
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    spec.compiler.boundmass = spec.compiler.boundinertia = 1.0
    spec.compiler.balanceinertia = True
    spec.compiler.LRopt.mode = mujoco.mjtLRMode.mjLRMODE_NONE  # muscles would be simulated
    # Memory for contacts and constraints in motion, of which no use is made: the least.
    spec.memory = spec.njmax = spec.nconmax = -1
    return spec.compile()


def _imported(path: str, name: str, tendons: list[str] | None) -> dict[str, Any]:
    """What ``read_mjcf`` returns, or its error, as plain values."""
    try:
        mujoco = load_mujoco()
    except UsageError as error:
        return {"error": str(error)}
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        model = compiled(mujoco, path)
        _check_numbers(model, name)
        return asdict(convert(mujoco, model, name, tendons))
    except CdrjError as error:
        return {"error": str(error)}
    except MemoryError:
        return {"error": f"cannot read {name}: MuJoCo needs more than {MEMORY / 1e6:.0f} MB for it"}
    except RecursionError:
        return {"error": f"cannot read {name}: its bodies are nested too deep"}
    except (ValueError, OSError, mujoco.FatalError) as error:
        reason = printable(" ".join(str(error).split())[:300])
        return {"error": f"cannot read {name}: {reason}"}


def _serve(path: str, name: str, tendons: list[str] | None, time_s: int) -> None:
    """Compile within limits and write the result to standard output."""
    for kind, most in (
        (resource.RLIMIT_DATA, MEMORY),
        (resource.RLIMIT_CORE, 0),
        (resource.RLIMIT_CPU, time_s),
        (resource.RLIMIT_FSIZE, 1_000_000),
    ):
        hard = resource.getrlimit(kind)[1]
        allowed = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(kind, (allowed, hard))  # beyond the hard one, SIGKILL
    with os.fdopen(os.dup(1), "w", encoding="utf-8") as answer:
        os.dup2(2, 1)  # what MuJoCo prints is no answer
        text = json.dumps(_imported(path, name, tendons))
        if len(text) > LARGEST_RESULT:
            text = json.dumps({"error": f"cannot read {name}: it is too large for a robot file"})
        answer.write(text)


if __name__ == "__main__":
    _serve(*json.loads(sys.argv[1]))

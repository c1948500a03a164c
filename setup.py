"""Build and install the ament_python package `cdrj_ros`, with colcon or as a wheel."""

import os
import subprocess
import sys
import sysconfig
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from xml.etree import ElementTree

from setuptools import Extension, find_packages, setup
from setuptools.command.build_ext import build_ext

PACKAGE = "cdrj_ros"
STUB = Path(PACKAGE) / "_core.pyi"


def installed(folder: str, pattern: str = "**/*") -> list[tuple[str, list[str]]]:
    """List the matching files of `folder`, by their destination below share/."""
    places: dict[str, list[str]] = {}
    for path in sorted(Path(folder).glob(pattern)):
        if path.is_file() and "__pycache__" not in path.parts:
            places.setdefault(f"share/{PACKAGE}/{path.parent}", []).append(str(path))
    return list(places.items())


def requirements(name: str) -> list[str]:
    """Read a list of requirements without ROS: those of package.xml, but with versions."""
    # With --symlink-install, colcon runs this file through a link in another folder.
    path = Path(__file__).resolve().parent / "requirements" / f"{name}.txt"
    lines = path.read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def scripts(folder: str, *names: str) -> list[str]:
    """Name the entry points of a room."""
    return [f"{name} = {PACKAGE}.{folder}.entry:{name}" for name in names]


def headers() -> list[str]:
    """Name the folders of what the core includes: nanobind, what it includes itself, and NumPy."""
    # Other commands do without them.
    import nanobind
    import numpy

    own = nanobind.include_dir()
    beside = str(Path(own).parent / "ext" / "robin_map" / "include")
    return [own, nanobind.source_dir(), beside, numpy.get_include()]


def core() -> Extension:
    """Describe the compiled core, `cdrj_ros/core`.

    Every build gives the same bits: no product and sum are contracted to one rounding, which other
    processors than those of PCs do by default, and arithmetic is as written.
    """
    folder = Path(PACKAGE) / "core"
    return Extension(
        f"{PACKAGE}._core",
        sources=sorted(map(str, folder.glob("*.cpp"))),
        depends=sorted(map(str, folder.glob("*.hpp"))),
        extra_compile_args=[
            "-std=c++20", "-O2", "-g0", "-ffp-contract=off", "-fvisibility=hidden",
            "-Wall", "-Wextra",
        ],
        language="c++",
    )  # fmt: skip


def is_newer(made: Path, sources: Iterable[str]) -> bool:
    """Say whether a file exists and was made after all of its sources."""
    if not made.exists():
        return False
    when = made.stat().st_mtime
    return all(Path(source).stat().st_mtime < when for source in sources)


class BuildExt(build_ext):
    """Compiles the files of the core side by side, those alone that have changed."""

    def run(self):
        """Run the command, unless it would put a module beside sources that have not changed."""
        made = Path(PACKAGE) / f"_core{sysconfig.get_config_var('EXT_SUFFIX')}"
        (ext,) = self.extensions
        sources = (*ext.sources, *ext.depends, __file__)
        if self.inplace and is_newer(made, sources) and is_newer(STUB, sources):
            return
        super().run()
        self.write_stub(Path(self.get_ext_fullpath(ext.name)).parent)

    def write_stub(self, folder):
        """Write the types of the core, which lies in `folder`, beside it."""
        here = {"PYTHONPATH": os.pathsep.join([str(folder), *sys.path])}
        options = ["-q", "-m", "_core", "-O", str(folder)]
        subprocess.run(
            [sys.executable, "-m", "nanobind.stubgen", *options], env=os.environ | here, check=True
        )

    def build_extension(self, ext):
        """Build an extension: compile its files, then link them."""
        files, ext.sources = ext.sources, []
        include_dirs = headers()
        used = [*ext.depends, __file__]
        ext.depends = [*used, *files]  # what is linked anew if one of them has changed

        def compiled(file: str) -> list[str]:
            made = self.compiler.object_filenames([file], output_dir=self.build_temp)
            if is_newer(Path(made[0]), (file, *used)):
                return made
            # nanobind asks for this; the rest of the core is a tenth slower with it.
            binds = ["-fno-strict-aliasing"] if Path(file).name.startswith("bind") else []
            return self.compiler.compile(
                [file],
                output_dir=self.build_temp,
                include_dirs=include_dirs,
                extra_postargs=ext.extra_compile_args + binds,
            )

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            ext.extra_objects = [one for made in pool.map(compiled, files) for one in made]
        super().build_extension(ext)
        ext.sources = files


# pip installs through a wheel, colcon does not.  The scripts of a wheel are on the path, where
# `watch` would shadow the system's, and pip cannot install the ROS packages that the nodes import.
AS_WHEEL = bool({"bdist_wheel", "dist_info", "editable_wheel"} & set(sys.argv))

NODES = ("commission", "estimator", "markers", "replay", "rig", "view", "watch")

about = ElementTree.parse("package.xml").getroot()
maintainer = about.find("maintainer")

setup(
    name=PACKAGE,
    version=about.findtext("version"),
    description=" ".join(about.findtext("description").split()),
    maintainer=maintainer.text,
    maintainer_email=maintainer.get("email"),
    license=about.findtext("license"),
    python_requires=">=3.10",
    install_requires=requirements("runtime"),
    extras_require={
        "mujoco": requirements("mujoco"),
        "view": requirements("view"),
    },
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    # recordings/msg is a link to the message definitions; a build copies the files themselves.
    package_data={
        PACKAGE: [
            "**/*.json",
            "**/*.html",
            "**/*.css",
            "recordings/msg/*.msg",
            "py.typed",
            "_core.pyi",
        ]
    },
    ext_modules=[core()],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        *installed("launch", "*.launch.py"),
        *installed("config"),
        *installed("bags"),
        *installed("examples", "**/*.py"),
    ],
    entry_points={
        "console_scripts": [
            *scripts(
                "commands",
                "check_robot",
                "identify",
                "import_robot",
                "simulate",
                "validate",
            ),
            *(scripts("commands", "commission", "view") if AS_WHEEL else scripts("nodes", *NODES)),
        ],
    },
    cmdclass={"build_ext": BuildExt},
    zip_safe=False,
)

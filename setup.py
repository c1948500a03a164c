"""Build and install the ament_python package `cdrj_ros`, with colcon or as a wheel."""

import sys
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

PACKAGE = "cdrj_ros"


def installed(folder: str, pattern: str = "**/*") -> list[tuple[str, list[str]]]:
    """List the matching files of `folder`, by their destination below share/."""
    places: dict[str, list[str]] = {}
    for path in sorted(Path(folder).glob(pattern)):
        if path.is_file() and "__pycache__" not in path.parts:
            places.setdefault(f"share/{PACKAGE}/{path.parent}", []).append(str(path))
    return list(places.items())


def requirements() -> list[str]:
    """Read the requirements without ROS: those of package.xml, but with versions."""
    # With --symlink-install, colcon runs this file through a link in another folder.
    path = Path(__file__).resolve().parent / "requirements" / "runtime.txt"
    lines = path.read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def scripts(folder: str, *names: str) -> list[str]:
    """Name the entry points of a room."""
    return [f"{name} = {PACKAGE}.{folder}.entry:{name}" for name in names]


# pip installs through a wheel, colcon does not.  The scripts of a wheel are on the path, where
# `watch` would shadow the system's, and pip cannot install the ROS packages that the nodes import.
AS_WHEEL = bool({"bdist_wheel", "dist_info", "editable_wheel"} & set(sys.argv))

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
    install_requires=requirements(),
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    # bag/msg is a link to the message definitions; a build copies the files themselves.
    package_data={PACKAGE: ["**/*.json", "**/*.html", "**/*.css", "bag/msg/*.msg", "py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        *installed("launch", "*.launch.py"),
        *installed("config"),
        *installed("bags"),
        *installed("examples", "*.py"),
    ],
    entry_points={
        "console_scripts": [
            *scripts("commands", "check_robot", "identify", "reproduce", "simulate", "validate"),
            *([] if AS_WHEEL else scripts("nodes", "estimator", "replay", "rig", "watch")),
        ],
    },
    zip_safe=False,
)

"""Build and install the ament_python package `cdrj_ros`."""

from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

PACKAGE = "cdrj_ros"


def installed(folder: str, pattern: str = "**/*") -> list[tuple[str, list[str]]]:
    """List the files of `folder` that match, each with its place below share/."""
    places: dict[str, list[str]] = {}
    for path in sorted(Path(folder).glob(pattern)):
        if path.is_file() and "__pycache__" not in path.parts:
            places.setdefault(f"share/{PACKAGE}/{path.parent}", []).append(str(path))
    return list(places.items())


about = ElementTree.parse("package.xml").getroot()
maintainer = about.find("maintainer")

setup(
    name=PACKAGE,
    version=about.findtext("version"),
    description=" ".join(about.findtext("description").split()),
    maintainer=maintainer.text,
    maintainer_email=maintainer.get("email"),
    license=about.findtext("license"),
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    # bag/msg is a link to the message definitions; a build copies the files themselves.
    package_data={PACKAGE: ["**/*.json", "**/*.html", "**/*.css", "bag/msg/*.msg", "py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        *installed("launch", "*.launch.py"),
        *installed("config"),
        *installed("bags"),
    ],
    entry_points={
        "console_scripts": [
            f"check_robot = {PACKAGE}.commands.entry:check_robot",
            f"estimator = {PACKAGE}.nodes.entry:estimator",
            f"identify = {PACKAGE}.commands.entry:identify",
            f"replay = {PACKAGE}.nodes.entry:replay",
            f"reproduce = {PACKAGE}.commands.entry:reproduce",
            f"simulate = {PACKAGE}.commands.entry:simulate",
            f"validate = {PACKAGE}.commands.entry:validate",
        ],
    },
    zip_safe=False,
)

"""A virtual tension sensor for cables that run over pulleys, for ROS 2."""

import re
from pathlib import Path


def _version() -> str:
    """Read the version from package.xml, beside the source; an installed copy has metadata."""
    manifest = Path(__file__).resolve().parents[1] / "package.xml"
    if manifest.is_file():
        found = re.search(r"<version>(.+?)</version>", manifest.read_text(encoding="utf-8"))
        if found:
            return found[1]
    from importlib import metadata  # slow, and not needed beside the source

    return metadata.version("cdrj_ros")


__version__ = _version()

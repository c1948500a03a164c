"""A virtual tension sensor for cables that run over pulleys, for ROS 2."""

__version__: str
"""The version in package.xml."""


def __getattr__(name: str) -> str:
    """Read the version when it is asked for: a command must be able to handle Ctrl-C before."""
    if name != "__version__":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    version = _version()
    globals()[name] = version
    return version


def _version() -> str:
    """Read the version from package.xml, beside the source; an installed copy has metadata."""
    import re
    from pathlib import Path

    manifest = Path(__file__).resolve().parents[1] / "package.xml"
    if manifest.is_file():
        found = re.search(r"<version>(.+?)</version>", manifest.read_text(encoding="utf-8"))
        if found:
            return found[1]
    from importlib import metadata  # slow, and not needed beside the source

    return metadata.version("cdrj_ros")

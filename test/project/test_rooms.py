"""The list of rooms in CONTRIBUTING.md agrees with the packages; only nodes need ROS."""

import ast
import re

from support.places import ROOT, ROS

PACKAGE = ROOT / "cdrj_ros"
ROW = re.compile(r"^\| `(\w+)(?:/|\.py)` \| (.+?) \| (.+?) \|$", re.MULTILINE)
ROOMS = {name: (door, imports) for name, door, imports in ROW.findall(
    (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
)}  # fmt: skip


def may_import(room):
    words = ROOMS[room][1]
    if words.startswith("every room"):
        return set(ROOMS) - set(re.findall(r"but (\w+)", words))
    return set(re.findall(r"\w+", words)) | {room}


def modules():
    return sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


def room_of(path):
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported(path):
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.module, f"{path.name} imports by a relative name"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def test_every_room_is_listed_and_no_module_is_outside_a_room():
    found = {
        path.name.removesuffix(".py")
        for path in PACKAGE.iterdir()
        if path.name not in ("__init__.py", "py.typed", "__pycache__", "_core.pyi")
        and path.suffix != ".so"
        and not (path.is_dir() and not any(path.glob("*.py")) and path.name != "core")
    }
    assert found == set(ROOMS)


def test_a_module_imports_only_what_its_room_may():
    for path in modules():
        room = room_of(path)
        for name in imported(path):
            parts = name.split(".")
            if parts[0] == "cdrj_ros" and parts[1] != "__version__":
                below = "core" if parts[1] == "_core" else parts[1]
                assert below in may_import(room), f"{path} imports {name}"
            if room != "nodes":
                assert parts[0] not in ROS, f"{path} imports {name}"

"""The package uses the public names of other libraries only, and changes none."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FILES = sorted(
    path for folder in ("cdrj_ros", "bench", "tools") for path in (ROOT / folder).rglob("*.py")
)

PUBLIC = {"_asdict", "_fields", "_make", "_replace", "_exit"}
"""Documented names that begin with an underscore: those of named tuples, and ``os._exit``."""


def private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__")


def defined(tree: ast.Module) -> set[str]:
    """Names that a module defines: functions, classes, and what it assigns or annotates."""
    names = set()
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                names.add(name)
            case ast.ClassDef(name=name):
                names.add(name)
            case ast.Name(id=name, ctx=ast.Store()):
                names.add(name)
            case ast.Attribute(value=ast.Name(id="self" | "cls"), attr=name, ctx=ast.Store()):
                names.add(name)
    return names


def foreign(tree: ast.Module, own: set[str]) -> list[tuple[str, int]]:
    """Private names that are used, but not defined by the package, with their lines."""
    found = []
    for node in ast.walk(tree):
        match node:
            case ast.Attribute(attr=name) if private(name) and name not in own:
                found.append((name, node.lineno))
            case ast.Import(names=aliases):
                parts = {part for one in aliases for part in one.name.split(".")}
                found += [(part, node.lineno) for part in parts if private(part)]
            case ast.ImportFrom(module=module, names=aliases) if not of_the_package(module):
                parts = {*(module or "").split("."), *(one.name for one in aliases)}
                found += [(part, node.lineno) for part in parts if private(part)]
    return found


def patched(tree: ast.Module) -> list[tuple[str, int]]:
    """Attributes of imported modules, classes and functions that are set or deleted.

    What ``import_module`` returns is one, too.
    """
    imported = set()
    for node in ast.walk(tree):
        match node:
            case ast.Import(names=aliases) | ast.ImportFrom(names=aliases):
                imported |= {(one.asname or one.name).split(".")[0] for one in aliases}
            case (
                ast.Assign(targets=[ast.Name(id=name)], value=value)
                | ast.AnnAssign(target=ast.Name(id=name), value=ast.expr() as value)
            ) if "import_module" in ast.unparse(value):
                imported.add(name)
    found = []
    for node in ast.walk(tree):
        match node:
            case ast.Attribute(ctx=ast.Store() | ast.Del()):
                changed: ast.expr = node
            case ast.Call(
                func=ast.Name(id="setattr" | "delattr")
                | ast.Attribute(value=ast.Name(id="object"), attr="__setattr__"),
                args=[ast.expr() as changed, *_],
            ):
                pass
            case _:
                continue
        root = changed
        while isinstance(root, ast.Attribute | ast.Subscript):
            root = root.value
        if isinstance(root, ast.Name) and root.id in imported:
            found.append((ast.unparse(changed), node.lineno))
    return found


def of_the_package(module: str | None) -> bool:
    return (module or "").split(".")[0] == "cdrj_ros"


TREES = {path: ast.parse(path.read_text(encoding="utf-8")) for path in FILES}
OWN = PUBLIC.union(*map(defined, TREES.values()))


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_only_public_names_of_other_libraries_are_used_and_none_is_changed(path: Path) -> None:
    found = [*foreign(TREES[path], OWN), *patched(TREES[path])]
    assert not found, ", ".join(f"line {line}: {word}" for word, line in found)

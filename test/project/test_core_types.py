"""The types that are written down for the compiled core are those of its module."""

from __future__ import annotations

import ast
from enum import EnumMeta
from typing import Any

from support.places import ROOT

from cdrj_ros import _core

STUB = ROOT / "cdrj_ros" / "_core.pyi"


def written(body: list[ast.stmt]) -> dict[str, Any]:
    """Names that are declared: those of a class by its name, arguments by a function's."""
    found: dict[str, Any] = {}
    for node in body:
        if isinstance(node, ast.ClassDef):
            found[node.name] = written(node.body)
        elif isinstance(node, ast.FunctionDef):
            is_property = any(getattr(one, "id", "") == "property" for one in node.decorator_list)
            arguments = [one.arg for one in (*node.args.args, *node.args.kwonlyargs)]
            found[node.name] = None if is_property else arguments
        elif isinstance(node, ast.AnnAssign | ast.Assign):
            target = node.target if isinstance(node, ast.AnnAssign) else node.targets[0]
            assert isinstance(target, ast.Name)
            found[target.id] = None
    return found


def compiled(owner: Any) -> dict[str, Any]:
    """The same of the module or of a class in it."""
    if isinstance(owner, EnumMeta):
        return dict.fromkeys(owner.__members__)
    found: dict[str, Any] = {}
    for name, value in vars(owner).items():
        if isinstance(value, type):
            found[name] = compiled(value)
        elif callable(value) and (name == "__init__" or not name.startswith("_")):
            signature = (value.__doc__ or "").partition("\n")[0]
            arguments = signature[signature.index("(") + 1 : signature.rindex(") ->")]
            found[name] = [one.partition(":")[0] for one in _split(arguments) if one != "*"]
        elif not name.startswith("_"):
            found[name] = None
    return found


def _split(arguments: str) -> list[str]:
    """Arguments of a signature, at the commas that are not within brackets."""
    parts, depth = [""], 0
    for letter in arguments:
        depth += (letter in "[(") - (letter in "])")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts if part.strip()]


def test_the_stub_declares_the_names_and_arguments_of_the_module() -> None:
    stub = written(ast.parse(STUB.read_text(encoding="utf-8")).body)
    by_word = dict.fromkeys(("FrameMotion", "Guide", "Law"))  # see test_prepared
    assert stub == compiled(_core) | by_word

"""The types of the compiled core, which a build writes, say what everything in it is for."""

import ast

from support.places import ROOT

from cdrj_ros import _core

STUB = ROOT / "cdrj_ros" / "_core.pyi"


def undescribed(body, of=""):
    """Classes, functions and methods without a docstring; a property may be plain by its name."""
    found = []
    for node in body:
        if isinstance(node, ast.ClassDef):
            found += undescribed(node.body, f"{node.name}.")
        elif not isinstance(node, ast.FunctionDef) or node.decorator_list:
            continue
        if not ast.get_docstring(node) and not node.name.endswith("state__"):  # of pickle
            found.append(of + node.name)
    return found


def test_all_of_the_core_is_described():
    body = ast.parse(STUB.read_text(encoding="utf-8")).body
    written = {node.name for node in body if isinstance(node, ast.ClassDef | ast.FunctionDef)}
    there = {name for name, one in vars(_core).items() if callable(one)}
    assert written == there
    assert undescribed(body) == []

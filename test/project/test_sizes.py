"""A function fits a screen, or its docstring says why it does not."""

import ast

from support.places import ROOT

SCREEN = 60
"""Lines, docstring and all."""
REASON = "longer than a screen because"
FILES = sorted(
    path for folder in ("cdrj_ros", "bench", "tools") for path in (ROOT / folder).rglob("*.py")
)


def test_a_function_is_short_or_its_docstring_gives_the_reason():
    long = [
        f"{path}:{node.lineno} {node.name}"
        for path in FILES
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and (node.end_lineno or 0) - node.lineno >= SCREEN
        and REASON not in " ".join((ast.get_docstring(node) or "").lower().split())
    ]
    assert long == []

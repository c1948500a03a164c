"""The package imports public names of other libraries only, and changes none.

Private attributes are found by ruff (SLF).
"""

from __future__ import annotations

import ast

from support.places import ROOT

FILES = sorted(
    path for folder in ("cdrj_ros", "bench", "tools") for path in (ROOT / folder).rglob("*.py")
)


def imported(tree: ast.Module) -> tuple[list[str], set[str]]:
    """All parts of the names that are imported from other packages, and the names they get here.

    What ``import_module`` returns is one, too.
    """
    parts: list[str] = []
    names: set[str] = set()
    for node in ast.walk(tree):
        match node:
            case ast.Import(names=aliases) | ast.ImportFrom(names=aliases):
                names |= {(one.asname or one.name).split(".")[0] for one in aliases}
                whole = [*(one.name for one in aliases), getattr(node, "module", None) or ""]
                if whole[-1].split(".")[0] != "cdrj_ros":
                    parts += ".".join(whole).split(".")
            case (
                ast.Assign(targets=[ast.Name(id=name)], value=value)
                | ast.AnnAssign(target=ast.Name(id=name), value=ast.expr() as value)
            ) if "import_module" in ast.unparse(value):
                names.add(name)
    return parts, names


def changed(tree: ast.Module) -> list[ast.expr]:
    """Attributes that are set or deleted."""
    found: list[ast.expr] = []
    for node in ast.walk(tree):
        match node:
            case ast.Attribute(ctx=ast.Store() | ast.Del()):
                found.append(node)
            case ast.Call(
                func=ast.Name(id="setattr" | "delattr") | ast.Attribute(attr="__setattr__"),
                args=[ast.expr() as first, *_],
            ):
                found.append(first)
    return found


def root_of(node: ast.expr) -> str:
    while isinstance(node, ast.Attribute | ast.Subscript):
        node = node.value
    return node.id if isinstance(node, ast.Name) else ""


def test_only_public_names_of_other_libraries_are_used_and_none_is_changed() -> None:
    found = []
    for path in FILES:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        parts, names = imported(tree)
        private = [part for part in parts if part.startswith("_") and not part.startswith("__")]
        patched = [ast.unparse(one) for one in changed(tree) if root_of(one) in names]
        found += [f"{path} {word}" for word in (*private, *patched)]
    assert found == []

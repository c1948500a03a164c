"""The package imports public names of other libraries only, and changes none.

Private attributes are found by ruff (SLF).
"""

from __future__ import annotations

import ast

from support.places import ROOT

FILES = sorted(
    path for folder in ("cdrj_ros", "bench", "tools") for path in (ROOT / folder).rglob("*.py")
)


def private_imports(tree: ast.Module) -> list[tuple[str, int]]:
    """Private names that are imported from other packages, with their lines."""
    found = []
    for node in ast.walk(tree):
        match node:
            case ast.Import(names=aliases):
                parts = {part for one in aliases for part in one.name.split(".")}
            case ast.ImportFrom(module=module, names=aliases):
                if (module or "").split(".")[0] == "cdrj_ros":
                    continue
                parts = {*(module or "").split("."), *(one.name for one in aliases)}
            case _:
                continue
        hidden = (part for part in parts if part.startswith("_") and not part.startswith("__"))
        found += [(part, node.lineno) for part in hidden]
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


def test_only_public_names_of_other_libraries_are_used_and_none_is_changed() -> None:
    found = []
    for path in FILES:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        words = (*private_imports(tree), *patched(tree))
        found += [f"{path}:{line} {word}" for word, line in words]
    assert found == []

#!/usr/bin/env python3
"""Write the key reference of docs/robot_file.md from the schema, between its two markers.

python tools/robot_file_keys.py
"""

import re
from pathlib import Path

from cdrj_ros.robot.document import schema, whole

ROOT = Path(__file__).resolve().parents[1]

DOCUMENT = ROOT / "docs" / "robot_file.md"
BEGIN = "<!-- keys: written by tools/robot_file_keys.py from robot.schema.json -->"
END = "<!-- end of keys -->"

PLACES = {
    "coupled_joint": "`joints[]` with `coupled`",
    "frame": "`frames[]`",
    "visual": "`visuals[]`",
    "use": "`parts[].used[]`",
    "correction": "`motors[].correction`, `joints[].correction`",
    "friction": "`friction`, `cables[].friction`, `cables[].nodes[].friction`",
    "cable": "`cables[]`",
    "term": "a function of one joint, in `spans` and `wrap_angle`",
}
"""Places of the schema's definitions in a file; unlisted definitions keep their own names."""

FAMILIES = {
    "`motors[]`, `joints[]`": ("motor", "joint"),
    "`cables[].nodes[]`, by `type`": (
        "winch", "pulley", "swivel", "eyelet", "cylinder", "sphere", "sheath", "anchor",
    ),
}  # fmt: skip
"""Definitions that share a table, by its title; a column names those that have the key."""

SKIPPED = {"axis", "node", "node_keys", "shares", "part", "residual"}
"""Definitions of parts of others, and those that the page describes."""

NUMBERS = {"point": "2 numbers", "place": "2 or 3 numbers", "vector": "3 numbers"}
"""Types of definitions that are numbers."""
PARTS = {"name": "name", "ros_name": "name", "profile": "number or function", **NUMBERS}
"""Types of definitions by their names."""

UNIT = re.compile(r"\s*\[([^\]]+)\]")
DEFAULT = re.compile(r"\s*Default:? (.+?)\.(?=\s|$)")


def reference():
    """All tables, as Markdown."""
    document = schema()
    definitions = document["$defs"]
    together = {name for names in FAMILIES.values() for name in names}
    parts = [_table("the file itself", {"": document})]
    parts += [
        _table(title, {name: whole(definitions[name]) for name in names})
        for title, names in FAMILIES.items()
    ]
    parts += [
        _table(PLACES.get(name, f"`{name}`"), {"": part})
        for name, part in definitions.items()
        if name not in SKIPPED | together and "properties" in part
    ]
    return "\n".join(parts)


def updated(text):
    """The document with the tables of the current schema between its markers."""
    begin, end = text.index(BEGIN) + len(BEGIN), text.index(END)
    return f"{text[:begin]}\n\n{reference()}\n{text[end:]}"


def _table(title, parts):
    """One table; of several parts, with a column of those that have the key with one meaning."""
    owners = {}
    for name, part in parts.items():
        for key, given in part["properties"].items():
            if key != "type" or len(parts) == 1:
                cells = _cells(key, given, key in part.get("required", ()))
                owners.setdefault(cells, []).append(name)
    head = ["key", "value", "default", "meaning"]
    rows = [list(cells) for cells in owners]
    if len(parts) > 1:
        head.insert(1, "of")
        for row, names in zip(rows, owners.values(), strict=True):
            row.insert(1, "all" if len(names) == len(parts) else ", ".join(names))
        order = list(dict.fromkeys(row[0] for row in rows))
        rows.sort(key=lambda row: order.index(row[0]))
    lines = [f"### {title[0].upper()}{title[1:]}", ""]
    lines += [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
    return "\n".join([*lines, ""])


def _cells(key, given, required):
    """Key, value, default and meaning."""
    rule = _resolved(given)
    meaning, unit, default = _described(rule.get("description", ""))
    value = _allowed(rule) if rule.keys() & {"const", "enum"} else _type(rule)
    if unit:
        value += f" [{unit}]"
    if not rule.keys() & {"const", "enum"} and (allowed := _allowed(rule)):
        value += f", {allowed}"
    return f"`{key}`", value, "required" if required else default, meaning


def _resolved(rule):
    """A rule merged with its referenced definition; keys beside the reference take precedence."""
    if "$ref" not in rule:
        return rule
    name = rule["$ref"].rsplit("/", 1)[1]
    return {**schema()["$defs"][name], **rule, "part": name}


def _described(text):
    """Meaning, unit and default from a description "Meaning [unit]. Default value."."""
    default = ""
    if found := DEFAULT.search(text):
        default = found[1]
        text = text[: found.start()] + text[found.end() :]
    units = UNIT.findall(text)
    if len(units) == 1:
        text = UNIT.sub("", text)
    return text.strip(), ", ".join(units).replace("-", "\N{EN DASH}"), default


def _type(rule):
    part = rule.get("part", "")
    if part in PARTS:
        return PARTS[part]
    if "if" in rule:
        return " or ".join(dict.fromkeys(_type(_resolved(rule[b])) for b in ("else", "then")))
    if part and "properties" in rule:
        return "mapping"
    if "const" in rule or ("enum" in rule and "type" not in rule):
        return "word"
    if rule.get("type") == "array":
        item = _resolved(rule.get("items", {}))
        kind = {"number or function": "numbers or functions", "list of numbers": "lists of numbers"}
        return "list of " + kind.get(_type(item), f"{_type(item)}s")
    return {"object": "mapping", "integer": "integer", "string": "word"}.get(
        rule.get("type", ""), rule.get("type", "mapping")
    )


def _allowed(rule):
    if "const" in rule:
        return f"`{rule['const']}`"
    if "enum" in rule:
        return ", ".join(f"`{value}`" for value in rule["enum"])
    if rule.get("type") == "array" and ("minItems" in rule or "maxItems" in rule):
        least, most = rule.get("minItems", 0), rule.get("maxItems")
        if rule.get("part") in NUMBERS:
            return ""
        return f"{least} or more" if most is None else f"{least} to {most}"
    low = [f"> {rule['exclusiveMinimum']:g}"] if "exclusiveMinimum" in rule else []
    low += [f"≥ {rule['minimum']:g}"] if "minimum" in rule else []
    high = [f"< {rule['exclusiveMaximum']:g}"] if "exclusiveMaximum" in rule else []
    high += [f"≤ {rule['maximum']:g}"] if "maximum" in rule else []
    return ", ".join([*low, *high])


if __name__ == "__main__":
    DOCUMENT.write_text(updated(DOCUMENT.read_text("utf-8")), "utf-8")

"""Replacement of numbers in the text of a robot file, preserving comments, units and blanks.

The text is not regenerated: scalars are replaced in place, at the positions that the YAML
parser reports.  A number keeps the unit of its key: ``radius_mm: 5`` becomes ``radius_mm: 5.02``.
Numbers that the file leaves out are added in SI to the mapping they belong to.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping, Sequence
from math import isclose
from pathlib import Path
from typing import Any, Final, NamedTuple

from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.foundation.files import write_text
from cdrj_ros.foundation.yaml import Document, first_alias, yaml_nodes
from cdrj_ros.robot.document import (
    IN_THE_UNIT,
    entry_node,
    file_document,
    parse_document,
    split_unit,
)
from cdrj_ros.robot.names import prefixed, without_prefix
from cdrj_ros.robot.parameters import Keys, Number, find_number, with_numbers
from cdrj_ros.robot.parts import KINDS, Origin, origin_of
from cdrj_ros.robot.reader import load_document
from cdrj_ros.robot.urdf import DESCRIPTION

DIGITS: Final = 7
"""Number of significant digits that are written."""

_PROPERTIES: Final = re.compile(r"^(?:[&!]\S*\s+)*")
_GAP: Final = re.compile(r" *(?=#)")
_PLAIN_KEY: Final = re.compile(r"^[A-Za-z_][A-Za-z0-9_]*\s*:")


def yaml_number(value: float, digits: int = DIGITS) -> str:
    """A number in a form that every YAML reader understands: ``0.11``, ``1.0e-06``."""
    text = f"{value:.{digits}g}"
    mantissa, exponent, power = text.partition("e")
    if "." not in mantissa and (exponent or len(mantissa.lstrip("-")) >= digits):
        mantissa += ".0"
    return mantissa + exponent + power


class Splice(NamedTuple):
    """A change of a text: what stands from ``begin`` to ``end`` becomes ``new``."""

    begin: int
    end: int
    new: str


def _spliced(text: str, splices: Sequence[Splice]) -> str:
    """The text with changes of different places; of several of one place, the last."""
    for begin, end, new in sorted({one.begin: one for one in splices}.values(), reverse=True):
        text = text[:begin] + new + text[end:]
    return text


def with_numbers_in_text(text: str, values: Mapping[str, float], source: str) -> str:
    """The robot file's text with other numbers, by path (see ``cdrj_ros.robot.parameters``) [SI].

    Raises:
        UsageError: a path does not exist.
        RobotFileError: the text is not a robot file, or a number cannot be changed separately
            because an alias repeats it, or is in another file, a URDF.
    """
    document, whole = parse_document(text, source), file_document(text, source)
    nodes, splices = yaml_nodes(text), list[Splice]()
    for path, value in values.items():
        # a number that the file leaves out is found only in the changed document
        changed = with_numbers(document, {path: value})
        if changed == document:  # it is its default
            continue
        document = changed
        number = find_number(document, path)
        kind, *keys = number.keys
        origin = origin_of(whole, str(kind), int(keys[0])) if kind in KINDS else None
        if origin is None:
            splices.append(_of_number(text, nodes, number, document))
        else:
            splices.append(_of_own_number(text, nodes, origin, whole, number))
        if splices[-1].begin == splices[-1].end:  # the next number may follow this new one
            text, splices = _spliced(text, splices), []
            nodes = yaml_nodes(text)
    text = _spliced(text, splices)
    if not _alike(parse_document(text, source), document):
        raise RobotFileError(
            f"{source} repeats one of {', '.join(values)} by an alias or a merge; write it out"
        )
    return text


def refuse_aliases(text: str, source: str) -> None:
    """Refuse a robot file whose numbers cannot be changed one by one, before work is done on it.

    Raises:
        RobotFileError: an alias repeats a part of the file.
    """
    if line := first_alias(text):
        raise RobotFileError(
            f"{source} has an alias in line {line}, and repeats what would be written once: write "
            "it out, or describe what repeats as one of parts (docs/robot_file.md)"
        )


def with_section(text: str, key: str, section: str | None) -> str:
    """Append a top-level entry to the text, in place of an existing entry of the same key.

    Args:
        text: YAML whose top level is a block mapping.
        key: of the entry.
        section: lines of the entry, including its key; None removes the entry.  The prefix of the
            robot is left out, so that it can be changed in one place.
    """
    lines, kept, inside = text.splitlines(keepends=True), [], False
    for line in lines:
        if _PLAIN_KEY.match(line):
            inside = line.split(":", 1)[0].strip() == key
        if not inside:
            kept.append(line)
    result = "".join(kept).rstrip() + "\n"
    if section is None:
        return result
    prefix = entry_node(yaml_nodes(text), "prefix")
    own = without_prefix(section, prefix[1].value if prefix is not None else "")
    return f"{result}\n{own.rstrip()}\n"


def urdf_frames(text: str) -> Any:
    """The entry ``frames`` of a robot file that takes them from a URDF; None of any other."""
    frames = entry_node(yaml_nodes(text), "frames")
    return frames[1] if frames is not None and frames[1].id == "mapping" else None


def moved(text: str, source: str, target: str) -> str:
    """The text for a file in another folder: a relative path of a URDF leads there from it.

    Args:
        text: a robot file.
        source: path of the file that the text was read from.
        target: path of the file that it will be written to.
    """
    before, after = (Path(path).parent.resolve() for path in (source, target))
    frames = urdf_frames(text)
    if before == after or frames is None:
        return text
    found = entry_node(frames, "urdf")
    if found is None or found[1].value == DESCRIPTION or Path(found[1].value).is_absolute():
        return text
    if found[1].value.startswith("package://"):
        return text
    path = os.path.relpath((before / found[1].value).resolve(), after)
    return _spliced(text, [_replaced(text, found[1], json.dumps(path))])


def exact_copy(source: Path, folder: Path) -> Path:
    """Write a robot file whose numbers count as exact, as those of a simulated robot are.

    Args:
        source: the file.
        folder: where the copy is written, under the same name.

    Raises:
        RobotFileError: there is no such file, or it is not valid.
    """
    load_document(source)  # refuses what is none
    target = folder / source.name
    text = with_section(
        source.read_text(encoding="utf-8"), "uncertainty", "uncertainty: {others: exact}\n"
    )
    write_text(target, moved(text, str(source), str(target)))
    return target


def _of_number(text: str, node: Any, number: Number, document: Document) -> Splice:
    """One number replaced or added; ``document`` has it already, ``node`` is the text's root."""
    factor = 1.0
    keys = list(number.keys)
    prefix = str(document.get("prefix", ""))
    entry: Any = document
    while keys:
        key = keys[0]
        listed = entry
        entry = entry.get(key) if isinstance(entry, dict) else entry[key]
        if isinstance(key, int):
            if node.id != "sequence":
                raise RobotFileError(f"{number.path} is a number of the URDF; change it there")
            place = _place(node, key, entry, prefix)
            if place is None:
                # those of a URDF follow in its order: the ones before come along
                names = [one["name"] for k, one in enumerate(listed[: key + 1])
                         if _place(node, k, one, prefix) is None]  # fmt: skip
                value = number.value / number.factor / factor
                return _appended(text, node, names, keys[1:], value)
            node = node.value[place]
        else:
            found = entry_node(node, key)
            if found is None:
                return _inserted(text, node, keys, number.value / number.factor / factor)
            name, node = found
            factor = split_unit(name)[1] * (factor if key in IN_THE_UNIT else 1.0)
        keys.pop(0)
    return _replaced(text, node, yaml_number(number.value / number.factor / factor))


def _of_own_number(text: str, use: Any, origin: Origin, whole: Document, number: Number) -> Splice:
    """A number of one use of a part, below the key ``with`` of the use in the text."""
    kind, _, *keys = number.keys
    value = number.value / number.factor
    for key, index in (("parts", origin.part), ("used", origin.use)):
        found = entry_node(use, key)
        use = found[1].value[index] if found else use
    if origin.index < 0:  # of the frame that places the use
        mapping, path, rest = use, str(keys[0]), keys[1:]
    else:
        path, rest = origin.with_key(whole, str(kind), keys), []
        given = entry_node(use, "with")
        if given is None:
            return _inserted(text, use, ["with", path], value)
        mapping = given[1]
        whole_list = path.rpartition(".")[0]
        if entry_node(mapping, path) is None and entry_node(mapping, whole_list):
            path, rest = whole_list, keys[-1:]
    found = entry_node(mapping, path)
    if found is None:
        return _inserted(text, mapping, [path, *rest], value)
    name, node = found
    for place in rest:
        node = node.value[place]
    return _replaced(text, node, yaml_number(value / split_unit(name)[1]))


def _place(sequence: Any, index: int, entry: Any, prefix: str) -> int | None:
    """Index of an entry in the text, found by its name if it has one; None if it is not there.

    The document also has joints that the text does not list, those of a URDF.
    """
    name = entry.get("name") if isinstance(entry, dict) else None
    if name is None:
        return index
    for k, node in enumerate(sequence.value):
        found = entry_node(node, "name")
        if found is not None and name in (found[1].value, prefixed(found[1].value, prefix)):
            return k
    return None


def _appended(
    text: str, sequence: Any, names: list[str], keys: list[str | int], value: float
) -> Splice:
    """A new entry ``{name: ...}`` for every name, the last with ``a: {b: value}``."""
    entry = yaml_number(value)
    for key in reversed(keys):
        entry = f"{{{key}: {entry}}}"
    *before, last_name = map(json.dumps, names)
    entries = [f"{{name: {name}}}" for name in before] + [f"{{name: {last_name}, {entry[1:]}"]
    if sequence.flow_style:
        at = len(text[: sequence.end_mark.index - 1].rstrip())
        return Splice(at, at, (", " if sequence.value else "") + ", ".join(entries))
    indent = "\n" + " " * sequence.start_mark.column + "- "
    at = _line_end(text, len(text[: sequence.value[-1].end_mark.index].rstrip()))
    return Splice(at, at, "".join(indent + entry for entry in entries))


def _replaced(text: str, node: Any, new: str) -> Splice:
    """Another scalar; a comment on the line keeps its column if possible."""
    begin, end = int(node.start_mark.index), int(node.end_mark.index)
    begin = end - len(_PROPERTIES.sub("", text[begin:end]))  # an anchor or a tag stays
    gap = _GAP.match(text, end)
    spaces = len(gap[0]) if gap else 0
    if spaces > 1:
        new += " " * max(end - begin + spaces - len(new), 1)
        end += spaces
    return Splice(begin, end, new)


def _inserted(text: str, mapping: Any, keys: Keys | list[str | int], value: float) -> Splice:
    """A new entry ``a: {b: value}`` in a mapping."""
    entry = yaml_number(value)
    for key in reversed(keys[1:]):
        entry = f"{{{key}: {entry}}}"
    entry = f"{keys[0]}: {entry}"
    if mapping.flow_style:
        at = len(text[: mapping.end_mark.index - 1].rstrip())
        return Splice(at, at, (", " if mapping.value else "") + entry)
    # The first key of the block gives the column.  The new entry goes before the second key, or
    # after the only entry.
    first_key, _ = mapping.value[0]
    column: int = first_key.start_mark.column
    if len(mapping.value) > 1:
        second_key, _ = mapping.value[1]
        at = second_key.start_mark.index - column
        return Splice(at, at, " " * column + entry + "\n")
    at = _line_end(text, max(mapping.value[0][1].end_mark.index - 1, 0))
    return Splice(at, at, "\n" + " " * column + entry)


def _line_end(text: str, index: int) -> int:
    end = text.find("\n", index)
    return len(text) if end < 0 else end


def _alike(one: Any, other: Any) -> bool:
    """Whether two documents are equal, with numbers compared to the written precision."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(_alike(one[key], other[key]) for key in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_alike, one, other))
    if isinstance(one, float) or isinstance(other, float):
        return isclose(one, other, rel_tol=10.0 ** (1 - DIGITS), abs_tol=1e-12)
    return bool(one == other)

"""Expansion of ``parts``: motors, joints, frames and cables described once and used several times.

Every use of a part adds its entries to the document under names of its own, as they would be
written by hand.  Nothing else of the program knows of parts, except errors, which name the use and
the line, and the writer, which gives a use numbers of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from re import match
from typing import Any, Final

from cdrj_ros.foundation.errors import Refusal, RobotFileError, ordered
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.robot.names import NAMED_KINDS, renamed

KINDS: Final = (*NAMED_KINDS, "visuals")
"""Lists of a part that are added to those of the robot."""

POSE: Final = ("origin", "rpy", "quaternion")

_NAMED: Final = {
    "motors": ("motor",),
    "joints": ("joint", "coupled"),
    "frames": ("frame", "parent", "exit_frame", "side_frame"),
}
"""Keys under which names of these kinds stand."""

_Entries = dict[str, list[Document]]
"""Entries of a part or of a use, by kind."""


@dataclass(frozen=True)
class Origin:
    """Where an entry of an expanded document stands in the file."""

    part: int
    """Index of the part."""
    use: int
    """Index of its use."""
    index: int
    """Index of the entry in the part's list; -1 for the frame that places the use."""
    prefix: str
    """Text before the names of the use."""

    def with_key(self, document: Document, kind: str, keys: Any) -> str:
        """The key below ``with`` of a number of the entry: ``cables.flexor.nodes.2.radius``.

        Args:
            document: the file before expansion.
            kind: list of the entry.
            keys: keys and indices that lead to the number in the entry.
        """
        entry = document["parts"][self.part][kind][self.index]
        if keys[0] == "coupled":
            keys = [one if one in entry["coupled"] else self._own(one, entry) for one in keys]
        name = entry.get("name", self.index + 1)
        return ".".join(str(k + 1 if isinstance(k, int) else k) for k in (kind, name, *keys))

    def _own(self, name: str, entry: Document) -> str:
        """The name in the part of a joint that moves another."""
        own = (one for one in entry["coupled"] if name.endswith(self.prefix + one))
        return next(own, name)


def expanded(document: Document, source: str) -> Document:
    """The document with the entries of every use of its parts, and without ``parts``.

    Args:
        document: a robot file in SI whose ``parts`` satisfy the schema.
        source: name of the file, for errors.

    Raises:
        RobotFileError: a part cannot be used as the file says.
    """
    refuse = Refusal(source)
    if isinstance(document.get("frames"), dict):
        raise refuse("parts", "cannot be used with the frames of a URDF: give frames as a list")
    result = {key: value for key, value in document.items() if key != "parts"}
    lists = {kind: result.get(kind, []) for kind in KINDS}
    for kind, value in lists.items():
        if not isinstance(value, list):
            raise refuse(kind, "must be a list")
    seen: set[str] = set()
    for path, part, use in _uses(document):
        if use["prefix"] in seen:
            raise refuse(f"{path}.prefix", f"{use['prefix']!r} is taken already")
        seen.add(use["prefix"])
        added = _used(part, use, path, refuse)
        lists = {kind: [*lists[kind], *added[kind]] for kind in KINDS}
    return result | {kind: value for kind, value in lists.items() if value or kind in result}


def origin_of(document: Document, kind: str, index: int) -> Origin | None:
    """Where an entry of the expanded document stands; None if in the robot's own list.

    Args:
        document: the file before expansion.
        kind: list of the entry.
        index: its index in the expanded document.
    """
    index -= len(document.get(kind, ()))
    for p, part in enumerate(document.get("parts", ())):
        for u, use in enumerate(part["used"]):
            placed = int(kind == "frames" and _placed(use))
            count = len(part.get(kind, ())) + placed
            if 0 <= index < count:
                return Origin(p, u, index - placed, use["prefix"])
            index -= count
    return None


@contextmanager
def errors_in_parts(
    document: Callable[[], Document], line: Callable[[list[Any]], int]
) -> Iterator[None]:
    """Let errors about entries that come from a part name its use, and the line in the file.

    Args:
        document: gives the file before expansion.
        line: gives the number of the line of the keys and indices of a place.
    """
    try:
        yield
    except RobotFileError as error:
        text = str(error)
        found = match(r"(parts|motors|joints|frames|cables|visuals)\[\d+\]\S*", text)
        if found is None or " (line " in text or not (whole := document()).get("parts"):
            raise
        keys: list[Any] = [int(k) if k.isdigit() else k for k in _split(found[0])]
        used, kind = "", keys[0]
        if kind != "parts":
            if (origin := origin_of(whole, kind, keys[1])) is None:
                raise
            used = f", used as {origin.prefix}"
            keys = _keys_in_file(whole, origin, kind, keys[2:])
        where = "".join(f"[{k}]" if isinstance(k, int) else f".{k}" for k in keys)[1:]
        raise RobotFileError(f"{where} (line {line(keys)}{used}){text[found.end() :]}") from error


def _split(path: str) -> list[str]:
    """Keys and indices of a path; what follows ``with`` is one key."""
    path, given, own = path.partition(".with.")
    return [*path.replace("[", ".").replace("]", "").split("."), *(("with", own) if given else ())]


def _keys_in_file(document: Document, origin: Origin, kind: str, rest: list[Any]) -> list[Any]:
    """Where a number of an entry stands: with its use if given there, else in the part."""
    use: list[Any] = ["parts", origin.part, "used", origin.use]
    if origin.index < 0:
        return [*use, *rest]
    own = document["parts"][origin.part]["used"][origin.use].get("with", {})
    wanted = origin.with_key(document, kind, rest)
    for key in own:
        if wanted == key or wanted.startswith(f"{key}."):
            return [*use, "with", key]
    return ["parts", origin.part, kind, origin.index, *rest]


def _uses(document: Document) -> Iterator[tuple[str, Document, Document]]:
    """Path, part and use of every use."""
    for p, part in enumerate(document["parts"]):
        for u, use in enumerate(part["used"]):
            yield f"parts[{p}].used[{u}]", part, use


def _placed(use: Document) -> bool:
    """Whether a use has a frame of its own."""
    return any(key in use for key in ("frame", *POSE))


def _used(part: Document, use: Document, path: str, refuse: Refusal) -> _Entries:
    """The entries that a use adds."""
    own: _Entries = {kind: deepcopy(part.get(kind, [])) for kind in KINDS}
    if "mirror" in use:
        _reflect(own, use["mirror"], partial(refuse, f"{path}.mirror"))
    for key, value in use.get("with", {}).items():
        _set(own, key, value, partial(refuse, f"{path}.with.{key}"))
    for kind, keys in _NAMED.items():
        names = {entry["name"]: use["prefix"] + entry["name"] for entry in own[kind]}
        change = partial(_either, names)
        own = {one: renamed(own[one], keys, change) for one in KINDS}
    for kind in NAMED_KINDS:
        for entry in own[kind]:
            entry["name"] = use["prefix"] + entry["name"]
    if _placed(use):
        base = use["prefix"] + part["name"]
        _hang(own, base)
        frame: Document = {"name": base, "parent": use.get("frame", "base"), "motion": "fixed"}
        own["frames"].insert(0, frame | {key: use[key] for key in POSE if key in use})
    return own


def _either(names: Mapping[str, str], name: str) -> str:
    """The name of a use for one of the part's own; another is one of the robot's."""
    return names.get(name, name)


def _hang(own: _Entries, base: str) -> None:
    """Attach what names no frame to the frame of the use."""
    for entry in own["frames"]:
        entry.setdefault("parent", base)
    for entry in own["visuals"]:
        entry.setdefault("frame", base)
    for node in _nodes_of(own):
        if "position" in node:
            node.setdefault("frame", base)
        if "exit" in node:
            node.setdefault("exit_frame", base)


def _set(
    own: _Entries,
    path: str,
    value: Any,
    refuse: Callable[[str], RobotFileError],
) -> None:
    """Give a use a number of its own; names instead of indices, nodes counted from 1."""
    kind, _, rest = path.partition(".")
    entries = {str(entry.get("name", k + 1)): entry for k, entry in enumerate(own.get(kind, ()))}
    name = next((one for one in entries if rest.startswith(f"{one}.")), None)
    if name is None:
        named = (f"{one}.{entry['name']}" for one in NAMED_KINDS for entry in own[one])
        raise refuse(f"must begin with one of {ordered(named)}")
    place: Any = entries[name]
    *keys, last = rest[len(name) + 1 :].split(".")
    for key in keys:
        place = place.setdefault(key, {}) if isinstance(place, dict) else _item(place, key, refuse)
        if not isinstance(place, (dict, list)):
            raise refuse(f"has nothing below {key}")
    if isinstance(place, dict):
        place[last] = value
    else:
        _item(place, last, refuse)
        place[int(last) - 1] = value


def _item(entries: list[Any], key: str, refuse: Callable[[str], RobotFileError]) -> Any:
    if not key.isdigit() or not 1 <= int(key) <= len(entries):
        raise refuse(f"must have a number from 1 to {len(entries)} in place of {key}")
    return entries[int(key) - 1]


# --- reflection in space ------------------------------------------------------------------------
# A position is reflected, an axis of rotation is reflected and reversed: then a frame turns, and a
# cable goes round a pulley, by the same angle with the same ``turn`` as its original.

_CARRIERS: Final = {
    "position": "frame", "axis": "frame", "exit": "exit_frame", "side": "side_frame",
}  # fmt: skip
"""Vectors of a node, and the key of the frame in which each is given."""


def _reflect(
    own: Mapping[str, list[Document]], axis: str, refuse: Callable[[str], RobotFileError]
) -> None:
    """Reflect entries of a robot file along an axis, in place; what lies in other frames stays.

    Args:
        own: the entries by kind: frames, cables and visuals.
        axis: ``x``, ``y`` or ``z``.
        refuse: makes the error of what cannot be reflected.

    Raises:
        RobotFileError: the entries are in the plane, or a frame rolls.
    """
    mirror = _Mirror([-1.0 if one == axis else 1.0 for one in "xyz"], refuse)
    frames = {frame["name"] for frame in own["frames"]}
    for frame in own["frames"]:
        mirror.frame(frame, placed="parent" not in frame or frame["parent"] in frames)
    for shape in own["visuals"]:
        if "frame" not in shape or shape["frame"] in frames:
            mirror.visual(shape)
    for node in _nodes_of(own):
        mirror.node(node, frames)


def _nodes_of(own: Mapping[str, list[Document]]) -> Iterator[Document]:
    """All nodes of the cables among some entries."""
    return (node for cable in own["cables"] for node in cable["nodes"])


class _Mirror:
    """Reverses the signs of vectors along an axis."""

    def __init__(self, signs: list[float], refuse: Callable[[str], RobotFileError]) -> None:
        self._signs = signs
        self._refuse = refuse

    def _vector(self, entry: Document, key: str, *, rotation: bool = False) -> None:
        """Reflect a vector, and reverse it if it is one of rotation; w of a quaternion stays."""
        if key not in entry:
            return
        first, rest = entry[key][:3], entry[key][3:]
        if len(first) < 3:
            raise self._refuse(f"is possible in space only, where {key} has three numbers")
        signs = [-s if rotation else s for s in self._signs]
        entry[key] = [s * v if v else v for s, v in zip(signs, first, strict=True)] + rest

    def frame(self, frame: Document, *, placed: bool) -> None:
        """Reflect a frame, with its pose if it is ``placed`` in what is reflected."""
        motion = frame["motion"]
        if motion == "rolling":
            raise self._refuse("is not possible with a rolling frame, which has no axis to reverse")
        if motion != "fixed":
            slides = motion == "prismatic"
            frame.setdefault("axis", [1.0, 0.0, 0.0] if slides else [0.0, 0.0, 1.0])
            self._vector(frame, "axis", rotation=not slides)
        if placed:
            self._vector(frame, "origin")
            self._vector(frame, "rpy", rotation=True)
            self._vector(frame, "quaternion", rotation=True)

    def visual(self, shape: Document) -> None:
        """Reflect a shape; a mesh by its scale."""
        if "mesh" in shape:
            shape.setdefault("scale", [1.0, 1.0, 1.0])
        self._vector(shape, "scale")
        self._vector(shape, "origin")
        self._vector(shape, "rpy", rotation=True)

    def node(self, node: Document, frames: Collection[str]) -> None:
        """Reflect those vectors of a node that lie in some frames, or in none that it names."""
        for key, carrier in _CARRIERS.items():
            frame = node.get(carrier, node.get("frame") if key == "side" else None)
            if frame is None or frame in frames:
                rotation = key == "axis" and node["type"] != "swivel"
                self._vector(node, key, rotation=rotation)
                if rotation and "pitch" in node:
                    node["pitch"] = -node["pitch"]

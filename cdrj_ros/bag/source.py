"""Find and open the files of one recording, in order."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from cdrj_ros.bag.batch import Channel
from cdrj_ros.bag.bounds import METADATA_BYTES
from cdrj_ros.bag.db3_file import Db3File
from cdrj_ros.bag.file_bytes import open_regular
from cdrj_ros.bag.mcap_file import McapFile
from cdrj_ros.foundation.errors import BagError
from cdrj_ros.foundation.text import printable
from cdrj_ros.foundation.yaml import YamlError, load_yaml

METADATA: Final = "metadata.yaml"
_SUFFIXES: Final = (".mcap", ".mcap.zstd", ".db3")
_PART: Final = re.compile(r"(?P<name>.*)_(?P<number>\d+)\.(mcap(\.zstd)?|db3)")

BagFile = McapFile | Db3File


@dataclass(frozen=True)
class Source:
    """The files of one recording."""

    path: Path
    files: tuple[BagFile, ...]
    notes: tuple[str, ...]
    """Irregularities of the folder."""

    def all_notes(self) -> tuple[str, ...]:
        """Notes of the folder and of every file, as far as the files have been read."""
        found = list(self.notes)
        for file in self.files:
            found += file.notes
            if state := file.state():
                found.append(state)
        return tuple(map(printable, found))

    def channels_known(self) -> bool:
        """Whether all channels are known without reading messages."""
        return all(file.complete and file.indexed for file in self.files)

    def channels(self) -> Mapping[str, Channel]:
        """Channels by topic, as declared so far; the first declaration of a topic counts."""
        found: dict[str, Channel] = {}
        for file in self.files:
            for channel in file.channels.values():
                found.setdefault(channel.topic, channel)
        return found


def open_source(path: Path | str) -> Source:
    """Open a rosbag2 folder, a folder of its files, or one .mcap, .mcap.zstd or .db3 file."""
    path = Path(path)
    if not _exists(path):
        raise BagError(f"{path} does not exist, expected a rosbag2 folder or an .mcap file")
    notes: list[str] = []
    if not path.is_dir():
        return Source(path, (_open(path),), ())
    paths = _listed(path, notes) or _found(path, notes)
    files = [file for part in paths if (file := _opened(part, notes)) is not None]
    if not files:
        raise BagError(f"{path} holds no readable file of a bag: {'; '.join(notes)}")
    return Source(path, tuple(files), tuple(notes))


def _open(path: Path) -> BagFile:
    if path.name.endswith(".db3.zstd"):
        raise BagError(f"{path} is a compressed sqlite3 bag: undo that first, `zstd -d {path}`")
    return Db3File(path) if path.suffix == ".db3" else McapFile(path)


def _opened(path: Path, notes: list[str]) -> BagFile | None:
    """Open one part of a recording; None, with a note, if it cannot be opened."""
    try:
        return _open(path)
    except BagError as error:
        notes.append(f"left out: {error}")
        return None


def _listed(folder: Path, notes: list[str]) -> list[Path]:
    """The existing files among those listed in metadata.yaml."""
    if not _exists(folder / METADATA):
        notes.append(f"no {METADATA}")
        return []
    try:
        with open_regular(folder / METADATA) as stream:
            content = stream.read(METADATA_BYTES + 1)
        if len(content) > METADATA_BYTES:
            raise BagError(f"it has more than {METADATA_BYTES} bytes")
        names = _file_names(content.decode())
    except (OSError, BagError, UnicodeDecodeError) as error:
        notes.append(f"{METADATA} cannot be read ({error})")
        return []
    if not names:
        notes.append(f"{METADATA} lists no files")
        return []
    paths: list[Path] = []
    for name in names:
        inside = folder / Path(name).name
        choices = [inside, inside.with_name(inside.name + ".zstd")]
        there = [choice for choice in choices if _exists(choice)]
        if there:
            paths.append(there[0])
        else:
            notes.append(f"{inside.name} is listed in {METADATA} but is not there")
    return paths


def _exists(path: Path) -> bool:
    """As `Path.exists`, but False for invalid names such as one with a zero byte."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


@lru_cache(maxsize=1000)
def _file_names(text: str) -> tuple[str, ...]:
    """File names listed in a metadata.yaml; empty if the text is not valid metadata.

    A command opens all its bags once to check their topics and again to read them.
    """
    try:
        content: Any = load_yaml(text, METADATA)
        information = content["rosbag2_bagfile_information"]
        return tuple(str(name) for name in information["relative_file_paths"])
    except (YamlError, KeyError, TypeError):
        return ()


def _found(folder: Path, notes: list[str]) -> list[Path]:
    """The parts of one recording in a folder without usable metadata."""
    recordings: dict[str, list[tuple[int, Path]]] = {}
    try:
        paths = sorted(folder.iterdir())
    except OSError as error:
        raise BagError(f"{folder} cannot be read: {error.strerror or error}") from None
    for path in paths:
        if not path.name.endswith(_SUFFIXES):
            continue
        part = _PART.fullmatch(path.name)
        name = part["name"] if part else path.name.partition(".mcap")[0].removesuffix(".db3")
        recordings.setdefault(name, []).append((int(part["number"]) if part else 0, path))
    if not recordings:
        raise BagError(f"{folder} holds no .mcap file, expected a rosbag2 folder")
    chosen = folder.name if folder.name in recordings else next(iter(recordings))
    others = sorted(set(recordings) - {chosen})
    if others and chosen != folder.name:
        raise BagError(
            f"{folder} has no {METADATA} and holds {len(recordings)} recordings "
            f"({', '.join(sorted(recordings))}): name one .mcap file"
        )
    if others:
        notes.append(f"other recordings in the folder were left out: {', '.join(others)}")
    return [path for _, path in sorted(recordings[chosen])]

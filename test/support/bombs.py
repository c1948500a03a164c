"""Small files that unpack to, or claim to contain, far more than their size."""

import os
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk, Header
from mcap.writer import CompressionType

from support import foreign_bags as foreign

MIB = 1 << 20
MAGIC = b"\x89MCAP0\r\n"
ENDLESS = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT x AS id"


def packed_zeros(size: int, start: bytes = b"") -> bytes:
    """`start` and `size` zeros compressed by zstd without holding the zeros in memory."""
    packer = zstandard.ZstdCompressor(level=1).compressobj()
    piece = bytes(16 * MIB)
    parts = [packer.compress(start)]
    parts += [packer.compress(piece) for _ in range(size // len(piece))]
    return b"".join([*parts, packer.flush()])


def messages_of_64_mib(folder: Path) -> Path:
    bomb = zstandard.compress(bytes(64 * MIB))
    messages = [*foreign.swing(2), *((foreign.TOPIC, i, bomb) for i in range(300))]
    return foreign.write_mcap(folder / "messages.mcap", messages)


def chunks_of_60_mib(folder: Path) -> Path:
    messages = [*foreign.swing(2), *((foreign.TOPIC, i, bytes(60 * MIB)) for i in range(6))]
    return foreign.write_mcap(
        folder / "chunks.mcap", messages, chunk_size=60 * MIB, compression=CompressionType.ZSTD
    )


def a_chunk_of_1_gib(folder: Path) -> Path:
    path = foreign.write_mcap(folder / "chunk.mcap", foreign.swing(2))
    content = path.read_bytes()
    builder = RecordBuilder()
    Header(profile="ros2", library="").write(builder)
    chunk = Chunk(
        compression="zstd",
        data=packed_zeros(1024 * MIB),
        message_start_time=0,
        message_end_time=0,
        uncompressed_crc=0,
        uncompressed_size=1024 * MIB,
    )
    chunk.write(builder)
    path.write_bytes(MAGIC + builder.end() + content[len(MAGIC) :])
    return path


def a_file_of_8_gib(folder: Path) -> Path:
    path = folder / "file.mcap.zstd"
    path.write_bytes(packed_zeros(128 * MIB, MAGIC) + packed_zeros(128 * MIB) * 63)
    return path


def definition(folder: Path, text: str) -> Path:
    good = [(1, foreign.joint_state(1, ["a"], [1]))]
    return foreign.write_topics(
        folder / "a.mcap", {foreign.TOPIC: (foreign.JOINT_STATE, text, good)}
    )


def nested(last: str) -> str:
    levels = [f"===\nMSG: p/L{k}\n" + f"L{k + 1} a\n" * 40 for k in range(6)]
    return "p/L0 a\n" + "".join(levels) + f"===\nMSG: p/L6\n{last}\n"


def database(folder: Path, statements: str) -> Path:
    path = folder / "a.db3"
    with closing(sqlite3.connect(path)) as connection:
        connection.executescript(statements)
        connection.commit()
    return path


TOPICS = (
    "CREATE TABLE topics (id INTEGER PRIMARY KEY, name, type, serialization_format);"
    f"INSERT INTO topics VALUES (1, '{foreign.TOPIC}', '{foreign.JOINT_STATE}', 'cdr');"
)
MESSAGES = "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, data);"
GOOD = "x'" + foreign.joint_state(1, ["a"], [1]).hex() + "'"


def pipe(folder: Path, name: str) -> Path:
    os.mkfifo(folder / name)
    return folder


def with_metadata(folder: Path, text: str) -> Path:
    foreign.write_mcap(folder / f"{folder.name}_0.mcap", foreign.swing(2))
    (folder / "metadata.yaml").write_text(text, encoding="utf-8")
    return folder


def pipe_for_metadata(folder: Path) -> Path:
    (with_metadata(folder, "") / "metadata.yaml").unlink()
    return pipe(folder, "metadata.yaml")


def listed(name: str) -> str:
    return f'rosbag2_bagfile_information: {{relative_file_paths: ["{name}"]}}'


def repeated(step: str) -> str:
    lines = ["a0: &a0 {k: 1}"]
    lines += [f"a{k}: &a{k} " + step.format(",".join([f"*a{k - 1}"] * 10)) for k in range(1, 12)]
    return "\n".join(lines)


BOMBS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "messages": (messages_of_64_mib, "unpacks to more than"),
    "chunks": (chunks_of_60_mib, "unpacks to more than"),
    "chunk": (a_chunk_of_1_gib, "claims 1073741824 bytes, more than"),
    "file": (a_file_of_8_gib, "unpacks to more than"),
    "nested definitions": (
        lambda folder: definition(folder, nested("int8 a")),
        "more than 10000 lines",
    ),
    "nested empty definitions": (
        lambda folder: definition(folder, nested("")),
        "more than 10000 lines",
    ),
    "array of 5000 digits": (
        lambda folder: definition(folder, f"int8[{'9' * 5000}] a"),
        "array of more than",
    ),
    "long definition": (
        lambda folder: definition(folder, "int8 a\n" * 200_000),
        "is of no type",
    ),
    "pipe in a folder": (lambda folder: pipe(folder, "a_0.mcap"), "not a regular file"),
    "pipe": (lambda folder: pipe(folder, "a.mcap") / "a.mcap", "not a regular file"),
    "pipe for a database": (lambda folder: pipe(folder, "a.db3") / "a.db3", "not a regular file"),
    "pipe for metadata": (
        pipe_for_metadata,
        "metadata.yaml cannot be read",
    ),
    "endless messages": (
        lambda folder: database(
            folder,
            f"{TOPICS} CREATE VIEW messages AS {ENDLESS}, 1 AS topic_id, x AS timestamp, "
            "x'00' AS data FROM c;",
        ),
        "messages is a view",
    ),
    "endless topics": (
        lambda folder: database(
            folder,
            f"{MESSAGES} CREATE VIEW topics AS {ENDLESS}, '/a' AS name, '' AS type, 'cdr' "
            "AS serialization_format FROM c;",
        ),
        "topics is a view",
    ),
    "last row": (
        lambda folder: database(
            folder, f"{TOPICS}{MESSAGES} INSERT INTO messages VALUES ({2**63 - 1}, 1, 5, {GOOD});"
        ),
        "read 1 values",
    ),
    "aliases": (lambda folder: with_metadata(folder, repeated("[{}]")), "lists no files"),
    "metadata of megabytes": (
        lambda folder: with_metadata(folder, "#" * 2_000_000),
        "more than 1000000 bytes",
    ),
    "surrogate": (lambda folder: with_metadata(folder, listed(r"\uD800.mcap")), "lists no files"),
    "zero byte": (lambda folder: with_metadata(folder, listed(r"a\0.mcap")), "is not there"),
}
"""By name: a function that creates the file in an empty folder, and a part of the error text."""

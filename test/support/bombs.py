"""Small files that unpack to, or claim to contain, far more than their size."""

import os

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk, Header
from mcap.writer import CompressionType

from support import foreign_bags as foreign

MIB = 1 << 20
MAGIC = b"\x89MCAP0\r\n"


def packed_zeros(size):
    """`size` zeros compressed by zstd without holding them in memory."""
    packer = zstandard.ZstdCompressor(level=1).compressobj()
    piece = bytes(16 * MIB)
    parts = [packer.compress(piece) for _ in range(size // len(piece))]
    return b"".join([*parts, packer.flush()])


def chunks_of_60_mib(folder):
    messages = [*foreign.swing(2), *((foreign.TOPIC, i, bytes(60 * MIB)) for i in range(6))]
    return foreign.write_mcap(
        folder / "chunks.mcap", messages, chunk_size=60 * MIB, compression=CompressionType.ZSTD
    )


def a_chunk_of_1_gib(folder):
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


def definition(folder, text):
    good = [(1, foreign.joint_state(1, ["a"], [1]))]
    return foreign.write_topics(
        folder / "a.mcap", {foreign.TOPIC: (foreign.JOINT_STATE, text, good)}
    )


def nested(last):
    levels = [f"===\nMSG: p/L{k}\n" + f"L{k + 1} a\n" * 40 for k in range(6)]
    return "p/L0 a\n" + "".join(levels) + f"===\nMSG: p/L6\n{last}\n"


def pipe(folder, name):
    os.mkfifo(folder / name)
    return folder


BOMBS = {
    "chunks": (chunks_of_60_mib, "unpacks to more than"),
    "chunk": (a_chunk_of_1_gib, "claims 1073741824 bytes, more than"),
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
}
"""By name: a function that creates the file in an empty folder, and a part of the error text."""

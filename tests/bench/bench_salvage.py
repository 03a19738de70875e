"""What is left of a large MCAP file that was cut off at many places, and damaged at many others.

Run on demand: ``python tests/bench/bench_salvage.py [--megabytes 300] [--cuts 100] [--damages 100] [--kind lz4]``. The
file is made in the temporary folder and removed. Which messages are in which chunk, and where the chunks lie, is told
by the ``mcap`` library from the whole file; every message of every chunk that neither cut nor damage touches has to
come out bit for bit, in order, whatever the rest of the file looks like, and no message that was never written.
"""

from __future__ import annotations

import argparse
import mmap
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple
from zlib import crc32

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from mapgraft.recording.containers.mcap_file import McapSource

KINDS = {"none": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}
TOPICS = ("/scan", "/odom", "/tf")
LONGEST_DAMAGE = 1 << 16

Seen = tuple[int, int]  # log time, CRC-32 of the message


class ChunkRange(NamedTuple):
    begin: int
    end: int
    messages: tuple[Seen, ...]


def write(path: Path, kind: str, megabytes: int) -> list[Seen]:
    """A file of about this size, of noisy messages on three topics; what it holds, in order."""
    noise, told = np.random.default_rng(0), list[Seen]()
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=1 << 20, compression=KINDS[kind])
        writer.start("ros2")
        channels = [writer.register_channel(topic, "json", 0) for topic in TOPICS]
        while stream.tell() < megabytes * 1_000_000:
            log_ns = 1_000_000 * (len(told) + 1)
            ranges = np.round(noise.uniform(0.2, 30.0, 1081), 2).astype(np.float32)
            data = ranges.tobytes() if len(told) % 3 == 0 else ranges[: 1 + len(told) % 90].tobytes()
            writer.add_message(channels[len(told) % 3], log_ns, data, log_ns)
            told.append((log_ns, crc32(data)))
        writer.finish()
    return told


def chunk_ranges(path: Path, told: list[Seen]) -> list[ChunkRange]:
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    found = []
    for index in summary.chunk_indexes:
        inside = [seen for seen in told if index.message_start_time <= seen[0] <= index.message_end_time]
        begin = index.chunk_start_offset
        found.append(ChunkRange(begin, begin + index.chunk_length, tuple(inside)))
    return found


@contextmanager
def cut(path: Path, length: int) -> Iterator[None]:
    with path.open("r+b") as file:
        file.seek(length)
        tail = file.read()
        file.truncate(length)
    try:
        yield
    finally:
        with path.open("ab") as file:
            file.write(tail)


@contextmanager
def damaged(path: Path, begin: int, noise: bytes) -> Iterator[None]:
    with path.open("r+b") as file, mmap.mmap(file.fileno(), 0) as view:
        before = view[begin : begin + len(noise)]
        view[begin : begin + len(noise)] = noise
    try:
        yield
    finally:
        with path.open("r+b") as file, mmap.mmap(file.fileno(), 0) as view:
            view[begin : begin + len(before)] = before


class Outcome(NamedTuple):
    expected: int
    found: int
    missing: int
    strangers: int
    faults: str
    seconds: float


def outcome(path: Path, intact: list[ChunkRange], told: list[Seen]) -> Outcome:
    start = time.process_time()
    with McapSource(path) as source:
        found = [(message.log_ns, crc32(message.data)) for message in source.messages()]
        causes = ", ".join(f"{fault.cause} {fault.topic} {fault.count}" for fault in source.faults)
    assert found == sorted(found, key=lambda seen: seen[0]), "the messages are not in order"
    expected = Counter(seen for chunk in intact for seen in chunk.messages)
    counted = Counter(found)
    missing, strangers = (expected - counted).total(), (counted - Counter(told)).total()
    return Outcome(expected.total(), len(found), missing, strangers, causes, time.process_time() - start)


def show(what: str, outcomes: list[Outcome]) -> bool:
    expected, found = sum(o.expected for o in outcomes), sum(o.found for o in outcomes)
    missing, strangers = sum(o.missing for o in outcomes), sum(o.strangers for o in outcomes)
    slowest = max((o.seconds for o in outcomes), default=0.0)
    print(
        f"{what}: {len(outcomes)} places, {expected} messages in intact chunks, {missing} of them missing, "
        f"{found - expected + missing} more from beginnings of broken chunks, {strangers} never written; "
        f"slowest {slowest:.1f} s of processor time"
    )
    return not missing and not strangers


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--megabytes", type=int, default=300)
    parser.add_argument("--cuts", type=int, default=100)
    parser.add_argument("--damages", type=int, default=100)
    parser.add_argument("--kind", choices=KINDS, default="lz4")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    places = np.random.default_rng(arguments.seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "recording.mcap"
        told = write(path, arguments.kind, arguments.megabytes)
        chunks, size = chunk_ranges(path, told), path.stat().st_size
        print(f"{arguments.kind}: {len(told)} messages in {len(chunks)} chunks, {size / 1e6:.0f} MB")
        cuts, damages = [], []
        for length in places.integers(9, size, arguments.cuts).tolist():
            with cut(path, length):
                cuts.append(outcome(path, [c for c in chunks if c.end <= length], told))
        for begin in places.integers(0, size, arguments.damages).tolist():
            noise = places.bytes(min(int(2 ** places.uniform(0, np.log2(LONGEST_DAMAGE))), size - begin))
            with damaged(path, begin, noise):
                left = [c for c in chunks if c.end <= begin or begin + len(noise) <= c.begin]
                damages.append(outcome(path, left, told))
        held = [show("cut off", cuts), show("damaged", damages)]
        print("holds" if all(held) else "MISSES: something intact is lost, or something false was given")


if __name__ == "__main__":
    main()

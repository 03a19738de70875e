"""Draws salvage.png: a recording that was damaged and cut off, as the mcap library and as mapgraft read it.

python docs/pictures/draw_salvage.py
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Channel, ChunkIndex, Message, Schema
from mcap.writer import Writer

import mapgraft
from mapgraft.events import Snapshot
from mapgraft.recording.containers.opening import open_source
from mapgraft_grid.grid_map import FREE, OCCUPIED, UNKNOWN, GridMap
from mapgraft_recordings import demo_files

Recorded = tuple[Schema | None, Channel, Message]
Window = tuple[tuple[int, int], tuple[int, int]]  # origin cell (ix, iy), shape (h, w)
CHUNK_BYTES = 40_000  # recorders that are set to lose little write small chunks
DAMAGED = (4, 9, 10, 17)  # chunks in the middle of which there are wrong bytes
KEPT = 0.93  # of the file, before it was cut off
SOUND, LOST, CUT = "#4c9a5f", "#c8232c", "#d9d9d9"
COLOURS = {UNKNOWN: (0.90, 0.90, 0.90), FREE: (1.0, 1.0, 1.0), OCCUPIED: (0.10, 0.10, 0.12)}


def recorded(path: Path) -> Iterator[Recorded]:
    """The messages of a file as far as the mcap library gives them, in the order of the file."""
    with path.open("rb") as stream, suppress(Exception):  # whatever it stops with
        yield from NonSeekingReader(stream).iter_messages(log_time_order=False)


def write(path: Path, messages: Iterator[Recorded]) -> int:
    """A recording of these messages in small chunks; returns how many there were."""
    with path.open("wb") as stream:
        writer: Any = Writer(stream, chunk_size=CHUNK_BYTES)
        writer.start("ros2")
        channels: dict[int, int] = {}
        count = 0
        for schema, channel, message in messages:
            if channel.id not in channels:
                assert schema is not None
                known = writer.register_schema(schema.name, schema.encoding, schema.data)
                told = writer.register_channel(channel.topic, channel.message_encoding, known, channel.metadata)
                channels[channel.id] = told
            writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
            count += 1
        writer.finish()
    return count


def chunks_of(path: Path) -> list[ChunkIndex]:
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    return sorted(summary.chunk_indexes, key=lambda chunk: chunk.chunk_start_offset)


def damage(path: Path, to: Path, chunks: list[ChunkIndex]) -> int:
    """The file with wrong bytes in some chunks, cut off near its end; returns how many bytes are left."""
    data = bytearray(path.read_bytes())
    for number in DAMAGED:
        middle = chunks[number].chunk_start_offset + chunks[number].chunk_length // 2
        data[middle : middle + 64] = bytes(64)
    kept = round(len(data) * KEPT)
    to.write_bytes(data[:kept])
    return kept


def mapped(path: Path) -> Snapshot:
    return mapgraft.run([path], {"robots": {"alpha": {"map": {"resolution_m": 0.1}}}}).maps["alpha"]


def draw_map(axes: Axes, snapshot: Snapshot, window: Window, title: str) -> None:
    assert isinstance(snapshot.own, GridMap)
    classes = snapshot.own.dense_over(*window).classes
    image = np.zeros((*classes.shape, 3))
    for kind, colour in COLOURS.items():
        image[classes == kind] = colour
    axes.imshow(image, origin="lower", interpolation="nearest")
    axes.set_title(title, fontsize=10, loc="left")
    axes.axis("off")


def draw_file(axes: Axes, chunks: list[ChunkIndex], size: int, kept: int) -> None:
    """The file from its first to its last byte: sound and damaged chunks, and what was cut off."""
    for number, chunk in enumerate(chunks):
        begin, end = chunk.chunk_start_offset, chunk.chunk_start_offset + chunk.chunk_length
        whole = number not in DAMAGED and end <= kept
        colour = SOUND if whole else CUT if begin >= kept else LOST
        axes.add_patch(Rectangle((begin, 0), end - begin, 1, facecolor=colour, edgecolor="white", linewidth=1.2))
        if begin < kept < end:
            axes.add_patch(Rectangle((kept, 0), end - kept, 1, facecolor=CUT, edgecolor="white", linewidth=1.2))
    axes.axvline(kept, color="black", linewidth=1.2)
    axes.annotate("cut off here", (kept, 1), (0, 3), textcoords="offset points", ha="center", fontsize=8)
    axes.set_xlim(0, size)
    axes.set_ylim(0, 1)
    axes.set_title("the file: chunks that are whole (green), damaged or cut (red), gone (grey)", fontsize=9, loc="left")
    axes.axis("off")


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        whole, broken, plain = (Path(folder) / f"{name}.mcap" for name in ("whole", "broken", "plain"))
        total = write(whole, recorded(demo_files()[0][0]))
        chunks = chunks_of(whole)
        kept = damage(whole, broken, chunks)
        size = whole.stat().st_size
        given = write(plain, recorded(broken))
        intact, with_library = mapped(whole), mapped(plain)
        salvaged = mapped(broken)
        with closing(open_source(broken)) as source:
            read = sum(1 for _ in source.messages())
    assert isinstance(intact.own, GridMap)
    x0, y0, x1, y1 = intact.own.bounds_cells()
    window = ((x0, y0), (y1 - y0, x1 - x0))
    figure = plt.figure(figsize=(12, 5.2), layout="constrained")
    grid = figure.add_gridspec(2, 3, height_ratios=(1, 13))
    draw_file(figure.add_subplot(grid[0, :]), chunks, size, kept)
    panels = [
        (intact, f"alpha as recorded: {total:,} messages, {intact.version} scans"),
        (with_library, f"the mcap library: {given:,} messages, {with_library.version} scans"),
        (salvaged, f"mapgraft: {read:,} messages, {salvaged.version} scans"),
    ]
    for column, (snapshot, title) in enumerate(panels):
        draw_map(figure.add_subplot(grid[1, column]), snapshot, window, title)
    figure.savefig(Path(__file__).with_name("salvage.png"), dpi=90, metadata={"Software": None})


if __name__ == "__main__":
    main()

"""All laser scans of one channel in one MCAP chunk at a time, by way of the chunk's message index.

The messages of one lidar are laid out alike, so their heads are read as one structured array; whatever is not alike is
left to the message-by-message way.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from functools import partial
from itertools import repeat
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts.sources import Channel, RecordedScan, ScanMessage
from mapgraft.recording.containers.mcap_records import (
    MESSAGE_HEAD,
    OPCODE_MESSAGE,
    OPCODE_MESSAGE_INDEX,
    RECORD_HEAD,
)
from mapgraft.recording.containers.octets import Octets, unpacked
from mapgraft.recording.containers.selection import Wanted
from mapgraft.recording.decoding.laser_layout import FLOAT32, LITTLE_ENDIAN_CDR, Layout, layout_of
from mapgraft.recording.decoding.names import bare_frame

_INDEX_HEAD = struct.Struct("<BQHI")  # opcode, length, channel, bytes of the entries
_message_head = struct.Struct("<BQHIQ").unpack_from
_new_scan = partial(tuple.__new__, ScanMessage)  # what NamedTuple's constructor does, at half the price
_new_recorded = partial(tuple.__new__, RecordedScan)

Entries = NDArray[np.uint64]  # (n, 2): log time in nanoseconds, offset of the message record in the chunk


def index_entries(view: Octets, at: int, channel_id: int, want: Wanted) -> Entries | None:
    """The entries of a message index record in the window, in log-time order; None when there is no such record."""
    entries = _entries(view, at, channel_id)
    if entries is None:
        return None
    times = entries[:, 0]
    if want.start_ns > 0 or want.end_ns < 2**63:
        entries = entries[(times >= max(want.start_ns, 0)) & (times <= min(want.end_ns, 2**64 - 1))]
        times = entries[:, 0]
    if (times[1:] < times[:-1]).any():
        entries = entries[np.lexsort((entries[:, 1], times))]
    return entries


class IndexedSpan(NamedTuple):
    """What the message indexes of a chunk tell: how many messages of which channel, and from when to when."""

    counts: Mapping[int, int]
    start_ns: int
    end_ns: int


def indexed_span(view: Octets, indexes: Mapping[int, int]) -> IndexedSpan | None:
    """What message indexes, by channel, at these places of the file tell; None unless all of them can be read."""
    counts, start_ns, end_ns = dict[int, int](), 2**64, -1
    for channel_id, at in indexes.items():
        entries = _entries(view, at, channel_id)
        if entries is None:
            return None
        if len(entries):
            counts[channel_id] = len(entries)
            start_ns = min(start_ns, int(entries[:, 0].min()))
            end_ns = max(end_ns, int(entries[:, 0].max()))
    return IndexedSpan(counts, start_ns, end_ns) if counts else None


def indexed_counts(view: Octets, indexes: Mapping[int, int]) -> dict[int, int]:
    """How many messages of which channel the message indexes, as far as they can be read, tell."""
    found = {channel_id: _entries(view, at, channel_id) for channel_id, at in indexes.items() if at}
    return {channel_id: len(entries) for channel_id, entries in found.items() if entries is not None}


def _entries(view: Octets, at: int, channel_id: int) -> Entries | None:
    try:
        opcode, length, channel, size = unpacked(_INDEX_HEAD, view, at)
    except (struct.error, OverflowError):  # an offset beyond all memory
        return None
    if opcode != OPCODE_MESSAGE_INDEX or channel != channel_id or size != length - 6 or size % 16:
        return None
    if at + 15 + size > len(view):
        return None
    return np.frombuffer(view[at + 15 : at + 15 + size], "<u8").reshape(-1, 2)


def chunk_scans(data: bytes | memoryview, entries: Entries, channel: Channel) -> list[RecordedScan] | None:
    """The scans at these entries of a chunk's content; None when they are not all alike, or the index is wrong.

    The ranges are views into ``data``.
    """
    if not len(entries):
        return []
    first = int(entries[0, 1])
    try:
        _, length, _, _, _ = _message_head(data, first)
    except (struct.error, OverflowError):  # an offset beyond all memory
        return None
    layout = layout_of(channel.encoding, memoryview(data)[first + MESSAGE_HEAD : first + RECORD_HEAD + length])
    if layout is None or int(entries[:, 1].max()) + RECORD_HEAD + length > len(data):
        return None
    offsets = entries[:, 1].astype(np.int64)
    if not _stride(offsets) and len(np.unique(offsets)) < len(offsets):
        return None
    heads = _heads(data, offsets, layout)
    if not _alike(heads, entries, layout, length, channel):
        return None
    if not (_intensity_counts(data, offsets, layout) == layout.intensities).all():
        return None
    return _scans(data, offsets, heads, layout, channel)


def _heads(data: bytes | memoryview, offsets: NDArray[np.int64], layout: Layout) -> NDArray[np.void]:
    """(n,) the fields of each message up to its count of ranges; a view where messages lie at equal distances."""
    kind = _head_type(layout)
    if stride := _stride(offsets):
        return np.ndarray((len(offsets),), kind, data, int(offsets[0]), (stride,))
    octets = np.frombuffer(data, np.uint8)
    gathered: NDArray[np.void] = octets[offsets[:, None] + np.arange(kind.itemsize)].view(kind)[:, 0]
    return gathered


def _stride(offsets: NDArray[np.int64]) -> int:
    """The distance between messages when it is the same throughout, else 0."""
    steps = np.diff(offsets)
    return int(steps[0]) if len(steps) and steps[0] > 0 and bool((steps == steps[0]).all()) else 0


def _head_type(layout: Layout) -> np.dtype[np.void]:
    message, floats = MESSAGE_HEAD, MESSAGE_HEAD + layout.ranges_at - 32
    fields = {
        "opcode": ("u1", 0),
        "length": ("<u8", 1),
        "channel": ("<u2", 9),
        "log_ns": ("<u8", 15),
        "encapsulation": ("<u2", message),
        "sec": ("<i4", message + 4),
        "nanosec": ("<u4", message + 8),
        "frame_bytes": ("<u4", message + 12),
        "frame": (f"S{layout.frame_bytes}", message + 16),
        "start": ("<f4", floats),
        "step": ("<f4", floats + 8),
        "beam_s": ("<f4", floats + 12),
        "shortest": ("<f4", floats + 20),
        "longest": ("<f4", floats + 24),
        "ranges": ("<u4", floats + 28),
    }
    return np.dtype(
        {
            "names": list(fields),
            "formats": [kind for kind, _ in fields.values()],
            "offsets": [at for _, at in fields.values()],
            "itemsize": floats + 32,
        }
    )


def _alike(heads: NDArray[np.void], entries: Entries, layout: Layout, length: int, channel: Channel) -> bool:
    expected = {
        "opcode": OPCODE_MESSAGE,
        "length": length,
        "channel": channel.id,
        "frame_bytes": layout.frame_bytes,
        "frame": heads["frame"][0],
        "ranges": layout.ranges,
    }
    if channel.encoding == "cdr":
        expected["encapsulation"] = LITTLE_ENDIAN_CDR
    alike = all(bool((heads[name] == value).all()) for name, value in expected.items())
    return alike and bool((heads["log_ns"] == entries[:, 0]).all())


def _scans(
    data: bytes | memoryview, offsets: NDArray[np.int64], heads: NDArray[np.void], layout: Layout, channel: Channel
) -> list[RecordedScan] | None:
    try:
        frame = bare_frame(bytes(heads["frame"][0]).decode())
    except UnicodeDecodeError:
        return None
    stamps_ns = heads["sec"].astype(np.int64) * 10**9 + heads["nanosec"]
    columns = [heads[name].tolist() for name in ("start", "step", "beam_s", "shortest", "longest")]
    fields = zip(stamps_ns.tolist(), repeat(frame), *columns, _rows(data, offsets, layout), repeat(None))
    scans = map(_new_scan, fields)
    return list(map(_new_recorded, zip(repeat(channel), heads["log_ns"].tolist(), scans)))


def _intensity_counts(data: bytes | memoryview, offsets: NDArray[np.int64], layout: Layout) -> NDArray[np.uint32]:
    at = offsets + (MESSAGE_HEAD + layout.ranges_at + 4 * layout.ranges)
    if stride := _stride(at):
        return np.ndarray((len(at),), "<u4", data, int(at[0]), (stride,))
    gathered: NDArray[np.uint32] = np.frombuffer(data, np.uint8)[at[:, None] + np.arange(4)].view("<u4")[:, 0]
    return gathered


def _rows(data: bytes | memoryview, offsets: NDArray[np.int64], layout: Layout) -> list[NDArray[np.float32]]:
    """The ranges of each message as views; messages at equal distances share one array."""
    at = offsets + (MESSAGE_HEAD + layout.ranges_at)
    if stride := _stride(at):
        return list(np.ndarray((len(at), layout.ranges), FLOAT32, data, int(at[0]), (stride, FLOAT32.itemsize)))
    return [np.ndarray((layout.ranges,), FLOAT32, data, begin) for begin in at.tolist()]

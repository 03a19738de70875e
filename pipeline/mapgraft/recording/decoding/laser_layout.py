"""The fast way into a serialized ``sensor_msgs/LaserScan``: one struct per geometry instead of a walk over fields.

Messages of one lidar have equal sizes, so the place of every field follows from the message's size, and the few
fields that decide it (lengths of the frame name, the ranges and the intensities) are checked in each message. Whatever
does not fit takes the general way.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from mapgraft.contracts.sources import ScanMessage

FLOAT32 = np.dtype("<f4")
LITTLE_ENDIAN_CDR = 0x0100  # bytes 00 01
_MOST_LAYOUTS = 256
_uint32 = struct.Struct("<I").unpack_from
_new = tuple.__new__  # what NamedTuple's constructor does, at half the price

Data = bytes | memoryview


class Layout(NamedTuple):
    """Where the fields lie in messages of one size.

    After 4 bytes (encapsulation or sequence number) come the stamp's seconds (with a sign also in ROS 1, as the general
    way has it) and nanoseconds, the size of the frame name and the name; the seven floats and the count of ranges end
    at ``ranges_at``.
    """

    unpack: Callable[[Data], tuple[Any, ...]]
    frame_bytes: int
    ranges: int
    intensities: int
    ranges_at: int


def layout_of(encoding: str, data: Data) -> Layout | None:
    """The layout of a message in ``cdr`` or ``ros1``; None when it is not of the plain kind (or has no frame)."""
    return _cdr_layout(data) if encoding == "cdr" else _ros1_layout(data)


def _cdr_layout(data: Data) -> Layout | None:
    try:
        (frame_bytes,) = _uint32(data, 12)
        at = (12 + frame_bytes + 3) & ~3
        ranges, intensities = _counts(data, 4 + at + 28)
    except struct.error:
        return None
    padding = at - 12 - frame_bytes
    end = 4 + at + 28 + 4 + 4 * ranges + 4 + 4 * intensities
    if frame_bytes < 1 or not 0 <= len(data) - end <= 3:
        return None
    text = f"<H2xiII{frame_bytes}s{padding}x7fI{4 * ranges}xI"
    return Layout(struct.Struct(text).unpack_from, frame_bytes, ranges, intensities, 4 + at + 32)


def _ros1_layout(data: Data) -> Layout | None:
    try:
        (frame_bytes,) = _uint32(data, 12)
        ranges, intensities = _counts(data, 16 + frame_bytes + 28)
    except struct.error:
        return None
    if frame_bytes < 1 or len(data) != 16 + frame_bytes + 28 + 4 + 4 * ranges + 4 + 4 * intensities:
        return None
    text = f"<IiII{frame_bytes}s7fI{4 * ranges}xI"
    return Layout(struct.Struct(text).unpack_from, frame_bytes, ranges, intensities, 16 + frame_bytes + 32)


def _counts(data: Data, at: int) -> tuple[int, int]:
    (ranges,) = _uint32(data, at)
    (intensities,) = _uint32(data, at + 4 + 4 * ranges)
    return ranges, intensities


class LaserScanReader:
    """Reads serialized laser scans of one encoding; ``general`` decodes what is unusual."""

    def __init__(self, encoding: str, general: Callable[[Data], ScanMessage]) -> None:
        self._general = general
        self._encoding, self._cdr = encoding, encoding == "cdr"
        self._layouts: dict[int, Layout] = {}
        self._frames: dict[bytes, str] = {}

    def __call__(self, data: Data) -> ScanMessage:
        layout = self._layouts.get(len(data))
        if layout is not None:
            unpack, frame_bytes, ranges, intensities, ranges_at = layout
            first, sec, nanosec, size, name, start, _, step, beam_s, _, shortest, longest, n, m = unpack(data)
            frame = self._frames.get(name)
            if (
                frame is not None
                and size == frame_bytes
                and n == ranges
                and m == intensities
                and (first == LITTLE_ENDIAN_CDR or not self._cdr)
            ):
                values = np.ndarray((ranges,), FLOAT32, data, ranges_at)
                fields = (sec * 10**9 + nanosec, frame, start, step, beam_s, shortest, longest, values, None)
                return _new(ScanMessage, fields)
        return self._learn(data)

    def _learn(self, data: Data) -> ScanMessage:
        """Decode the general way, and remember what to expect of further messages of this size."""
        scan = self._general(data)
        layout = layout_of(self._encoding, data)
        if layout is not None:
            if len(self._layouts) >= _MOST_LAYOUTS or len(self._frames) >= _MOST_LAYOUTS:
                self._layouts.clear()
                self._frames.clear()
            self._layouts[len(data)] = layout
            self._frames[layout.unpack(data)[4]] = scan.frame_id
        return scan

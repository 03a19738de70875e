"""Writing CDR field by field, for the messages that are written too often for a general encoder."""

from __future__ import annotations

import struct
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

_PADDING = [bytes(n) for n in range(8)]


@lru_cache(maxsize=4096)  # names repeat in every message
def _text(text: str) -> bytes:
    data = text.encode()
    return struct.pack("<I", len(data) + 1) + data + b"\0"


class CdrWriter:
    """Little-endian CDR; every method appends one field, aligned as its type needs. ``numbers`` is a sequence."""

    __slots__ = ("_out",)

    def __init__(self) -> None:
        self._out = bytearray(b"\0\1\0\0")

    def stamp(self, stamp_ns: int) -> None:
        self.integers("<iI", *divmod(stamp_ns, 1_000_000_000))

    def text(self, text: str) -> None:
        out = self._out
        out += _PADDING[-len(out) & 3]
        out += _text(text)

    def integers(self, layout: str, *values: int) -> None:
        """32-bit integers; ``layout`` is that of the struct module."""
        self._out += _PADDING[-len(self._out) & 3]
        self._out += struct.pack(layout, *values)

    def wide(self, layout: str, *values: float) -> None:
        """64-bit integers or floats; ``layout`` is that of the struct module."""
        self._out += _PADDING[(4 - len(self._out)) & 7]
        self._out += struct.pack(layout, *values)

    def flag_byte(self, value: int) -> None:
        self._out.append(value)

    def numbers(self, values: NDArray[np.float64] | None) -> None:
        """A sequence of float64 of any shape, row-major; None is an empty one."""
        self.integers("<I", 0 if values is None else values.size)
        if values is not None and values.size:
            self._out += _PADDING[(4 - len(self._out)) & 7]
            self._out += np.ascontiguousarray(values, dtype="<f8").tobytes()

    def finish(self) -> bytes:
        return bytes(self._out)

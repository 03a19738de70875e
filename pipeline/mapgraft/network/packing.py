"""Bytes in bytes: numbers and texts of known length, read back with a look at every one of them; and what is packed."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import zstandard

from mapgraft.graph.claims import MOST_NAME_BYTES, Source

QUICK: Final = 3  # levels of zstd: what is kept, and what is sent
SMALL: Final = 15
_TYPICAL: Final = zstandard.ZstdCompressionDict(
    b'{"metadata":{"bounds_m":[-12.350000000000001,-8.1,14.600000000000001,9.9],"can_send":["counts","rays","path"],'
    b'"extra":{},"known_area_m2":153.2675,"mapper":"scans","observations":312,"quality":0.9123456789012345,'
    b'"resolution_m":0.05,"scale_known":true,"sensor":"laser","type":"occupancy_grid"},"provenance":["alpha",1,312]}',
    dict_type=zstandard.DICT_TYPE_RAWCONTENT,
)


class Writer:
    """Bytes that grow."""

    __slots__ = ("data",)

    def __init__(self, start: bytes = b"") -> None:
        self.data = bytearray(start)

    def number(self, value: int) -> Writer:
        """A whole number from 0 on, in as many bytes as it needs (7 bits in each)."""
        while value > 0x7F:
            self.data.append(0x80 | (value & 0x7F))
            value >>= 7
        self.data.append(value)
        return self

    def raw(self, data: bytes) -> Writer:
        """Bytes of a length that the reader knows."""
        self.data += data
        return self

    def text(self, data: bytes) -> Writer:
        """Bytes with their length."""
        return self.number(len(data)).raw(data)

    def source(self, source: Source) -> Writer:
        return self.text(source.name.encode()).number(source.epoch)


class Reader:
    """Reads what a ``Writer`` wrote; raises ValueError where that cannot be."""

    __slots__ = ("_at", "_data")

    def __init__(self, data: bytes, at: int = 0) -> None:
        self._data, self._at = data, at

    def number(self, most: int = (1 << 63) - 1) -> int:
        value, shift = 0, 0
        while True:
            byte = self.raw(1)[0]
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                break
            if shift > 63:
                raise ValueError("a number does not end")
        if value > most or (byte == 0 and shift > 7):
            raise ValueError(f"a number is {value}, or written too long")
        return value

    def raw(self, length: int) -> bytes:
        data = self._data[self._at : self._at + length]
        if len(data) < length:
            raise ValueError(f"it ends after {len(self._data)} bytes")
        self._at += length
        return bytes(data)

    def text(self, most: int) -> bytes:
        return self.raw(self.number(most))

    def source(self) -> Source:
        name = self.text(MOST_NAME_BYTES).decode()
        if not name:
            raise ValueError("a source has no name")
        return Source(name, self.number(0xFFFF_FFFF))

    def end(self) -> None:
        if self._at != len(self._data):
            raise ValueError(f"{len(self._data) - self._at} bytes follow its end")


def pack(data: bytes, against: bytes = b"", level: int = QUICK) -> bytes:
    """The bytes, compressed; ``against`` is what the one who unpacks them has anyway."""
    known = zstandard.ZstdCompressionDict(against, dict_type=zstandard.DICT_TYPE_RAWCONTENT) if against else None
    return zstandard.ZstdCompressor(level=level, dict_data=known, write_content_size=True).compress(data)


def unpack(data: bytes, most: int, against: bytes = b"") -> bytes:
    """The inverse of ``pack``; raises ValueError when they are something else, or unpack to more than ``most``."""
    known = zstandard.ZstdCompressionDict(against, dict_type=zstandard.DICT_TYPE_RAWCONTENT) if against else None
    try:
        size = zstandard.frame_content_size(data)
        if not 0 <= size <= most:
            raise ValueError(f"it unpacks to {size} bytes, {most} are allowed")
        unpacker = zstandard.ZstdDecompressor(dict_data=known)
        found = unpacker.decompress(data, max_output_size=most, read_across_frames=False, allow_extra_data=False)
    except zstandard.ZstdError as error:
        raise ValueError(f"it cannot be unpacked ({error})") from None
    if len(found) != size:
        raise ValueError(f"it unpacks to {len(found)} bytes instead of {size}")
    return found


def pack_offer(offer: bytes) -> bytes:
    """An offer, compressed against what all offers have in common."""
    return pack(offer, _TYPICAL.as_bytes())


def unpack_offer(data: bytes, most: int) -> bytes:
    """The inverse of ``pack_offer``; raises ValueError."""
    return unpack(data, most, _TYPICAL.as_bytes())


def difference(now: bytes, before: bytes) -> bytes:
    """By how much each byte of ``now`` differs from that of ``before`` at the same place, modulo 256."""
    import numpy as np

    old = np.zeros(len(now), np.uint8)
    both = min(len(now), len(before))
    old[:both] = np.frombuffer(before, np.uint8, both)
    return (np.frombuffer(now, np.uint8) - old).tobytes()


def restored(by: bytes, before: bytes) -> bytes:
    """The inverse of ``difference``."""
    import numpy as np

    old = np.zeros(len(by), np.uint8)
    both = min(len(by), len(before))
    old[:both] = np.frombuffer(before, np.uint8, both)
    return (np.frombuffer(by, np.uint8) + old).tobytes()


def texts(reader: Reader, most: int, longest: int) -> list[bytes]:
    """A list of texts as ``write_texts`` wrote it."""
    return [reader.text(longest) for _ in range(reader.number(most))]


def write_texts(writer: Writer, items: Iterable[bytes]) -> None:
    """A list of texts, its length first."""
    listed = list(items)
    writer.number(len(listed))
    for item in listed:
        writer.text(item)

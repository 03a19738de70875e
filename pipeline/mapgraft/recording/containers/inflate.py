"""Decompressing one chunk, and saving what can be had of a damaged or cut one."""

from __future__ import annotations

import bz2
import threading
import zlib
from collections.abc import Callable
from typing import NamedTuple, Protocol

import lz4.frame
import zstandard

COMPRESSIONS = frozenset({"", "none", "lz4", "zstd", "bz2"})
ONE_SHOT_LIMIT = 1 << 28
"""Above this many bytes a claimed size is not trusted: the output grows as it comes."""

_PIECE = 4096
_DAMAGE = (zstandard.ZstdError, RuntimeError, OSError, ValueError, EOFError, MemoryError)
_thread = threading.local()


class Content(NamedTuple):
    """What a chunk holds: all of it, or (``damage`` says why) only what lies before the damage.

    ``costly`` says that it had to be decompressed, which is worth another thread's while.
    """

    data: bytes | memoryview
    damage: str = ""
    costly: bool = False


class _Stream(Protocol):
    def decompress(self, data: bytes, /) -> bytes: ...


def inflate(compression: str, packed: memoryview, size: int, crc: int = 0) -> Content:
    """Decompress a chunk and check it.

    ``size`` is the uncompressed size in bytes, ``crc`` the CRC-32 of the uncompressed bytes, 0 where none was kept.
    Never raises for damaged bytes: a chunk whose stream breaks off gives its readable beginning, a complete chunk whose
    checksum is wrong gives nothing, because nobody can tell which of its bytes are wrong.
    """
    if compression not in COMPRESSIONS:
        return Content(b"", f"is compressed with {compression!r}, which is unknown here")
    if compression in ("", "none"):
        content = Content(packed, "" if len(packed) == size else "is shorter than it says")
    else:
        content = _unpacked(compression, packed, size)._replace(costly=True)
    if not content.damage and crc and zlib.crc32(content.data) != crc:
        return content._replace(data=b"", damage="does not match its checksum")
    return content


def _unpacked(compression: str, packed: memoryview, size: int) -> Content:
    if size <= ONE_SHOT_LIMIT:
        try:
            data = _ONE_SHOT[compression](packed, size)
            if len(data) == size:
                return Content(data)
        except _DAMAGE:
            pass
    return _readable_beginning(compression, packed, size)


def _zstd(packed: memoryview, size: int) -> bytes:
    if zstandard.frame_content_size(packed) not in (-1, size):
        raise ValueError("the frame disagrees with the chunk about its size")
    if not hasattr(_thread, "zstd"):
        _thread.zstd = zstandard.ZstdDecompressor()
    data: bytes = _thread.zstd.decompress(packed, max_output_size=size)
    return data


def _lz4(packed: memoryview, size: int) -> bytes:
    if lz4.frame.get_frame_info(packed)["content_size"] != size:  # 0: not said, or a lie
        raise ValueError("the frame does not say its size")
    data: bytes = lz4.frame.decompress(packed)
    return data


def _bz2(packed: memoryview, size: int) -> bytes:
    return bz2.BZ2Decompressor().decompress(packed, max_length=size)


_ONE_SHOT: dict[str, Callable[[memoryview, int], bytes]] = {"zstd": _zstd, "lz4": _lz4, "bz2": _bz2}


def _stream(compression: str) -> _Stream:
    if compression == "zstd":
        return zstandard.ZstdDecompressor().decompressobj()
    stream: _Stream = lz4.frame.LZ4FrameDecompressor() if compression == "lz4" else bz2.BZ2Decompressor()
    return stream


def _readable_beginning(compression: str, packed: memoryview, size: int) -> Content:
    """Feed the stream piece by piece until it is done, breaks, or gives more than it said."""
    stream, out, damage = _stream(compression), bytearray(), ""
    try:
        for start in range(0, len(packed), _PIECE):
            out += stream.decompress(bytes(packed[start : start + _PIECE]))
            if len(out) >= size:
                break
    except _DAMAGE as error:
        damage = f"is damaged ({error})"
    if len(out) > size:
        return Content(b"", "holds more than it says")
    if not damage and len(out) < size:
        damage = "is cut off"
    return Content(bytes(out), damage)

"""Decompressing one chunk, and saving what can be had of a damaged or cut one."""

from __future__ import annotations

import bz2
import struct
import threading
import zlib
from collections.abc import Callable
from typing import NamedTuple, Protocol

import lz4.frame
import zstandard

COMPRESSIONS = frozenset({"", "none", "lz4", "zstd", "bz2"})
ONE_SHOT_LIMIT = 1 << 26
"""Above this many bytes a claimed size is not trusted: the output grows as it comes."""

_PIECE = 1024  # so little, because a few bytes may unpack to a hundred thousand times as many
_ZSTD_BLOCK, _LZ4_LARGEST_BLOCK = 128 << 10, 4 << 20
_LZ4_HEADER = 15  # magic 4, flags 2, content size 8, checksum 1
_uint32 = struct.Struct("<I").unpack_from
_DAMAGE = (struct.error, zstandard.ZstdError, RuntimeError, OSError, ValueError, EOFError, MemoryError)
_thread = threading.local()


class Content(NamedTuple):
    """What a chunk holds: all of it, or (``damage`` says why) only what lies well before the damage.

    ``costly`` says that it had to be decompressed, which is worth another thread's while. ``suspect`` is everything
    that came out of a damaged chunk; nobody can tell which of its bytes are wrong.
    """

    data: bytes | memoryview
    damage: str = ""
    costly: bool = False
    suspect: bytes | memoryview = b""


class _Stream(Protocol):
    def decompress(self, data: bytes, /) -> bytes: ...


def inflate(
    compression: str, packed: memoryview, size: int, crc: int = 0, *, limit: int = ONE_SHOT_LIMIT, cut: bool = False
) -> Content:
    """Decompress a chunk and check it.

    ``size`` is the uncompressed size in bytes, ``crc`` the CRC-32 of the uncompressed bytes, 0 where none was kept.
    ``cut`` says that the file ends before the chunk does. Never raises for damaged bytes, and never makes more than
    ``limit`` bytes of them. A cut chunk gives its beginning. One whose stream breaks off gives its beginning up to
    two blocks before the break, because damage begins before it is noticed; one whose checksum is wrong gives nothing.
    """
    if compression not in COMPRESSIONS:
        return Content(b"", f"is compressed with {compression!r}, which is unknown here")
    if size > limit:
        return Content(b"", f"says that it holds {size:,} bytes, more than the limit of {limit:,} (limits.chunk_bytes)")
    if compression in ("", "none"):
        content = _plain(packed, size, cut)
    else:
        content = _unpacked(compression, packed, size, cut)._replace(costly=True)
    if not content.damage and crc and zlib.crc32(content.data) != crc:
        return content._replace(data=b"", damage="does not match its checksum", suspect=content.data)
    return content


def _plain(packed: memoryview, size: int, cut: bool) -> Content:
    if len(packed) == size:
        return Content(packed)
    if cut:
        return Content(packed[:size], "is cut off" if len(packed) < size else "")
    return Content(b"", "has another size than it says", suspect=packed)


def _unpacked(compression: str, packed: memoryview, size: int, cut: bool) -> Content:
    if size <= ONE_SHOT_LIMIT and not cut:
        try:
            data = _ONE_SHOT[compression](packed, size)
            if len(data) == size:
                return Content(data)
        except _DAMAGE:
            pass
    return _readable_beginning(compression, packed, size, cut)


def _zstd(packed: memoryview, size: int) -> bytes:
    if zstandard.frame_content_size(packed) not in (-1, size):
        raise ValueError("the frame disagrees with the chunk about its size")
    if not hasattr(_thread, "zstd"):
        _thread.zstd = zstandard.ZstdDecompressor()
    data: bytes = _thread.zstd.decompress(packed, max_output_size=size)
    return data


def _lz4(packed: memoryview, size: int) -> bytes:
    told = lz4.frame.get_frame_info(packed)
    if told["content_size"] != size:  # 0: not said, or a lie
        raise ValueError("the frame does not say its size")
    if _lz4_blocks(packed, told["block_checksum"]) * told["block_size"] < size + told["block_size"]:
        data: bytes = lz4.frame.decompress(packed)  # as quick as it gets, and does not stop at the size that is said
    else:
        data = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size)
    return data


def _lz4_blocks(packed: memoryview, checksums: bool) -> int:
    """How many blocks an LZ4 frame with a content size has."""
    at, blocks = _LZ4_HEADER + 4 * (packed[4] & 1), 0  # with a dictionary's id
    while (head := _uint32(packed, at)[0]) != 0:
        at += 4 + (head & 0x7FFFFFFF) + 4 * checksums
        blocks += 1
    return blocks


def _bz2(packed: memoryview, size: int) -> bytes:
    return bz2.BZ2Decompressor().decompress(packed, max_length=size)


_ONE_SHOT: dict[str, Callable[[memoryview, int], bytes]] = {"zstd": _zstd, "lz4": _lz4, "bz2": _bz2}


def _stream(compression: str) -> _Stream:
    if compression == "zstd":
        return zstandard.ZstdDecompressor().decompressobj()
    stream: _Stream = lz4.frame.LZ4FrameDecompressor() if compression == "lz4" else bz2.BZ2Decompressor()
    return stream


def _readable_beginning(compression: str, packed: memoryview, size: int, cut: bool) -> Content:
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
        return Content(b"", "holds more than it says", suspect=_read_only(out)[:size])
    if damage or (len(out) < size and not cut):
        sound = max(len(out) - _doubtful_bytes(compression, packed), 0)
        return Content(_read_only(out)[:sound], damage or "holds less than it says", suspect=_read_only(out))
    return Content(_read_only(out), "is cut off" if len(out) < size else "")


def _read_only(data: bytearray) -> memoryview:
    return memoryview(data).toreadonly()


def _doubtful_bytes(compression: str, packed: memoryview) -> int:
    """How many bytes before a break may be wrong already: two of the format's blocks.

    In a block whose bytes are stored as they are, damage is not noticed; the head of the next block tells of it. The
    blocks of bzip2 have checksums.
    """
    if compression == "bz2":
        return 0
    if compression == "zstd":
        return 2 * _ZSTD_BLOCK
    try:
        return 2 * int(lz4.frame.get_frame_info(packed)["block_size"])
    except _DAMAGE:
        return 2 * _LZ4_LARGEST_BLOCK

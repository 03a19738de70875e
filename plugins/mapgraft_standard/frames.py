"""The frame in which map types send their layers: a magic word, a version, and one zstd frame with a checksum."""

from __future__ import annotations

import struct
from typing import Final, NamedTuple

import zstandard

from mapgraft.contracts import MapError

_VERSION: Final = struct.Struct("<H")
_PIECE: Final = 1 << 12  # packed bytes that are unpacked at once
_MOST_WINDOW: Final = 1 << 27  # bytes that unpacking may look back


class Frame(NamedTuple):
    """How the layers of one map type are framed.

    ``what`` names them in errors ("grid"), ``most_bytes`` bounds what they unpack to. ``level`` is that of zstd: a part
    of the format, because it decides the bytes.
    """

    what: str
    magic: bytes
    version: int
    most_bytes: int
    level: int = 3

    @property
    def head(self) -> bytes:
        """What stands before the zstd frame."""
        return self.magic + _VERSION.pack(self.version)

    def packer(self) -> zstandard.ZstdCompressor:
        """What makes the zstd frame, of all at once or of parts; each way has bytes of its own."""
        return zstandard.ZstdCompressor(level=self.level, write_checksum=True)

    def unpacked(self, data: bytes) -> bytearray:
        """What was packed, taking no more memory than it really unpacks to.

        Raises MapError when the bytes are something else, of another version, damaged, cut short or too large.
        """
        start = len(self.magic) + _VERSION.size
        if data[: len(self.magic)] != self.magic or len(data) < start:
            raise MapError(
                f"an encoded {self.what} begins with {self.magic!r}, found {data[:start]!r}: "
                "these bytes are something else"
            )
        (version,) = _VERSION.unpack_from(data, len(self.magic))
        if version != self.version:
            raise MapError(
                f"an encoded {self.what} of version {version} was found, this program reads {self.version}: update it"
            )
        unpacker = zstandard.ZstdDecompressor(max_window_size=_MOST_WINDOW).decompressobj()
        found = bytearray()
        try:
            for first in range(start, len(data), _PIECE):
                found += unpacker.decompress(data[first : first + _PIECE])
                if len(found) > self.most_bytes:
                    most = f"more than {self.most_bytes} bytes"
                    raise MapError(f"an encoded {self.what} unpacks to {most}: it is damaged or too large")
        except zstandard.ZstdError as fault:
            raise self.damaged(fault) from fault
        if not unpacker.eof or unpacker.unused_data:
            raise MapError(f"an encoded {self.what} is cut short or has something behind its end: send it again")
        return found

    def damaged(self, why: object) -> MapError:
        """The error about bytes that are framed as they should be and hold what nobody would have written."""
        return MapError(f"an encoded {self.what} is damaged ({why}): send it again")

"""How much is unpacked of a file that may be broken or hostile."""

from __future__ import annotations

from dataclasses import dataclass

from mapgraft.errors import RecordingError

FREE_BYTES = 256 << 20
"""So much a file may unpack to, however small it is."""

FREE_TEXT_BYTES = 16 << 20
TEXT_SHARE = 0.1
"""A text, which is read line by line, may unpack to so much, or to this share of ``expansion`` times its size."""


@dataclass(frozen=True, slots=True)
class ReadLimits:
    """Bounds on what a container says of itself.

    ``chunk_bytes`` is the size that one chunk, or one compressed message, may unpack to: it bounds memory. A file may
    unpack to ``expansion`` times its own size: that bounds time.
    """

    chunk_bytes: int = 128 << 20
    expansion: float = 1000.0

    def check_expansion(self, path: object, packed_bytes: int, unpacked_bytes: int) -> None:
        """Raise RecordingError when a file of ``packed_bytes`` unpacks, by what it says, to more than it may."""
        if unpacked_bytes > self.unpacked_bytes(packed_bytes):
            raise RecordingError(
                f"{path} has {packed_bytes:,} bytes and says that it unpacks to {unpacked_bytes:,}, more than "
                f"{self.expansion:g} times its size: raise limits.expansion if you trust it"
            )

    def unpacked_bytes(self, packed_bytes: int) -> float:
        """How many bytes a file of ``packed_bytes`` may unpack to."""
        return max(FREE_BYTES, self.expansion * packed_bytes)

    def text_bytes(self, packed_bytes: int) -> int:
        """How much of a compressed text of ``packed_bytes`` is read."""
        return int(max(FREE_TEXT_BYTES, TEXT_SHARE * self.expansion * packed_bytes))


DEFAULT_LIMITS = ReadLimits()

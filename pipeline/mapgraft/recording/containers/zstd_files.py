"""Files and messages that a ROS 2 recorder compressed with zstd."""

from __future__ import annotations

import shutil
from pathlib import Path

import zstandard

from mapgraft.contracts.sources import ReadFaults
from mapgraft.errors import RecordingError
from mapgraft.recording.containers.limits import ReadLimits

_PIECE_BYTES = 1 << 20
LEFT_FREE_BYTES = 256 << 20  # of the disk; others write there, too


class Unpacking:
    """Decompresses the storage files of one bag into a folder, which together may not unpack to more than the limits.

    ``packed_bytes`` is what they take before.
    """

    def __init__(self, folder: Path, packed_bytes: int, limits: ReadLimits) -> None:
        self._folder, self._packed_bytes, self._limits = folder, packed_bytes, limits
        self._written_bytes = 0

    def unpack(self, packed: Path) -> Path:
        """Decompress a file; raises RecordingError when it cannot be, unpacks to far too much, or there is no room."""
        target = self._folder / packed.stem  # <name>.db3.zstd → <name>.db3
        try:
            with packed.open("rb") as source, target.open("wb") as sink:
                for piece in zstandard.ZstdDecompressor().read_to_iter(source, write_size=_PIECE_BYTES):
                    self._written_bytes += len(piece)
                    self._limits.check_expansion(packed.parent, self._packed_bytes, self._written_bytes)
                    if shutil.disk_usage(self._folder).free < LEFT_FREE_BYTES:
                        raise RecordingError(f"there is no room in {self._folder} to unpack {packed}: set TMPDIR")
                    sink.write(piece)
        except (OSError, zstandard.ZstdError) as error:
            raise RecordingError(f"{packed} cannot be decompressed ({error})") from error
        return target


def unpack_message(
    data: bytes | memoryview, faults: ReadFaults, topic: str, log_ns: int, limits: ReadLimits
) -> bytes | None:
    """Decompress one message; None, counted as a fault, when it cannot be."""
    try:
        if zstandard.frame_content_size(data) > limits.chunk_bytes:
            raise zstandard.ZstdError(f"it claims to be larger than {limits.chunk_bytes:,} bytes (limits.chunk_bytes)")
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=limits.chunk_bytes)
    except zstandard.ZstdError as error:
        faults.add("message_damaged", f"a compressed message cannot be unpacked ({error})", topic=topic, place=log_ns)
        return None

"""Files and messages that a ROS 2 recorder compressed with zstd."""

from __future__ import annotations

from pathlib import Path

import zstandard

from mapgraft.contracts.sources import ReadFaults
from mapgraft.errors import RecordingError
from mapgraft.recording.containers.limits import ReadLimits

_PIECE_BYTES = 1 << 20


def unpack_file(packed: Path, workspace: Path, limits: ReadLimits) -> Path:
    """Decompress a storage file into a folder; raises RecordingError when it cannot be, or unpacks to far too much."""
    target = workspace / packed.stem  # <name>.db3.zstd → <name>.db3
    try:
        size, written = packed.stat().st_size, 0
        with packed.open("rb") as source, target.open("wb") as sink:
            for piece in zstandard.ZstdDecompressor().read_to_iter(source, write_size=_PIECE_BYTES):
                written += len(piece)
                limits.check_expansion(packed, size, written)
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

"""Files and messages that a ROS 2 recorder compressed with zstd."""

from __future__ import annotations

from pathlib import Path

import zstandard

from mapgraft.contracts.sources import ReadFaults
from mapgraft.errors import RecordingError

MESSAGE_LIMIT_BYTES = 1 << 30
"""A compressed message that says it is larger than this is not believed."""


def unpack_file(packed: Path, workspace: Path) -> Path:
    """Decompress a storage file into a folder; raises RecordingError when it cannot be."""
    target = workspace / packed.stem  # <name>.db3.zstd → <name>.db3
    try:
        with packed.open("rb") as source, target.open("wb") as sink:
            zstandard.ZstdDecompressor().copy_stream(source, sink)
    except (OSError, zstandard.ZstdError) as error:
        raise RecordingError(f"{packed} cannot be decompressed ({error})") from error
    return target


def unpack_message(data: bytes | memoryview, faults: ReadFaults, topic: str, log_ns: int) -> bytes | None:
    """Decompress one message; None, counted as a fault, when it cannot be."""
    try:
        if zstandard.frame_content_size(data) > MESSAGE_LIMIT_BYTES:
            raise zstandard.ZstdError("it claims to be huge")
        return zstandard.ZstdDecompressor().decompressobj().decompress(data)
    except zstandard.ZstdError as error:
        faults.add("message_damaged", f"a compressed message cannot be unpacked ({error})", topic=topic, place=log_ns)
        return None

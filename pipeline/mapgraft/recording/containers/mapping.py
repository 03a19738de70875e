"""Files mapped into memory: only the pages that are read are loaded, and views stay valid as long as they are held."""

from __future__ import annotations

import mmap
from pathlib import Path

from mapgraft.errors import RecordingError


def map_file(path: Path) -> memoryview:
    """A read-only view of a whole file.

    The mapping lives as long as any view into it. Raises RecordingError when the file cannot be read or is empty.
    """
    try:
        with path.open("rb") as file:
            if path.stat().st_size == 0:
                raise RecordingError(f"{path} is empty (0 bytes): nothing was recorded, or the copy failed")
            return memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror or error}") from error

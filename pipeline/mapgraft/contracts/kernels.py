"""What the package of a plugin's numba kernels calls once, before any of them is compiled."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

_DIGITS: Final = 32  # of the SHA-256 in the name of a file of code


def share_cache() -> None:
    """Let processes that compile at once, or are killed while they do, share numba's cache on disk without harm.

    Numba numbers the files of a function's code by an index that it reads, extends and writes without a lock, and
    writes the code last. Two processes can give one number to the code of two signatures, and one that is killed in
    between leaves the number of code that was compiled from an earlier source: whoever loads that runs the wrong code,
    and dies of it. Here a file of code is called after its content and written before the index names it, so that a
    name never means anything else; when two write the index at once, one signature is compiled once more. Files that a
    power cut has spoiled count as missing, and a cache that cannot be written is none.

    Only what is decorated afterwards is concerned, in this process; the files stay where numba has them.
    """
    from numba.core import caching

    numbas = vars(caching)
    if numbas["IndexDataCacheFile"] is not SharedCacheFile:
        SharedCacheFile.numbered = numbas["IndexDataCacheFile"]
        numbas["IndexDataCacheFile"] = SharedCacheFile


class SharedCacheFile:
    """The compiled signatures of one function: an index in numba's own format, and a file of code for each."""

    numbered: Any = None  # numba's own class

    def __init__(self, cache_path: str, filename_base: str, source_stamp: object) -> None:
        self._files = self.numbered(cache_path, filename_base, source_stamp)
        self._folder, self._base = Path(cache_path), filename_base

    def flush(self) -> None:
        """Forget everything."""
        self._files.flush()

    def save(self, key: object, data: object) -> None:
        """Keep the code of a signature, if the disk lets us: it is compiled in any case."""
        code = self._files._dump(data)
        name = f"{self._base}.{_digest(code)}.nbc"
        with suppress(OSError):
            with self._files._open_for_write(str(self._folder / name)) as stream:
                stream.write(code)
            self._files._save_index({**self._index(), key: name})

    def load(self, key: object) -> object:
        """The code of a signature; None where it is not kept, or is not what was kept."""
        name = self._index().get(key)
        if name is None:
            return None
        try:
            code = (self._folder / name).read_bytes()
        except OSError:
            return None
        return pickle.loads(code) if name == f"{self._base}.{_digest(code)}.nbc" else None

    def _index(self) -> Mapping[object, str]:
        """Signature → file; nothing where it cannot be read, whatever is wrong with it."""
        with suppress(Exception):
            index: Mapping[object, str] = self._files._load_index()
            return index
        return {}


def _digest(code: bytes) -> str:
    return hashlib.sha256(code).hexdigest()[:_DIGITS]

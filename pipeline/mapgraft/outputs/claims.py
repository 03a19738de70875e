"""Unfinished files that several processes write side by side: those whose writer is gone are told from the others.

Whoever writes such a file holds its lock until it has its final name; dying gives the lock back.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path


def claim(path: Path, descriptor: int) -> bool:
    """Lock the file that a descriptor is open for; whether it still is the one at ``path``.

    It is not where somebody took it away as a rest before it was locked. The lock holds as long as the descriptor, or
    another one that was duplicated from it, is open. Raises OSError.
    """
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False


def clear(rests: Iterable[Path]) -> None:
    """Take away those files that nobody has claimed, as far as the folder lets us."""
    for path in rests:
        with suppress(OSError), path.open("rb") as stream:
            fcntl.flock(stream.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)  # BlockingIOError: somebody writes it
            path.unlink()

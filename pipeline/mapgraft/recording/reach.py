"""What this user may look at: below a folder that may not be entered, every question about a path raises."""

from __future__ import annotations

import os
from pathlib import Path

from mapgraft.errors import RecordingError


def is_file(path: Path) -> bool:
    """Whether there is a file, as far as this user may know."""
    try:
        return path.is_file()
    except PermissionError:
        return False


def is_there(path: Path) -> bool:
    """Whether there is a file or a folder, as far as this user may know."""
    try:
        return path.exists()
    except PermissionError:
        return False


def require_readable(path: Path) -> None:
    """Raise RecordingError where this user may not read a file or list a folder, or not come to it.

    What is not there, or cannot be looked at for another reason, is left to whoever opens it.
    """
    try:
        wanted = os.R_OK | (os.X_OK if path.is_dir() else 0)
        closed = path.exists() and not os.access(path, wanted, effective_ids=True)
    except PermissionError:
        closed = True
    except OSError:
        return
    if closed:
        raise RecordingError(f"{path} may not be read by this user: check the permissions of it and of its folders")

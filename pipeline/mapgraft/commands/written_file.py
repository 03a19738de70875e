"""A file that an option names: whether it can be written is found out before anything is computed for it."""

from __future__ import annotations

import os
from pathlib import Path

from mapgraft.errors import UsageError


def require_no_folder(option: str, path: Path) -> None:
    """Raises UsageError where the file that ``option`` names is a folder."""
    if path.is_dir():
        raise UsageError(f"{option} {path}: that is a folder; name a file")


def require_writable(option: str, path: Path) -> None:
    """Raises UsageError where the file that ``option`` names cannot be written."""
    require_no_folder(option, path)
    if not path.absolute().parent.is_dir():
        raise UsageError(f"{option} {path}: its folder does not exist; make it, or write elsewhere")
    if not os.access(path if path.exists() else path.absolute().parent, os.W_OK):
        raise UsageError(f"{option} {path}: this user may not write there; write elsewhere")

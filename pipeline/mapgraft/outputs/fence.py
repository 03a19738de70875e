"""What keeps files in the folder that was named: neither names that somebody wrote down nor links lead out of it.

A folder may come from anybody. The folder itself may be reached through a link; below it none is followed where
something is written, renamed or removed. This holds for what lies in the folder beforehand, not against somebody who
changes it at the same moment.
"""

from __future__ import annotations

import os
from pathlib import Path, PurePosixPath

from mapgraft.errors import OutputError


def is_name(name: object) -> bool:
    """Whether this can be the name of a file in a folder: relative, with '/', in its one spelling, going up nowhere."""
    if not isinstance(name, str) or "\0" in name:
        return False
    try:
        os.fsencode(name)
    except UnicodeEncodeError:
        return False
    path = PurePosixPath(name)
    return bool(path.parts) and not path.is_absolute() and ".." not in path.parts and str(path) == name


def file_in(out: Path, name: str) -> Path:
    """The place of a file in a folder, by its relative name; it need not be there, nor need the folders above it.

    A link in the place itself is none of our concern: what is renamed or removed there is the link. Raises OutputError
    where the name is none, or a link lies on the way.
    """
    if not is_name(name):
        raise OutputError(f"{name!r} is not the name of a file below {out}: choose another folder")
    return folder_in(out, str(PurePosixPath(name).parent)) / PurePosixPath(name).name


def folder_in(out: Path, name: str) -> Path:
    """The place of a folder below another one; raises OutputError where it is a link, or one lies on the way."""
    place = out
    for part in PurePosixPath(name).parts:
        place /= part
        if place.is_symlink():
            raise OutputError(
                f"{place} is a link, which may lead out of {out}: put a folder in its place, or choose another folder"
            )
    return place


def lies_in(out: Path, name: object) -> bool:
    """Whether this is the name of a file for which ``file_in`` has a place."""
    try:
        return isinstance(name, str) and bool(file_in(out, name))
    except OutputError:
        return False

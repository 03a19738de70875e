"""Names of files wherever they are: paths of this machine, and URLs of object stores."""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from urllib.parse import urlsplit

from mapgraft.errors import UsageError

LOCAL = "file://"


def is_url(place: str) -> bool:
    """Whether a name is one of a store elsewhere (``s3://…``); ``file://`` is not."""
    return "://" in place and not place.startswith(LOCAL)


def local(place: str) -> Path:
    """The absolute path of a file of this machine, given as path or as ``file://`` URL."""
    if not place.startswith(LOCAL):
        return Path(place).absolute()
    split = urlsplit(place)
    if split.netloc not in ("", "localhost") or not split.path:
        raise UsageError(f"{place} names another machine: a file of this one is file:///folder/file")
    return Path(split.path)


def whole(place: str, folder: str = "") -> str:
    """A name that means the same from everywhere: an absolute path, or a URL. ``folder`` is what it may be relative to.

    A slash at the end says nothing and is left out. ``..`` and links stay as they are, because robots are called after
    the files as they were given.
    """
    if is_url(place):
        scheme, _, rest = place.partition("://")
        return f"{scheme}://{rest.rstrip('/')}"
    if folder and not place.startswith(LOCAL) and not Path(place).is_absolute():
        return below(folder, place) if is_url(folder) else str(Path(folder).absolute() / place)
    return str(local(place))


def below(folder: str, name: str) -> str:
    """A name within a folder, of this machine or elsewhere."""
    return f"{folder.rstrip('/')}/{name}" if is_url(folder) else str(Path(folder) / name)


def stand_in(root: Path, url: str) -> Path:
    """The path below ``root`` that stands for a file elsewhere; the same names in the same folders."""
    scheme, _, rest = url.partition("://")
    parts = [part for part in PurePosixPath(rest).parts if part not in ("/", "..", ".")]
    return root.joinpath(scheme, *parts)


def name_of(place: str) -> str:
    """The last part of a path or URL."""
    return PurePosixPath(place.rstrip("/")).name

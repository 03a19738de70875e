"""Where a data set lies: a folder of this machine, or an object store through fsspec."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Protocol
from uuid import uuid4

from mapgraft.corpus.places import is_url, local
from mapgraft.errors import MapgraftError, OutputError, UsageError
from mapgraft.outputs.fence import file_in, folder_in
from mapgraft.outputs.staging import new_file, sync, sync_folder, writing

UNFINISHED = ".unfinished"
"""The folder of a data set on a disk in which files are written before they get their names."""

_A_DAY_S = 86_400.0  # nobody writes one file for so long: what is older was left by a process that was killed


class Store(Protocol):
    """A folder of files that appear and are replaced as wholes; names are relative, with '/'.

    Methods raise OutputError when the store refuses.
    """

    @property
    def url(self) -> str: ...
    def names(self, folder: str) -> list[str]:
        """All files in a folder and below, sorted; none where the folder is not there."""
        ...

    def has(self, name: str) -> bool: ...
    def read(self, name: str) -> bytes | None:
        """All of a small file; None where there is none."""
        ...

    def put(self, file: Path, name: str) -> None:
        """Copy a file of this machine there. Who looks sees nothing of it, or what was there before, or all of it."""
        ...

    def remove(self, name: str) -> None:
        """Take a file away, if it is there."""
        ...

    def arrow(self) -> tuple[Any, str]:
        """The ``pyarrow.fs.FileSystem`` and the path in it, for those who read tables."""
        ...


def open_store(place: str) -> Store:
    """The store at a path or URL, which need not be there yet; raises UsageError for a kind of URL nobody knows."""
    if not is_url(place):
        return FolderStore(local(place))
    filesystem, root = filesystem_of(place)
    return ObjectStore(place.rstrip("/"), filesystem, root)


def filesystem_of(url: str) -> tuple[Any, str]:
    """The fsspec file system that a URL is of, and the path in it.

    Options, such as another endpoint, come from where its library looks for them: environment and fsspec's
    configuration. Raises UsageError when there is none for this kind of URL.
    """
    scheme = url.partition("://")[0]
    extra = "mapgraft[s3]" if scheme == "s3" else f"fsspec and its package for {scheme}://"
    try:
        from fsspec.core import url_to_fs
    except ImportError:
        raise UsageError(f"{url} needs fsspec: pip install '{extra}'") from None
    try:
        filesystem, root = url_to_fs(url)
    except (ImportError, ValueError) as error:
        raise UsageError(f"{url} cannot be opened: {error}; install {extra}") from None
    return filesystem, root.rstrip("/")


@contextmanager
def asking(what: str, error: type[MapgraftError] = OutputError) -> Iterator[None]:
    """Turns whatever a store's library raises into one sentence; each has errors of its own, without a common kind."""
    try:
        yield
    except MapgraftError:
        raise
    except Exception as fault:
        said = " ".join(str(fault).split()) or type(fault).__name__
        raise error(f"{what}: {said}") from (fault if isinstance(fault, OSError) else OSError(said))


class FolderStore:
    """A folder on a disk. Files are written aside, synced, and renamed; through links below it nothing is written."""

    def __init__(self, root: Path) -> None:
        self._root = root

    @property
    def url(self) -> str:
        return str(self._root)

    def names(self, folder: str) -> list[str]:
        with writing(self._root):
            found = (self._root / folder).rglob("*")
            return sorted(path.relative_to(self._root).as_posix() for path in found if path.is_file())

    def has(self, name: str) -> bool:
        return (self._root / name).is_file()

    def read(self, name: str) -> bytes | None:
        with writing(self._root):
            return (self._root / name).read_bytes() if self.has(name) else None

    def put(self, file: Path, name: str) -> None:
        with writing(self._root):
            aside, place = file_in(self._root, f"{UNFINISHED}/{uuid4().hex}"), file_in(self._root, name)
            aside.parent.mkdir(parents=True, exist_ok=True)
            place.parent.mkdir(parents=True, exist_ok=True)
            try:
                with new_file(aside) as stream, file.open("rb") as source:
                    shutil.copyfileobj(source, stream, 1 << 20)
                    sync(stream)
                os.replace(aside, place)  # noqa: PTH105 (says what it does: atomic)
            except BaseException:
                aside.unlink(missing_ok=True)
                raise
            for folder in (place.parent, place.parent.parent):
                sync_folder(folder)

    def remove(self, name: str) -> None:
        with writing(self._root):
            place = file_in(self._root, name)
            place.unlink(missing_ok=True)
        with suppress(OSError):  # somebody has put something else there meanwhile
            place.parent.rmdir()

    def arrow(self) -> tuple[Any, str]:
        from pyarrow.fs import LocalFileSystem

        return LocalFileSystem(), str(self._root)

    def tidy(self) -> None:
        """Take away what processes that were killed have left half-written.

        Raises OutputError where that lies behind a link.
        """
        with suppress(OSError):
            for path in folder_in(self._root, UNFINISHED).iterdir():
                if time.time() - path.stat().st_mtime > _A_DAY_S:
                    path.unlink(missing_ok=True)


class ObjectStore:
    """A prefix of an object store. An object appears when its upload is complete, as such stores do."""

    def __init__(self, url: str, filesystem: Any, root: str) -> None:
        self._url, self._filesystem, self._root = url, filesystem, root

    @property
    def url(self) -> str:
        return self._url

    def names(self, folder: str) -> list[str]:
        with asking(f"{self._url}/{folder} cannot be listed"):
            self._filesystem.invalidate_cache()
            try:
                found = self._filesystem.find(f"{self._root}/{folder}")
            except FileNotFoundError:
                return []
            return sorted(name.removeprefix(self._root).lstrip("/") for name in map(str, found))

    def has(self, name: str) -> bool:
        with asking(f"{self._url}/{name} cannot be looked for"):
            self._filesystem.invalidate_cache()
            return bool(self._filesystem.exists(f"{self._root}/{name}"))

    def read(self, name: str) -> bytes | None:
        with asking(f"{self._url}/{name} cannot be read"):
            try:
                data: bytes = self._filesystem.cat_file(f"{self._root}/{name}")
            except FileNotFoundError:
                return None
            return data

    def put(self, file: Path, name: str) -> None:
        with asking(f"{self._url}/{name} cannot be written"):
            self._filesystem.put_file(str(file), f"{self._root}/{name}")

    def remove(self, name: str) -> None:
        with asking(f"{self._url}/{name} cannot be removed"), suppress(FileNotFoundError):
            self._filesystem.rm_file(f"{self._root}/{name}")

    def arrow(self) -> tuple[Any, str]:
        from pyarrow.fs import FSSpecHandler, PyFileSystem

        self._filesystem.invalidate_cache()
        return PyFileSystem(FSSpecHandler(self._filesystem)), self._root

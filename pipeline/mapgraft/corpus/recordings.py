"""Recordings wherever they lie: what is known of a file without reading it, its ranges, and all that a folder holds."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from mapgraft.corpus.places import below, is_url, local, whole
from mapgraft.corpus.stores import asking, filesystem_of
from mapgraft.errors import RecordingError
from mapgraft.outputs.provenance import InputFile

SUFFIXES = (".mcap", ".bag", ".log", ".clf", ".gfs", ".log.gz", ".clf.gz", ".gfs.gz", ".db3")
OWN = ".merge.mcap"  # what a run has written is no recording of a corpus
_ETAGS = ("ETag", "etag", "md5Hash", "content_md5")  # as the libraries of the stores call it
_BAG = "metadata.yaml"  # tells that a folder is a ROS 2 bag
_BAG_KEY, _HEAD_BYTES = b"rosbag2_bagfile_information", 1024  # what such a file begins with
_OF_READERS = "-shm"  # beside an SQLite database: made and removed by whoever reads it
Looks = tuple[tuple[str, int, int], ...]
"""Paths, sizes (bytes) and times of last writing (ns): as long as they stay, files are taken for unchanged."""


@dataclass(frozen=True, slots=True)
class FarFile:
    """A file of an object store, with what the store says of it."""

    url: str
    size_bytes: int
    etag: str
    _filesystem: Any
    _path: str

    def read(self, begin: int, end: int) -> bytes:
        """The bytes of a range; raises OSError, whatever the store's library raises."""
        try:
            data: bytes = self._filesystem.cat_file(self._path, start=begin, end=end)
        except Exception as error:
            raise OSError(" ".join(str(error).split()) or type(error).__name__) from error
        return data

    def copy_to(self, path: Path) -> None:
        """Fetch the whole file; raises RecordingError."""
        path.parent.mkdir(parents=True, exist_ok=True)
        with asking(f"{self.url} cannot be read", RecordingError):
            self._filesystem.get_file(self._path, str(path))


@dataclass(frozen=True, slots=True)
class FarRecording:
    """A recording of an object store: one file, or the files of a ROS 2 bag's folder, sorted."""

    url: str
    files: tuple[FarFile, ...]

    @property
    def is_folder(self) -> bool:
        return self.files[0].url != self.url

    @property
    def input_file(self) -> InputFile:
        """What it is, by what the store says; nothing is read for it."""
        etag, size_bytes = self.files[0].etag, sum(file.size_bytes for file in self.files)
        if self.is_folder:
            told = [(file.url.removeprefix(self.url), file.etag, file.size_bytes) for file in self.files]
            etag = hashlib.sha256(json.dumps(told).encode()).hexdigest()
        return InputFile(self.url, "", size_bytes, etag=etag)


def far_recording(url: str) -> FarRecording:
    """What a store says of a recording.

    Raises RecordingError when it is not there, when the store does not answer, or when it does not tell a version of
    the contents: nobody could know them again then.
    """
    url = whole(url)
    filesystem, path = filesystem_of(url)
    with asking(f"{url} cannot be read", RecordingError):
        filesystem.invalidate_cache()
        try:
            told = filesystem.info(path)
        except FileNotFoundError:
            raise RecordingError(f"{url} does not exist") from None
        found = filesystem.find(path, detail=True) if told["type"] == "directory" else {path: told}
    if not found:
        raise RecordingError(f"{url} is an empty folder: name a file")
    files = [_far_file(url + str(name).removeprefix(path), filesystem, told) for name, told in sorted(found.items())]
    if files[0].url != url and f"{url}/{_BAG}" not in [file.url for file in files]:
        raise RecordingError(f"{url} is a folder without {_BAG}, which is no ROS 2 bag: name a file")
    return FarRecording(url, tuple(files))


def _far_file(url: str, filesystem: Any, told: Mapping[str, Any]) -> FarFile:
    etag = next((str(told[key]) for key in _ETAGS if told.get(key)), "")
    if not etag:
        raise RecordingError(f"the store of {url} tells no ETag, by which its contents are known: copy it to a disk")
    if told.get("size") is None:
        raise RecordingError(f"the store of {url} does not tell its size: copy it to a disk")
    return FarFile(url, int(told["size"]), etag.strip('"'), filesystem, str(told["name"]))


def near_file(path: Path) -> InputFile | None:
    """What a disk says of a file: no digest yet; None for a folder, and for what cannot be looked at."""
    try:
        told = path.stat()
    except OSError:
        return None
    return InputFile(str(path), "", told.st_size, modified_ns=told.st_mtime_ns) if path.is_file() else None


def looks_of(path: Path) -> Looks:
    """What a disk says of a file, or of all files in a folder; nothing where there is none."""
    files = sorted(path.rglob("*")) if path.is_dir() else [path]
    told = [near_file(file) for file in files if not file.name.endswith(_OF_READERS)]
    return tuple((file.path, file.size_bytes, file.modified_ns or 0) for file in told if file is not None)


def recordings_in(place: str, suffixes: Sequence[str] = ()) -> list[str]:
    """All recordings in a folder and below, of this machine or elsewhere, sorted.

    They are files, told by their suffixes, and the folders of ROS 2 bags. ``suffixes`` are those of plugins' readers.
    Names with a dot in front are left out, and what a run has written. The folder of a ROS 2 bag is that recording, and
    so is a file elsewhere. Raises RecordingError when the folder cannot be listed.
    """
    names, at = _far_names(place) if is_url(place) else _near_names(local(place))
    bags = {str(PurePosixPath(name).parent) for name in names if PurePosixPath(name).name == _BAG}
    if names == [""] or ("." in bags and _is_bag(place)):
        return [whole(place)]
    bags = {
        bag for bag in bags if bag != "." and any(_in(name, bag) and name.endswith((".mcap", ".db3")) for name in names)
    }
    fitting = (*SUFFIXES, *suffixes)
    single = [
        name
        for name in names
        if name.lower().endswith(fitting) and not name.endswith(OWN) and not any(_in(name, bag) for bag in bags)
    ]
    return [at(name) for name in sorted([*single, *bags])]


def _is_bag(folder: str) -> bool:
    """Whether a folder with ``metadata.yaml`` is a ROS 2 bag, and not one of recordings with some file of that name."""
    place = below(folder, _BAG)
    with asking(f"{place} cannot be read", RecordingError):
        if is_url(place):
            filesystem, path = filesystem_of(place)
            head = bytes(filesystem.cat_file(path, start=0, end=_HEAD_BYTES))
        else:
            with local(place).open("rb") as stream:
                head = stream.read(_HEAD_BYTES)
    return _BAG_KEY in head


def _in(name: str, folder: str) -> bool:
    return name.startswith(f"{folder}/")


def _visible(names: Sequence[str]) -> list[str]:
    return [name for name in names if not any(part.startswith(".") for part in PurePosixPath(name).parts)]


def _near_names(folder: Path) -> tuple[list[str], Callable[[str], str]]:
    with asking(f"{folder} cannot be listed", RecordingError):
        names = [path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()]
    return _visible(names), lambda name: str(folder / name)


def _far_names(url: str) -> tuple[list[str], Callable[[str], str]]:
    filesystem, root = filesystem_of(url)
    with asking(f"{url} cannot be listed", RecordingError):
        filesystem.invalidate_cache()
        names = [str(name).removeprefix(root).lstrip("/") for name in filesystem.find(root)]
    return _visible(names), lambda name: f"{url.rstrip('/')}/{name}"

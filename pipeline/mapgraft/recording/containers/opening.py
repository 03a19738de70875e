"""Opening a recording, whatever it is: by what the file says of itself, and by suffix for plugins' readers."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from mapgraft.contracts.sources import Source
from mapgraft.errors import RecordingError
from mapgraft.recording.containers.carmen_lines import KEYWORDS
from mapgraft.recording.containers.limits import DEFAULT_LIMITS, ReadLimits
from mapgraft.recording.containers.octets import Octets
from mapgraft.recording.containers.text_lines import GZIP_MAGIC
from mapgraft.recording.containers.tum_file import pose_of
from mapgraft.recording.decoding.codecs import DEFAULT_TYPESTORE, known_typestore
from mapgraft.recording.reach import require_readable

_GLANCE_BYTES = 1 << 16
_PACKED = {b"BZh": "bunzip2", b"\xfd7zXZ": "unxz", b"\x28\xb5\x2f\xfd": "unzstd", b"PK\x03\x04": "unzip"}
_CARMEN_SUFFIXES = (".clf", ".gfs", ".clf.gz", ".gfs.gz")
_SUFFIXES = (".mcap", ".bag", ".bag.active", ".db3", ".log", ".log.gz", *_CARMEN_SUFFIXES)
_KINDS = "MCAP, ROS 1 bag, ROS 2 bag, CARMEN log or TUM trajectory"


class Reader(NamedTuple):
    """A plugin's way to open files with one of these suffixes (``.pbstream``); called only for such files."""

    suffixes: tuple[str, ...]
    open: Callable[[Path], object]


def is_named_as_recording(path: Path, readers: Sequence[Reader] = ()) -> bool:
    """Whether there is something at the path, a folder or a file, that is called as recordings are.

    Where this user may not look, the name alone tells.
    """
    suffixes = (*_SUFFIXES, *(suffix for reader in readers for suffix in reader.suffixes))
    named = path.name.endswith(suffixes)
    try:
        return path.is_dir() or (path.is_file() and named)
    except PermissionError:
        return named


def open_source(
    path: str | Path,
    *,
    typestore: str | None = None,
    readers: Sequence[Reader] = (),
    limits: ReadLimits = DEFAULT_LIMITS,
    octets: Octets | None = None,
) -> Source:
    """Open one recording: a file, or the folder of a ROS 2 bag.

    ``typestore`` names the rosbags typestore for ROS 2 messages whose definition is not in the file (default
    ``ros2_humble``). ``readers`` come first for files with their suffixes. ``limits`` bound what a container may unpack
    to. ``octets`` are the bytes of an MCAP file that is not on this machine, for which ``path`` is only a name. Raises
    RecordingError when the file is missing, empty, unreadable or no recording, and UsageError for an unknown typestore.
    """
    path, types = Path(path), known_typestore(typestore or DEFAULT_TYPESTORE).value
    if octets is not None:
        from mapgraft.recording.containers.mcap_file import McapSource

        return McapSource(path, typestore=types, limits=limits, octets=octets)
    require_readable(path)
    try:
        is_folder = path.is_dir()
        if not is_folder and not path.exists():
            raise RecordingError(f"{path} does not exist")
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror or error}") from error
    for reader in readers:
        if path.name.endswith(reader.suffixes):
            return _checked(reader.open(path), path)
    if is_folder:
        from mapgraft.recording.containers.bag_folder import BagFolderSource

        return BagFolderSource(path, typestore=types, limits=limits)
    return _open_file(path, _head(path), types, limits)


def _checked(source: object, path: Path) -> Source:
    if not isinstance(source, Source):
        raise RecordingError(f"the reader for {path.name} gives a {type(source).__name__}, which is no source")
    return source


def _head(path: Path) -> bytes:
    try:
        if not path.is_file():
            raise RecordingError(f"{path} is neither a file nor a folder")
        with path.open("rb") as file:
            head = file.read(_GLANCE_BYTES)
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror or error}") from error
    if not head:
        raise RecordingError(f"{path} is empty (0 bytes): nothing was recorded, or the copy failed")
    return head


def _open_file(path: Path, head: bytes, typestore: str, limits: ReadLimits) -> Source:
    """Open by the first bytes; the readers are imported when they are needed."""
    if head.startswith(b"\x89MCAP"):
        from mapgraft.recording.containers.mcap_file import McapSource

        return McapSource(path, typestore=typestore, limits=limits)
    if head.startswith((b"#ROSBAG V", b"#ROSRECORD V")):
        from mapgraft.recording.containers.bag_file import BagSource

        return BagSource(path, typestore=typestore, limits=limits)
    if head.startswith(b"SQLite format 3\0"):
        from mapgraft.recording.containers.sqlite_file import SqliteSource

        return SqliteSource(path, typestore=typestore, limits=limits)
    for magic, tool in _PACKED.items():
        if head.startswith(magic):
            raise RecordingError(f"{path} is compressed as a whole: unpack it first ({tool})")
    return _open_text(path, head, typestore, limits)


def _open_text(path: Path, head: bytes, typestore: str, limits: ReadLimits) -> Source:
    text = _unzipped(path, head)
    if text.startswith((b"\x89MCAP", b"#ROSBAG V", b"SQLite format 3\0")):
        raise RecordingError(f"{path} is compressed as a whole: unpack it first (gunzip)")
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith(b"#")]
    if any(line.split(None, 1)[0] in KEYWORDS for line in lines) or path.name.endswith(_CARMEN_SUFFIXES):
        from mapgraft.recording.containers.carmen_file import CarmenSource

        return CarmenSource(path, limits)
    if any(map(_is_pose, lines[:10])):
        from mapgraft.recording.containers.tum_file import TumSource

        return TumSource(path, limits)
    return _open_by_name(path, typestore, limits)


def _open_by_name(path: Path, typestore: str, limits: ReadLimits) -> Source:
    """A file whose first bytes tell nothing may still be one whose beginning is damaged."""
    if path.name.endswith(".mcap"):
        from mapgraft.recording.containers.mcap_file import McapSource

        return McapSource(path, typestore=typestore, limits=limits)
    if path.name.endswith((".bag", ".bag.active")):
        from mapgraft.recording.containers.bag_file import BagSource

        return BagSource(path, typestore=typestore, limits=limits)
    raise RecordingError(f"{path} is not a recording that can be read here ({_KINDS})")


def _unzipped(path: Path, head: bytes) -> bytes:
    """The first bytes of the text, also of a gzip file that is cut off."""
    if not head.startswith(GZIP_MAGIC):
        return head
    try:
        return zlib.decompressobj(wbits=31).decompress(head, _GLANCE_BYTES)
    except zlib.error as error:
        raise RecordingError(f"{path} is a gzip file that cannot be unpacked ({error})") from error


def _is_pose(line: bytes) -> bool:
    try:
        pose_of(line)
    except ValueError:
        return False
    return True

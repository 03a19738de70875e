"""Which files make up a ROS 2 bag, and how they are compressed: from its metadata.yaml, or from the file names."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

from mapgraft.contracts.sources import ReadFaults
from mapgraft.documents import parse_yaml, read_text
from mapgraft.errors import RecordingError
from mapgraft.recording.naming import real_path

METADATA = "metadata.yaml"
SUFFIXES = (".db3", ".mcap")

_PART = re.compile(r"(.*?)_?(\d+)?$")  # rosbag2 names the parts of a bag <name>_0, <name>_1, …


class _UnusableError(RecordingError):
    """The metadata cannot be read; never leaves this module."""


@dataclass(frozen=True, slots=True)
class BagLayout:
    """The storage files of a bag in order, and what is compressed: nothing, each ``file`` or each ``message``."""

    files: tuple[Path, ...]
    compression: str = ""


def read_layout(folder: Path, faults: ReadFaults) -> BagLayout:
    """The layout of the bag in a folder. Raises RecordingError when there is none."""
    told = _told(folder, faults) if (folder / METADATA).is_file() else None
    if told is not None:
        return told
    found = sorted((path for path in folder.iterdir() if path.suffix in SUFFIXES), key=_part_number)
    if not found:
        held = f"it has no {METADATA}, .db3 or .mcap file; name files of other kinds one by one"
        raise RecordingError(f"{folder} is a folder without a ROS 2 bag: {held}")
    if len({(_part_name(path), path.suffix) for path in found}) > 1:
        names = ", ".join(path.name for path in found[:4])
        raise RecordingError(f"{folder} holds several recordings ({names}, …) without {METADATA}: name the files")
    faults.add("metadata_missing", f"the folder has no usable {METADATA}: its {len(found)} file(s) are read by name")
    return BagLayout(tuple(found))


def _told(folder: Path, faults: ReadFaults) -> BagLayout | None:
    """What the metadata says; None when it cannot be used."""
    try:
        loaded: Any = _parsed(folder / METADATA)
        information = loaded["rosbag2_bagfile_information"]
        names = [PurePath(str(name)).name for name in information["relative_file_paths"]]
        compression = _compression(folder, information)
    except (_UnusableError, AttributeError, KeyError, TypeError) as error:
        why = error if isinstance(error, _UnusableError) else type(error).__name__
        faults.add("metadata_damaged", f"{METADATA} cannot be used ({why}): it is left aside")
        return None
    files: dict[Path, Path] = {}  # by where they lead to
    for number, name in enumerate(names):
        path = folder / name
        if path.is_file():
            if files.setdefault(real_path(path), path) is not path:
                faults.add("metadata_damaged", f"{METADATA} names {name} more than once: it counts once", place=number)
        else:
            faults.add("part_missing", f"{name}, a part of the bag, is not in its folder", place=number)
    if not files:
        raise RecordingError(f"no file that {folder / METADATA} names is there ({', '.join(names) or 'none'})")
    return BagLayout(tuple(files.values()), compression)


def _parsed(path: Path) -> object:
    return parse_yaml(read_text(path, "the text", _UnusableError), "the text", _UnusableError)


def _compression(folder: Path, information: Mapping[str, object]) -> str:
    mode = str(information.get("compression_mode") or "").lower()
    if mode in ("", "none", "storage"):  # storage: the MCAP chunks themselves
        return ""
    kind = str(information.get("compression_format") or "").lower()
    if mode not in ("file", "message") or kind != "zstd":
        raise RecordingError(f"{folder} is compressed by {mode} with {kind or 'nothing'}, which is unknown here")
    return mode


def _part_name(path: Path) -> str:
    found = _PART.fullmatch(path.stem)
    return found.group(1) if found else path.stem


def _part_number(path: Path) -> tuple[str, int, str]:
    found = _PART.fullmatch(path.stem)
    return _part_name(path), int(found.group(2) or 0) if found else 0, path.name

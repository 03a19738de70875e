"""What a run that was killed leaves in a folder: what it decided is kept until the same run is finished there."""

from __future__ import annotations

import os
import struct
from pathlib import Path

from mapgraft.outputs.claims import clear
from mapgraft.outputs.fence import file_in, folder_in
from mapgraft.outputs.parquet_log import UNTITLED, WRITTEN, rests_of
from mapgraft.outputs.provenance import is_run_id
from mapgraft.outputs.read_back import Told, told_by
from mapgraft.outputs.staging import SUFFIX, sync, sync_folder

_FOLDERS, _TABLES = ("maps", "trajectories"), (*WRITTEN, "labels")
_WRITTEN_AT_THE_END = ("mission.json", "transforms.csv", "layout.json", "summary.json", "report.html")
_END = struct.pack("<BQI", 0x0F, 4, 0) + struct.pack("<BQQQI", 0x02, 20, 0, 0, 0) + b"\x89MCAP0\r\n"


def make_room(out: Path, stem: str, ending: str) -> None:
    """Prepare a folder for a new run, whose recording ``<stem><ending>`` takes the place of an unfinished one.

    An unfinished recording that tells of a decision becomes ``<stem>.<run id><ending>.partial``; of two of the same run
    the one that got farther stays. Other partial files tell nothing more and go. Labels that somebody is adding
    stay, and so do unfinished recordings of other stems. The caller holds the lock. Raises OSError, and OutputError
    where a folder that a run writes is a link.
    """
    for folder in {*_FOLDERS, *_TABLES}:
        folder_in(out, folder)
    recording = out / f"{stem}{ending}{SUFFIX}"
    if recording.is_file():
        told = told_by(recording)
        if told.run_id and told.events:
            _set_aside(recording, told, out / f"{stem}.{told.run_id}{ending}{SUFFIX}")
        else:
            recording.unlink()
    rests = [out / (name + SUFFIX) for name in _WRITTEN_AT_THE_END]
    for folder in _FOLDERS:
        rests += sorted((out / folder).glob(f"*{SUFFIX}"))
    for table in _TABLES:
        rests += sorted((out / table).glob(f"run_id=*/{UNTITLED}{SUFFIX}"))
    for rest in rests:
        file_in(out, rest.relative_to(out).as_posix()).unlink(missing_ok=True)
    clear(rests_of(out, "labels"))
    sync_folder(out)


def set_aside(out: Path, ending: str) -> dict[str, str]:
    """Unfinished recordings of earlier runs that were set aside: name → run id."""
    names = sorted(path.name for path in out.glob(f"*.*{ending}{SUFFIX}"))
    ids = {name: name.removesuffix(ending + SUFFIX).rpartition(".")[2] for name in names}
    return {name: run_id for name, run_id in ids.items() if is_run_id(run_id)}


def end_at(path: Path, size: int, *, ended: bool) -> None:
    """End a recording after its first ``size`` bytes, which must end with a whole record; raises OSError.

    Unless it has ``ended`` there it gets the shortest end that makes it whole: no summary, but the records and the
    magic bytes that come last (MCAP specification, "Data End", "Footer", "Magic").
    """
    with path.open("r+b") as stream:
        stream.truncate(size)
        if not ended:
            stream.seek(size)
            stream.write(_END)
        sync(stream)


def _set_aside(recording: Path, told: Told, place: Path) -> None:
    if place.is_file() and told_by(place).events >= told.events:
        recording.unlink()
    else:
        os.replace(recording, place)  # noqa: PTH105 (says what it does: atomic)

"""Reading what people say about merges while they go on saying it: each word is a part of its own at first."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.parquet as pq

from mapgraft.errors import OutputError
from mapgraft.outputs.lock import locked
from mapgraft.outputs.parquet_log import replace_parts
from mapgraft.outputs.provenance import is_run_id
from mapgraft.outputs.staging import begun, writing
from mapgraft_schemas import arrow_schema

NAME: Final = "labels"
MANY: Final = 64  # parts of one run, from which they are put together
PART_ROWS: Final = 10_000_000  # of a part that is read: few bytes can claim many rows
SETTLED_NS: Final = 1_000_000_000  # after which a folder's time tells that nothing has come in since


class LabelParts:
    """The words in ``labels/`` of one folder: all of them at first, then what has come in since.

    Parts that cannot be read are left out; ``unread`` is their path with the reason.
    """

    def __init__(self, out: Path) -> None:
        self._out = out
        self._seen: dict[Path, set[str]] = {}
        self._looked: dict[Path, tuple[int, int]] = {}
        self.unread: dict[Path, str] = {}

    def new(self) -> Iterator[tuple[str, pa.Table]]:
        """Run id and words, in the schema ``labels``, of every part that was not there before.

        Where parts were put together since, words come again: who keeps the last of each person loses nothing.
        """
        for folder in _run_folders(self._out):
            changed_ns, looked_ns = folder.stat().st_mtime_ns, time.time_ns()
            before_ns, last_ns = self._looked.get(folder, (0, 0))
            if changed_ns == before_ns and last_ns - changed_ns > SETTLED_NS:
                continue
            self._looked[folder] = changed_ns, looked_ns
            seen = self._seen.setdefault(folder, set())
            while unseen := _unseen(folder, seen):  # again: words may move to another part while they are read
                for path in unseen:
                    rows = self._read(path)
                    seen.add(path.name)
                    if rows is not None:
                        yield _run_id(folder), rows

    def _read(self, path: Path) -> pa.Table | None:
        try:
            with pq.ParquetFile(path) as part:
                return _rows(part)
        except FileNotFoundError:  # put together with others just now: its words are in another part
            return None
        except (OSError, ValueError, pa.ArrowException) as error:
            self.unread[path] = str(error).partition("\n")[0]
            return None


def unread_parts(out: Path) -> Mapping[Path, str]:
    """The parts of ``labels/`` that cannot be read, and why: what they hold is missing in all that is made of words."""
    parts = LabelParts(out)
    for _ in parts.new():
        pass
    return parts.unread


def gather(out: Path, run_id: str, at_least: int = MANY) -> bool:
    """Put the words of a run together in one part, where they lie in ``at_least`` many; whether that was done.

    The rows stay as they are, and nobody who adds words waits. Who lists the parts meanwhile may find rows twice, or a
    part gone that was listed: then they are listed again. Parts that this version cannot read whole stay. Nothing is
    done while another process writes the folder, or where it cannot be written. What another process had begun to
    publish when it was killed is carried out if it is of words only; all else waits for those who write it.
    """
    folder = out / NAME / f"run_id={run_id}"
    if not folder.is_dir() or len(_parts(folder)) < at_least:
        return False
    try:
        with writing(out):
            if not all(name.startswith(f"{NAME}/") for name in begun(out)):
                return False
        with locked(out):
            known = {path: rows for path in _parts(folder) if (rows := _whole(path)) is not None}
            if len(known) < at_least:
                return False
            gone = [path.relative_to(out).as_posix() for path in known]
            replace_parts(out, NAME, run_id, pa.concat_tables(known.values()), gone)
            return True
    except OutputError:
        return False


def _run_folders(out: Path) -> list[Path]:
    found = sorted((out / NAME).glob("run_id=*"))
    return [folder for folder in found if is_run_id(_run_id(folder)) and folder.is_dir()]


def _unseen(folder: Path, seen: set[str]) -> list[Path]:
    """Parts with other names, from a listing during which the folder did not change: else it may lack some."""
    while True:
        changed_ns = folder.stat().st_mtime_ns
        unseen = [path for path in _parts(folder) if path.name not in seen]
        if unseen or folder.stat().st_mtime_ns == changed_ns:
            return unseen


def _run_id(folder: Path) -> str:
    return folder.name.removeprefix("run_id=")


def _parts(folder: Path) -> list[Path]:
    return sorted(folder.glob("part-*.parquet"))


def _whole(path: Path) -> pa.Table | None:
    """The words of a part; None where it is damaged, or has columns that would be lost."""
    try:
        with pq.ParquetFile(path) as part:
            return _rows(part) if set(part.schema_arrow.names) <= set(arrow_schema(NAME).names) else None
    except (OSError, ValueError, pa.ArrowException):
        return None


def _rows(part: pq.ParquetFile) -> pa.Table:
    """The words of a part in the schema ``labels``, null in columns that it does not have yet; raises as Arrow does."""
    schema = arrow_schema(NAME)
    if part.metadata.num_rows > PART_ROWS:
        raise ValueError(f"{part.metadata.num_rows} rows are more than {PART_ROWS}")
    if part.schema_arrow.equals(schema):
        return part.read(use_threads=False)
    given = part.read([name for name in part.schema_arrow.names if name in schema.names], use_threads=False)
    columns = [
        given[field.name].cast(field.type) if field.name in given.column_names else pa.nulls(len(given), field.type)
        for field in schema
    ]
    return pa.table(columns, schema=schema)

"""The Parquet tables of a run: one part per table in a hive partition of the run, named by its content."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from uuid import uuid4

import pyarrow as pa
import pyarrow.parquet as pq

from mapgraft.errors import OutputError
from mapgraft.events import Event, Snapshot
from mapgraft.outputs.claims import claim, clear
from mapgraft.outputs.fence import file_in
from mapgraft.outputs.provenance import InputFile, is_run_id
from mapgraft.outputs.staging import SUFFIX, Staging, close_quietly, sha256_of, sync, writing
from mapgraft.outputs.tables import Row, events_table, metrics_table, recordings_table, rows_table, snapshot_row
from mapgraft_schemas import Column, arrow_schema, table

EXAMPLES = "examples"  # only where they are wanted
WRITTEN = ("events", "metrics", "maps", EXAMPLES, "recordings", "timings", "traffic")
"""Written anew by every run; labels are people's."""

UNTITLED = ".part-00000.parquet"  # a run's part before it is finished; readers of a data set skip names with a dot
_BATCH = 1024  # events that wait to become Arrow
_GROUP_ROWS = 65_536  # rows of one row group, at most
_GROUP_ROWS_OF = {"examples": 64, "dataset": 64}  # of tables with pictures, of which somebody wants one at once
_DIGITS = 8  # of one part among few
_DIGITS_OF_MANY = 32  # of parts that many writers add for ever: no two of other content may have one name
_GROUP_BYTES = 32 * 2**20  # of Arrow data waiting to become a row group


class PartWriter:
    """Streams one part of one table; rows must come sorted as the table says. Methods raise OSError.

    ``writer`` tells several of them apart, who write parts of one table at the same time. The final name holds
    ``digits`` hex digits of the part's content. ``folder`` is another one than that of the run's partition.
    """

    def __init__(
        self,
        staging: Staging,
        name: str,
        run_id: str,
        writer: str = "",
        group_rows: int | None = None,
        digits: int = _DIGITS,
        folder: str = "",
    ) -> None:
        self._group_rows, self._digits = group_rows or _GROUP_ROWS_OF.get(name, _GROUP_ROWS), digits
        self._folder, self._staging = folder or f"{name}/run_id={run_id}", staging
        self._name = f"{self._folder}/{UNTITLED.replace('.parquet', f'{writer}.parquet')}"
        self._waiting: list[pa.Table] = []
        self._rows = self._bytes = 0
        schema = arrow_schema(name)  # run_id is told by the folder; as a column it would clash with the partition
        self._schema = schema.with_metadata({**schema.metadata, "run_id": run_id})
        columns = [column.name for column in table(name).columns]
        self._stream = staging.create(self._name)
        try:
            self._writer = pq.ParquetWriter(
                self._stream,
                self._schema,
                version="2.6",
                compression="zstd",
                compression_level=3,
                use_dictionary=[
                    _path(c) for c in table(name).columns if c.type in ("dictionary<string>", "list<uint8>")
                ],
                write_page_index=True,
                sorting_columns=[pq.SortingColumn(columns.index(column)) for column in table(name).sorted_by],
            )
        except BaseException:
            close_quietly(self._stream)
            raise

    def append(self, rows: pa.Table) -> None:
        """Take rows of the table's schema; writes a row group when enough have come together."""
        self._waiting.append(rows)
        self._rows += rows.num_rows
        self._bytes += rows.nbytes
        if self._rows >= self._group_rows or self._bytes >= _GROUP_BYTES:
            self._write_group()

    def close(self) -> str:
        """The part is whole and on disk when this returns; returns the name that it will have."""
        if self._rows:
            self._write_group()
        self._writer.close()
        sync(self._stream)
        self._stream.close()
        digest = sha256_of(self._staging.partial(self._name))
        name = f"{self._folder}/part-00000-{digest[: self._digits]}.parquet"
        self._staging.call(self._name, name)
        return name

    def claimed(self) -> int | None:
        """A descriptor that, until it is closed, tells others that somebody writes this part; None where it is gone."""
        descriptor = os.dup(self._stream.fileno())
        try:
            if claim(self._staging.partial(self._name), descriptor):
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)
        return None

    def abandon(self) -> None:
        """Let go of a part that could not be written."""
        with suppress(OSError):
            self._writer.close()
        close_quietly(self._stream)

    def _write_group(self) -> None:
        rows = pa.concat_tables(self._waiting).unify_dictionaries().combine_chunks()
        self._writer.write_table(rows, row_group_size=self._group_rows)
        self._waiting.clear()
        self._rows = self._bytes = 0


def _path(column: Column) -> str:
    """Where a column's values are within a file."""
    return f"{column.name}.list.element" if column.type.startswith("list<") else column.name


class ParquetLog:
    """Writes the tables of one run as it goes on. Memory is bounded: what waits is at most a row group per table."""

    def __init__(self, staging: Staging, run_id: str, examples: bool = False) -> None:
        self._staging, self._run_id = staging, run_id
        self._events: list[Event] = []
        self._timings: list[Row] = []
        self._traffic: list[Row] = []
        self._digests: set[str] = set()
        self._snapshots = 0
        self._parts: dict[str, PartWriter] = {}
        try:
            for name in [name for name in WRITTEN if examples or name != EXAMPLES]:
                self._parts[name] = PartWriter(staging, name, run_id)
        except BaseException:
            self.abandon()
            raise

    def happened(self, event: Event) -> None:
        self._events.append(event)
        if len(self._events) >= _BATCH:
            self._convert()

    def mapped(self, snapshot: Snapshot) -> None:
        sha256 = hashlib.sha256(snapshot.layer).hexdigest()
        row = snapshot_row(self._snapshots, snapshot, sha256, repeated=sha256 in self._digests)
        self._parts["maps"].append(rows_table("maps", [row]))
        self._digests.add(sha256)
        self._snapshots += 1

    def exemplified(self, rows: pa.Table) -> None:
        self._parts[EXAMPLES].append(rows)

    def timed(self, stage: str, elapsed_s: float, count: int) -> None:
        row = {"position": len(self._timings), "stage": stage, "elapsed_s": elapsed_s, "count": count}
        self._timings.append(row)

    def carried(self, sent: Mapping[tuple[str, str, str], int]) -> None:
        """What was sent, by sender, receiver and kind."""
        names = ("sender", "receiver", "kind", "size_bytes")
        self._traffic = [dict(zip(names, (*key, size), strict=True)) for key, size in sorted(sent.items())]

    def close(self, inputs: Sequence[InputFile]) -> None:
        """All parts are whole and on disk, under their partial names, when this returns."""
        self._convert()
        self._parts["recordings"].append(recordings_table(inputs))
        self._parts["timings"].append(rows_table("timings", self._timings))
        self._parts["traffic"].append(rows_table("traffic", self._traffic))
        for part in self._parts.values():
            part.close()

    def abandon(self) -> None:
        """Let go of everything, after the folder has failed."""
        for part in self._parts.values():
            part.abandon()

    def _convert(self) -> None:
        if self._events:
            self._parts["events"].append(events_table(self._events))
            self._parts["metrics"].append(metrics_table(self._events))
            self._events.clear()


def write_rows(out: Path, name: str, run_id: str, rows: pa.Table) -> str:
    """Append a part to a table of an output folder, atomically; returns its name, relative to the folder.

    For rows that people add after a run (``labels``), also several at once: nobody waits for anybody, nobody's part is
    replaced. What writers that were killed have left goes. The same rows written twice are one part. ``rows`` are cast
    to the table's schema and sorted as it says. Raises OutputError when the folder cannot be written, ValueError when
    the rows do not fit the schema.
    """
    return replace_parts(out, name, run_id, rows, ())


def replace_parts(out: Path, name: str, run_id: str, rows: pa.Table, gone: Sequence[str]) -> str:
    """As ``write_rows``, and the parts ``gone`` (relative names) go as the new one comes, all of it or nothing.

    Where parts go the caller must hold the lock of the folder.
    """
    if not is_run_id(run_id):
        raise OutputError(
            f"{out} has a run that is called {run_id!r}, which no run is: nothing can be written beside it"
        )
    keys = [(column, "ascending") for column in table(name).sorted_by]
    fitting = rows.cast(arrow_schema(name)).sort_by(keys)
    with writing(out):
        clear(rests_of(out, name, run_id))
        while (written := _written(Staging(out), name, run_id, fitting, gone)) is None:
            continue
        return written


def rests_of(out: Path, name: str, run_id: str = "*") -> list[Path]:
    """Unfinished parts that people's writers have in a table, whether these are alive or not.

    Raises OutputError where a link on the way may lead out of the folder.
    """
    found = sorted(out.glob(f"{name}/run_id={run_id}/{UNTITLED.replace('.parquet', '-*.parquet')}{SUFFIX}"))
    return [file_in(out, path.relative_to(out).as_posix()) for path in found]


def _written(staging: Staging, name: str, run_id: str, rows: pa.Table, gone: Sequence[str]) -> str | None:
    """The name of a part with these rows; None where somebody took it for a rest before it was claimed."""
    held, part = None, PartWriter(staging, name, run_id, writer=f"-{uuid4().hex}", digits=_DIGITS_OF_MANY)
    try:
        held = part.claimed()
        if held is None:
            part.abandon()
            return None
        part.append(rows)
        part.close()
        return staging.publish({*gone} - {*staging.names})[0]
    except BaseException:
        part.abandon()
        staging.remove()
        raise
    finally:
        if held is not None:
            os.close(held)


def other_parts(out: Path, name: str, run_id: str, kept: Sequence[str]) -> list[str]:
    """Parts of this run that an earlier writing of it left behind: all but those in ``kept`` (relative names)."""
    parts = sorted((out / name / f"run_id={run_id}").glob("part-*.parquet"))
    return [found for path in parts if (found := path.relative_to(out).as_posix()) not in kept]

"""The data set that a corpus is written to: one part per table and run, in hive partitions, on any store."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from mapgraft.corpus.fetching import Digests, scratch
from mapgraft.corpus.places import local
from mapgraft.corpus.stores import FolderStore, Store, asking, open_store
from mapgraft.errors import OutputError
from mapgraft.outputs.fence import folder_in
from mapgraft.outputs.lock import CORPUS, require_kind
from mapgraft.outputs.parquet_log import WRITTEN
from mapgraft.outputs.staging import writing
from mapgraft.outputs.tables import Row, rows_table
from mapgraft_schemas import VERSION, arrow_schema

if TYPE_CHECKING:
    import pyarrow as pa

PART = "part-00000.parquet"
"""One part per table and run, whoever writes it how often: it can be replaced, but never be there twice."""

TABLES = (*WRITTEN, "labels")
RUNS, FAILURES = "runs", "failures"


class Dataset:
    """Tables of many runs below a path or URL.

    A run counts when it has a row in ``runs``, which is written last; what was written before that is replaced when the
    run is done again. Methods raise OutputError when the store refuses.
    """

    def __init__(self, place: str) -> None:
        self._store: Store = open_store(place)

    @property
    def url(self) -> str:
        return self._store.url

    def runs(self) -> set[str]:
        """The ids of all runs that are there."""
        return _values(self._store.names(RUNS))

    def has(self, run_id: str) -> bool:
        """Whether a run is there."""
        return self._store.has(_name(RUNS, "run_id", run_id))

    def append(self, run_id: str, parts: Mapping[str, Path], row: Row, scratch: Path) -> None:
        """Put a run's tables there, and then the ``row`` that makes it count."""
        for table, file in sorted(parts.items()):
            self._store.put(file, _name(table, "run_id", run_id))
        self._store.put(_written(scratch, RUNS, row), _name(RUNS, "run_id", run_id))

    def fail(self, job_id: str, row: Row, scratch: Path) -> None:
        """Note that a job has failed, in the place of what was noted before."""
        self._store.put(_written(scratch, FAILURES, row), _name(FAILURES, "job", job_id))

    def forgive(self, job_id: str) -> None:
        """Take away what was noted of a job that has succeeded since."""
        self._store.remove(_name(FAILURES, "job", job_id))

    def failures(self) -> set[str]:
        """The ids of the jobs that have failed."""
        return _values(self._store.names(FAILURES))

    def table(self, name: str, columns: list[str] | None = None) -> pa.Table:
        """A table of all runs that count, with the column ``run_id`` (``job`` in ``failures``), sorted by it.

        ``columns`` are those of the schema that are wanted; all where nobody says.
        """
        import pyarrow as pa
        import pyarrow.dataset as ds

        key = "job" if name == FAILURES else "run_id"
        counting = None if name in (RUNS, FAILURES) else self.runs()
        files = [file for file in self._store.names(name) if counting is None or _value(file) in counting]
        schema = pa.schema([*arrow_schema(name), pa.field(key, pa.string())])
        wanted = [*(columns if columns is not None else arrow_schema(name).names), key]
        if not files:
            return schema.empty_table().select(wanted)
        filesystem, root = self._store.arrow()
        with asking(f"{self.url}/{name} cannot be read", OutputError):
            partitioning = ds.partitioning(pa.schema([(key, pa.string())]), flavor="hive")
            found = ds.dataset(
                [f"{root}/{file}" for file in files],
                schema=schema,
                format="parquet",
                filesystem=filesystem,
                partitioning=partitioning,
                partition_base_dir=f"{root}/{name}",
            )
            return found.to_table(columns=wanted)

    def digests(self) -> Digests:
        """What the runs that are there have found their files to hold."""
        told = self.table("recordings", ["path", "sha256", "size_bytes", "modified"])
        modified = told["modified"].cast("int64").to_pylist()
        rows = zip(told["path"].to_pylist(), told["size_bytes"].to_pylist(), modified, strict=True)
        return {
            (path, size_bytes, modified_ns): sha256
            for (path, size_bytes, modified_ns), sha256 in zip(rows, told["sha256"].to_pylist(), strict=True)
            if sha256 is not None and modified_ns is not None
        }

    def prepare(self) -> None:
        """Make it a data set if it is none yet, and take away what processes that were killed have left half-written.

        Raises OutputError where there is something else, a data set of a version that is not known here, or one of
        which a table is a link.
        """
        if isinstance(self._store, FolderStore):
            root = local(self.url)
            require_kind(root, CORPUS)
            for table in (*TABLES, RUNS, FAILURES):
                folder_in(root, table)
            self._store.tidy()
        if (told := self._store.read(CORPUS)) is None:
            with scratch() as folder:
                file = folder / CORPUS
                file.write_text(json.dumps({"schema_version": VERSION}) + "\n", encoding="utf-8")
                self._store.put(file, CORPUS)
        elif _major(told) != VERSION.partition(".")[0]:
            raise OutputError(f"{self.url} is a data set of another version than {VERSION}: choose another place")


def _major(told: bytes) -> str:
    """The major version that ``corpus.json`` tells; empty where that cannot be read."""
    try:
        return str(json.loads(told)["schema_version"]).partition(".")[0]
    except (ValueError, KeyError, TypeError):
        return ""


def _name(table: str, key: str, value: str) -> str:
    return f"{table}/{key}={value}/{PART}"


def _value(name: str) -> str:
    return PurePosixPath(name).parts[1].partition("=")[2]


def _values(names: Iterable[str]) -> set[str]:
    return {_value(name) for name in names if PurePosixPath(name).name == PART}


def _written(folder: Path, table: str, row: Mapping[str, Any]) -> Path:
    import pyarrow.parquet as pq

    path = folder / f"{table}.parquet"
    with writing(folder):
        pq.write_table(rows_table(table, [row]), path, version="2.6", compression="zstd")
    return path

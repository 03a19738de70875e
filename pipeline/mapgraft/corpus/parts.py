"""The tables of one run as files, without the folder that a single run has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import pyarrow as pa

from mapgraft.contracts import Observation
from mapgraft.events import Event, Snapshot
from mapgraft.network.radio import Traffic
from mapgraft.outputs.parquet_log import EXAMPLES, UNTITLED, WRITTEN, ParquetLog, PartWriter
from mapgraft.outputs.provenance import RunProvenance
from mapgraft.outputs.staging import SUFFIX, Staging, writing


class RunParts:
    """A run's output that keeps Parquet tables only. ``parts`` holds them by table when the run is finished.

    With ``examples`` there is a table of them.

    Raises OutputError when the folder cannot be written.
    """

    unshown: Sequence[str] = ()
    unfinished: Sequence[str] = ()

    def __init__(self, folder: Path, run_id: str, provenance: RunProvenance, examples: bool = False) -> None:
        self._folder, self._run_id, self._provenance = folder, run_id, provenance
        self._finished = False
        self.parts: Mapping[str, Path] = {}
        with writing(folder):
            self._staging = Staging(folder)
            self._log = ParquetLog(self._staging, run_id, examples)
        self._tables = [*(name for name in WRITTEN if examples or name != EXAMPLES), "labels"]

    def open(self) -> Self:
        return self

    def write_maps(self) -> None:
        pass

    def observed(self, observation: Observation) -> None:
        pass

    def happened(self, event: Event) -> None:
        with writing(self._folder):
            self._log.happened(event)

    def mapped(self, snapshot: Snapshot) -> None:
        with writing(self._folder):
            self._log.mapped(snapshot)

    def exemplified(self, rows: pa.Table) -> None:
        with writing(self._folder):
            self._log.exemplified(rows)

    def timed(self, stage: str, elapsed_s: float, count: int = 0) -> None:
        self._log.timed(stage, elapsed_s, count)

    def keep(self, name: str, data: bytes) -> None:
        pass

    def carried(self, traffic: Traffic) -> None:
        self._log.carried(traffic.bytes)

    def lost(self, losses: Sequence[Mapping[str, str | int]]) -> None:
        pass

    def noticed(self, remarks: Sequence[str]) -> None:
        pass

    def audited(self, findings: list[dict[str, Any]]) -> None:
        pass

    def finish(self) -> None:
        """All tables are whole when this returns."""
        with writing(self._folder):
            self._log.close(self._provenance.inputs)
            PartWriter(self._staging, "labels", self._run_id).close()  # people's; for those who read it before them
        unnamed = f"run_id={self._run_id}/{UNTITLED}{SUFFIX}"  # they get their names where they are put
        self.parts = {table: self._folder / table / unnamed for table in self._tables}
        self._finished = True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self._finished:
            self._log.abandon()

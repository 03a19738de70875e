"""The folder of a finished run, as the report reads it: tables, summary, and where the merge recording is."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mapgraft.contracts import Exactness, Measurement, Transform
from mapgraft.errors import UsageError
from mapgraft.events import Event
from mapgraft.outputs.lock import settled
from mapgraft.outputs.run_folder import MERGE_RECORDING, ROUTINE, SUMMARY
from mapgraft.outputs.staging import SUFFIX

if TYPE_CHECKING:
    import pyarrow as pa

_MEASURED = ("seq", "merge_id", "metric", "value", "unit", "support", "better", "details")
_ENDED = ("robot", "map_type", "version", "resolution_m", "known_area_m2", "known_own", "known_fused")
_PLAIN = (
    *("seq", "kind", "receiver", "donor", "merge_id", "state", "reason", "by", "rule", "matcher", "fuser", "verifier"),
    *("reversal", "scale", "score", "margin", "hypotheses", "donor_epoch", "donor_version", "receiver_version"),
    "bytes_received",
)


@dataclass(frozen=True, slots=True)
class FinishedRun:
    """A finished run. ``recording`` is the merge recording, ``summary`` and ``mission`` are the JSON files' content."""

    path: Path
    recording: Path
    run_id: str
    summary: Mapping[str, Any]
    mission: Mapping[str, Any]

    def decisions(self) -> list[Event]:
        """Every event but offers and verifications, in order, without measurements."""
        return self._events("kind", ROUTINE, inverted=True)

    def events_of(self, merge_ids: Sequence[str]) -> dict[str, list[Event]]:
        """All events of these merges with their measurements, by merge id, in order."""
        measured: dict[int, list[Measurement]] = {}
        for row in self._rows("metrics", _MEASURED, "merge_id", merge_ids):
            value = float("nan") if row["value"] is None else row["value"]
            details = {pair["name"]: pair["value"] for pair in row["details"]}
            one = Measurement(row["metric"], value, row["unit"], row["support"], row["better"], details)
            measured.setdefault(row["seq"], []).append(one)
        out: dict[str, list[Event]] = {merge_id: [] for merge_id in merge_ids}
        for event in self._events("merge_id", merge_ids, measured=measured):
            out[event.merge_id].append(event)
        return out

    def recordings(self) -> list[dict[str, Any]]:
        """One row per file that was replayed."""
        return self._rows("recordings")

    def maps_at_the_end(self) -> dict[str, dict[str, Any]]:
        """Robot → the row of its last snapshot, without the layer."""
        return {row["robot"]: row for row in self._rows("maps", _ENDED)}

    def _events(
        self,
        column: str,
        values: Sequence[str],
        inverted: bool = False,
        measured: Mapping[int, Sequence[Measurement]] | None = None,
    ) -> list[Event]:
        rows = self._rows("events", None, column, values, inverted)
        return [_event(row, (measured or {}).get(row["seq"], ())) for row in rows]

    def _rows(
        self,
        table: str,
        columns: Sequence[str] | None = None,
        column: str = "",
        values: Sequence[str] = (),
        inverted: bool = False,
    ) -> list[dict[str, Any]]:
        """Rows of a table, those only (or, ``inverted``, those not) that have one of the values in a column."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        parts = sorted((self.path / table / f"run_id={self.run_id}").glob("part-*.parquet"))
        if not parts:
            raise UsageError(f"{self.path} is not whole: the table {table} of its run is gone; run again")
        rows: list[dict[str, Any]] = []
        try:
            for part in parts:
                stream = pq.ParquetFile(part)
                for n in range(stream.num_row_groups):  # one at a time: most of a large table is not wanted
                    group = stream.read_row_group(n, None if columns is None else list(columns))
                    rows += _in_nanoseconds(_chosen(group, column, values, inverted)).to_pylist()
        except (pa.ArrowInvalid, OSError) as error:
            raise UsageError(f"the table {table} of {self.path} cannot be read ({error}): run again") from error
        return rows


def open_run(path: Path) -> FinishedRun:
    """The run in a folder; raises UsageError when there is none, or none that is finished, OutputError when it is being
    written just now."""
    if not path.is_dir():
        found = f"{path} is a file" if path.exists() else f"there is no folder {path}"
        raise UsageError(f"{found}: give the folder that mapgraft run wrote")
    settled(path)
    if not (path / SUMMARY).is_file():
        if unfinished := sorted(path.glob(f"*{MERGE_RECORDING}{SUFFIX}")):
            raise UsageError(
                f"the run in {path} is not finished ({unfinished[0].name} is there): wait for it, or run it again if "
                "it was ended; what it has decided can be read with mapgraft.outputs.read_back.read_events"
            )
        raise UsageError(f"{path} is not the folder of a run: it has no {SUMMARY}; give what mapgraft run wrote")
    summary, mission = (_json(path, name) for name in (SUMMARY, "mission.json"))
    try:
        run_id, files = str(summary["run_id"]), [str(name) for name in summary["files"]]
        recording = path / next(name for name in files if name.endswith(MERGE_RECORDING) and "/" not in name)
        for document, key in ((mission, "config"), (summary, "robots")):
            document[key].items()
    except (KeyError, TypeError, AttributeError, StopIteration):
        raise UsageError(f"the {SUMMARY} or mission.json of {path} is not what a run writes: run again") from None
    if not recording.is_file():
        raise UsageError(f"{path} is not whole: {recording.name} is gone; run again")
    return FinishedRun(path, recording, run_id, summary, mission)


def _json(path: Path, name: str) -> Any:
    try:
        return json.loads((path / name).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise UsageError(f"{path} is not whole: {name} is gone; run again") from None
    except (OSError, ValueError) as error:
        raise UsageError(f"{path / name} cannot be read ({error}): run again") from error


def _chosen(table: pa.Table, column: str, values: Sequence[str], inverted: bool) -> pa.Table:
    import pyarrow as pa
    import pyarrow.compute as pc

    if not column:
        return table
    found = pc.is_in(pc.cast(table[column], pa.string()), pa.array(values, pa.string()))
    return table.filter(pc.invert(found) if inverted else found)


def _in_nanoseconds(table: pa.Table) -> pa.Table:
    """Stamps as integers: Python's own lose nanoseconds."""
    import pyarrow as pa

    for n, column in enumerate(table.schema):
        if pa.types.is_timestamp(column.type):
            table = table.set_column(n, column.name, table[column.name].cast(pa.int64()))
    return table


def _event(row: Mapping[str, Any], measurements: Sequence[Measurement]) -> Event:
    matrix, covariance = (np.array(row[name]) for name in ("T_receiver_donor", "covariance"))
    return Event(
        **{name: row[name] for name in _PLAIN},
        stamp_ns=row["stamp"],
        T_receiver_donor=Transform(matrix.reshape(4, 4)) if np.isfinite(matrix).all() else None,
        covariance=covariance.reshape(6, 6) if np.isfinite(covariance).all() else None,
        evidence={pair["name"]: pair["value"] for pair in row["evidence"]},
        measurements=tuple(measurements),
        exactness=None if row["exact"] is None else _exactness(row),
        through=tuple(row["through"]),
    )


def _exactness(row: Mapping[str, Any]) -> Exactness:
    reset, contaminated, lost = (row[name] for name in ("cells_reset", "cells_contaminated", "cells_lost"))
    return Exactness(row["exact"], reset, contaminated, lost, row["exactness_reason"])

"""Events, snapshots and standing merges as Arrow tables, in the schemas of ``mapgraft_schemas``."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from mapgraft.contracts import MapMetadata, Measurement, Transform
from mapgraft.events import Event, Snapshot
from mapgraft.outputs.provenance import InputFile
from mapgraft.outputs.standing import Chain, StandingMerges, chains_from, components
from mapgraft_schemas import TABLES, arrow_schema, table

Row = Mapping[str, object]


def events_table(events: Iterable[Event]) -> pa.Table:
    """One row per event, in the schema ``events``."""
    return rows_table("events", [_event_row(event) for event in events])


def metrics_table(events: Iterable[Event]) -> pa.Table:
    """One row per measurement of the events, in the schema ``metrics``; NaN becomes null."""
    return rows_table("metrics", [_metric_row(event, m) for event in events for m in event.measurements])


def transforms_table(events: Iterable[Event]) -> pa.Table:
    """Where connected robots' maps lie in each other after these events, in the schema ``transforms``.

    One row per ordered pair of robots that standing merges connect, along the shortest chain of merges.
    """
    merges = StandingMerges(events).merges
    chains = [
        chain
        for part in components((), merges)
        for target in part
        for source, chain in chains_from(target, merges).items()
        if source != target
    ]
    chains.sort(key=lambda chain: (chain.target, chain.source))
    return rows_table("transforms", [_chain_row(chain) for chain in chains])


def recordings_table(inputs: Sequence[InputFile]) -> pa.Table:
    """One row per input file, in the schema ``recordings``."""
    rows: list[Row] = [
        {
            "position": n,
            "path": file.path,
            "sha256": file.sha256 or None,
            "size_bytes": file.size_bytes,
            "etag": file.etag or None,
            "modified": file.modified_ns,
        }
        for n, file in enumerate(inputs)
    ]
    return rows_table("recordings", rows)


def snapshot_row(number: int, snapshot: Snapshot, sha256: str, repeated: bool) -> Row:
    """One row of the schema ``maps``; without the layer's bytes when an earlier row holds them (``repeated``)."""
    metadata = snapshot.metadata
    x_min_m, y_min_m, x_max_m, y_max_m = metadata.bounds_m or (None, None, None, None)
    return {
        "snapshot": number,
        "stamp": snapshot.stamp_ns,
        "robot": snapshot.robot,
        "why": snapshot.why,
        "merge_id": snapshot.merge_id,
        "map_type": snapshot.map_type.name,
        "version": snapshot.version,
        "known_own": snapshot.own.known(),
        "known_fused": snapshot.fused.known(),
        "x_min_m": x_min_m,
        "y_min_m": y_min_m,
        "x_max_m": x_max_m,
        "y_max_m": y_max_m,
        "sha256": sha256,
        "size_bytes": len(snapshot.layer),
        "layer": None if repeated else snapshot.layer,
        **_metadata_columns(metadata),
    }


def rows_table(name: str, rows: Sequence[Row]) -> pa.Table:
    """Rows (column → value; stamps in integer nanoseconds) as a table of the schema ``name``."""
    arrays = [array_of([row[column.name] for row in rows], column.type) for column in table(name).columns]
    return pa.Table.from_arrays(arrays, schema=arrow_schema(name))


def array_of(values: Sequence[Any], type_text: str) -> pa.Array:
    """Values as a column of a type, spelt as the schemas spell it; stamps in integer nanoseconds."""
    arrow_type = _ARROW[type_text]
    if type_text == "dictionary<string>":
        return pa.array(values, pa.string()).dictionary_encode()
    if type_text == "timestamp[ns, UTC]":
        return pa.array(values, pa.int64()).cast(arrow_type)
    if type_text.startswith("fixed_size_list"):
        return _fixed_size_lists(values, arrow_type)
    if type_text.startswith("list<struct<name: ") and all(isinstance(value, Mapping) for value in values):
        return _lists_of_pairs(values, arrow_type)
    return pa.array(values, arrow_type)


def _fixed_size_lists(values: Sequence[Any], arrow_type: Any) -> pa.Array:
    """Matrices as fixed-size lists, row-major; NaN for None, because Arrow before 24 writes and reads no null here."""
    flat = np.full((len(values), arrow_type.list_size), np.nan)
    for row, value in enumerate(values):
        if value is not None:
            flat[row] = value.reshape(-1)
    return pa.FixedSizeListArray.from_arrays(pa.array(flat.reshape(-1)), type=arrow_type)


def _lists_of_pairs(values: Sequence[Mapping[str, Any]], arrow_type: Any) -> pa.Array:
    """Mappings as lists of structs of name and value."""
    offsets = np.cumsum([0, *map(len, values)], dtype=np.int32)
    struct = arrow_type.value_type
    names = pa.array([name for value in values for name in value], pa.string())
    numbers = pa.array([number for value in values for number in value.values()], struct.field("value").type)
    pairs = pa.StructArray.from_arrays([names, numbers], fields=list(struct))
    return pa.ListArray.from_arrays(pa.array(offsets), pairs, type=arrow_type)


_ARROW = {column.type: arrow_schema(name).field(column.name).type for name in TABLES for column in table(name).columns}


def _event_row(event: Event) -> Row:
    T, exactness = event.T_receiver_donor, event.exactness
    return {
        "seq": event.seq,
        "stamp": event.stamp_ns,
        "kind": event.kind,
        "receiver": event.receiver,
        "donor": event.donor,
        "merge_id": event.merge_id,
        "state": event.state,
        "reason": event.reason,
        "by": event.by,
        "rule": event.rule,
        "matcher": event.matcher,
        "fuser": event.fuser,
        "verifier": event.verifier,
        "reversal": event.reversal,
        "T_receiver_donor": None if T is None else T.matrix,
        "scale": event.scale,
        "covariance": event.covariance,
        "score": event.score,
        "margin": event.margin,
        "hypotheses": event.hypotheses,
        "donor_epoch": event.donor_epoch,
        "donor_version": event.donor_version,
        "receiver_version": event.receiver_version,
        "bytes_received": event.bytes_received,
        "evidence": event.evidence,
        "exact": None if exactness is None else exactness.exact,
        "cells_reset": None if exactness is None else exactness.cells_reset,
        "cells_contaminated": None if exactness is None else exactness.cells_contaminated,
        "cells_lost": None if exactness is None else exactness.cells_lost,
        "exactness_reason": None if exactness is None else exactness.reason,
        "through": list(event.through),
        **_planar(T),
    }


def _metric_row(event: Event, m: Measurement) -> Row:
    return {
        "seq": event.seq,
        "stamp": event.stamp_ns,
        "kind": event.kind,
        "merge_id": event.merge_id,
        "receiver": event.receiver,
        "donor": event.donor,
        "state": event.state,
        "reversal": event.reversal,
        "metric": m.name,
        "value": None if math.isnan(m.value) else m.value,
        "unit": m.unit,
        "support": m.support,
        "better": m.better,
        "details": m.details,
    }


def _chain_row(chain: Chain) -> Row:
    return {
        "target": chain.target,
        "source": chain.source,
        "T_target_source": chain.T_target_source.matrix,
        "z_m": chain.T_target_source.z_m,
        "scale": chain.scale,
        "covariance": chain.covariance,
        "merges": list(chain.merges),
        "state": chain.state,
        **_planar(chain.T_target_source),
    }


def _planar(T: Transform | None) -> Row:
    if T is None:
        return {"x_m": None, "y_m": None, "yaw_rad": None}
    return {"x_m": T.x_m, "y_m": T.y_m, "yaw_rad": T.yaw_rad}


def _metadata_columns(metadata: MapMetadata) -> Row:
    plain = ("resolution_m", "known_area_m2", "sensor", "mapper", "quality", "observations", "scale_known")
    columns: dict[str, object] = {name: getattr(metadata, name) for name in plain}
    extra = {name: json.dumps(value) for name, value in metadata.extra.items()}
    return columns | {"can_send": list(metadata.can_send), "extra": extra}

"""The tables: read by DuckDB, Polars, pandas and Hugging Face datasets, sorted, and named by their content."""

from __future__ import annotations

import hashlib
import json
import math
import re
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from plots import ALPHA, AT, START_NS, UNDERSCORE, PlotType, S, provenance, tell, told

from mapgraft.events import Event
from mapgraft.outputs.parquet_log import EXAMPLES, WRITTEN, PartWriter, write_rows
from mapgraft.outputs.run_folder import RunFolder
from mapgraft.outputs.staging import Staging
from mapgraft.outputs.tables import events_table, metrics_table, rows_table, transforms_table
from mapgraft_schemas import arrow_schema, table

RUN_ID = "r0123456789abcde"
ALWAYS = tuple(name for name in WRITTEN if name != EXAMPLES)  # those have tests of their own, with attempts


def part(out: Path, name: str) -> Path:
    (path,) = out.glob(f"{name}/run_id={RUN_ID}/*.parquet")
    return path


def test_parts_are_named_by_their_content_and_hold_schema_and_doc(out: Path) -> None:
    for name in (*ALWAYS, "labels"):
        path = part(out, name)
        assert path.name == f"part-00000-{hashlib.sha256(path.read_bytes()).hexdigest()[:8]}.parquet"
        schema = pq.read_schema(path)
        assert schema.equals(arrow_schema(name))
        assert schema.metadata[b"schema_name"] == f"mapgraft.{name}".encode()
        assert schema.metadata[b"run_id"] == RUN_ID.encode()
        for column in table(name).columns:
            assert schema.field(column.name).metadata[b"doc"].decode() == column.doc
    convention = pq.read_schema(part(out, "events")).field("T_receiver_donor").metadata[b"convention"]
    assert convention.decode().startswith("p_receiver = T_receiver_donor · p_donor")


def test_parts_are_compressed_sorted_and_indexed(out: Path) -> None:
    for name in ALWAYS:
        group = pq.ParquetFile(part(out, name)).metadata.row_group(0)
        rows = pq.read_table(part(out, name), partitioning=None)
        columns = rows.column_names
        assert [columns[key.column_index] for key in group.sorting_columns] == list(table(name).sorted_by)
        keys = [rows.column(column).to_pylist() for column in table(name).sorted_by]
        assert list(zip(*keys, strict=True)) == sorted(zip(*keys, strict=True))
        assert {group.column(n).compression for n in range(group.num_columns)} == {"ZSTD"}
        assert all(group.column(n).has_offset_index for n in range(group.num_columns))


def test_duckdb_reads_every_table(out: Path, events: list[Event]) -> None:
    for name in (*ALWAYS, "labels"):
        rows = duckdb.sql(f"select * from read_parquet('{out}/{name}/**/*.parquet', hive_partitioning=true)")
        assert rows.columns == [*(column.name for column in table(name).columns), "run_id"]
    columns = "run_id, T_receiver_donor, epoch_ns(stamp), kind"
    rows = duckdb.sql(f"select {columns} from read_parquet('{out}/events/**/*.parquet') order by seq")
    run_id, matrix, stamp_ns, kind = rows.fetchall()[2]
    assert (run_id, stamp_ns, kind) == (RUN_ID, events[2].stamp_ns, "merged")
    assert events[2].T_receiver_donor is not None
    assert np.array_equal(np.array(matrix).reshape(4, 4), events[2].T_receiver_donor.matrix)


def test_polars_reads_every_table(out: Path, events: list[Event]) -> None:
    for name in (*ALWAYS, "labels"):
        rows = pl.read_parquet(f"{out}/{name}/**/*.parquet", hive_partitioning=True)
        assert rows.columns == [*(column.name for column in table(name).columns), "run_id"]
    rows = pl.read_parquet(f"{out}/events/**/*.parquet")
    assert rows.schema["stamp"] == pl.Datetime("ns", "UTC")
    assert rows.schema["T_receiver_donor"] == pl.Array(pl.Float64, 16)
    assert rows["kind"].to_list() == [event.kind for event in events]


def test_pandas_reads_every_table(out: Path, events: list[Event]) -> None:
    for name in (*ALWAYS, "labels"):
        rows = pd.read_parquet(out / name / f"run_id={RUN_ID}")
        assert list(rows.columns) == [column.name for column in table(name).columns]
    rows = pd.read_parquet(out / "events")
    assert str(rows["stamp"].dtype) == "datetime64[ns, UTC]"
    assert rows["stamp"].astype("int64").tolist() == [event.stamp_ns for event in events]
    assert set(rows["run_id"]) == {RUN_ID}


def test_hugging_face_datasets_reads_every_table_that_has_rows(out: Path, tmp_path: Path, events: list[Event]) -> None:
    import datasets

    datasets.disable_progress_bars()
    for name in ALWAYS:
        rows = datasets.load_dataset(
            "parquet", data_files=f"{out}/{name}/**/*.parquet", split="train", cache_dir=str(tmp_path)
        )
        assert list(rows.features) == [column.name for column in table(name).columns]
        if name == "events":
            assert rows["reason"][:] == [event.reason for event in events]
            assert len(rows[2]["T_receiver_donor"]) == 16


def test_tables_hold_the_events(out: Path, events: list[Event]) -> None:
    for name, made in (("events", events_table(events)), ("metrics", metrics_table(events))):
        read = pq.read_table(part(out, name), partitioning=None)
        assert read.schema.equals(made.schema)
        assert pl.DataFrame(read).equals(pl.DataFrame(made))  # to which NaN equals NaN
    merged = events_table(events).to_pylist()[2]
    assert merged["stamp"].value == events[2].stamp_ns
    assert merged["evidence"] == [{"name": "support", "value": 120.0}]
    assert merged["yaw_rad"] == pytest.approx(0.3) and merged["covariance"][7] == 0.02
    assert merged["score"] == 0.9 and merged["margin"] is None and merged["exact"] is None
    offered = events_table(events).to_pylist()[0]
    assert all(map(math.isnan, offered["T_receiver_donor"])) and offered["x_m"] is None
    reverted = next(row for row in events_table(events).to_pylist() if row["kind"] == "reverted")
    assert (reverted["exact"], reverted["cells_reset"], reverted["cells_lost"]) == (False, 120, 2)
    assert reverted["margin"] == math.inf


def test_what_could_not_be_measured_is_null(events: list[Event]) -> None:
    rows = [row for row in metrics_table(events).to_pylist() if row["kind"] == "verified"]
    assert {row["value"] for row in rows if row["metric"] == "rays"} == {None}
    similarity = [row for row in rows if row["metric"] == "similarity"]
    assert similarity[0]["details"][1] == {"name": "occupied", "value": 0.5}
    assert all(row["value"] > 0.9 for row in similarity)


def test_maps_hold_every_layer_once(out: Path) -> None:
    rows = pq.read_table(part(out, "maps"), partitioning=None).to_pylist()
    assert [row["snapshot"] for row in rows] == list(range(9))
    assert [row["why"] for row in rows[:4]] == ["before merge", "after merge", "before merge", "after merge"]
    layers: dict[str, bytes] = {}
    for row in rows:
        if row["layer"] is None:
            assert row["sha256"] in layers
        else:
            assert row["sha256"] not in layers
            layers[row["sha256"]] = row["layer"]
            assert hashlib.sha256(row["layer"]).hexdigest() == row["sha256"]
            assert PlotType().decode(row["layer"]).known() == row["known_own"]
        assert len(layers[row["sha256"]]) == row["size_bytes"]
    assert rows[1]["known_fused"] == rows[1]["known_own"] + 1
    assert (rows[0]["x_min_m"], rows[0]["x_max_m"], rows[0]["resolution_m"]) == (0.0, 5.0, 0.5)
    assert rows[0]["can_send"] == ["cells"] and rows[0]["quality"] is None
    assert {pair["name"]: json.loads(pair["value"]) for pair in rows[0]["extra"]} == {
        "colour": "green",
        "depth": 2.5,
        "wet": False,
    }


def test_matrices_are_never_null_because_older_readers_refuse_that(out: Path) -> None:
    for name in (*ALWAYS, "labels"):
        rows = pq.read_table(part(out, name), partitioning=None)
        matrices = [field.name for field in rows.schema if pa.types.is_fixed_size_list(field.type)]
        assert all(rows.column(matrix).null_count == 0 for matrix in matrices)
        assert name not in ("events", "labels") or matrices


def test_traffic(out: Path) -> None:
    told = pq.read_table(part(out, "traffic"), partitioning=None).to_pylist()
    assert told == [
        {"sender": "alpha", "receiver": "beta@2", "kind": "hello", "size_bytes": 120},
        {"sender": "alpha", "receiver": "beta@2", "kind": "layer", "size_bytes": 4000},
    ]


def test_recordings_and_timings(out: Path) -> None:
    rows = pq.read_table(part(out, "recordings"), partitioning=None).to_pylist()
    assert [(row["path"], row["size_bytes"]) for row in rows] == [("a.mcap", 1234), ("b.bag", 99)]
    told_to, own = pq.read_table(part(out, "timings"), partitioning=None).to_pylist()
    assert told_to == {"position": 0, "stage": "replay", "elapsed_s": 1.5, "count": 1800}
    assert (own["position"], own["stage"]) == (1, "writing") and own["elapsed_s"] > 0 and own["count"] > 1


def test_transforms_lead_both_ways_between_connected_robots(events: list[Event]) -> None:
    rows = transforms_table(events).to_pylist()
    assert [(row["target"], row["source"]) for row in rows] == [(ALPHA, AT), (AT, ALPHA)]
    there, back = (np.array(row["T_target_source"]).reshape(4, 4) for row in rows)
    assert there @ back == pytest.approx(np.eye(4), abs=1e-5)  # in fixed point a rotation is not quite one
    assert rows[0]["merges"] == [f"{ALPHA}.{AT}.1"] and rows[0]["state"] == "confirmed"
    until_revert = [event for event in events if event.stamp_ns < START_NS + 20 * S]
    assert {row["source"] for row in transforms_table(until_revert).to_pylist()} == {ALPHA, AT, UNDERSCORE}


def test_no_event_makes_empty_tables_of_the_same_schema() -> None:
    for made, name in (
        (events_table([]), "events"),
        (metrics_table([]), "metrics"),
        (transforms_table([]), "transforms"),
    ):
        assert made.num_rows == 0 and made.schema.equals(arrow_schema(name))


def test_many_rows_are_written_in_row_groups_and_read_as_one(tmp_path: Path) -> None:
    many = [
        Event(n, START_NS + n, "verified", "a", f"donor {n % 7}", f"a.{n % 7}.1", reason=f"{n}") for n in range(10_000)
    ]
    staging = Staging(tmp_path)
    writer = PartWriter(staging, "events", RUN_ID, group_rows=3000)
    for at in range(0, len(many), 1000):
        writer.append(events_table(many[at : at + 1000]))
    writer.close()
    staging.publish()
    path = part(tmp_path, "events")
    assert [pq.ParquetFile(path).metadata.row_group(n).num_rows for n in range(4)] == [3000, 3000, 3000, 1000]
    rows = pq.read_table(path, partitioning=None)
    assert rows.column("seq").to_pylist() == list(range(10_000))
    assert rows.column("donor").to_pylist() == [event.donor for event in many]


def test_labels_are_appended_beside_what_is_there(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    with RunFolder(folder, "demo", RUN_ID, provenance()) as sink:
        tell(sink, told())
    label = {
        "receiver": "alpha",
        "donor": "beta",
        "T_receiver_donor_judged": np.eye(4),
        "label": "wrong",
        "annotator": "Ann",
        "T_receiver_donor": np.eye(4),
        "comment": "another corridor",
        "labelled_at": 1_700_000_000_000_000_000,
        "elapsed_s": 4.5,
    }
    rows = rows_table("labels", [{"merge_id": "z", **label}, {"merge_id": "a", **label, "T_receiver_donor": None}])
    name = write_rows(folder, "labels", RUN_ID, rows)
    assert re.fullmatch(rf"labels/run_id={RUN_ID}/part-00000-[0-9a-f]{{32}}\.parquet", name)
    read = pl.read_parquet(f"{folder}/labels/**/*.parquet", hive_partitioning=True)
    assert read["merge_id"].to_list() == ["a", "z"]
    assert list(folder.glob("labels/**/.*")) == []
    with pytest.raises(ValueError):
        write_rows(folder, "labels", RUN_ID, pa.table({"merge": ["a"]}))

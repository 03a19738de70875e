"""The page on formats: it names everything that is written, and its examples run."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, get_args

import duckdb
import numpy as np
import pytest
from plots import ALPHA, AT, UNDERSCORE, provenance, tell, told
from rosbags.highlevel import AnyReader

from mapgraft import recording
from mapgraft.contracts import GRID_MESSAGE, GridMessage, Observation, Transform
from mapgraft.events import Event
from mapgraft.outputs.files import connected, transforms_csv
from mapgraft.outputs.findings import findings_csv
from mapgraft.outputs.run_folder import RunFolder
from mapgraft.outputs.standing import StandingMerges
from mapgraft.plugins import load_plugins
from mapgraft.procedures import Workshop
from mapgraft.recording.poses import tf
from mapgraft.recording.robots import stamps
from mapgraft_schemas import TABLES, VERSION, message_texts, table

PAGE = (Path(__file__).parents[2] / "docs" / "formats.md").read_text(encoding="utf-8")


LOST = {"where": "a.mcap", "topic": "/scan", "cause": "messages_lost", "count": 3, "sentence": "three are gone"}


def examples(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, flags=re.DOTALL)


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which there is an ``OUT``."""
    folder = tmp_path_factory.mktemp("page")
    with RunFolder(folder / "OUT", "demo", "r1", provenance()) as sink:
        tell(sink, told())
        sink.timed("replay", 1.0, 1)
        sink.lost([LOST])
    return folder


@pytest.mark.parametrize("name", TABLES)
def test_every_column_is_on_the_page(name: str) -> None:
    assert f"### `{name}`" in PAGE and table(name).doc in PAGE
    for column in table(name).columns:
        doc = column.doc + (f"; {column.convention}" if column.convention else "")
        assert f"| `{column.name}` | `{column.type}` | {column.unit or '–'} | {doc} |" in PAGE


def test_every_message_is_on_the_page() -> None:
    for name, text in message_texts().items():
        assert f"`{name}`:\n\n```text\n{text}```" in PAGE


def test_every_topic_and_record_is_on_the_page(here: Path) -> None:
    with AnyReader([here / "OUT/demo.merge.mcap"]) as reader:
        for connection in reader.connections:
            robot = re.fullmatch(r"/[^/]+(/merged|/donors/[^/]+)?/map", connection.topic)
            kind = re.sub("/donors/.*", "/donors/<donor>", robot[1] or "") if robot else ""
            topic = f"/<robot>{kind}/<suffix>" if robot else connection.topic
            assert f"| `{topic}` |" in PAGE
    for record in ("merge_run", "merge_schema", "merge_names", *provenance().record("r1")):
        assert f"`{record}`" in PAGE
    assert f"version {VERSION}" in PAGE


def test_every_cause_of_a_loss_is_on_the_page() -> None:
    section = PAGE.split("## What was lost")[1].split("## ")[0]
    told = set(re.findall(r"`(\w+)`", section))
    source = Path(recording.__file__).parent
    said = re.compile(r'(?:faults\.add|\.drop|\.notice|_COUNT_DIFFERS =|MESSAGES_LOST =)\(?\s*(?:waiting, )?"(\w+)"')
    causes = {cause for path in source.rglob("*.py") for cause in said.findall(path.read_text(encoding="utf-8"))}
    causes |= {*get_args(tf.Cause), *get_args(stamps.StampCause)}
    assert len(causes) > 40
    assert causes - {"message_unconvertible"} <= told  # of a conversion, which has no summary
    assert all(f"| `{key}` |" in section for key in LOST)


def test_every_file_is_on_the_page(here: Path) -> None:
    shapes = {
        "maps": {r"[^/]+\.merged\.json": "`OUT/maps/<component>.merged.*`", r"[^/]+\.json": "`OUT/maps/<robot>.*`"},
        "trajectories": {r"[^/]+\.tum": "`OUT/trajectories/<robot>.tum`"},
        ".": {r"demo\.merge\.mcap": "`OUT/<stem>.merge.mcap`"},
    }
    for path in sorted(p.relative_to(here / "OUT") for p in (here / "OUT").rglob("*") if p.is_file()):
        known = shapes.get(str(path.parent), {})
        shape = next((said for pattern, said in known.items() if re.fullmatch(pattern, path.name)), f"`OUT/{path}`")
        if path.suffix == ".parquet":
            shape = f"`OUT/{path.parts[0]}/run_id=<run>/part-00000-<8 hex>.parquet`"
        assert shape in PAGE


SHIPPED = ("occupancy_grid", "point_cloud", "line_segments", "floor_plan")


def shipped_map(kind: str) -> tuple[Any, Any]:
    """A map type that is shipped, and a map of it in which something stands and something is free."""
    workshop, scan = Workshop(load_plugins()), Transform.identity()
    grid, layer = workshop.map_type("occupancy_grid"), workshop.map_type("occupancy_grid").new_layer()
    cells = np.zeros((60, 60), np.int8)
    cells[5, 5:55] = cells[5:55, 5] = 100
    message = GridMessage(cells, 0.05, Transform.identity())
    grid.integrate(layer, Observation("r", 0, 0, "map", GRID_MESSAGE, message, scan, scan))
    made = workshop.map_type(kind)
    if kind == "floor_plan":
        layer = made.new_layer()
        made.integrate(layer, Observation("r", 0, 0, "map", GRID_MESSAGE, message, scan, scan))
    else:
        layer = workshop.converter(grid, made)(layer)
    return made, made.view(layer)


@pytest.mark.parametrize("kind", SHIPPED)
def test_how_each_map_type_is_shown_and_written_is_on_the_page(kind: str) -> None:
    section = PAGE.split("### Map types")[1].split("###")[0]
    row = next(line for line in section.splitlines() if line.startswith(f"| `{kind}` |"))
    map_type, map_ = shipped_map(kind)
    told = {message.suffix: message.message_type for message in map_type.messages(map_)}
    assert told
    assert all(f"`{suffix}` | `{message_type}`" in section for suffix, message_type in told.items())
    assert all(f"`{name.removeprefix('stem')}`" in row for name in map_type.files(map_, "stem"))


def test_every_shipped_map_type_is_on_the_page() -> None:
    offered = {o.descriptor.name for o in load_plugins().of_kind("map type") if o.origin.distribution == "mapgraft"}
    assert offered == set(SHIPPED)


def test_the_columns_of_findings_csv_are_on_the_page() -> None:
    section = PAGE.split("## findings.csv")[1].split("## ")[0]
    assert all(f"`{column}`" in section for column in findings_csv([]).decode().strip().split(","))
    assert "| `OUT/findings.csv` |" in PAGE and "| `/<robot>/findings` | `visualization_msgs/msg/MarkerArray` |" in PAGE


def test_the_columns_of_transforms_csv_are_on_the_page(events: list[Event]) -> None:
    header = transforms_csv(StandingMerges(events).merges).decode().splitlines()[0]
    assert all(f"`{column}`" in PAGE for column in header.split(","))


def test_the_queries_run_and_answer(here: Path, monkeypatch: pytest.MonkeyPatch, events: list[Event]) -> None:
    monkeypatch.chdir(here)
    lost, present, refused, reverts, metrics, layers, labels = (
        duckdb.sql(query).fetchall() for query in examples("sql")
    )
    assert lost == [tuple(LOST.values())]
    standing = [(m.merge_id, m.receiver, m.donor, m.state) for m in StandingMerges(events).merges]
    assert [row[1:5] for row in present] == standing == [(f"{ALPHA}.{AT}.1", ALPHA, AT, "confirmed")]
    assert {row[2] for row in refused} == {"rejected", "unmatched", "ambiguous"}
    assert reverts == [(f"{UNDERSCORE}.{ALPHA}.1", "0.2 is below 0.5", 7.5, False, 3)]
    assert {(row[0], row[1]) for row in metrics} >= {(f"{ALPHA}.{AT}.1", "similarity"), (f"{ALPHA}.{AT}.1", "rays")}
    assert [row[0] for row in layers] == list(range(9)) and all(row[3] for row in layers)
    assert sorted(row[1] for row in labels) == [f"{ALPHA}.{AT}.1", f"{UNDERSCORE}.{ALPHA}.1"]
    assert connected([], StandingMerges(events).merges)[0].robots == (ALPHA, AT)


def test_the_python_examples_run(here: Path, monkeypatch: pytest.MonkeyPatch, events: list[Event]) -> None:
    import datasets

    datasets.disable_progress_bars()
    monkeypatch.chdir(here)
    monkeypatch.setattr(datasets.config, "HF_DATASETS_CACHE", str(here / "cache"))
    results: list[dict[str, Any]] = []
    for example in examples("python"):
        results.append({})
        exec(example, results[-1])
    read, ros, frames, hugging, transforms = results
    assert [e.seq for e in read["events"]] == [e.seq for e in events]
    assert ros["event"].seq == events[-1].seq
    assert len(frames["events"]) == len(events) and frames["similarity"].height > 100
    assert hugging["events"].num_rows == len(events)
    assert set(transforms["T"]) == {(ALPHA, AT), (AT, ALPHA)}

"""Whole runs of the demo's first minute: what was timed and counted, the run's id, remembering, and persons' words."""

from __future__ import annotations

import io
import json
import shutil
import signal
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from mcap.reader import make_reader

import mapgraft
from mapgraft.config import load_config
from mapgraft.contracts import Transform
from mapgraft.errors import UsageError
from mapgraft.outputs.labels import label
from mapgraft.outputs.read_back import read_events
from mapgraft.outputs.run_folder import ROUTINE
from mapgraft.remember import recall
from mapgraft_recordings import demo_files

CONFIG = """
mission: {end_s: 45}
robots:
  alpha: {map: {type: occupancy_grid, resolution_m: 0.1}}
  bravo: {files: [more/bravo.mcap], map: {type: occupancy_grid, resolution_m: 0.1}}
  charlie: {files: ['more/ch*.mcap'], poses: {file: more/charlie.mcap}, map: {type: occupancy_grid, resolution_m: 0.1}}
exchange: {use: every, seconds: 10}
"""


def recorded(folder: Path) -> Path:
    """A folder with the demo's recordings and a configuration that names them relatively."""
    files, _, _ = demo_files()
    (folder / "more").mkdir(parents=True)
    for file in files:
        shutil.copy(file, folder / ("" if file.stem == "alpha" else "more") / file.name)
    (folder / "mission.yaml").write_text(CONFIG)
    return folder


def replayed(folder: Path, monkeypatch: pytest.MonkeyPatch, out: str = "out") -> mapgraft.Result:
    """Run with relative paths from inside the folder."""
    with monkeypatch.context() as inside:
        inside.chdir(folder)
        return mapgraft.run(["alpha.mcap", "more/charlie.mcap"], "mission.yaml", out)


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, mapgraft.Result]]:
    """A folder with recordings, and a run whose files lie in its ``out``; tests must not change it."""
    folder = recorded(tmp_path_factory.mktemp("whole") / "here")
    with pytest.MonkeyPatch.context() as monkeypatch:
        yield folder, replayed(folder, monkeypatch)


def rows(out: Path, table: str) -> pl.DataFrame:
    return pl.read_parquet(f"{out}/{table}/**/*.parquet", hive_partitioning=True)


def contents(out: Path) -> dict[str, bytes]:
    return {p.relative_to(out).as_posix(): p.read_bytes() for p in out.rglob("*") if p.is_file()}


def said(recording: bytes) -> list[tuple[str, int, int, bytes]]:
    """Every message of an MCAP file."""
    messages = make_reader(io.BytesIO(recording)).iter_messages()
    return [(channel.topic, message.log_time, message.sequence, message.data) for _, channel, message in messages]


def test_a_run_says_what_took_how_long(here: tuple[Path, mapgraft.Result]) -> None:
    folder, result = here
    timed = rows(folder / "out", "timings")
    counts = dict(zip(timed["stage"].to_list(), timed["count"].to_list(), strict=True))
    assert list(counts) == ["opening", "replaying", "reading", "observing", "exchanging", "writing"]
    assert counts["replaying"] == counts["reading"] == counts["observing"] == result.observations > 100
    assert counts["opening"] == 1
    assert counts["exchanging"] == 5  # at 10, 20, 30 and 40 s and at the end
    assert counts["writing"] > sum(event.kind == "merged" for event in result.events)
    assert (timed["elapsed_s"] > 0).all()


def test_every_byte_between_two_robots_is_in_the_summary(here: tuple[Path, mapgraft.Result]) -> None:
    folder, result = here
    summary = json.loads((folder / "out/summary.json").read_text())
    told = {(entry["donor"], entry["receiver"]): entry["bytes"] for entry in summary["bytes"]}
    assert told == dict(result.traffic) and len(told) == 6
    kinds = {(entry["receiver"], entry["kind"]): entry["bytes"] for entry in summary["bytes_by_kind"]}
    assert kinds == dict(result.kinds) and sum(kinds.values()) == sum(told.values())
    sent = rows(folder / "out", "traffic")
    assert sent["size_bytes"].sum() == sum(told.values()) and {"hello", "layer"} <= set(sent["kind"])
    for (donor, receiver), size in told.items():
        received = [e.bytes_received for e in result.events if (e.donor, e.receiver) == (donor, receiver)]
        verified = [e.bytes_received for e in result.events if e.kind == "verified"]
        assert 0 < sum(received) <= size and not any(verified)


def test_what_came_for_nothing_is_in_the_summary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Robots that keep few claims of others: those above are counted, and a person is told."""
    monkeypatch.setattr("mapgraft.network.gossip.MOST_EDGES", 1)
    config = {
        "mission": {"end_s": 11},
        "exchange": {"use": "at", "seconds": [10, 10.5], "at_end": False},
        "map": {"resolution_m": 0.2},
        "output": {"report": False, "examples": False, "snapshots": False},
    }
    result = mapgraft.run(demo_files()[0], config, tmp_path / "out")
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    assert summary["unread"]["charlie"]["messages"] == 0 < summary["unread"]["charlie"]["claims"]
    said = [remark for remark in result.remarks if " claims came that cannot be read, or above what it keeps" in remark]
    assert len(said) == len(summary["unread"]) and summary["remarks"] == list(result.remarks)


def test_two_equal_runs_differ_in_nothing_but_the_clock(
    here: tuple[Path, mapgraft.Result], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, result = here
    assert replayed(folder, monkeypatch, "again").run_id == result.run_id
    first, second = contents(folder / "out"), contents(folder / "again")
    assert {name.partition("/")[0] for name in first.keys() ^ second.keys()} <= {"timings"}
    same = [name for name in first if not name.startswith("timings/") and not name.endswith(".mcap")]
    assert "mission.json" in same and "summary.json" in same
    assert {name: first[name] for name in same} == {name: second[name] for name in same}
    assert said(first["alpha.merge.mcap"]) == said(second["alpha.merge.mcap"])


def test_the_same_contents_elsewhere_are_the_same_run(
    here: tuple[Path, mapgraft.Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = recorded(tmp_path / "deeper" / "there")
    assert replayed(there, monkeypatch).run_id == here[1].run_id
    (there / "mission.yaml").write_text(CONFIG.replace("0.1}", "0.2}", 1))
    assert replayed(there, monkeypatch).run_id != here[1].run_id


def test_whose_pose_file_it_is_makes_another_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from mapgraft.remember import essence_text

    folder = recorded(tmp_path / "here")
    files, digests = [folder / "alpha.mcap"], {folder / "alpha.mcap": "a", folder / "poses.tum": "p"}
    texts = set()
    for robot in ("x", "y"):
        (folder / "c.yaml").write_text(
            "robots: {x: {}, y: {}}".replace(f"{robot}: {{}}", f"{robot}: {{poses: {{file: poses.tum}}}}")
        )
        texts.add(essence_text(files, load_config(folder / "c.yaml"), digests))
    assert len(texts) == 2 and not any(str(tmp_path) in text for text in texts)


def test_a_run_is_made_again_from_another_folder(
    here: tuple[Path, mapgraft.Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, result = here
    monkeypatch.chdir(tmp_path)
    remembered = recall(folder / "out")
    charlie = remembered.config.robots["charlie"]
    assert charlie.files == [str(folder / "more/charlie.mcap")]
    assert charlie.poses.file == folder / "more/charlie.mcap"
    assert list(remembered.config.robots) == ["alpha", "bravo", "charlie"]
    again = mapgraft.run(remembered.files, remembered.config, "elsewhere")
    assert again.run_id == result.run_id
    assert [event.seq for event in again.events] == [event.seq for event in result.events]
    assert rows(tmp_path / "elsewhere", "maps")["sha256"].equals(rows(folder / "out", "maps")["sha256"])
    assert (tmp_path / "elsewhere/mission.json").read_bytes() == (folder / "out/mission.json").read_bytes()


@pytest.mark.parametrize("gone", ["alpha.mcap", "more/bravo.mcap"])
def test_what_is_gone_is_named(here: tuple[Path, mapgraft.Result], tmp_path: Path, gone: str) -> None:
    text = (here[0] / "out/mission.json").read_text()
    (tmp_path / "mission.json").write_text(text.replace(str(here[0] / gone), str(tmp_path / gone)))
    with pytest.raises(UsageError, match=f"the recording of .* is gone: {tmp_path / gone}; put it back"):
        recall(tmp_path)


def test_a_persons_word_is_kept_when_the_run_is_computed_again(
    here: tuple[Path, mapgraft.Result], tmp_path: Path
) -> None:
    out, (folder, result) = tmp_path / "out", here
    shutil.copytree(folder / "out", out)
    merge = next(event for event in result.events if event.kind == "merged")
    about: dict[str, Any] = {"merge_id": merge.merge_id, "receiver": merge.receiver, "donor": merge.donor}
    T, said_at = Transform.planar(1.0, 2.0, 0.5), datetime(2026, 1, 2, 3, 4, 5, 6, tzinfo=UTC)
    label(out, result.run_id, **about, verdict="wrong", by="ann", reason="no", T_receiver_donor=T, clock=said_at)
    remembered = recall(out)
    reverted = {"merge": merge.merge_id, "action": "revert", "by": "ann", "reason": "no"}
    config = remembered.config.model_dump() | {"verdicts": [reverted]}
    again = mapgraft.run(remembered.files, config, out)
    assert again.run_id == result.run_id and again.events != result.events
    label(out, result.run_id, **about, verdict="right", T_receiver_donor=T, elapsed_s=3.5)
    events = rows(out, "events").sort("seq")
    assert events["seq"].to_list() == list(range(len(again.events)))  # one computation, not two
    first, second = rows(out, "labels").sort("labelled_at").to_dicts()
    assert {name: first[name] for name in about} == about and first["run_id"] == result.run_id
    assert (first["label"], first["annotator"], first["comment"]) == ("wrong", "ann", "no")
    assert first["labelled_at"] == said_at and first["elapsed_s"] is None
    assert np.array_equal(np.reshape(first["T_receiver_donor_judged"], (4, 4)), T.matrix)
    assert np.isnan(first["T_receiver_donor"]).all()  # wrong: what would be right was not said
    assert (second["label"], second["annotator"], second["elapsed_s"]) == ("right", "person", 3.5)
    assert np.array_equal(np.reshape(second["T_receiver_donor"], (4, 4)), T.matrix)
    with pytest.raises(ValueError, match="a label is one of right, wrong, unsure, withdrawn, found 'maybe'"):
        label(out, result.run_id, **about | {"verdict": "maybe"})


KILLED = """
    import os, sys
    import mapgraft

    class Deadly:
        def observed(self, observation): pass
        def mapped(self, snapshot): pass
        def happened(self, event):
            print(event.seq, event.kind, flush=True)
            if event.seq == int(sys.argv[1]):
                os.kill(os.getpid(), 9)

    mapgraft.run(["alpha.mcap", "more/charlie.mcap"], "mission.yaml", "killed", sinks=[Deadly()])
"""


def test_a_run_that_is_killed_and_started_again_is_the_same_run(
    here: tuple[Path, mapgraft.Result], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, result = here
    last = next(event.seq for event in result.events if event.kind not in ROUTINE and event.seq > 3)
    command = [sys.executable, "-c", textwrap.dedent(KILLED), str(last)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == -signal.SIGKILL
    heard = [line.split() for line in done.stdout.splitlines()]
    told = read_events(folder / "killed/alpha.merge.mcap.partial")
    assert [int(seq) for seq, kind in heard if kind not in ROUTINE][-1] == told[-1].seq == last
    assert [repr(event) for event in told] == [repr(event) for event in result.events[: last + 1]]
    replayed(folder, monkeypatch, out="killed")
    whole, again = contents(folder / "out"), contents(folder / "killed")
    clock = {name for name in {**whole, **again} if name.startswith("timings/")} | {"alpha.merge.mcap"}
    assert {n: c for n, c in whole.items() if n not in clock} == {n: c for n, c in again.items() if n not in clock}
    assert said(whole["alpha.merge.mcap"]) == said(again["alpha.merge.mcap"])

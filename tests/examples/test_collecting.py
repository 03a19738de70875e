"""The examples of a run: one for each attempt, with what the run knew, and the truth where it is told."""

from __future__ import annotations

import hashlib
import json
import math
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import duckdb
import numpy as np
import polars as pl
import pytest

import mapgraft
from mapgraft.contracts import Measurement, Observation, Sample, Transform, Verdict
from mapgraft.errors import ConfigError, UsageError
from mapgraft.events import Event, Snapshot
from mapgraft.examples import ExampleFolder, ExampleKey, transform_of
from mapgraft.examples.looks import MOST, Looks
from mapgraft.examples.pictures import cells_of
from mapgraft_recordings import demo_files


def test_every_attempt_is_one_example(ran):
    rows = ran.rows()
    attempts = [e for e in ran.result.events if e.kind in ("merged", "ambiguous", "unmatched")]
    assert {e.merge_id for e in attempts} == {i for i, row in rows.items() if row["verdict"] != "rejected"}
    for event in attempts:
        row = rows[event.merge_id]
        assert row["merge_id"] == event.merge_id and row["seq"] == event.seq and row["stamp"] == event.stamp_ns
        assert row["verdict"] == {"merged": "provisional"}.get(event.kind, event.kind)
        assert (row["rule"], row["matcher"], row["reason"]) == (event.rule, event.matcher, event.reason)
        assert row["acceptor"] == "posterior" and row["verifier"] == "sequential"
        assert row["score"] == event.score and row["margin"] == event.margin
        assert np.array_equal(row["T_receiver_donor"], event.T_receiver_donor.matrix.ravel())
        assert row["receiver_type"] == row["donor_type"] == row["compared_type"] == "occupancy_grid"
        assert row["receiver_resolution_m"] == row["donor_resolution_m"] == 0.2 and row["resolution_ratio"] == 1.0
        assert 0.0 < row["receiver_quality"] <= 1.0 and row["receiver_area_m2"] > 10.0
    assert sorted(row["position"] for row in rows.values()) == list(range(len(rows)))


def test_what_became_of_a_merge_is_told(ran):
    last = {e.merge_id: e for e in ran.result.events if e.merge_id}
    states = []
    for example_id, row in ran.rows().items():
        if row["verdict"] != "provisional":
            assert row["state"] == "" and row["history"] == [] and row["later"] == []
            continue
        event = last[example_id]
        states.append(row["state"])
        assert (row["state"], row["state_reason"]) == (event.state, event.reason)
        assert np.array_equal(row["T_final"], event.T_receiver_donor.matrix.ravel())
    assert {"reverted", "confirmed", "provisional"} == set(states)


def test_evidence_is_what_the_acceptor_was_shown(ran):
    (event,) = (e for e in ran.result.events if e.merge_id == "alpha.bravo.1" and e.kind == "merged")
    row = ran.rows()["alpha.bravo.1"]
    told = {pair["name"]: pair["value"] for pair in row["evidence"]}
    assert told["score"] == event.score and told["margin"] == event.margin
    for measurement in event.measurements:
        assert told[measurement.name] == measurement.value or math.isnan(measurement.value)
        assert {f"{measurement.name}.{name}" for name in measurement.details} <= told.keys()
    assert {"posterior", "posterior.log_odds", "evidence.agreement", "recall", "contradiction"} <= told.keys()
    assert len(row["hypotheses"]) == event.hypotheses and row["chosen"] == 0
    best = row["hypotheses"][0]
    assert (best["x_m"], best["y_m"]) == pytest.approx((row["x_m"], row["y_m"]), abs=1e-4)
    assert {pair["hypothesis"] for pair in row["rivals"]} == {1}  # the rule shows two candidates
    rival = {pair["name"]: pair["value"] for pair in row["rivals"]}
    assert rival.keys() == told.keys() and rival["score"] == row["hypotheses"][1]["score"]


def test_history_is_what_verification_measured_again_and_again(ran):
    verified = [e for e in ran.result.events if e.merge_id == "alpha.bravo.1" and e.measurements and e.kind != "merged"]
    row = ran.rows()["alpha.bravo.1"]
    looks = {}
    for one in row["history"]:
        looks.setdefault(one["stamp"], {})[one["metric"]] = one
    assert len(looks) >= len({e.stamp_ns for e in verified}) >= 3
    assert len(looks) > 5  # also what no event tells of
    for event in verified:
        news = next(m for m in event.measurements if m.name == "news")
        latest = [look["news.against"]["value"] for stamp, look in looks.items() if stamp <= event.stamp_ns]
        assert latest[-1] == news.details["against"]
    first, *_, final = looks.values()
    assert all(one["observations"] == 0 for one in first.values())
    assert final["verifier.log_odds_wrong"]["value"] > 6.9  # it was reverted
    assert final["news"]["support"] > 0
    later = {pair["name"]: pair["value"] for pair in row["later"]}
    assert later["news.against"] == final["news.against"]["value"]


def test_the_truth_is_told_where_it_is_known(ran):
    rows = ran.rows()
    for row in rows.values():
        T = ran.T_world_map[row["receiver"]].inverse() @ ran.T_world_map[row["donor"]]
        assert transform_of(row["truth_T"]).difference(T)[0] < 1e-6  # of charlie and bravo it follows from two others
        assert row["truth_by"] == "given" and row["environment"] == "demo"
        shift_m, turn_rad = T.difference(transform_of(row["T_receiver_donor"]))
        if shift_m < 0.3 and abs(turn_rad) < 0.01:
            assert row["truth"] == "right" and row["truth_error_m"] < 0.5
        if abs(turn_rad) > math.radians(5.0):
            assert row["truth"] == "wrong" and row["truth_error_deg"] > 5.0
    assert rows["alpha.bravo.1"]["truth"] == rows["alpha.bravo.1"]["truth_final"] == "wrong"
    assert rows["alpha.charlie.3"]["truth"] == rows["alpha.charlie.3"]["truth_final"] == "right"
    assert rows["alpha.charlie.3"]["truth_overlap"] > 0.5 > rows["alpha.bravo.1"]["truth_overlap"]


def test_pictures_show_the_maps_as_they_were(ran):
    folder = ran.folder
    key = next(key for key in folder.keys if key.example_id == "alpha.charlie.3")
    row = folder.row(key, ["own_px_m", "own_x_m", "overlap", "truth_overlap", "classes_own", "classes_donor"])
    shape = folder.row(key, ["window_px_h", "window_px_w"])
    own, overlay = cells_of(folder.picture(key, "own")), cells_of(folder.picture(key, "overlay"))
    assert row["own_px_m"] == 0.2 and set(np.unique(own)) == {0, 1, 2}
    window = (shape["window_px_h"], shape["window_px_w"])
    assert max(window) <= 128 and overlay.shape == (2 * window[0], 2 * window[1])
    mine, theirs = (np.reshape(row[f"classes_{whose}"], window) for whose in ("own", "donor"))
    assert set(np.unique(mine)) == set(np.unique(theirs)) == {0, 1, 2}
    joint = (mine > 0) & (theirs > 0)
    assert joint.any() and np.mean(mine[joint] == theirs[joint]) > 0.8  # a right one
    assert abs(row["overlap"] - row["truth_overlap"]) < 0.15
    assert np.count_nonzero(overlay == 4) > np.count_nonzero(overlay == 2)


def test_the_same_run_gives_the_same_bytes_and_the_truth_makes_no_other_run(ran, tmp_path):
    files, _, _ = demo_files()
    config = {**ran.config, "examples": {"environments": {"alpha": "elsewhere"}}}
    again = mapgraft.run(files, config, tmp_path)
    assert again.run_id == ran.result.run_id
    mapgraft.run(files, ran.config, tmp_path)
    (one,), (other,) = (sorted(folder.glob("examples/**/*.parquet")) for folder in (ran.out, tmp_path))
    assert hashlib.sha256(one.read_bytes()).digest() == hashlib.sha256(other.read_bytes()).digest()
    mapgraft.run(files, {**ran.config, "output": {"report": False, "snapshots": False, "examples": False}}, tmp_path)
    assert not list(tmp_path.glob("examples/**/*.parquet"))  # nobody takes the earlier ones for this run's
    with_, without = (sorted((folder / "events").rglob("*.parquet"))[0].read_bytes() for folder in (ran.out, tmp_path))
    assert with_ == without  # looking on changes nothing


def test_a_pair_that_is_turned_away_again_and_again_is_one_example(tmp_path):
    files, _, _ = demo_files()
    config = {
        "mission": {"end_s": 20},
        "map": {"type": "occupancy_grid", "resolution_m": 0.2},
        "exchange": {"use": "every", "seconds": 5},
        "output": {"report": False, "snapshots": False},
        "rules": [{"name": "none for grids", "when": {"own.type": "occupancy_grid"}, "reject": "no"}],
    }
    result = mapgraft.run(files[:2], config, tmp_path)
    assert sum(event.kind == "rejected" for event in result.events) > 4
    folder = ExampleFolder(tmp_path)
    assert [key.example_id for key in folder.keys] == ["alpha.bravo.1x", "bravo.alpha.1x"]
    row = folder.row(folder.keys[0])
    assert row["verdict"] == "rejected" and row["merge_id"] is None and "no" in row["reason"]
    assert np.isnan(row["T_receiver_donor"]).all() and row["evidence"] == [] and row["chosen"] is None
    assert folder.picture(folder.keys[0], "own") and folder.picture(folder.keys[0], "donor") is None
    assert row["receiver_area_m2"] > 0 and row["donor_resolution_m"] == 0.2


def test_a_truth_about_nobody_is_refused_before_anything_is_written(tmp_path):
    files, _, _ = demo_files()
    for truth, said in (
        ([{"receiver": "alpha", "donor": "zoe"}], "there is no robot zoe"),
        ([{"receiver": "alpha", "donor": "bravo", "x_m": 1.0}], "or none of them"),
    ):
        with pytest.raises(ConfigError, match=said):
            mapgraft.run(files, {"examples": {"truth": truth}}, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def looked(looks: Looks, count: int, turn: int) -> None:
    for n in range(count):
        news = Measurement("news", float(n), "1", n, "lower", {"against": float(n)})
        sample = Sample(n, n, {"news": news})
        looks.add(sample, Verdict("revert" if n == turn else "keep", "", {"log_odds": n / 2.0}))


def test_of_very_many_looks_enough_are_kept():
    looks = Looks()
    looked(looks, 5_000, turn=1_234)
    columns = looks.columns()
    stamps = sorted({row["stamp"] for row in columns["history"]})
    assert MOST < len(stamps) <= 2 * MOST + 1
    assert stamps[0] == 0 and stamps[-1] == 4_999 and {1_234, 1_235} <= set(stamps)  # where the verdict turned
    assert columns["later"] == {"news": 4_999.0, "news.against": 4_999.0, "verifier.log_odds": 2_499.5}


def test_what_was_not_measured_anew_is_not_told_again():
    looks, old = Looks(), Measurement("paths", 1.0, "1", 3, "lower", {})
    looks.add(Sample(1, 0, {"paths": old}), Verdict("keep", "", {"limit": 6.9}))
    looks.add(Sample(2, 10, {"paths": old}), Verdict("keep", "", {"limit": 6.9}))
    assert [row["stamp"] for row in looks.columns()["history"]] == [1, 1]


def test_tables_join_on_the_merge_id(ran):
    found = duckdb.sql(
        f"SELECT count(*) FROM read_parquet('{ran.out}/examples/**/*.parquet', hive_partitioning = true) AS x "
        f"JOIN read_parquet('{ran.out}/events/**/*.parquet', hive_partitioning = true) AS e "
        "ON x.run_id = e.run_id AND x.merge_id = e.merge_id AND x.seq = e.seq"
    ).fetchall()
    assert found == [(len(ran.folder),)]


def test_keys_are_the_runs(ran):
    assert {key.run_id for key in ran.folder.keys} == {ran.result.run_id}
    assert ExampleKey(ran.result.run_id, "alpha.bravo.1") in ran.folder
    assert isinstance(ran.out, Path) and isinstance(ran.T_world_map["alpha"], Transform)


def test_a_run_that_was_ended_leaves_what_was_whole_and_ends_with_the_same_bytes(ran, tmp_path):
    class Ends:
        """Somebody presses Ctrl-C when a merge is reverted."""

        def observed(self, observation: Observation) -> None: ...
        def mapped(self, snapshot: Snapshot) -> None: ...
        def happened(self, event: Event) -> None:
            if event.kind == "reverted":
                raise KeyboardInterrupt

    files, _, _ = demo_files()
    with pytest.raises(KeyboardInterrupt):
        mapgraft.run(files, ran.config, tmp_path, sinks=[Ends()])
    (partial,) = tmp_path.glob("examples/run_id=*/.part-*.partial")
    whole = pl.read_parquet(partial)["example_id"].to_list()
    assert whole == [key.example_id for key in ran.folder.keys][: len(whole)] and "alpha.bravo.1" in whole
    with pytest.raises(UsageError, match="has no examples yet, because the run there is not finished"):
        ExampleFolder(tmp_path)
    mapgraft.run(files, ran.config, tmp_path)
    (ours,), (theirs,) = (sorted(folder.glob("examples/**/*.parquet")) for folder in (tmp_path, ran.out))
    assert ours.read_bytes() == theirs.read_bytes() and not list(tmp_path.rglob("*.partial"))


def test_a_run_that_was_killed_is_computed_again_to_the_same_bytes(ran, tmp_path):
    script = """
    import json, os, signal, sys
    from pathlib import Path
    import mapgraft

    class Dies:
        def observed(self, observation): ...
        def mapped(self, snapshot): ...
        def happened(self, event):
            if event.kind == "reverted":
                os.kill(os.getpid(), signal.SIGKILL)

    files, config, out = json.loads(sys.argv[1])
    mapgraft.run(files, config, out, sinks=[Dies()])
    """
    files, _, _ = demo_files()
    told = json.dumps([[str(file) for file in files], ran.config, str(tmp_path)])
    killed = subprocess.run([sys.executable, "-c", textwrap.dedent(script), told], capture_output=True, check=False)
    assert killed.returncode == -signal.SIGKILL
    assert not list(tmp_path.glob("examples/**/part-*.parquet"))
    mapgraft.run(files, ran.config, tmp_path)
    (ours,), (theirs,) = (sorted(folder.glob("examples/**/*.parquet")) for folder in (tmp_path, ran.out))
    assert ours.read_bytes() == theirs.read_bytes()

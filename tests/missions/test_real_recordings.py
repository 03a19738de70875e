"""The main job on real recordings: whatever stands at the end is right, and every event says why."""

from __future__ import annotations

import math

import numpy as np
import pytest

import mapgraft
from mapgraft.contracts import MapgraftError, Transform
from mapgraft_grid.grid_map import OCCUPIED


def error_of(T: Transform, truth: Transform) -> tuple[float, float]:
    """(metres, degrees) between a found transform and the true one."""
    shift_m, turn_rad = T.difference(truth)
    return shift_m, math.degrees(turn_rad)


def test_intel_what_stands_is_right_and_the_largest_overlap_is_merged(intel, intel_truth):
    standing = intel.standing.values()
    assert {("first", "third"), ("third", "first")} <= {(e.receiver, e.donor) for e in standing}
    for event in standing:
        truth = intel_truth[event.receiver].inverse() @ intel_truth[event.donor]
        shift_m, turn_deg = error_of(event.T_receiver_donor, truth)
        assert shift_m <= 0.5, event.merge_id
        assert turn_deg <= 3.0, event.merge_id


def test_intel_every_event_explains_itself(intel):
    assert all(event.reason and event.by for event in intel.events if event.kind != "offered")
    assert {"offered", "unmatched", "merged", "verified", "confirmed"} <= {event.kind for event in intel.events}


def test_intel_reverted_by_hand_is_byte_for_byte_the_run_that_never_merged(intel, intel_mcap, intel_config, tmp_path):
    receiver, donor = "first", "third"
    pairs = [["first", "second"], ["second", "third"]]
    at_once = intel_config(exchange={"use": "at", "seconds": [400]}, forbid=pairs)
    made = mapgraft.run([intel_mcap], at_once)
    merge_id = next(e.merge_id for e in made.events if e.kind == "merged" and e.receiver == receiver)
    verdict = {"merge": merge_id, "action": "revert", "by": "test"}
    reverted = mapgraft.run([intel_mcap], {**at_once, "verdicts": [verdict]}, tmp_path / "reverted")
    never = mapgraft.run([intel_mcap], {**at_once, "forbid": [*pairs, [receiver, donor]]}, tmp_path / "never")
    assert [e.exactness.exact for e in reverted.events if e.kind == "reverted" and e.receiver == receiver] == [True]
    assert not any(e.kind == "merged" for e in never.events)
    assert reverted.maps[receiver].layer == never.maps[receiver].layer
    for suffix in ("pgm", "yaml"):
        one, other = (tmp_path / run / "maps" / f"{receiver}.{suffix}" for run in ("reverted", "never"))
        assert one.read_bytes() == other.read_bytes()


@pytest.mark.parametrize("reversal", ["single_map", "multi_map"])
def test_intel_the_exactness_statement_is_true(intel_mcap, intel_config, reversal):
    """Revert in the middle, map on, and count the cells in which the map differs from one that never merged."""
    pairs = [["first", "second"], ["second", "third"]]
    mission = {"known_poses": True}
    once = intel_config(reversal=reversal, mission=mission, exchange={"use": "at", "seconds": [400]}, forbid=pairs)
    for robot in once["robots"].values():  # weak evidence and a far clamp: what is viewed is all the evidence there is
        robot["map"] |= {"l_hit": 0.2, "l_miss": -0.1, "clamp": 31.0}
    made = mapgraft.run([intel_mcap], once)
    merge_id = next(e.merge_id for e in made.events if e.kind == "merged" and e.receiver == "first")
    reverted = mapgraft.run([intel_mcap], {**once, "verdicts": [{"merge": merge_id, "action": "revert"}]})
    never = mapgraft.run([intel_mcap], {**once, "forbid": [*pairs, ["first", "third"]]})
    said = next(e.exactness for e in reverted.events if e.kind == "reverted" and e.merge_id == merge_id)
    differing = differing_cells(reverted.maps["first"].fused, never.maps["first"].fused)
    if reversal == "multi_map":
        assert said.exact
        assert differing == 0
        assert reverted.maps["first"].layer == never.maps["first"].layer
    else:
        assert not said.exact
        assert said.cells_reset > 0
        assert differing == said.cells_contaminated


def differing_cells(a, b) -> int:
    """How many cells hold other log-odds in one map than in the other."""
    x0, y0, x1, y1 = (f(p, q) for f, p, q in zip((min, min, max, max), a.bounds_cells(), b.bounds_cells(), strict=True))
    margin = 500  # evidence too weak to make a cell known lies outside the bounds of what is known
    window = ((x0 - margin, y0 - margin), (y1 - y0 + 2 * margin, x1 - x0 + 2 * margin))
    return int((a.dense_over(*window).log_odds != b.dense_over(*window).log_odds).sum())


def test_three_bags_of_one_simulation_are_all_merged(shared_data, pair_truth):
    bags = [shared_data / "bags/three_robots_sim" / f"robot{n}.bag" for n in (1, 2, 3)]
    result = mapgraft.run(bags)
    merged = {(e.receiver, e.donor): e for e in result.standing.values()}
    assert len(merged) == 6
    for a, b in (("robot1", "robot2"), ("robot2", "robot3")):
        truth = pair_truth(f"three_robots_sim_{a}", f"three_robots_sim_{b}")
        shift_m, turn_deg = error_of(merged[a, b].T_receiver_donor, truth)
        assert shift_m <= 0.3
        assert turn_deg <= 4.0


def test_scans_in_one_bag_and_poses_in_another(shared_data, pair_truth):
    folder = shared_data / "bags" / "arena"
    robots = {f"arena_raw_{n}": {"poses": {"file": str(folder / f"arena_gmapping_{n}.bag")}} for n in (1, 2)}
    result = mapgraft.run([folder / "arena_raw_1.bag", folder / "arena_raw_2.bag"], {"robots": robots})
    merged = {(e.receiver, e.donor): e for e in result.standing.values()}
    assert len(merged) == 2
    truth = pair_truth("arena_gmapping_1", "arena_gmapping_2")
    shift_m, turn_deg = error_of(merged["arena_raw_1", "arena_raw_2"].T_receiver_donor, truth)
    assert shift_m <= 0.3
    assert turn_deg <= 4.0


def test_a_robot_on_odometry_against_the_prior_map_of_its_floor(shared_data):
    """Two maps a day apart: the long walls that both hold lie within 0.3 m of each other."""
    files = [shared_data / "bags/turtlebot4/macfirst_floor_take_2", shared_data / "maps/mac_1st_floor_final.yaml"]
    prior = {"receiver": "mac_1st_floor_final", "donor": "macfirst_floor_take_2"}
    config = {
        "robots": {"mac_1st_floor_final": {"options": {"unknown_gray": 205}}},
        "priors": [{**prior, "x_m": -0.126, "y_m": 13.805, "yaw_rad": -0.111}],
    }
    result = mapgraft.run(files, config)
    standing = {(e.receiver, e.donor): e for e in result.standing.values()}
    event = standing["mac_1st_floor_final", "macfirst_floor_take_2"]
    assert result.maps["mac_1st_floor_final"].version == 1
    prior_walls = walls_of(result.maps["mac_1st_floor_final"].own)
    seen = event.T_receiver_donor.apply(walls_of(result.maps["macfirst_floor_take_2"].own))
    corridor = seen[(seen[:, 0] > 4.0) & (seen[:, 0] < 7.0) & (seen[:, 1] > -11.0) & (seen[:, 1] < 7.0)]
    nearest = np.array([np.hypot(*(prior_walls - p).T).min() for p in corridor])
    assert len(corridor) > 200
    assert np.mean(nearest < 0.3) > 0.9


def walls_of(map_) -> np.ndarray:
    """Centres of the occupied cells, (n, 2) metres in the map's frame."""
    dense = map_.dense()
    rows, columns = np.nonzero(dense.classes == OCCUPIED)
    return np.stack((columns + 0.5, rows + 0.5), axis=1) * dense.resolution_m + dense.origin_m


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("mcap/nav2_turtlebot.mcap", "no scans and no maps"),
        ("bags/damaged/rosrecord_v1.2.bag", "old format"),
        ("bags/damaged/broken_index.bag", "no poses"),
        ("bags/there_is_no.bag", "does not exist"),
    ],
)
def test_what_cannot_be_mapped_is_said_in_a_sentence(shared_data, tmp_path, name, sentence):
    with pytest.raises(MapgraftError, match=sentence) as error:
        mapgraft.run([shared_data / name], out=tmp_path / "out")
    assert "\n" not in str(error.value)
    assert not (tmp_path / "out").exists()

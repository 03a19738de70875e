"""A cloud robot beside robots that map grids and line segments: each takes the other in, and gives it back exactly."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

import mapgraft
from mapgraft.contracts import Transform
from mapgraft_recordings.buildings import building, record
from mapgraft_recordings.buildings.carmen import write_carmen
from mapgraft_recordings.buildings.cloud_messages import cloud_messages, first_place
from mapgraft_recordings.buildings.spatial import record_spatial
from mapgraft_recordings.writing import write_mcap

SEED, SWEEPS, SCANS = 2, 30, 120
AT_THE_END: dict[str, Any] = {
    "exchange": {"use": "every", "seconds": 100_000},
    "output": {"report": False},
}
MAPS = {"lines": {"type": "line_segments"}, "grid": {"type": "occupancy_grid"}}


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Path], Transform]:
    """ada with a spinning lidar, eve with a planar one, in one castle; and where ada's map lies in eve's."""
    folder = tmp_path_factory.mktemp("castle")
    made = record_spatial(building(SEED), 0, SWEEPS)
    write_mcap(folder / "ada.mcap", cloud_messages(made, "ada", first_place(made)))
    write_carmen(folder / "eve.log", record(building(SEED), 1, SCANS), 1)
    return [folder / "ada.mcap", folder / "eve.log"], first_place(made).inverse()


def run(paths: list[Path], kind: str, folder: Path, **more: Any) -> mapgraft.Result:
    return mapgraft.run(paths, {**AT_THE_END, "robots": {"eve": {"map": MAPS[kind]}}, **more}, folder)


def files_of(result: mapgraft.Result, robot: str) -> dict[str, bytes]:
    """What was written of a robot's own map."""
    assert result.folder is not None
    return {path.name: path.read_bytes() for path in (result.folder / "maps").glob(f"{robot}.*")}


@pytest.mark.parametrize(
    ("kind", "rules", "fusers"),
    [
        ("grid", ("a grid into a cloud", "a cloud into a grid"), ("voxels", "log_odds")),
        ("lines", ("line segments into a cloud", "a cloud into line segments"), ("voxels", "line_union")),
    ],
)
def test_both_take_each_other_in_and_part_exactly(
    recordings: tuple[list[Path], Transform],
    tmp_path: Path,
    kind: str,
    rules: tuple[str, str],
    fusers: tuple[str, str],
) -> None:
    paths, T_eve_ada = recordings
    standing = run(paths, kind, tmp_path / "standing")
    merged = {event.receiver: event for event in standing.standing.values()}
    truths = {"ada": T_eve_ada.inverse(), "eve": T_eve_ada}
    for robot, rule, fuser in zip(("ada", "eve"), rules, fusers, strict=True):
        event = merged[robot]
        assert (event.rule, event.matcher, event.fuser) == (rule, "correlation", fuser)
        assert event.T_receiver_donor is not None
        shift_m, turn_rad = truths[robot].difference(event.T_receiver_donor)
        assert shift_m < 0.3 and math.degrees(turn_rad) < 2.0
        assert standing.maps[robot].fused.known() > standing.maps[robot].own.known()
    verdicts = [{"merge": event.merge_id, "action": "revert", "by": "test"} for event in merged.values()]
    reverted = run(paths, kind, tmp_path / "reverted", verdicts=verdicts)
    never = run(paths, kind, tmp_path / "never", forbid=[["ada", "eve"], ["eve", "ada"]])
    exact = {e.receiver: e.exactness.exact for e in reverted.events if e.kind == "reverted" and e.exactness}
    assert exact == {"ada": True, "eve": True}
    for robot in ("ada", "eve"):
        assert reverted.maps[robot].layer == never.maps[robot].layer
        assert files_of(reverted, robot) == files_of(never, robot) != {}

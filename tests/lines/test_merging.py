"""Robots that map line segments and robots that map grids graft each other's maps in, and take them out again."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import mapgraft
from mapgraft.config import parse_config
from mapgraft.recording.mission import open_mission
from mapgraft_recordings.buildings import building, record
from mapgraft_recordings.buildings.carmen import write_carmen

SCANS = 160
KINDS = {"lines": {"type": "line_segments"}, "grid": {"type": "occupancy_grid", "resolution_m": 0.07}}


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, float]:
    """A drive through an office as a log, and how many seconds it took."""
    made = record(building(6, "office"), 0, SCANS)
    path = tmp_path_factory.mktemp("log") / "office.log.gz"
    write_carmen(path, made, 0)
    stamps = [sighting.stamp_ns for sighting in made.sightings]
    return path, (stamps[-1] - stamps[0]) / 1e9


def config(log: tuple[Path, float], ann: str, bob: str, **more: Any) -> dict[str, Any]:
    """Two robots that have seen the first and the second two thirds of the drive, each in its own frame."""
    seconds = log[1]
    windows = {"ann": (0.0, 0.66 * seconds, ann), "bob": (0.33 * seconds, None, bob)}
    robots = {
        name: {"source": "office", "window": {"start_s": start, "end_s": end}, "map": KINDS[kind]}
        for name, (start, end, kind) in windows.items()
    }
    return {
        "robots": robots,
        "exchange": {"use": "at", "seconds": [0.9 * seconds]},
        "output": {"report": False},
        **more,
    }


def maps(result: mapgraft.Result) -> dict[str, bytes]:
    assert result.folder is not None
    return {path.name: path.read_bytes() for path in sorted((result.folder / "maps").iterdir()) if path.is_file()}


@pytest.fixture(scope="module")
def alone(log: tuple[Path, float], tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], dict[str, bytes]]:
    """The files of ann's own map when ann and bob never merged, by the kind of map that ann makes."""

    @functools.cache
    def made(kind: str) -> dict[str, bytes]:
        out = tmp_path_factory.mktemp("alone") / kind
        files = maps(mapgraft.run([log[0]], config(log, kind, "grid", forbid=[["ann", "bob"]]), out))
        own = {name: data for name, data in files.items() if name.startswith("ann.")}
        assert own
        return own

    return made


@pytest.mark.parametrize(
    ("ann", "bob", "rule", "fuser"),
    [
        ("lines", "lines", "line segments with line segments", "line_union"),
        ("lines", "grid", "a grid into line segments", "line_union"),
        ("grid", "lines", "line segments into a grid", "log_odds"),
    ],
)
def test_either_is_receiver_and_nothing_is_left_of_what_is_taken_out(log, alone, tmp_path, ann, bob, rule, fuser):
    path = log[0]
    told = config(log, ann, bob, verdicts=[{"merge": "ann.bob.1", "action": "revert", "by": "us", "reason": "to see"}])
    reverted = mapgraft.run([path], told, tmp_path / "reverted")
    (merged,) = [event for event in reverted.events if event.merge_id == "ann.bob.1" and event.kind == "merged"]
    assert (merged.rule, merged.matcher, merged.fuser) == (rule, "line_association", fuser)
    with open_mission([path], parse_config(config(log, ann, bob))) as mission:
        truth = mission.T_world_map["ann"].inverse() @ mission.T_world_map["bob"]
    shift_m, turn_rad = truth.difference(merged.T_receiver_donor)
    assert shift_m < 0.5 and math.degrees(turn_rad) < 2.0

    (event,) = [event for event in reverted.events if event.merge_id == "ann.bob.1" and event.kind == "reverted"]
    assert event.exactness is not None and event.exactness.exact
    after = maps(reverted)
    assert {name: after[name] for name in alone(ann)} == alone(ann)


def test_what_came_in_is_seen_as_long_as_it_stands(log, tmp_path):
    standing = mapgraft.run([log[0]], config(log, "lines", "lines"), tmp_path / "standing").maps["ann"]
    assert standing.fused.known() > standing.own.known()

"""The files that people open with other tools."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plots import ALPHA, AT, ROBOTS, UNDERSCORE, PlotType, S, snapshot, told

from mapgraft.contracts import Map, Observation, Transform
from mapgraft.errors import PluginError
from mapgraft.events import Event
from mapgraft.outputs.files import Component, connected, map_files
from mapgraft.outputs.names import file_names
from mapgraft.outputs.standing import StandingMerge, StandingMerges
from mapgraft.outputs.tables import transforms_table


def test_every_robots_own_map_and_the_components_fused_map_are_there(out: Path) -> None:
    kind = PlotType()
    for robot in ROBOTS:
        last = snapshot(robot, 599, "end", 14)
        assert (out / f"maps/{robot}.json").read_bytes() == last.layer
    merged = kind.decode((out / f"maps/{ALPHA}.merged.json").read_bytes())
    assert merged.cells.keys() - kind.decode((out / f"maps/{ALPHA}.json").read_bytes()).cells.keys() == {(90, 90)}
    assert {path.name for path in (out / "maps").glob("*.merged.*")} == {f"{ALPHA}.merged.json"}


def test_trajectories_are_tum_with_every_pose(out: Path) -> None:
    for robot in ROBOTS:
        poses = [item for item in told() if isinstance(item, Observation) and item.robot == robot]
        lines = (out / f"trajectories/{robot}.tum").read_text().splitlines()
        assert len(lines) == len(poses) == 600
        for line, pose in zip(lines, poses, strict=True):
            seconds, *numbers = line.split(" ")
            whole, _, nano = seconds.partition(".")
            assert int(whole) * S + int(nano) == pose.stamp_ns
            x, y, z, *q = map(float, numbers)
            T = Transform.from_quaternion((x, y, z), (q[0], q[1], q[2], q[3]))
            assert T.matrix == pytest.approx(pose.T_map_base.matrix, abs=1e-8)


def test_transforms_csv_says_what_the_table_says(out: Path, events: list[Event]) -> None:
    with (out / "transforms.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    table = transforms_table(events).to_pylist()
    assert [(row["target"], row["source"]) for row in rows] == [(ALPHA, AT), (AT, ALPHA)]
    for row, expected in zip(rows, table, strict=True):
        for name in ("x_m", "y_m", "z_m", "yaw_rad", "scale"):
            assert float(row[name]) == expected[name]
        assert row["merges"].split() == expected["merges"] and row["state"] == expected["state"]
        assert float(row["sigma_y_m"]) == pytest.approx(math.sqrt(expected["covariance"][7]))
        matrix = np.array(expected["T_target_source"]).reshape(4, 4)
        q = tuple(float(row[name]) for name in ("qx", "qy", "qz", "qw"))
        assert Transform.from_quaternion((0, 0, 0), q).matrix[:3, :3] == pytest.approx(matrix[:3, :3], abs=1e-6)


def test_the_summary_tells_who_is_connected_and_what_became_of_every_merge(out: Path) -> None:
    summary = json.loads((out / "summary.json").read_text())
    assert summary["components"] == [{"name": ALPHA, "robots": [ALPHA, AT], "map_of": ALPHA}]
    assert [(m["merge_id"], m["state"]) for m in summary["merges"]] == [
        (f"{ALPHA}.{AT}.1", "confirmed"),
        (f"{UNDERSCORE}.{ALPHA}.1", "reverted"),
    ]
    assert summary["events"]["verified"] == 99 and summary["events"]["merged"] == 2
    assert summary["robots"][AT]["observations"] == 600 and summary["robots"][AT]["known_own"] == 196
    written = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    assert {name for name in written if "/run_id=" not in name} == {*summary["files"], "summary.json", ".mapgraft.lock"}


def test_the_layout_file_is_the_attached_one(out: Path) -> None:
    panel = json.loads((out / "layout.json").read_text())["configById"]["3D!mapgraft"]
    assert panel["topics"]["/alpha/merged/map"]["colorMode"] == "map"
    assert panel["cameraState"]["distance"] > 10.0


def test_a_components_map_is_of_its_first_robot_that_receives() -> None:
    T = Transform.identity()
    merges = [StandingMerge("c.a.1", 0, "c", "a", T), StandingMerge("d.c.1", 1, "d", "c", T)]
    assert connected(["a", "b", "c", "d"], merges) == [Component("a", ("a", "c", "d"), "c")]


def test_maps_that_know_nothing_give_no_file() -> None:
    empty = replace(snapshot(ALPHA, 0, "end", 1), own=PlotType().new_layer(), fused=PlotType().new_layer())
    files = map_files({ALPHA: empty}, [Component(ALPHA, (ALPHA, AT), ALPHA)], file_names())
    assert files == {}


class Escaping(PlotType):
    """A map type that names its file as it likes."""

    def files(self, map_: Map, stem: str) -> Mapping[str, bytes]:
        return {"../elsewhere": b""}


def test_a_map_type_cannot_write_elsewhere() -> None:
    last = replace(snapshot(ALPHA, 0, "end", 2), map_type=Escaping())
    with pytest.raises(PluginError, match=r"a file '\.\./elsewhere': its name must start with 'alpha'"):
        map_files({ALPHA: last}, [], file_names())


def test_the_standing_merges_are_those_of_the_events(events: list[Event]) -> None:
    assert [(m.merge_id, m.state) for m in StandingMerges(events).merges] == [(f"{ALPHA}.{AT}.1", "confirmed")]

"""Whole missions with clouds: found, said, mapped, merged, taken out again; without the extra."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import mapgraft
from mapgraft.commands.app import app
from mapgraft.contracts import ConfigError, RecordingError, Transform
from mapgraft.decision import build_table, facts_of
from mapgraft.plugins import load_plugins
from mapgraft_cloud.map_type import PointCloud
from mapgraft_recordings.buildings import building
from mapgraft_recordings.buildings.cloud_messages import cloud_messages, first_place
from mapgraft_recordings.buildings.spatial import record_spatial
from mapgraft_recordings.simulator.messages import Message
from mapgraft_recordings.writing import write_mcap

SEED, SWEEPS = 2, 30
AT_THE_END: dict[str, Any] = {
    "exchange": {"use": "every", "seconds": 100_000},
    "output": {"report": False},
}


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Path], dict[str, Transform]]:
    """Two robots with spinning lidars in one castle, and where their map frames lie in it."""
    folder, paths, places = tmp_path_factory.mktemp("castle"), [], {}
    for drive, name in enumerate(("ada", "bob")):
        made = record_spatial(building(SEED), drive, SWEEPS)
        places[name] = first_place(made).inverse()
        paths.append(folder / f"{name}.mcap")
        write_mcap(paths[-1], cloud_messages(made, name, first_place(made)))
    return paths, places


def displaced(found: Transform, truth: Transform, about: np.ndarray) -> tuple[float, float]:
    apart = float(np.linalg.norm(found.apply(about) - truth.apply(about)))
    return apart, math.degrees(found.difference(truth)[1])


def written(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.glob("*.pcd")}


def test_info_shows_the_clouds_and_the_map_type(recordings: tuple[list[Path], dict[str, Transform]]) -> None:
    said = CliRunner().invoke(app, ["info", str(recordings[0][0])])
    assert said.exit_code == 0
    assert f"cloud on /ada/points: {SWEEPS} of {SWEEPS} have a pose" in said.output
    assert "point_cloud at 0.1 m" in said.output


def test_two_cloud_robots_merge_and_are_parted_exactly(
    recordings: tuple[list[Path], dict[str, Transform]], tmp_path: Path
) -> None:
    pytest.importorskip("kiss_matcher", reason="needs the extra cloud")
    paths, places = recordings
    result = mapgraft.run(paths, AT_THE_END, tmp_path / "out")
    standing = {(event.receiver, event.donor): event for event in result.standing.values()}
    assert set(standing) == {("ada", "bob"), ("bob", "ada")}
    for (receiver, donor), event in standing.items():
        truth = places[receiver].inverse() @ places[donor]
        assert event.T_receiver_donor is not None
        kind = PointCloud()
        middle = kind.view(kind.decode(result.maps[donor].layer)).points_m.mean(axis=0)[None]
        apart_m, apart_deg = displaced(event.T_receiver_donor, truth, middle)
        assert apart_m < 0.25
        assert apart_deg < 1.0
    verdict = {"merge": standing["ada", "bob"].merge_id, "action": "revert", "by": "test"}
    reverted = mapgraft.run(paths, {**AT_THE_END, "verdicts": [verdict]}, tmp_path / "reverted")
    never = mapgraft.run(paths, {**AT_THE_END, "forbid": [["ada", "bob"]]}, tmp_path / "never")
    assert [e.exactness.exact for e in reverted.events if e.kind == "reverted" and e.receiver == "ada"] == [True]
    merged, one, other = (written(tmp_path / run / "maps") for run in ("out", "reverted", "never"))
    assert one["ada.pcd"] == other["ada.pcd"]
    assert other.keys() == {"ada.pcd", "bob.pcd"}
    assert len(merged) > 2
    assert reverted.maps["ada"].layer == never.maps["ada"].layer


def with_scans(paths: list[Path], folder: Path) -> Path:
    """The first recording with a planar scan beside every cloud."""
    made = record_spatial(building(SEED), 0, 10)
    messages = []
    for message in cloud_messages(made, "ada", first_place(made)):
        messages.append(message)
        if message.topic == "/ada/points":
            head = {**message.fields["header"], "frame_id": "ada/lidar"}
            scan = {
                "header": head,
                "angle_min": -1.0,
                "angle_max": 1.0,
                "angle_increment": 0.5,
                "range_min": 0.1,
                "range_max": 20.0,
                "ranges": np.full(5, 2.0, np.float32),
            }
            messages.append(Message("/ada/scan", "sensor_msgs/msg/LaserScan", message.stamp_ns, scan))
    write_mcap(folder / "ada.mcap", messages)
    return folder / "ada.mcap"


def test_of_scans_and_clouds_the_scans_are_taken_unless_somebody_says_otherwise(
    recordings: tuple[list[Path], dict[str, Transform]], tmp_path: Path
) -> None:
    path = with_scans(recordings[0], tmp_path)
    said = CliRunner().invoke(app, ["info", str(path)])
    text = " ".join(said.output.split())
    assert "/ada/points holds a cloud: the robot is mapped from its scans" in text
    assert "occupancy_grid" in text
    config = tmp_path / "config.yaml"
    config.write_text("robots: {ada: {scans: [/ada/points]}}\n")
    said = CliRunner().invoke(app, ["info", str(path), "-c", str(config)])
    assert "cloud on /ada/points: 10 of 10 have a pose" in said.output
    config.write_text("robots: {ada: {scans: [/ada/points, /ada/scan]}}\n")
    said = CliRunner().invoke(app, ["info", str(path), "-c", str(config)])
    assert isinstance(said.exception, ConfigError)
    assert "hold a cloud and a scan: name one kind" in str(said.exception)


def test_broken_clouds_are_counted_and_the_others_mapped(tmp_path: Path) -> None:
    made = record_spatial(building(SEED), 0, 4)
    messages = list(cloud_messages(made, "ada", first_place(made)))
    clouds = [k for k, message in enumerate(messages) if message.topic == "/ada/points"]
    broken = {**messages[clouds[1]].fields, "width": 10_000}
    messages[clouds[1]] = messages[clouds[1]]._replace(fields=broken)
    write_mcap(tmp_path / "ada.mcap", messages)
    result = mapgraft.run([tmp_path / "ada.mcap"], None)
    assert result.maps["ada"].metadata.observations == 3
    for k in clouds:
        messages[k] = messages[k]._replace(fields={**messages[k].fields, "fields": []})
    write_mcap(tmp_path / "none.mcap", messages)
    with pytest.raises(RecordingError, match="a cloud needs the fields x, y and z, found no x and no y and no z"):
        mapgraft.run([tmp_path / "none.mcap"], None)


def test_real_files_are_matched_from_the_command_line(shared_data: Path, tmp_path: Path) -> None:
    pytest.importorskip("kiss_matcher", reason="needs the extra cloud")
    folder = shared_data / "clouds" / "small_gicp"
    files = [str(folder / "target.ply"), str(folder / "source.ply")]
    said = CliRunner().invoke(app, ["match", *files, "-o", str(tmp_path / "out")])
    assert said.exit_code == 0, said.output
    assert "accepted" in said.output
    assert (tmp_path / "out" / "merged.pcd").is_file()


def test_without_the_extra_the_matchers_say_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("kiss_matcher", "small_gicp"):
        monkeypatch.setitem(sys.modules, name, None)
    plugins = load_plugins()
    said = CliRunner().invoke(app, ["plugins", "list"])
    assert "pip install 'mapgraft[cloud]'" in " ".join(said.output.split())
    own = PointCloud()
    facts = facts_of(own.metadata(own.new_layer()), own.metadata(own.new_layer()))
    ruling = build_table(plugins).choose(facts)
    assert ruling.rejected
    assert "mapgraft[cloud]" in ruling.reason


def facts(own: str, other: str) -> dict[str, Any]:
    area = {"known_area_m2": 100.0, "free_space": True, "wall_m": 50.0}
    return {
        **{f"own.{k}": v for k, v in {"type": own, **area}.items()},
        **{f"other.{k}": v for k, v in {"type": other, **area}.items()},
        "scale_known": True,
        "resolution_ratio": 1.0,
        "prior": False,
        "reversal": "ledger",
    }


@pytest.mark.parametrize(
    ("own", "other", "rule"),
    [
        ("point_cloud", "point_cloud", "clouds that know what is free"),
        ("occupancy_grid", "point_cloud", "a cloud into a grid"),
        ("point_cloud", "occupancy_grid", "a grid into a cloud"),
        ("point_cloud", "line_segments", "line segments into a cloud"),
        ("line_segments", "point_cloud", "a cloud into line segments"),
    ],
)
def test_every_pair_has_its_rule(own: str, other: str, rule: str) -> None:
    pytest.importorskip("kiss_matcher", reason="needs the extra cloud")
    ruling = build_table(load_plugins()).choose(facts(own, other))
    assert ruling.rule is not None
    assert ruling.rule.name == rule

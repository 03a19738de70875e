"""The demo of robots whose maps differ: as the script makes it, true to its world, and what a run of it comes to."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

import mapgraft
from mapgraft.cli import invoke
from mapgraft.config import load_config
from mapgraft.contracts import Transform
from mapgraft.events import Snapshot
from mapgraft.outputs.memory_sink import MemorySink
from mapgraft.outputs.report.rasters import FREE, OCCUPIED
from mapgraft.outputs.report.scenes import Scenes
from mapgraft_floorplan.svg_file import read as read_svg
from mapgraft_recordings import demo_files
from mapgraft_recordings.drawn_plan import Alteration, DrawnPlan, as_svg, drawn_lines
from mapgraft_recordings.generate import DEMO, drawn_plan, frames, generate, judged, main, other_lidars
from mapgraft_recordings.mission import Mission, build_mission, load_mission_plan
from mapgraft_recordings.outcome import Outcome, describe, read_outcome
from mapgraft_recordings.outcome import differences as differing
from mapgraft_recordings.simulator import build_world, distance_to_walls, load_plan, parse_plan, trajectory_of

NAME = "heterogeneous"
OTHER_SEED = 2
ROOM: dict[str, Any] = {
    "name": "a room",
    "floor": {
        "walls": [{"line": [[0, 0], [6, 0], [6, 4], [0, 4], [0, 0]], "doors": [{"at_m": 2.0, "width_m": 1.0}]}],
        "furniture": [{"name": "table", "box": [2, 2, 1, 1]}],
    },
}


class Made(NamedTuple):
    mission: Mission
    paths: list[Path]


class Ran(NamedTuple):
    result: mapgraft.Result
    expected: Outcome
    found: Outcome
    snapshots: list[Snapshot]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    return Made(*generate(0, tmp_path_factory.mktemp(NAME), NAME))


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which the script has made the recording of another seed."""
    folder = tmp_path_factory.mktemp("other")
    assert main(["--demo", NAME, "--seed", str(OTHER_SEED), "-o", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Ran:
    """The one run of the demo that all tests look at."""
    pytest.importorskip("svgelements", reason="needs the extra floorplan")
    files, config, expected_file = demo_files(NAME)
    memory, expected = MemorySink(), read_outcome(expected_file)
    result = mapgraft.run(files, config, tmp_path_factory.mktemp("run") / "out", sinks=[memory])
    return Ran(result, expected, judged(result.events, expected.T_world_map, NAME), memory.snapshots)


def messages(path: Path) -> list[tuple[str, int, bytes]]:
    with path.open("rb") as stream:
        return [(channel.topic, m.log_time, m.data) for _, channel, m in make_reader(stream).iter_messages()]


def test_the_script_makes_it_by_name_and_another_seed_makes_another(made: Made, other: Path) -> None:
    assert [path.name for path in made.paths] == ["alpha.mcap", "bravo.mcap", "charlie.mcap", "plan.svg"]
    assert sorted(path.name for path in other.iterdir()) == sorted([*(path.name for path in made.paths), "config.yaml"])
    for path in made.paths:
        same = path.read_bytes() == (other / path.name).read_bytes()
        assert same == (path.suffix == ".svg")  # one plan for all


def test_the_shipped_files_are_what_the_script_makes_and_small(made: Made) -> None:
    shipped, _, _ = demo_files(NAME)
    assert [path.name for path in shipped] == [path.name for path in made.paths]
    for ours, fresh in zip(shipped, made.paths, strict=True):
        if ours.suffix == ".svg":
            assert ours.read_bytes() == fresh.read_bytes()
        else:  # the messages: compressors of other versions pack otherwise
            assert messages(ours) == messages(fresh)
    assert sum(path.stat().st_size for path in demo_files(NAME)[1].parent.iterdir()) < 2_000_000


def test_recorded_points_placed_by_the_truth_lie_on_walls_floor_and_ceiling(made: Made) -> None:
    robot = next(robot for robot in made.mission.robots if robot.name == "bravo")
    trajectory, world = trajectory_of(robot, made.mission.duration_s), made.mission.world
    height_m = other_lidars()["bravo"].height_m
    upright = level = 0
    with AnyReader([made.paths[1]]) as reader:
        for connection, stamp_ns, data in reader.messages():
            if connection.topic != "/bravo/points":
                continue
            cloud = reader.deserialize(data, connection.msgtype)
            points = cloud.data.view("<f4").reshape(-1, 3).astype(np.float64)
            points = points[np.isfinite(points).all(axis=1)]
            x, y, yaw = trajectory.at(np.array([(stamp_ns - 1_700_000_000 * 10**9) / 1e9]))[0]
            placed = Transform.planar(x, y, yaw).apply(points)[:, :2]
            z = points[:, 2] + height_m
            flat = np.minimum(np.abs(z), np.abs(z - world.ceiling_m)) < 0.08
            assert distance_to_walls(placed[~flat], world.segments).max() < 0.1
            upright, level = upright + int((~flat).sum()), level + int(flat.sum())
    assert upright > 50_000 and level > 10_000


def test_each_robot_has_a_type_of_map_of_its_own() -> None:
    robots = load_config(demo_files(NAME)[1]).robots
    assert {name: robot.map.type for name, robot in robots.items() if robot.map} == {
        "alpha": "occupancy_grid",
        "bravo": "point_cloud",
        "charlie": "line_segments",
    }


def test_a_plan_is_drawn_with_its_doorways_and_without_furniture(tmp_path: Path) -> None:
    pytest.importorskip("svgelements", reason="needs the extra floorplan")
    world = build_world(parse_plan(ROOM), seed=0)
    (tmp_path / "room.svg").write_text(as_svg(world, DrawnPlan()))
    ends = read_svg(tmp_path / "room.svg").segments_m.reshape(-1, 2)
    walls = np.vstack([np.hstack((p, np.roll(p, -1, axis=0))) for p in world.walls])
    assert distance_to_walls(ends, walls).max() < 0.001
    assert len(world.walls) == 5 and len(world.polygons) == 6
    assert not ((ends[:, 0] > 1.6) & (ends[:, 0] < 2.4) & (ends[:, 1] < 1)).any()  # the doorway


def test_what_is_altered_is_drawn_so_and_nothing_else() -> None:
    world = build_world(parse_plan(ROOM), seed=0)
    changes = [
        Alteration(name="gone", what="not drawn", within=(5.5, 1.0, 6.5, 2.0)),
        Alteration(name="off", what="drawn elsewhere", within=(1.0, 3.5, 2.0, 4.5), by=(0.0, 0.3)),
        Alteration(name="more", what="not built", line=(3.0, 1.0, 3.0, 2.0)),
    ]
    plain = {line_at(line) for line in drawn_lines(world, DrawnPlan())}
    drawn = {line_at(line) for line in drawn_lines(world, DrawnPlan(alterations=changes))}
    assert drawn - plain == {
        (6.0, -0.06, 6.0, 1.0),
        (6.0, 2.0, 6.0, 4.06),
        (1.0, 4.3, 2.0, 4.3),
        (-0.06, 4.0, 1.0, 4.0),
        (2.0, 4.0, 6.06, 4.0),
        (3.0, 1.0, 3.0, 2.0),
    }
    assert len(plain - drawn) == 2


def line_at(line: tuple[float, float, float, float]) -> tuple[float, ...]:
    ends = sorted((line[:2], line[2:]))
    return tuple(round(value, 6) for end in ends for value in end)


@pytest.mark.parametrize("given", [{"what": "not built"}, {"what": "not drawn"}, {"what": "painted"}])
def test_an_alteration_says_what_and_where(given: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"needs a|Input should be"):
        Alteration(name="it", **given)


def test_a_run_gives_the_expected_outcome(ran: Ran) -> None:
    assert differing(ran.expected, ran.found) == []


def test_wrong_merges_of_a_grid_and_a_cloud_are_found_out_and_right_ones_follow(ran: Ran) -> None:
    assert ran.expected.tells_the_story
    for receiver, donor in (("alpha", "bravo"), ("bravo", "alpha")):
        told = [(t.kind, t.right) for t in ran.found.events if (t.receiver, t.donor) == (receiver, donor)]
        merged = [entry for entry in told if entry[0] in ("merged", "reverted")]
        assert merged == [("merged", False), ("reverted", False), ("merged", True)]


def test_the_plan_enters_as_a_prior_and_its_mistakes_are_told(ran: Ran) -> None:
    standing = {(merge.receiver, merge.donor) for merge in ran.found.standing if merge.right}
    assert {("alpha", "plan"), ("charlie", "plan")} <= standing
    found = {change.name: ("alpha", "charlie") for change in drawn_plan().alterations}
    assert ran.found.found == found and len(found) == 4
    priors = [e.evidence for e in ran.result.events if e.kind == "merged" and e.donor == "plan"]
    assert priors and all("prior" in evidence for evidence in priors)


def test_lines_and_cloud_meet_as_grids(ran: Ran) -> None:
    standing = {(merge.receiver, merge.donor): merge.right for merge in ran.found.standing}
    assert standing["bravo", "charlie"] and standing["charlie", "bravo"]
    assert not any(
        told.right is False for told in ran.found.events if told.kind == "merged" and told.donor == "charlie"
    )


def test_pairs_that_cannot_meet_are_turned_away(ran: Ran) -> None:
    turned = {(told.receiver, told.donor) for told in ran.found.events if told.kind == "rejected"}
    assert turned >= {("bravo", "plan"), *(("plan", robot) for robot in ("alpha", "bravo", "charlie"))}


def test_what_was_taken_out_leaves_no_byte(ran: Ran) -> None:
    reverted = [event for event in ran.result.events if event.kind == "reverted"]
    assert {event.receiver for event in reverted} >= {"alpha", "bravo"}
    assert all(event.exactness and event.exactness.exact for event in reverted)
    after = [s for s in ran.snapshots if s.why == "after revert"]
    assert len(after) == len(reverted)
    alone = [s for s in after if not held(ran, s)]
    assert alone, "after no revert a robot was alone with its own map"
    for snapshot in alone:
        kind = snapshot.map_type
        assert kind.files(snapshot.fused, "map") == kind.files(snapshot.own, "map")


def held(ran: Ran, snapshot: Snapshot) -> set[str]:
    """Whose maps stand in a robot's right after a revert."""
    standing: set[str] = set()
    for event in ran.result.events:
        if event.receiver == snapshot.robot:
            if event.kind == "merged":
                standing.add(event.donor)
            elif event.kind == "reverted":
                standing.discard(event.donor)
                if event.merge_id == snapshot.merge_id:
                    return standing
    raise AssertionError(f"{snapshot.merge_id} was never reverted")


def test_every_type_of_map_is_in_the_output_as_viewers_show_it(ran: Ran) -> None:
    assert ran.result.folder is not None
    wanted = {
        "/alpha/map": "nav_msgs/msg/OccupancyGrid",
        "/alpha/merged/map": "nav_msgs/msg/OccupancyGrid",
        "/bravo/cloud": "sensor_msgs/msg/PointCloud2",
        "/bravo/merged/cloud": "sensor_msgs/msg/PointCloud2",
        "/charlie/lines": "visualization_msgs/msg/MarkerArray",
        "/charlie/merged/lines": "visualization_msgs/msg/MarkerArray",
        "/plan/plan": "visualization_msgs/msg/MarkerArray",
        "/alpha/findings": "visualization_msgs/msg/MarkerArray",
    }
    last: dict[str, Any] = {}
    with AnyReader([ran.result.folder / "alpha.merge.mcap"]) as reader:
        assert wanted.items() <= {c.topic: c.msgtype for c in reader.connections}.items()
        for connection, _, data in reader.messages():
            if connection.topic in wanted:
                last[connection.topic] = reader.deserialize(data, connection.msgtype)
    assert (last["/alpha/merged/map"].data >= 65).sum() > (last["/alpha/map"].data >= 65).sum() > 1_000
    assert last["/bravo/merged/cloud"].width >= last["/bravo/cloud"].width > 5_000
    for topic, msgtype in wanted.items():
        if msgtype.endswith("MarkerArray"):
            assert sum(len(marker.points) for marker in last[topic].markers) > 0, topic
    assert {entry.header.frame_id for entry in (last["/alpha/map"], last["/bravo/cloud"])} == {
        "alpha/map",
        "bravo/map",
    }


def test_the_report_shows_every_type_of_map(ran: Ran) -> None:
    assert ran.result.folder is not None
    scenes = Scenes(ran.result.folder / "alpha.merge.mcap")
    first = next(event for event in ran.result.events if event.kind == "merged")
    for _ in scenes.moments([first.seq]):
        pass
    looks = scenes.last
    assert looks.keys() == {"alpha", "bravo", "charlie", "plan"}
    assert looks["alpha"].own.keys() == {"map"}  # what was found is no map
    for robot, look in looks.items():
        raster = look.own_raster()
        assert raster is not None and not look.undrawn()
        wall_m2, free_m2 = (float((raster.cells == kind).sum()) * raster.cell_m**2 for kind in (OCCUPIED, FREE))
        assert 10.0 < wall_m2 < 100.0, robot
        assert (free_m2 > wall_m2) == (robot != "plan"), robot
    assert looks["alpha"].donor_raster("plan") is not None


def test_a_demo_is_named_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("svgelements", reason="needs the extra floorplan")
    assert invoke(["run", "--demo", NAME, "--end", "5", "--no-report", "-q", "-o", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert all(robot in said for robot in ("alpha", "bravo", "charlie", "plan"))


@pytest.mark.slow
def test_another_seed_comes_out_so_too(other: Path) -> None:
    pytest.importorskip("svgelements", reason="needs the extra floorplan")
    mission = build_mission(load_plan(DEMO / "floor.yaml"), load_mission_plan(DEMO / "mission.yaml"), OTHER_SEED)
    paths = [path for path in sorted(other.iterdir()) if path.name != "config.yaml"]
    outcome = judged(mapgraft.run(paths, other / "config.yaml").events, frames(mission, paths), NAME)
    assert outcome.tells_the_story and len(outcome.standing) == 8, describe(outcome)
    assert all(robots == ("alpha", "charlie") for robots in outcome.found.values()), describe(outcome)

"""Real recordings: every scan where its mapper had it, clocks that disagree, damaged files, all containers together."""

from __future__ import annotations

import gzip
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from mapgraft.contracts import RecordingError, Scan, Transform
from mapgraft.plugins import load_plugins

WINDOWS = {"a": (0.0, 676.0), "b": (676.0, 1200.0), "c": (1200.0, None)}


def flaser(path):
    """(stamp in seconds, corrected pose) of every FLASER line, read independently."""
    with gzip.open(path, "rt") as lines:
        for line in lines:
            words = line.split()
            if words and words[0] == "FLASER":
                n = 2 + int(words[1])
                yield float(words[n + 6]), tuple(map(float, words[n : n + 3]))


def test_intel_in_three_windows_with_the_truth_between_them(shared_data, mission):
    log = shared_data / "carmen/intel-corrected.log.gz"
    cut = {n: {"source": "intel-corrected", "window": {"start_s": s, "end_s": e}} for n, (s, e) in WINDOWS.items()}
    found = mission(log, cut)
    seen = list(found.observations())
    truth = {round(t * 1e6): Transform.planar(*pose) for t, pose in flaser(log)}
    assert len(seen) == 910
    counts = dict.fromkeys(WINDOWS, 0)
    for one in seen:
        counts[one.robot] += 1
        recorded = truth[round(one.recorded_ns / 1e3)]
        assert np.allclose((found.T_world_map[one.robot] @ one.T_map_sensor).matrix, recorded.matrix, atol=1e-6)
    assert counts == {"a": 188, "b": 195, "c": 527}
    assert {one.robot: one.stamp_ns for one in reversed(seen)} == dict.fromkeys(WINDOWS, found.start_ns)
    assert {robot.drift for robot in found.robots} == {"corrected"}


def test_a_log_without_time_goes_by_its_order(shared_data, mission):
    found = mission(shared_data / "carmen/belgioioso-corrected.log.gz")
    seen = list(found.observations())
    assert len(seen) == 395
    assert all(abs(b.stamp_ns - a.stamp_ns - 10**9) <= 100_000 for a, b in pairwise(seen))


def share_on_walls(observations, grid, T_map_origin, near_m=0.11) -> float:
    """The share of scan end points inside a map that lie near an occupied cell."""
    free = grid.cells < 60
    away_m = distance_transform_edt(free) * grid.resolution_m
    near = total = 0
    for one in observations:
        rays = one.payload.rays(one.T_map_sensor)
        cells = np.floor(T_map_origin.inverse().apply(rays.ends_m[rays.hits]) / grid.resolution_m).astype(int)
        inside = ((cells >= 0) & (cells < free.shape[::-1])).all(axis=1)
        near += int((away_m[cells[inside, 1], cells[inside, 0]] <= near_m).sum())
        total += int(inside.sum())
    return near / total


def last_map(mission, path):
    name = path.stem
    return list(mission(path, {name: {"maps": ["/map"]}}).observations())[-1].payload


@pytest.mark.parametrize("k", [1, 2, 3])
def test_simulated_robots_see_the_walls_of_their_mappers_map(shared_data, mission, k):
    """map → odom is stamped by the wall's clock there, all else by the simulator's."""
    path = shared_data / f"bags/three_robots_sim/robot{k}.bag"
    found = mission(path)
    seen = list(found.observations())
    assert found.robots[0].base_frame == "base_footprint"
    assert len(seen) >= found.robots[0].count - 1
    grid = last_map(mission, path)
    assert share_on_walls(seen, grid, grid.T_map_origin) > 0.94


def test_three_bags_are_three_robots_at_the_same_time(shared_data, mission):
    found = mission([shared_data / f"bags/three_robots_sim/robot{k}.bag" for k in (3, 1, 2)])
    assert [(r.name, r.topics, r.shift_ns) for r in found.robots] == [
        (f"robot{k}", ("/base_scan",), 0) for k in (1, 2, 3)
    ]
    stamps = [(one.stamp_ns, one.robot) for one in found.observations()]
    assert stamps == sorted(stamps)
    assert not found.T_world_map  # three mappers, three frames that nobody relates


def arena(shared_data):
    return {
        f"r{k}": {
            "files": [f"arena_raw_{k}.bag"],
            "poses": {"file": str(shared_data / f"bags/arena/arena_gmapping_{k}.bag")},
        }
        for k in (1, 2)
    }


def test_scans_in_one_bag_and_slam_poses_in_another(shared_data, mission):
    raw = [shared_data / f"bags/arena/arena_raw_{k}.bag" for k in (1, 2)]
    found = mission(raw, arena(shared_data))
    seen = list(found.observations())
    assert len(seen) == 1329 + 1491
    assert found.robots[1].shift_ns / 1e9 == pytest.approx(-509.74, abs=0.01)
    assert min(one.stamp_ns for one in seen if one.robot == "r2") == found.start_ns
    for k in (1, 2):
        grid = last_map(mission, shared_data / f"bags/arena/arena_gmapping_{k}.bag")
        own = [one for one in seen if one.robot == f"r{k}"]
        assert share_on_walls(own, grid, grid.T_map_origin) > 0.95
        odometry = list(mission(raw[k - 1]).observations())
        assert share_on_walls(odometry, grid, grid.T_map_origin) < 0.6


def test_deskewed_scans_of_a_turning_robot_fit_its_mappers_map_better(shared_data, mission):
    found = mission(shared_data / "bags/arena/arena_raw_2.bag", {"r2": arena(shared_data)["r2"]})
    seen = [one for one in found.observations() if one.payload.T_sensor_beam is not None]
    turning = [one for one in seen if abs(one.payload.T_sensor_beam[-1, 2]) > 0.02]
    assert len(turning) > 300
    frozen = [
        replace(one, payload=Scan(one.payload.directions, one.payload.ranges_m, one.payload.hits)) for one in turning
    ]
    grid = last_map(mission, shared_data / "bags/arena/arena_gmapping_2.bag")
    deskewed = share_on_walls(turning, grid, grid.T_map_origin, 0.06)
    assert deskewed > share_on_walls(frozen, grid, grid.T_map_origin, 0.06) + 0.01


def test_a_turtlebot_with_both_base_frames_and_a_plan_of_its_floor(shared_data, mission):
    bag, plan = shared_data / "bags/turtlebot4/macfirst_floor_take_2", shared_data / "maps/mac_1st_floor_final.yaml"
    found = mission([bag, plan], {"plan": {"files": [plan.name], "options": {"unknown_gray": 205}}}, load_plugins())
    robots = {robot.name: robot for robot in found.robots}
    assert robots["plan"].kinds == ("grid_message",) and not robots["plan"].remarks
    turtle = robots["macfirst_floor_take_2"]
    assert (turtle.map_frame, turtle.base_frame, turtle.drift) == ("odom", "base_link", "odometry")
    seen = list(found.observations())
    assert seen[0].robot == "plan" and (seen[0].payload.cells == -1).sum() > 1_000_000
    scans = seen[1:]
    assert len(scans) == 356
    mount = scans[0].T_map_base.inverse() @ scans[0].T_map_sensor
    assert math.degrees(mount.yaw_rad) == pytest.approx(90.0, abs=0.1)
    assert mount.x_m == pytest.approx(0.004, abs=0.001)
    places = [(one.T_map_base.x_m, one.T_map_base.y_m) for one in scans]
    steps = [math.dist(a, b) for a, b in pairwise(places)]
    assert 7.0 < sum(steps) < 10.0 and max(steps) < 0.1


def test_ros_1_ros_2_and_carmen_in_one_mission(shared_data, mission):
    paths = [
        shared_data / "carmen/freiburg-101-corrected.log.gz",
        shared_data / "bags/three_robots_sim/robot1.bag",
        shared_data / "bags/turtlebot4/macfirst_floor_take_2",
    ]
    found = mission(paths)
    seen = list(found.observations())
    assert len({one.robot for one in seen}) == 3
    assert [one.stamp_ns for one in seen] == sorted(one.stamp_ns for one in seen)
    first = {one.robot: one.stamp_ns for one in reversed(seen)}
    assert max(first.values()) - min(first.values()) < 0.2e9
    recorded = list(mission(paths, start="recorded").observations())
    assert all(one.stamp_ns == one.recorded_ns for one in recorded)


def test_poses_without_scans_are_nothing_to_map(shared_data, mission):
    with pytest.raises(RecordingError, match=r"nav2_turtlebot.mcap holds poses .*/amcl_pose.*, but no scans"):
        mission(shared_data / "mcap/nav2_turtlebot.mcap")


def test_damaged_bags_say_what_is_wrong(shared_data, mission):
    with pytest.raises(RecordingError, match=r"its scans on /scan have no poses: .* name a file that does"):
        mission(shared_data / "bags/damaged/broken_index.bag")
    with pytest.raises(RecordingError, match=r"V1\.2"):
        mission(shared_data / "bags/damaged/rosrecord_v1.2.bag")


def test_what_a_broken_index_leaves_can_be_mapped_with_poses_from_elsewhere(shared_data, mission, tmp_path):
    bag = shared_data / "bags/damaged/broken_index.bag"
    anywhere = tmp_path / "still.tum"
    anywhere.write_text("1 0 0 0 0 0 0 1\n4000000000 0 0 0 0 0 0 1\n")
    found = mission(bag, {"saved": {"files": [bag.name], "poses": {"file": str(anywhere)}}})
    assert len(list(found.observations())) == 360

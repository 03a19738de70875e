"""One pass in order of time: poses that come late, early, or never; scans out of order; clocks of every kind."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import Observation, Scan
from mapgraft.recording.poses.lookup import beams_in_motion
from mapgraft.recording.poses.rigid import compose, inverse, planar, to_transform, yaw_of

EPOCH_NS = 1_700_000_000 * 10**9


def seconds(seen: Observation) -> float:
    return round((seen.stamp_ns - EPOCH_NS) / 1e9, 6)


def causes(mission) -> dict[str, int]:
    return {cause: dropped.count for topic in mission.tally for cause, dropped in topic.dropped.items()}


def path(t: float) -> tuple[float, float, float]:
    return 0.5 * t, 0.1 * t, 0.05 * t


def test_every_scan_gets_the_interpolated_pose_of_its_stamp(record, mission):
    found = mission(record().drive(6).write())
    seen = list(found.observations())
    assert len(seen) == found.robots[0].count == 30
    for one in seen:
        t = seconds(one)
        low = math.floor(t * 20) / 20
        u = (t - low) * 20
        ends = [compose(planar(1 + 0.01 * s, -2.0, 0.001 * s), planar(*path(s))) for s in (low, low + 0.05)]
        assert one.T_map_base.x_m == pytest.approx((1 - u) * ends[0][0] + u * ends[1][0], abs=1e-4)
        assert one.T_map_base.yaw_rad == pytest.approx((1 - u) * yaw_of(ends[0]) + u * yaw_of(ends[1]), abs=1e-9)
        mount = one.T_map_base.inverse() @ one.T_map_sensor
        assert (round(mount.x_m, 9), round(mount.y_m, 9), round(mount.yaw_rad, 9)) == (0.2, 0.0, 0.0)
        assert one.recorded_ns == one.stamp_ns
    assert not found.tally.sentences()


def test_static_transforms_may_come_last_in_the_file(record, mission):
    file = record().drive(4, mount=False)
    file.static("base_link", "laser", 0.3, 0.0, log_s=4.5)
    assert len(list(mission(file.write()).observations())) == 20


def test_the_mount_may_be_on_the_moving_tf(record, mission):
    file = record().drive(4, mount=False)
    for k in range(5):
        file.tf(float(k), "base_link", "laser", 0.3, 0.0)
    found = mission(file.write())
    seen = list(found.observations())
    assert len(seen) == 20  # a second between two equal poses of a mount is no gap
    assert (seen[0].T_map_base.inverse() @ seen[0].T_map_sensor).x_m == pytest.approx(0.3)


def test_poses_that_are_recorded_seconds_late_still_count(record, mission):
    file = record()
    file.static("base_link", "laser")
    for k in range(101):
        file.tf(k / 10, "odom", "base_link", k / 10)
        file.tf(k / 10, "map", "odom", log_s=k / 10 + 3.0)
        if k % 2:
            file.scan(k / 10 + 0.03)
    assert len(list(mission(file.write()).observations())) == 50


def test_scans_without_a_pose_are_counted_by_cause(record, mission):
    file = record()
    file.static("base_link", "laser")
    for k in range(101):
        t = 2.0 + k / 10
        if not 5.0 < t < 6.0:
            file.tf(t, "odom", "base_link", t)
    for k in range(28):
        file.scan(k / 2 + 0.03)
    file.scan(4.0, "/other/scan", "camera")
    found = mission(file.write(), {"run": {"scans": ["/scan", "/other/scan"]}})
    seen = list(found.observations())
    assert causes(found) == {"before_first": 4, "gap_too_long": 2, "after_last": 4, "no_link": 1}
    assert len(seen) == 18
    said = found.tally.sentences()
    assert any("4 of 28 scans on /scan were left out (before_first)" in s for s in said)
    assert any("the poses odom → base_link around it lie 1 s apart, more than poses.max_gap_s" in s for s in said)
    assert any("no transform knows the frame 'camera'" in s for s in said)
    for topic in found.tally:
        assert topic.read == topic.used + topic.outside + topic.thinned + topic.lost
    wide = mission(file.write(), {"run": {"scans": ["/scan"], "poses": {"max_gap_s": 2.0}}})
    assert len(list(wide.observations())) == 20


def test_scans_recorded_out_of_order_come_in_order(record, mission):
    file = record().drive(8, scans=False)
    for k in range(35):
        file.scan(0.1 + 0.2 * k, log_s=0.1 + 0.2 * k + (0.7 if k % 3 == 0 else 0.0))
    found = mission(file.write())
    stamps = [seconds(one) for one in found.observations()]
    assert stamps == sorted(stamps)
    assert len(stamps) == 35


def test_a_scan_from_long_ago_is_dropped_and_counted(record, mission):
    file = record().drive(8)
    file.scan(1.0, log_s=6.0)
    found = mission(file.write())
    assert len(list(found.observations())) == 40
    assert causes(found) == {"stamp_backwards": 1}


def test_robots_are_merged_by_time_and_ties_go_by_name(record, mission):
    one = record("b").drive(4).write()
    other = record("a").drive(4).write()
    found = mission([one, other])
    seen = [(seconds(s), s.robot) for s in found.observations()]
    assert seen == sorted(seen)
    assert [s for _, s in seen[:4]] == ["a", "b", "a", "b"]
    again = mission([other, one])
    assert [(seconds(s), s.robot) for s in again.observations()] == seen


def test_reading_twice_gives_the_same(record, mission):
    found = mission(record().drive(4).write())
    first = [(s.stamp_ns, s.T_map_sensor) for s in found.observations()]
    used = [topic.used for topic in found.tally]
    assert [(s.stamp_ns, s.T_map_sensor) for s in found.observations()] == first
    assert [topic.used for topic in found.tally] == used


def test_places_are_the_observations_without_their_payloads(record, mission):
    found = mission(record().drive(4).write())
    places = list(found.places())
    assert [(s.stamp_ns, s.T_map_base) for s in places] == [(s.stamp_ns, s.T_map_base) for s in found.observations()]
    assert all(s.payload is None for s in places)


@pytest.mark.parametrize(("options", "expected"), [
    ({"start_s": 1.0}, 25), ({"end_s": 1.0}, 5), ({"start_s": 1.0, "end_s": 2.0}, 5), ({"every": 4}, 8),
    ({"start_s": 1.0, "end_s": 2.0, "every": 2}, 3), ({"start_s": 99.0}, 0),
])  # fmt: skip
def test_start_end_and_every(record, mission, options, expected):
    found = mission(record().drive(6).write(), **options)
    seen = list(found.observations())
    assert len(seen) == expected
    base = found.start_ns
    low, high = options.get("start_s", -9.0), options.get("end_s", 99.0)
    assert all(low * 1e9 <= s.stamp_ns - base < high * 1e9 for s in seen)


def test_every_thins_each_lidar_by_itself_and_leaves_maps_alone(record, mission):
    file = record().drive(4)
    file.static("base_link", "rear")
    for k in range(20):
        file.scan(0.1 + 0.19 * k, "/rear_scan", "rear")
    found = mission(file.write(), every=5)
    sensors = [s.sensor for s in found.observations()]
    assert (sensors.count("laser"), sensors.count("rear")) == (4, 4)
    maps = record("maps")
    for k in range(6):
        maps.grid(float(k))
    assert len(list(mission(maps.write(), every=5).observations())) == 6


def test_a_latched_map_is_there_from_the_start_asked_for(record, mission):
    file = record("maps").drive(10, scans=False)
    file.grid(0.5)
    other = record("scans").drive(10).write()
    found = mission([file.write(), other], start_s=3.0)
    first = next(iter(found.observations()))
    assert (first.robot, first.kind) == ("maps", "grid_message")
    assert seconds(first) == pytest.approx(3.0 + 0.017, abs=1e-3)


def test_stamps_of_zero_leave_the_time_of_recording(record, mission):
    file = record()
    file.clock_s = -1_700_000_000.0
    file.static("base_link", "laser", log_s=0.0)
    for k in range(81):
        file.tf(0.0, "odom", "base_link", 0.5 * k / 20, log_s=k / 20)
    for k in range(19):
        file.scan(0.0, log_s=0.01 + k / 5)
    found = mission(file.write())
    seen = list(found.observations())
    assert found.robots[0].clock == "log"
    assert len(seen) == 19
    assert seen[5].T_map_base.x_m == pytest.approx(0.5 * 1.01, abs=1e-6)
    assert "no usable stamps" in found.robots[0].remarks[-1]


def test_without_any_time_poses_cannot_be_found(record, mission):
    from mapgraft.contracts import RecordingError

    file = record()
    file.static("base_link", "laser")
    for k in range(20):
        file.tf(1.0, "odom", "base_link", 0.5 * k)
        file.scan(1.0)
    with pytest.raises(RecordingError, match="neither stamps nor times of recording tell when its scans were taken"):
        mission(file.write())


def test_transforms_by_another_clock_count_from_their_recording(record, mission):
    file = record()
    file.static("base_link", "laser")
    for k in range(101):
        t = k / 10
        file.clock_s = 0.0
        file.tf(t, "odom", "base_link", t)
        file.clock_s = -5000.0  # the mapper's clock
        file.tf(t, "map", "odom", 0.1 * t)
    file.clock_s = 0.0
    for k in range(45):
        file.scan(0.1 + k / 5)
    found = mission(file.write())
    seen = list(found.observations())
    assert len(seen) == 45
    assert seen[10].T_map_base.x_m == pytest.approx(1.1 * 2.1, abs=1e-6)
    assert "map → odom: stamped by another clock, so the time of recording counts" in found.robots[0].remarks


def test_simulated_time_that_runs_slower_than_the_clock_on_the_wall(record, mission):
    file = record()
    file.clock_s = 100.0 - 1_700_000_000
    file.static("base_link", "laser")
    for k in range(401):
        t = k / 10
        file.tf(t, "odom", "base_link", t, log_s=3 * t)
        file.tf(t, "map", "odom", log_s=3 * t)
        if k % 5 == 0 and k < 400:
            file.scan(t + 0.03, log_s=3 * (t + 0.03))
    found = mission(file.write())
    seen = list(found.observations())
    assert len(seen) == 80
    assert seen[0].stamp_ns == pytest.approx(100.03e9, abs=1e4)
    part = mission(file.write(), start_s=20.0, end_s=30.0)
    assert len(list(part.observations())) == 20


def test_robots_of_one_file_on_different_clocks(record, mission):
    file = record()
    file.drive(6, prefix="a/", ns="/a")
    file.clock_s = 5000.0
    file.drive(6, prefix="b/", ns="/b")
    found = mission(file.write())
    shift = {robot.name: robot.shift_ns for robot in found.robots}
    assert shift["a"] == 0
    assert shift["b"] == pytest.approx(-5000e9, abs=1e6)
    seen = list(found.observations())
    assert len(seen) == 60
    assert [s.robot for s in seen[:4]] == ["a", "b", "a", "b"]


def test_a_clock_offset_moves_one_robot(record, mission):
    paths = [record("a").drive(4).write(), record("b").drive(4).write()]
    found = mission(paths, {"b": {"clock_offset_s": 0.05}})
    first = {s.robot: s for s in reversed(list(found.observations()))}
    assert first["b"].stamp_ns - first["a"].stamp_ns == 50_000_000
    assert first["b"].recorded_ns == first["a"].recorded_ns
    assert first["b"].T_map_base == first["a"].T_map_base


# ---- lidars in motion, upside down -----------------------------------------------------------------------------------


def wall_ranges(pose, angles: np.ndarray, wall_x: float = 3.0) -> np.ndarray:
    """Ranges from sensor poses (one per beam) to the wall x = wall_x; NaN where the beam does not meet it."""
    ranges = np.full(len(angles), np.nan)
    for k, angle in enumerate(angles):
        x, _, yaw = pose(k)
        forward = math.cos(yaw + angle)
        if forward > 0.2:
            ranges[k] = (wall_x - x) / forward
    return ranges


@pytest.mark.parametrize("reverse", [False, True])
def test_a_wall_stays_straight_while_the_robot_turns_fast(record, mission, reverse):
    turn, sweep, n = 2.0, 0.1, 181
    step = sweep / (n - 1) * (-1 if reverse else 1)
    angles = np.linspace(-1.5, 1.5, n)

    def where(t):
        return 0.4 * t, 0.0, turn * t - 0.4

    file = record()
    file.static("base_link", "laser")
    for k in range(61):
        file.tf(k / 100, "odom", "base_link", *where(k / 100))
    for t in (0.15, 0.25, 0.4):
        ranges = wall_ranges(lambda k, t=t: where(t + k * step), angles)
        file.scan(t, ranges=ranges, angle_min=-1.5, angle_increment=3.0 / (n - 1), time_increment=step)
    observations = list(mission(file.write()).observations())
    assert len(observations) == 3
    for seen in observations:
        scan = seen.payload
        assert isinstance(scan, Scan) and scan.T_sensor_beam is not None
        rays = scan.rays(seen.T_map_sensor)
        assert rays.origins_m.shape == rays.ends_m.shape
        assert np.abs(rays.ends_m[:, 0] - 3.0).max() < 0.005
        frozen = Scan(scan.directions, scan.ranges_m, scan.hits).rays(seen.T_map_sensor)
        assert np.abs(frozen.ends_m[:, 0] - 3.0).max() > 0.3


def test_a_sweep_of_a_standing_robot_needs_no_beam_poses(record, mission):
    file = record().drive(4, scans=False, where=lambda t: (0.0, 0.0, 0.0), slam=False)
    for k in range(9):
        file.scan(0.1 + 0.2 * k, time_increment=0.01)
    seen = list(mission(file.write()).observations())
    assert len(seen) == 9
    assert all(s.payload.T_sensor_beam is None for s in seen)


def test_a_sweep_that_cannot_be_true_is_ignored_and_counted(record, mission):
    file = record().drive(4, scans=False)
    for k, value in enumerate((1.0, math.nan, math.inf)):
        file.scan(1.0 + k / 5, time_increment=value)
    found = mission(file.write())
    assert all(s.payload.T_sensor_beam is None for s in found.observations())
    assert "the time_increment of 3 scans on /scan cannot be true" in found.tally.sentences()[0]


def test_the_last_sweep_needs_poses_to_its_end(record, mission):
    file = record().drive(4, scans=False)
    file.scan(3.95, time_increment=0.02)
    found = mission(file.write())
    assert not list(found.observations())
    assert causes(found) == {"after_last": 1}


def test_a_lidar_that_hangs_upside_down(record, mission):
    """A wall on the robot's left is to the right of a lidar that looks at it head down."""
    file = record()
    file.static("base_link", "laser", 0.1, 0.0, 0.0, upside_down=True)
    for k in range(21):
        file.tf(k / 10, "odom", "base_link", 0.0, 0.0, 0.0)
    angles = np.linspace(-1.5, 1.5, 31)
    ranges = np.where(angles < -0.5, 2.0 / np.sin(-np.minimum(angles, -0.4)), np.nan)
    file.scan(1.0, ranges=ranges, angle_min=-1.5, angle_increment=0.1)
    (seen,) = mission(file.write()).observations()
    rays = seen.payload.rays(seen.T_map_sensor)
    assert np.allclose(rays.ends_m[:, 1], 2.0, atol=1e-5)  # to the robot's left
    assert rays.ends_m[:, 0].min() > 0.1
    assert seen.T_map_sensor.matrix[2, 2] == pytest.approx(-1.0)


@settings(deadline=None)
@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1), st.integers(2, 50))
def test_beams_in_motion_begin_at_the_stamp_and_end_at_the_last_pose(x, y, yaw, n):
    first = planar(3.0, -1.0, 0.7)
    last = compose(first, planar(x, y, yaw))
    beams = beams_in_motion(first, last, n)
    if beams is None:
        assert math.hypot(x, y) < 0.002 + 1e-9 and abs(yaw) < 0.001 + 1e-9
        return
    assert beams.shape == (n, 3)
    assert np.allclose(beams[0], 0.0)
    T = to_transform(compose(inverse(first), last))
    assert np.allclose(beams[-1], [T.x_m, T.y_m, T.yaw_rad], atol=1e-9)


# ---- memory ----------------------------------------------------------------------------------------------------------


class Counting:
    """A source that counts how far ahead of the observations it is read."""

    def __init__(self, source) -> None:
        self._source = source
        self.read = 0

    def __getattr__(self, name: str):
        return getattr(self._source, name)

    def messages(self, topics=None, start_ns=None, end_ns=None) -> Iterator:
        for message in self._source.messages(topics, start_ns, end_ns):
            if message.channel.topic == "/scan":
                self.read += 1
            yield message


def test_scans_do_not_pile_up(record):
    """However long the recording: no more scans are read ahead than a few seconds hold, poses or no poses."""
    from dataclasses import replace

    from mapgraft.config import parse_config
    from mapgraft.contracts.sources import ReadFaults
    from mapgraft.recording.robots.library import Library
    from mapgraft.recording.robots.roster import call_roll
    from mapgraft.recording.timeline.intake import Limits
    from mapgraft.recording.timeline.stream import Member, Stream
    from mapgraft.recording.timeline.tally import Tally

    file = record().drive(60, from_s=0.0)
    file.drive(180, from_s=90.0, mount=False)  # half a minute without any pose
    for k in range(150):
        file.scan(60.1 + 0.2 * k)
    library = Library(None, "ros2_humble")
    (plan,) = call_roll([file.write()], parse_config({}), library).plans
    counting = Counting(plan.glimpses[0].source)
    plan = replace(plan, glimpses=(replace(plan.glimpses[0], source=counting),))
    tally = Tally()
    stream = Stream([Member(plan, 0, 0)], library.payloads, Limits(), tally, ReadFaults())
    ahead = max(counting.read - sum(t.used + t.lost for t in tally) for _ in stream.observations())
    assert ahead <= 5 * (1 + 5 + 1)  # five scans a second, a second to reorder, five to wait
    assert counting.read == 900
    library.close()

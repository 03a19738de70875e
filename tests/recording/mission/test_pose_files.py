"""Poses from elsewhere: a second recording with a SLAM result, a trajectory in a text file, a topic of one's own."""

from __future__ import annotations

import math

import pytest

from mapgraft.contracts import ConfigError, RecordingError


def slam(record, name="slam", *, log_s=0.0, **given):
    """A recording of a mapper's tf alone; ``log_s`` is how much later it was made."""
    file = record(name)
    for k in range(121):
        t = k / 20
        file.tf(t, "map", "odom", 1.0, -2.0, 0.002 * t, log_s=t + log_s)
        for parent, child in given.get("also", ()):
            file.tf(t, parent, child, 0.5 * t, 0.0, log_s=t + log_s)
    return file.write()


def test_the_mapper_gives_map_to_odom_and_the_scans_file_the_rest(record, mission):
    scans = record("scans").drive(6, slam=False).write()
    found = mission(scans, {"scans": {"poses": {"file": str(slam(record))}}})
    (robot,) = found.robots
    assert robot.poses == "tf of slam.mcap (map → odom → base_link → laser): SLAM or localization"
    seen = list(found.observations())
    assert len(seen) == 30
    alone = list(mission(scans).observations())
    for one, raw in zip(seen, alone, strict=True):
        t = one.stamp_ns / 1e9 - 1_700_000_000
        assert one.T_map_base.yaw_rad - raw.T_map_base.yaw_rad == pytest.approx(0.002 * t, abs=1e-6)
        assert math.hypot(one.T_map_base.x_m - 1.0, one.T_map_base.y_m + 2.0) == pytest.approx(
            math.hypot(raw.T_map_base.x_m, raw.T_map_base.y_m), abs=1e-6
        )


def test_the_pose_file_may_have_been_recorded_on_another_day(record, mission):
    scans = record("scans").drive(6, slam=False).write()
    later = slam(record, log_s=86_400.0)
    found = mission(scans, {"scans": {"poses": {"file": str(later)}}})
    assert len(list(found.observations())) == 30


def test_what_the_pose_file_tells_goes_before_the_scans_files_word(record, mission):
    """Both files have odom → base_link: without that rule every scan would have two places."""
    scans = record("scans").drive(6, slam=False, where=lambda t: (99.0, 0.0, 0.0)).write()
    result = slam(record, also=[("odom", "base_link")])
    found = mission(scans, {"scans": {"poses": {"file": str(result)}}})
    seen = list(found.observations())
    assert len(seen) == 30
    assert seen[-1].T_map_base.x_m < 5.0


def test_a_mapper_that_places_the_base_itself(record, mission):
    scans = record("scans").drive(6, slam=False).write()
    file = record("slam")
    for k in range(121):
        file.tf(k / 20, "map", "base_link", 0.3 * k / 20, 0.0)
    found = mission(scans, {"scans": {"poses": {"file": str(file.write())}}})
    seen = list(found.observations())
    assert found.robots[0].map_frame == "map"
    assert len(seen) == 30
    assert seen[10].T_map_sensor.x_m == pytest.approx(0.3 * 2.017 + 0.2, abs=1e-6)


def test_poses_of_another_run_are_counted_not_guessed(record, mission):
    scans = record("scans").drive(6, slam=False).write()
    file = record("slam")
    file.clock_s = 5000.0
    for k in range(121):
        file.tf(k / 20, "map", "odom", log_s=5000.0 + k / 20)
    found = mission(scans, {"scans": {"poses": {"file": str(file.write())}}})
    assert not list(found.observations())
    assert any("30 of 30 scans on /scan were left out (before_first)" in s for s in found.tally.sentences())


def test_a_pose_file_that_says_nothing_about_this_robot_is_not_passed_over(record, mission):
    scans = record("scans").drive(6, slam=False).write()
    file = record("slam")
    for k in range(121):
        file.tf(k / 20, "other/map", "other/odom")
    with pytest.raises(RecordingError, match=r"nothing links the sensor frame laser to the frames of slam.mcap"):
        mission(scans, {"scans": {"poses": {"file": str(file.write())}}})


def trajectory(tmp_path, step_s=0.1):
    lines = ["# stamp x y z qx qy qz qw"]
    for k in range(61):
        yaw = 0.05 * k * step_s
        z, w = math.sin(yaw / 2), math.cos(yaw / 2)
        lines.append(f"{1_700_000_000 + k * step_s:.9f} {0.5 * k * step_s:.9f} 1.0 0 0 0 {z:.12f} {w:.12f}")
    path = tmp_path / "run.tum"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_trajectory_places_the_base_where_the_tree_has_one(record, mission, tmp_path):
    scans = record("scans").drive(6, slam=False).write()
    found = mission(scans, {"scans": {"poses": {"file": str(trajectory(tmp_path))}}})
    (robot,) = found.robots
    assert (robot.base_frame, robot.drift) == ("base_link", "unknown")
    seen = list(found.observations())
    assert len(seen) == 30
    assert seen[5].T_map_base.x_m == pytest.approx(0.5 * 1.017, abs=1e-6)
    assert (seen[5].T_map_base.inverse() @ seen[5].T_map_sensor).x_m == pytest.approx(0.2, abs=1e-9)


def test_a_trajectory_is_the_sensors_own_where_there_is_no_tree(record, mission, tmp_path):
    file = record("scans")
    for k in range(20):
        file.scan(0.05 + k / 5)
    found = mission(file.write(), {"scans": {"poses": {"file": str(trajectory(tmp_path))}}})
    assert found.robots[0].base_frame == "laser"
    assert any("taken to be its own" in remark for remark in found.robots[0].remarks)
    assert len(list(found.observations())) == 20


def test_a_configured_topic_goes_before_the_tree(record, mission):
    file = record().drive(6)
    for k in range(121):
        file.odometry(k / 20, "odom", "base_link", 7.0, 0.0, 0.0, "/wheels")
    found = mission(file.write(), {"run": {"poses": {"topic": "/wheels"}}})
    assert found.robots[0].poses == "/wheels (odom → base_link): raw odometry, the map will be smeared"
    assert {round(one.T_map_base.x_m, 9) for one in found.observations()} == {7.0}


def test_a_configured_map_frame_above_a_configured_topic(record, mission):
    file = record().drive(6)
    for k in range(121):
        file.odometry(k / 20, "odom", "base_link", 7.0, 0.0, 0.0, "/wheels")
    found = mission(file.write(), {"run": {"poses": {"topic": "/wheels", "map_frame": "map"}}})
    seen = list(found.observations())
    assert len(seen) == 30
    assert seen[0].T_map_base.x_m == pytest.approx(8.0, abs=1e-3)


def test_configured_frames_and_topics_that_are_not_there(record, mission, tmp_path):
    path = record().drive(2).write()
    with pytest.raises(ConfigError, match=r"no frame 'mapp' as poses.map_frame asks for: the recording has base_link"):
        mission(path, {"run": {"poses": {"map_frame": "mapp"}}})
    with pytest.raises(ConfigError, match=r"no topic of poses '/odm' in run.mcap .* there are none"):
        mission(path, {"run": {"poses": {"topic": "/odm"}}})
    with pytest.raises(RecordingError, match="does not exist"):
        mission(path, {"run": {"poses": {"file": str(tmp_path / "none.tum")}}})
    blind = record("blind")
    blind.text(0.0, "/chatter")
    with pytest.raises(ConfigError, match=r"blind.mcap holds no poses, but poses.file names it"):
        mission(path, {"run": {"poses": {"file": str(blind.write())}}})


def test_a_file_given_for_its_poses_is_no_robot(record, mission):
    scans = record("scans").drive(6, slam=False).write()
    result = record("slam")
    for k in range(121):
        result.tf(k / 20, "map", "odom")
    result.grid(1.0)
    path = result.write()
    found = mission([scans, path], {"scans": {"poses": {"file": str(path)}}})
    assert [robot.name for robot in found.robots] == ["scans"]
    both = mission([scans, path], {"scans": {"poses": {"file": str(path)}}, "plan": {"files": ["slam.mcap"]}})
    assert [robot.name for robot in both.robots] == ["plan", "scans"]

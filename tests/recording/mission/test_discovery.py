"""Robots without configuration: whose scans these are, where their poses come from, and what is said about it."""

from __future__ import annotations

import pytest

from mapgraft.contracts import RecordingError


def named(mission):
    return {robot.name: robot for robot in mission.robots}


def test_one_robot_takes_the_name_of_its_file(record, mission):
    robot = mission(record("kitchen").drive(2).write()).robots[0]
    assert (robot.name, robot.topics, robot.kinds) == ("kitchen", ("/scan",), ("scan",))
    assert (robot.map_frame, robot.base_frame, robot.drift) == ("map", "base_link", "slam")
    assert robot.poses == "tf (map → odom → base_link → laser): SLAM or localization"


def test_namespaced_topics_and_prefixed_frames_in_one_tree(record, mission):
    file = record()
    for k in (1, 2):
        file.drive(2, prefix=f"robot_{k}/", ns=f"/robot_{k}")
        file.static("world", f"robot_{k}/map", 3.0 * k, 0.0, 0.1)
    found = mission(file.write())
    assert sorted(named(found)) == ["robot_1", "robot_2"]
    assert named(found)["robot_2"].map_frame == "robot_2/map"
    assert {name: round(T.x_m, 6) for name, T in found.T_world_map.items()} == {"robot_1": 3.0, "robot_2": 6.0}
    assert found.tally.sentences() == []
    assert len(list(found.observations())) == 20


def test_robots_localized_in_one_map_share_its_frame(record, mission):
    file = record()
    for k in (1, 2):
        file.static("map", f"r{k}/map", 0.0, 0.0)
        file.drive(2, prefix=f"r{k}/", ns=f"/r{k}")
    found = mission(file.write())
    assert {name: T.x_m for name, T in found.T_world_map.items()} == {"r1": 0.0, "r2": 0.0}


def test_bare_frames_on_namespaced_tf_topics(record, mission):
    file = record()
    for k in (1, 2):
        file.drive(2, ns=f"/tb{k}", tf=f"/tb{k}/tf", where=lambda t, k=k: (k * t, 0.0, 0.0))
    found = mission(file.write())
    assert sorted(named(found)) == ["tb1", "tb2"]
    assert named(found)["tb1"].base_frame == "base_link"
    last = {seen.robot: seen.T_map_base.x_m for seen in found.observations()}
    assert last["tb2"] - last["tb1"] == pytest.approx(1.817, abs=1e-5)
    assert not found.T_world_map


def test_bare_frames_get_the_namespace_where_the_rest_speaks_of_it(record, mission):
    file = record()
    for k in (1, 2):
        file.drive(2, ns=f"/tb{k}", tf=f"/tb{k}/tf")
        file.static("world", f"tb{k}/map", float(k))
    found = mission(file.write())
    assert named(found)["tb1"].map_frame == "tb1/map"
    assert {name: T.x_m for name, T in found.T_world_map.items()} == {"tb1": 1.0, "tb2": 2.0}


def test_a_configured_prefix_goes_before_bare_frames(record, mission):
    path = record().drive(2, ns="/tb1", tf="/tb1/tf").write()
    robot = mission(path, {"tb1": {"poses": {"prefix": "left_"}}}).robots[0]
    assert robot.map_frame == "left_map"


def test_prefixed_frames_name_robots_without_namespaces(record, mission):
    file = record()
    for name in ("anna", "ben"):
        file.drive(2, prefix=f"{name}/", ns=f"/{name}_laser")  # /anna_laser/scan: says which sensor, not whose
    assert sorted(named(mission(file.write()))) == ["anna", "ben"]


def test_two_lidars_on_one_base_are_one_robot(record, mission):
    file = record("twin").drive(2)
    file.static("base_link", "rear_laser", -0.3, 0.0, 3.14159)
    for k in range(8):
        file.scan(0.1 + 0.2 * k, "/rear/scan", "rear_laser")
    found = mission(file.write())
    (robot,) = found.robots
    assert (robot.name, robot.topics) == ("twin", ("/rear/scan", "/scan"))
    seen = list(found.observations())
    assert {one.sensor for one in seen} == {"laser", "rear_laser"}
    assert [one.stamp_ns for one in seen] == sorted(one.stamp_ns for one in seen)


def test_two_topics_of_one_sensor_count_once(record, mission):
    file = record().drive(2)
    for k in range(5):
        file.scan(0.1 + 0.2 * k, "/scan_filtered", "laser")
    (robot,) = mission(file.write()).robots
    assert robot.topics == ("/scan",)
    assert "/scan_filtered is of the same sensor 'laser' as /scan" in robot.remarks


def test_equal_names_in_several_files_are_sessions(record, mission):
    paths = [record(day).drive(2, prefix="r/", ns="/r").write() for day in ("monday", "tuesday")]
    assert sorted(named(mission(paths))) == ["r@monday", "r@tuesday"]


def test_equal_stems_are_told_apart_by_their_folders(record, mission, tmp_path):
    paths = []
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        written = record("run").drive(2).write()
        paths.append(written.rename(tmp_path / folder / "run.mcap"))
    assert sorted(named(mission(paths))) == ["a_run", "b_run"]


def test_raw_odometry_is_said_to_be_raw(record, mission):
    (robot,) = mission(record().drive(2, slam=False).write()).robots
    assert (robot.map_frame, robot.drift) == ("odom", "odometry")
    assert "raw odometry, the map will be smeared" in robot.poses


def test_a_map_frame_that_never_moves_is_odometry_in_disguise(record, mission):
    file = record().drive(2, slam=False)
    file.static("map", "odom")
    (robot,) = mission(file.write()).robots
    assert (robot.map_frame, robot.drift) == ("map", "odometry")


def test_both_base_frames_below_odom(record, mission):
    file = record().drive(2, slam=False)
    for k in range(41):
        file.tf(k / 20, "odom", "base_footprint", 0.025 * k, 0.0)
    found = mission(file.write())
    assert found.robots[0].base_frame == "base_link"
    assert len(list(found.observations())) == 10


def test_a_tree_that_hangs_on_the_robots_body(record, mission):
    file = record()
    file.static("body", "laser", 0.2, 0.0)
    for k in range(41):
        file.tf(k / 20, "body", "odom", -0.05 * k, 0.0)
        if k % 4 == 0 and k < 40:
            file.scan(k / 20 + 0.01)
    found = mission(file.write())
    assert (found.robots[0].map_frame, found.robots[0].base_frame) == ("odom", "body")
    last = list(found.observations())[-1]
    assert last.T_map_base.x_m == pytest.approx(0.05 * 36.2, abs=1e-6)
    assert last.T_map_sensor.x_m == pytest.approx(0.05 * 36.2 + 0.2, abs=1e-6)


def test_motion_capture_without_odometry(record, mission):
    file = record()
    file.static("base_link", "laser", 0.2, 0.0)
    for k in range(41):
        file.tf(k / 20, "world", "base_link", 0.05 * k, 0.0)
    for k in range(9):
        file.scan(k / 5 + 0.03)
    (robot,) = mission(file.write()).robots
    assert (robot.map_frame, robot.base_frame, robot.drift) == ("world", "base_link", "slam")


def test_a_topic_of_poses_where_there_is_no_tree(record, mission):
    file = record()
    for k in range(41):
        file.pose(k / 20, "map", 0.05 * k, 0.0, 0.0, "/slam_pose")
        file.pose(k / 20, "map", 9.0, 9.0, 0.0, "/goal_pose")
    for k in range(9):
        file.scan(k / 5 + 0.03)
    found = mission(file.write())
    (robot,) = found.robots
    assert robot.poses == "/slam_pose (map → laser): SLAM or localization"
    assert "nothing tells where 'laser' is mounted: the poses of /slam_pose are taken to be its own" in robot.remarks
    assert next(iter(found.observations())).T_map_sensor.x_m == pytest.approx(0.03)


def test_odometry_of_a_body_of_which_the_mount_is_unknown_is_of_no_use(record, mission):
    file = record()
    for k in range(41):
        file.odometry(k / 20, "odom", "base_link", 0.05 * k, 0.0, 0.0)
    for k in range(9):
        file.scan(k / 5 + 0.03)
    path = file.write()
    with pytest.raises(RecordingError, match="nothing tells where the sensor 'laser' sits on 'base_link'"):
        mission(path)
    found = mission(path, {"run": {"poses": {"topic": "/odom", "base_frame": "laser"}}})
    assert len(list(found.observations())) == 9


def test_odometry_with_a_mount_in_the_tree(record, mission):
    file = record()
    file.static("base_link", "laser", 0.2, 0.0)
    for k in range(41):
        file.odometry(k / 20, "odom", "base_link", 0.05 * k, 0.0, 0.0)
    for k in range(9):
        file.scan(k / 5 + 0.03)
    found = mission(file.write())
    assert found.robots[0].poses == "/odom (odom → base_link): raw odometry, the map will be smeared"
    assert next(iter(found.observations())).T_map_sensor.x_m == pytest.approx(0.23)


def test_scans_go_before_maps_and_maps_before_nothing(record, mission):
    file = record("both").drive(2)
    file.grid(0.5)
    (robot,) = mission(file.write()).robots
    assert robot.kinds == ("scan",)
    assert "/map is not used, because the robot is mapped from its scans" in robot.remarks

    lost = record("lost")
    lost.scan(0.1)
    lost.grid(0.5)
    lost.grid(1.5)
    found = mission(lost.write())
    (robot,) = found.robots
    assert (robot.kinds, robot.topics) == (("grid_message",), ("/map",))
    assert any("because its scans have no poses" in remark for remark in robot.remarks)
    assert [one.kind for one in found.observations()] == ["grid_message"] * 2


def test_maps_of_two_robots_and_one_of_nobody(record, mission):
    file = record()
    for k in (1, 2):
        file.drive(2, prefix=f"r{k}/", ns=f"/r{k}", scans=False)
        file.grid(0.5, f"/r{k}/map", f"r{k}/map")
        file.grid(0.5, f"/r{k}/global_costmap/costmap", f"r{k}/map")
    found = mission(file.write())
    assert {name: robot.topics for name, robot in named(found).items()} == {"r1": ("/r1/map",), "r2": ("/r2/map",)}
    seen = list(found.observations())
    assert all(one.T_map_sensor.x_m == 0.0 and one.T_map_base.x_m > 1.0 for one in seen)


def test_nothing_to_map_says_what_there_is(record, mission):
    file = record("empty").drive(2, scans=False)
    file.text(0.5, "/chatter")
    with pytest.raises(RecordingError, match=r"empty.mcap holds poses \(/tf_static, /tf\), /chatter .*but no scans"):
        mission(file.write())


def test_scans_that_no_tree_reaches_are_named(record, mission):
    path = record("bad").drive(2, mount=False).write()
    with pytest.raises(RecordingError, match="no transform knows the sensor frame 'laser'"):
        mission(path)


def test_robots_with_names_that_are_long_and_alike_are_told_apart(record, mission):
    file = record()
    for k in range(4):
        file.drive(1, prefix=f"r{k}/", ns=f"/fleet{k // 2}/{'x' * 120}{k % 2}", where=lambda t, k=k: (t, k, 0.0))
    names = sorted(named(mission(file.write())))
    assert len(set(names)) == 4 and all(len(name) <= 100 for name in names)


def test_topics_without_end_are_refused_before_anybody_looks_at_them(record, mission):
    file = record()
    for k in range(41):
        file.scan(1.0, f"/r{k}/scan", f"laser{k}")
    with pytest.raises(RecordingError, match=r"has 41 topics of scans, maps and poses, more than 20 for each of 2"):
        mission(file.write(), limits={"robots": 2})


def test_more_robots_than_the_limits_are_refused_and_those_that_count_are_named_once(record, mission):
    file = record()
    for k in range(3):
        file.drive(1, prefix=f"r{k}/", ns=f"/r{k}")
    path = file.write()
    with pytest.raises(RecordingError, match=r"shows 3 robots, .* raise limits.robots \(2\)"):
        mission(path, limits={"robots": 2})
    renamed = {"anna": {"source": "r0"}}
    assert sorted(named(mission(path, renamed, limits={"robots": 3}))) == ["anna", "r1", "r2"]


def test_a_link_to_itself_is_no_file(tmp_path, mission):
    loop = tmp_path / "loop.mcap"
    loop.symlink_to(loop)
    with pytest.raises(RecordingError, match=r"loop\.mcap"):
        mission(loop)

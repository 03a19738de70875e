"""What ``info`` tells: topics and who reads them, lost scans, shifts, and how far odometry drifts."""

from __future__ import annotations

import dataclasses
import json
import math

import pytest

from mapgraft.cli import invoke
from mapgraft.config import parse_config
from mapgraft.contracts import RecordingError
from mapgraft.plugins import load_plugins
from mapgraft.recording.poses.rigid import compose, inverse, planar
from mapgraft.recording.smear import Track, disagreement
from mapgraft.recording.survey import Survey, survey


def look(paths, robots=None, **options) -> Survey:
    config = parse_config({"robots": robots or {}, "mission": options})
    found = survey(paths, config, plugins=load_plugins())
    json.dumps(dataclasses.asdict(found))  # plain values throughout
    return found


def test_a_survey_tells_what_is_read_and_by_whom(record):
    file = record("run").drive(4)
    file.text(1.0, "/chatter")
    found = look([file.write()])
    (one,) = found.files
    assert (one.container, round(one.duration_s)) == ("mcap", 4)
    assert one.size_bytes > 1000
    topics = {topic.topic: (topic.count, topic.used_by) for topic in one.topics}
    assert topics == {
        "/chatter": (1, ()),
        "/scan": (20, ("run",)),
        "/tf": (162, ("run",)),
        "/tf_static": (1, ("run",)),
    }
    (robot,) = found.robots
    assert (robot.read, robot.placed) == (20, 20)
    assert robot.path_m == pytest.approx(math.hypot(0.5, 0.1) * 3.8, rel=0.05)
    assert not found.problems


def test_lost_scans_robots_and_shifts_are_told(record):
    blind = record("blind")
    blind.scan(0.1)
    late = record("late").drive(4)
    late.scan(9.0)
    other = record("other").drive(104, from_s=100.0)
    found = look([blind.write(), late.write(), other.write()])
    assert [robot.source.name for robot in found.robots] == ["late", "other"]
    assert any(p.startswith("robot blind cannot be mapped: its scans on /scan have no poses") for p in found.problems)
    assert any("1 of 21 scans on /scan was left out (after_last)" in p for p in found.problems)
    assert any(r.startswith("other: its stamps are shifted by -100.000 s") for r in found.remarks)


def test_raw_odometry_alone_cannot_be_measured(record):
    found = look([record().drive(4, slam=False).write()])
    assert found.robots[0].odometry is None
    assert found.robots[0].smear.startswith("raw odometry: its error grows with the path")
    assert "nothing to measure it against" in found.robots[0].smear


def test_drift_is_measured_against_slam(record):
    """map → odom turns by 2 degrees per 10 m of path and nothing else: that is what the survey must find."""
    rate = math.radians(2.0) / 10.0
    file = record()
    file.static("base_link", "laser")
    for k in range(1201):
        t = k / 20
        file.tf(t, "odom", "base_link", t, 0.0, 0.0)
        corrected = planar(t, 0.0, rate * t)
        x, y, _, _, _, z, w = compose(corrected, inverse(planar(t, 0.0, 0.0)))
        file.tf(t, "map", "odom", x, y, 2 * math.atan2(z, w))
        if k % 5 == 0:
            file.scan(t)
    measured = look([file.write()]).robots[0].odometry
    assert measured is not None
    assert measured.segments >= 10
    assert measured.median_deg == pytest.approx(2.0, rel=0.02)


def test_disagreement_is_per_ten_metres_of_path():
    stamps = list(range(301))
    true = [planar(0.1 * k, 0.0, 0.0) for k in stamps]
    long = [planar(0.103 * k, 0.0, 0.0) for k in stamps]  # odometry that says 3 % too much
    found = disagreement(Track(stamps, true), Track(stamps, long))
    assert found.median_m == pytest.approx(0.3, rel=0.02)
    assert found.worst_m == pytest.approx(0.3, rel=0.02)
    assert found.median_deg == pytest.approx(0.0, abs=1e-9)
    assert disagreement(Track(stamps[:50], true[:50]), Track(stamps[:50], long[:50])) is None
    assert disagreement(Track(stamps, true), Track([s + 1000 for s in stamps], long)) is None


def test_intel_tells_how_far_its_odometry_drifts(shared_data):
    found = look([shared_data / "carmen/intel-corrected.log.gz"])
    (robot,) = found.robots
    assert robot.path_m == pytest.approx(500.0, rel=0.02)
    assert 0.2 < robot.odometry.median_m < 0.6
    assert "corrected poses" in robot.smear
    assert any("out of order" in problem for problem in found.problems)


def test_arena_tells_the_drift_of_both_robots(shared_data):
    robots = {
        f"r{k}": {
            "files": [f"arena_raw_{k}.bag"],
            "poses": {"file": str(shared_data / f"bags/arena/arena_gmapping_{k}.bag")},
        }
        for k in (1, 2)
    }
    found = look([shared_data / f"bags/arena/arena_raw_{k}.bag" for k in (1, 2)], robots)
    assert {file.path.rsplit("/", 1)[-1] for file in found.files} == {
        f"arena_{kind}_{k}.bag" for kind in ("raw", "gmapping") for k in (1, 2)
    }
    for robot in found.robots:
        assert robot.odometry.median_deg > 3.0
    assert sum("its stamps are shifted" in remark for remark in found.remarks) == 1


def test_a_plan_with_a_trap_in_it_is_told(shared_data):
    paths = [shared_data / "bags/turtlebot4/macfirst_floor_take_2", shared_data / "maps/mac_1st_floor_final.yaml"]
    found = look(paths)
    (plan,) = [robot.source for robot in found.robots if robot.source.kinds == ("grid_message",)]
    assert "unknown_gray: 205" in plan.remarks[0] and plan.remarks[0].endswith("(robots.mac_1st_floor_final.options)")
    smear = {robot.source.name: robot.smear for robot in found.robots}
    assert smear["mac_1st_floor_final"] == "a ready map: as sharp as it was made"


def test_poses_without_scans(shared_data):
    with pytest.raises(RecordingError, match="nothing to map"):
        look([shared_data / "mcap/nav2_turtlebot.mcap"])


def test_info_cuts_no_name_of_a_topic_or_a_type(record, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    topic = "/" + "/".join(f"a_part_of_a_name_{n}" for n in range(12))
    file = record("long").drive(1)
    file.text(0.5, topic)
    assert invoke(["info", str(file.write())]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert topic in "".join(line.split()[0] for line in lines if line.startswith("  ") and line.split()[0] != "topic")
    assert "…" not in "".join(lines).replace("FILE…", "")


def test_info_shows_the_topics_of_a_file_with_nothing_to_map(record, capsys):
    file = record("empty").drive(2, scans=False)
    file.text(0.5, "/chatter")
    path = str(file.write())
    assert invoke(["info", path]) == 1
    out, err = capsys.readouterr()
    for part in (path, "/chatter", "std_msgs/msg/String", "/tf_static", "tf2_msgs/msg/TFMessage"):
        assert part in out
    assert err.startswith("mapgraft: nothing to map: empty.mcap holds poses (/tf_static, /tf), /chatter")
    assert invoke(["info", path, "--json"]) == 1
    assert capsys.readouterr().out == ""


def test_info_counts_the_rules_and_says_who_tells_of_them(record, capsys):
    assert invoke(["info", str(record().drive(1).write())]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("  rules:")]
    assert "'mapgraft decide FILE…' says" in line and "grids of any resolution" not in line

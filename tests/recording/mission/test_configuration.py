"""What a configuration may say about robots, and the sentences that answer what cannot be."""

from __future__ import annotations

import pytest

from mapgraft.config import load_config
from mapgraft.contracts import GRID_MESSAGE, ConfigError, Descriptor, GridMessage, RecordingError, Transform
from mapgraft.plugins import Offered, Origin, Plugins


def two_robots(record):
    file = record()
    for k in (1, 2):
        file.drive(2, prefix=f"r{k}/", ns=f"/r{k}")
    return file.write()


def test_a_discovered_robot_may_be_renamed_and_the_others_stay(record, mission):
    found = mission(two_robots(record), {"anna": {"source": "r1"}})
    assert [(robot.name, robot.source) for robot in found.robots] == [("anna", "r1"), ("r2", "r2")]


def test_unknown_sources_topics_and_files_say_what_there_is(record, mission):
    path = two_robots(record)
    with pytest.raises(ConfigError, match=r"robots.a.source: there is no robot 'r3': there are r1, r2"):
        mission(path, {"a": {"source": "r3"}})
    with pytest.raises(ConfigError, match=r"robots.a: the recording shows no such robot: there are r1, r2"):
        mission(path, {"a": {}})
    with pytest.raises(ConfigError, match=r"robots.r1.scans: there is no topic '/scann': .*/r1/scan, /r2/scan"):
        mission(path, {"r1": {"scans": ["/scann"]}})
    with pytest.raises(ConfigError, match=r"robots.r1.maps: there is no topic '/map': the recording has none"):
        mission(path, {"r1": {"maps": ["/map"]}})
    with pytest.raises(ConfigError, match=r"robots.a.files: there is no file 'x.bag': the mission has run.mcap"):
        mission(path, {"a": {"files": ["x.bag"]}})
    with pytest.raises(ConfigError, match=r"robots.a may be any of r1, r2: say which with source or files"):
        mission(path, {"a": {"files": ["run.mcap"]}})


def test_a_robot_may_be_told_by_its_topics(record, mission):
    found = mission(two_robots(record), {"anna": {"scans": ["/r2/scan"]}})
    assert [(robot.name, robot.topics) for robot in found.robots] == [("anna", ("/r2/scan",)), ("r1", ("/r1/scan",))]


def test_sessions_must_be_told_apart(record, mission):
    paths = [record(day).drive(2, prefix="r/", ns="/r").write() for day in ("monday", "tuesday")]
    with pytest.raises(ConfigError, match=r"robots.r may be any of r@monday, r@tuesday"):
        mission(paths, {"r": {}})
    found = mission(paths, {"r": {"files": ["monday.mcap"]}})
    assert [robot.name for robot in found.robots] == ["r", "r@tuesday"]


def test_one_robot_in_several_files(record, mission):
    first = record("part_0").drive(4, prefix="r/", ns="/r").write()
    second = record("part_1").drive(8, prefix="r/", ns="/r", from_s=4.0, mount=False).write()
    found = mission([second, first], {"r": {"files": ["part_*.mcap"]}})
    (robot,) = found.robots
    seen = list(found.observations())
    assert robot.count == len(seen) == 40
    assert [one.stamp_ns for one in seen] == sorted(one.stamp_ns for one in seen)
    assert (robot.end_ns - robot.start_ns) / 1e9 == pytest.approx(7.8, abs=1e-6)


def test_files_may_be_named_by_the_configuration_alone(record, mission, tmp_path):
    record("kitchen").drive(2).write()
    (tmp_path / "mission.yaml").write_text("robots:\n  cook: {files: [kitchen.mcap]}\n")
    config = load_config(tmp_path / "mission.yaml")
    found = mission([], {"cook": {"files": config.robots["cook"].files}})
    assert [robot.name for robot in found.robots] == ["cook"]


def test_one_name_twice_in_a_file(tmp_path):
    (tmp_path / "mission.yaml").write_text("robots:\n  a: {}\n  a: {}\n")
    with pytest.raises(ConfigError, match=r'found duplicate key "a"'):
        load_config(tmp_path / "mission.yaml")


def test_maps_may_be_asked_for(record, mission):
    file = record().drive(2)
    file.grid(0.5)
    path = file.write()
    assert mission(path, {"run": {"maps": ["/map"]}}).robots[0].kinds == (GRID_MESSAGE,)
    assert mission(path, {"run": {"scans": []}}).robots[0].kinds == (GRID_MESSAGE,)


def test_a_configured_robot_that_cannot_be_mapped_is_an_error_another_is_a_remark(record, mission):
    blind = record("blind")
    blind.scan(0.1)
    blind.scan(0.3)
    paths = [record("good").drive(2).write(), blind.write()]
    found = mission(paths)
    assert [robot.name for robot in found.robots] == ["good"]
    assert found.unmappable[0].name == "blind"
    with pytest.raises(RecordingError, match=r"robot blind cannot be mapped: its scans on /scan have no poses"):
        mission(paths, {"blind": {}})


def test_nothing_at_all(mission, tmp_path):
    with pytest.raises(RecordingError, match="no file was given"):
        mission([])
    with pytest.raises(RecordingError, match="does not exist"):
        mission(tmp_path / "none.bag")


# ---- plugins ---------------------------------------------------------------------------------------------------------


def offering(kind, descriptor) -> Plugins:
    return Plugins({(kind, descriptor.name): Offered(kind, descriptor, Origin("test", "test", "1"))})


def length_of(message) -> int:
    """A plugin's decoder."""
    if len(message.data) < 8:
        raise ValueError("too short")
    return len(message.data)


def checkerboard(path, *, size: int = 2) -> GridMessage:
    """A plugin's format."""
    import numpy as np

    return GridMessage(np.zeros((size, size), np.int8), 0.5, Transform.identity())


@pytest.fixture
def at(monkeypatch):
    """Make a function of this file importable by name, as a plugin's factory is."""
    import sys
    import types

    module = types.ModuleType("a_plugin_of_this_test")
    module.length_of, module.checkerboard = length_of, checkerboard
    monkeypatch.setitem(sys.modules, module.__name__, module)
    return lambda function: f"{module.__name__}:{function.__name__}"


def test_a_format_makes_a_file_a_robot_without_scans(record, mission, tmp_path, at):
    (tmp_path / "board.chess").write_text("white to move")
    plugins = offering("format", Descriptor("chess", at(checkerboard), "", accepts=(".chess",), gives=GRID_MESSAGE))
    path = record("run").drive(2).write()
    found = mission([path, tmp_path / "board.chess"], plugins=plugins)
    first = next(iter(found.observations()))
    assert (first.robot, first.kind, first.stamp_ns) == ("board", GRID_MESSAGE, found.start_ns)
    assert first.payload.cells.shape == (2, 2)
    plan = mission([path, tmp_path / "board.chess"], {"plan": {"source": "board", "options": {"size": 3}}}, plugins)
    assert next(iter(plan.observations())).payload.cells.shape == (3, 3)
    with pytest.raises(ConfigError, match=r"the format 'chess' has no option sise: it has size"):
        mission([tmp_path / "board.chess"], {"board": {"options": {"sise": 3}}}, plugins)
    alone = mission([tmp_path / "board.chess"], plugins=plugins)
    assert [one.robot for one in alone.observations()] == ["board"]


def test_a_decoder_adds_a_kind_of_payload(record, mission, at):
    file = record()
    file.static("base_link", "mast")
    for k in range(41):
        file.tf(k / 20, "odom", "base_link", 0.1 * k)
        file.pose(k / 20, "mast", 0.0, 0.0, 0.0, "/tags")
    name = "geometry_msgs/msg/PoseStamped"
    plugins = offering("decoder", Descriptor("tags", at(length_of), "", accepts=(name,), gives="tag"))
    found = mission(file.write(), plugins=plugins)
    assert found.robots[0].kinds == ("tag",)
    assert not list(found.observations())
    assert "failed: AttributeError" in found.tally.sentences()[0]

"""Plugins that hang where no exchange is: ``decide`` on a recording, ``match``, and ``--verify-ledger``."""

from __future__ import annotations

import time

import cv2
import numpy as np
import pytest

from mapgraft.assembly import assemble
from mapgraft.audit import audit
from mapgraft.cli import invoke
from mapgraft.config import LimitsConfig
from mapgraft.decision import build_table
from mapgraft.guard import Guard
from mapgraft.job import as_config, demo
from mapgraft.outputs.null_sink import NullSink
from mapgraft.plugins import load_plugins
from mapgraft.recording.mission import open_mission
from mapgraft_grid.correlation import Correlation
from mapgraft_grid.map_type import OccupancyGrid


def hang(*_arguments: object, **_named: object) -> None:
    time.sleep(3600)


@pytest.fixture
def brief(tmp_path):
    """A configuration with a time limit for plugins of a second."""
    config = tmp_path / "config.yaml"
    config.write_text("limits: {plugin_s: 1}\nmission: {end_s: 3}\n")
    return str(config)


def test_a_map_type_that_hangs_is_named_by_decide(monkeypatch, capsys, brief):
    monkeypatch.setattr(OccupancyGrid, "integrate", hang)
    assert invoke(["decide", "-c", brief, *map(str, demo()[0])]) == 1
    assert "the map type 'occupancy_grid' took longer than 1 s" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("owner", "method", "said"),
    [
        (Correlation, "match", "the matcher 'correlation'"),
        (OccupancyGrid, "integrate", "the map type 'occupancy_grid'"),
    ],
)
def test_a_plugin_that_hangs_is_named_by_match(tmp_path, monkeypatch, capsys, brief, owner, method, said):
    image = np.full((60, 60), 254, np.uint8)
    image[10:50, 10:12] = image[10:12, 10:50] = 0
    plan = tmp_path / "plan.png"
    assert cv2.imwrite(str(plan), image)
    monkeypatch.setattr(owner, method, hang)
    assert invoke(["match", "-c", brief, "--resolution", "0.1", str(plan), str(plan)]) == 1
    assert f"{said} took longer than 1 s" in capsys.readouterr().err


@pytest.fixture
def audited():
    """Checks the ledgers of three robots that have observed for two seconds, by some guard."""
    files, _ = demo()
    config, plugins = as_config({"mission": {"end_s": 2}}), load_plugins()
    with open_mission(files, config, plugins=plugins) as mission:
        robots = assemble(mission, config, plugins, build_table(plugins), NullSink()).robots
        for observation in mission.observations():
            robots[observation.robot].observe(observation)
        kinds = {robot.name: robot.kinds for robot in mission.robots}
        yield lambda guard: audit(mission.observations(), kinds, robots, config, plugins, guard)


@pytest.mark.parametrize("method", ["integrate", "encode", "known_region"])
def test_a_map_type_that_hangs_while_ledgers_are_checked_is_named(monkeypatch, audited, method):
    guard = Guard(LimitsConfig(plugin_s=1))
    with guard.armed():
        assert all(one.sound for one in audited(guard))
        monkeypatch.setattr(OccupancyGrid, method, hang)
        found = audited(guard)
    assert [one.sound for one in found] == [False] * 3
    assert all("cannot be checked: the map type 'occupancy_grid' took longer than 1 s" in one.sentence for one in found)


def test_a_ledger_whose_map_type_was_set_aside_in_the_run_cannot_be_checked(audited):
    guard, said = Guard(), "the map type 'occupancy_grid' took too long and is not asked for its encode again"
    guard.set_aside["map type", "occupancy_grid", "encode"] = said
    assert [(one.sound, one.sentence) for one in audited(guard)] == [(False, f"cannot be checked: {said}")] * 3

"""Fixtures of the engine's tests: only a toy plugin is loaded, so that nothing can lean on grids."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Callable

import beacons as beacon_plugin
import pytest
from four_robots import WORLD, begun

from mapgraft.config import LimitsConfig
from mapgraft.contracts import Meeting, Observation, Situation, Transform
from mapgraft.decision import build_table
from mapgraft.guard import Guard
from mapgraft.guarded_map_type import GuardedMapType
from mapgraft.history import History, Journal
from mapgraft.job import Fan
from mapgraft.outputs.memory_sink import MemorySink
from mapgraft.persons import Hand
from mapgraft.plugins import GROUP, Origin, Plugins, load_plugin, load_plugins
from mapgraft.procedures import Workshop
from mapgraft.replay import Exchange, replay
from mapgraft.reversal import new_reversal
from mapgraft.robot import Robot

Hear = Callable[..., Observation]
SECOND = 1_000_000_000


class At:
    """A policy: everybody meets at these stamps."""

    def __init__(self, *stamps_s: float) -> None:
        self.stamps_ns = [round(s * SECOND) for s in stamps_s]

    def due(self, situation: Situation) -> list[Meeting]:
        return [Meeting(ns) for ns in self.stamps_ns if situation.previous_ns < ns <= situation.now_ns]


@pytest.fixture
def plugins() -> Plugins:
    """The beacon plugin and nothing else."""
    loaded = load_plugins(without=[entry_point.name for entry_point in importlib.metadata.entry_points(group=GROUP)])
    load_plugin(loaded, beacon_plugin, Origin("beacons", "beacon-plugin", "1.0"))
    return loaded


@pytest.fixture
def hear() -> Hear:
    """Makes an observation: a robot hears beacons at whole metres of its own line."""

    def make(robot: str, *at: int, stamp_ns: int = 0) -> Observation:
        T = Transform.planar(float(max(at, default=0)), 0.0, 0.0)
        return Observation(robot, stamp_ns, stamp_ns, "ear", "heard", tuple(at), Transform.identity(), T)

    return make


@pytest.fixture
def play(plugins, hear):
    """Replays tuples (second, robot, places…), with plugins in their time, and gives back the memory and the robots."""

    def run(
        *observations,
        meet=(),
        reversal="ledger",
        hand=None,
        rules=None,
        spacing_m=1.0,
        limits=None,
        guard=None,
        sinks=(),
        through="confirmed",
        **how,
    ):
        memory = MemorySink()
        workshop = Workshop(plugins, guard=guard or Guard(limits or LimitsConfig()))
        fan = Fan([memory, *sinks])
        history, table = History(fan), build_table(plugins, rules)
        stream = [hear(robot, *at, stamp_ns=second * SECOND) for second, robot, *at in observations]
        with workshop.guard.armed():
            robots = {}
            for name in sorted({robot for _, robot, *_ in observations}):
                map_type = GuardedMapType(beacon_plugin.Beacons(spacing_m=spacing_m), workshop.guard)
                kept = new_reversal(reversal, map_type)
                journal = Journal(history, name, map_type, kept)
                robots[name] = Robot(name, map_type, kept, table, workshop, hand or Hand(), journal, through=through)
            exchange = Exchange(At(*meet), robots, **how)
            assert replay(stream, robots, exchange, fan) == len(stream)
        return memory, robots, exchange

    return run


@pytest.fixture
def apart(play) -> Callable[..., tuple]:
    """Robots that have observed and not met; returns the memory and the robots."""

    def make(*names: str, **options) -> tuple:
        memory, robots, _ = play(*begun(*(names or WORLD)), **options)
        memory.events.clear()
        return memory, robots

    return make

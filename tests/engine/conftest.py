"""Fixtures of the engine's tests: only a toy plugin is loaded, so that nothing can lean on grids."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Callable

import beacons as beacon_plugin
import pytest

from mapgraft.contracts import Observation, Transform
from mapgraft.plugins import GROUP, Origin, Plugins, load_plugin, load_plugins

Hear = Callable[..., Observation]


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
        return Observation(robot, stamp_ns, stamp_ns, "ear", "heard", tuple(at), T, T)

    return make

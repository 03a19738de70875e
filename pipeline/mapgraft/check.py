"""Whether a configuration fits a mission, found out without mapping anything, and what it comes to."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mapgraft.assembly import assemble
from mapgraft.config import Config
from mapgraft.decision import build_table
from mapgraft.plugins import Plugins
from mapgraft.robot import Robot


def check(paths: Sequence[Path], config: Config, plugins: Plugins) -> dict[str, Any]:
    """What a run would use: each robot's map and reversal, the exchange, the rules in order.

    Raises whatever a run would raise before its first observation.
    """
    from mapgraft.outputs.null_sink import NullSink
    from mapgraft.recording.mission import open_mission

    with open_mission(paths, config, plugins=plugins) as mission:
        table = build_table(plugins, config.rules)
        robots = assemble(mission, config, plugins, table, NullSink()).robots
    return {
        "robots": {name: {"map": _map_of(robot), "reversal": robot.reversal.name} for name, robot in robots.items()},
        "exchange": {"use": config.exchange.use, **config.exchange.parameters},
        "rules": [record.rule.name for record in table.records],
    }


def _map_of(robot: Robot) -> str:
    metadata = robot.map_type.metadata(robot.reversal.offered_layer())
    return metadata.type if metadata.resolution_m is None else f"{metadata.type} at {metadata.resolution_m:g} m"

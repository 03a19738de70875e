"""Real missions, each run once for all tests that look at it."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

import mapgraft
from mapgraft.config import parse_config
from mapgraft.contracts import Transform
from mapgraft.recording.mission import open_mission
from mapgraft.recording.writing import convert

INTEL_WINDOWS = {"first": (0.0, 676.0, 0.07), "second": (676.0, 1200.0, 0.10), "third": (1200.0, None, 0.07)}


@pytest.fixture(scope="session")
def intel_config() -> Callable[..., dict[str, Any]]:
    """The Intel log cut into three robots, each with a map frame of its own that starts at its first pose."""

    def make(**more: Any) -> dict[str, Any]:
        robots = {
            name: {"source": "intel-corrected", "window": {"start_s": start, "end_s": end}, "map": {"resolution_m": r}}
            for name, (start, end, r) in INTEL_WINDOWS.items()
        }
        return {"robots": robots, "exchange": {"use": "every", "seconds": 120}, **more}

    return make


@pytest.fixture(scope="session")
def intel_mcap(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Intel log as MCAP."""
    path = tmp_path_factory.mktemp("intel") / "intel-corrected.mcap"
    convert([shared_data / "carmen" / "intel-corrected.log.gz"], path)
    return path


@pytest.fixture(scope="session")
def intel(intel_mcap: Path, intel_config, tmp_path_factory: pytest.TempPathFactory) -> mapgraft.Result:
    return mapgraft.run([intel_mcap], intel_config(), tmp_path_factory.mktemp("intel") / "out")


@pytest.fixture(scope="session")
def intel_truth(intel_mcap: Path, intel_config) -> Mapping[str, Transform]:
    """Where the log itself places every robot's map frame."""
    with open_mission([intel_mcap], parse_config(intel_config())) as mission:
        return dict(mission.T_world_map)


@pytest.fixture(scope="session")
def pair_truth(shared_data: Path) -> Callable[[str, str], Transform]:
    """The published transform between two maps of ``grid_pairs``, by their names: from b's map frame to a's."""
    pairs = {pair["id"]: pair for pair in json.loads((shared_data / "maps/grid_pairs/pairs.json").read_text())}

    def find(a: str, b: str) -> Transform:
        T = pairs[f"m_{a}__m_{b}"]["T_m_b2a"]
        return Transform.planar(T["x"], T["y"], math.radians(T["yaw_deg"]))

    return find

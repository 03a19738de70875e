"""One small run of the demo whose robots lie as is known, told once; and a folder of examples that nobody ran."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from toy_examples import write_toys

import mapgraft
from mapgraft.contracts import Transform
from mapgraft.examples import ExampleFolder
from mapgraft_recordings import demo_files


class Ran(NamedTuple):
    """A run, its folder, the configuration, and where the robots' map frames really lie."""

    result: mapgraft.Result
    out: Path
    config: Mapping[str, Any]
    T_world_map: Mapping[str, Transform]

    @property
    def folder(self) -> ExampleFolder:
        return ExampleFolder(self.out)

    def rows(self) -> dict[str, dict[str, Any]]:
        """All columns but pictures and classes, by example id."""
        folder = self.folder
        return {key.example_id: folder.row(key) for key in folder.keys}


def true_pose(T_world_map: Mapping[str, Transform], receiver: str, donor: str) -> dict[str, Any]:
    """An entry of ``examples.truth``."""
    T = T_world_map[receiver].inverse() @ T_world_map[donor]
    return {"receiver": receiver, "donor": donor, "x_m": T.x_m, "y_m": T.y_m, "yaw_rad": T.yaw_rad}


@pytest.fixture(scope="session")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Ran:
    """The demo's first minute and a half in coarse cells: two wrong merges are reverted, right ones stand at the end.

    Of alpha and bravo, and of charlie and alpha, the truth is told.
    """
    files, _, expected = demo_files()
    poses = json.loads(Path(expected).read_text())["T_world_map"]
    T_world_map = {name: Transform.planar(*pose) for name, pose in poses.items()}
    config = {
        "mission": {"end_s": 95},
        "map": {"type": "occupancy_grid", "resolution_m": 0.2},
        "output": {"report": False, "snapshots": False},
        "examples": {
            "environments": {"alpha": "demo"},
            "truth": [true_pose(T_world_map, "alpha", "bravo"), true_pose(T_world_map, "charlie", "alpha")],
        },
    }
    out = tmp_path_factory.mktemp("ran") / "out"
    return Ran(mapgraft.run(files, config, out), out, config, T_world_map)


@pytest.fixture(scope="session")
def toys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with 150 examples of five environments; tests must not change it."""
    folder = tmp_path_factory.mktemp("toys")
    write_toys(folder, 150)
    return folder

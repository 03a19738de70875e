"""Ready-made grids from OccupancyGrid messages."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mapgraft.errors import RecordingError
from mapgraft.recording.containers.opening import open_source
from mapgraft.recording.decoding.grids import grid_payload


def grid(width: int = 3, height: int = 2, data: Any = None, resolution: float = 0.05, **turn: float) -> Any:
    cells = np.arange(width * height, dtype=np.int8) if data is None else np.array(data, np.int8)
    orientation = SimpleNamespace(**({"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0} | turn))
    origin = SimpleNamespace(position=SimpleNamespace(x=-1.0, y=2.0, z=0.0), orientation=orientation)
    info = SimpleNamespace(width=width, height=height, resolution=resolution, origin=origin)
    return SimpleNamespace(info=info, data=cells)


def test_cells_resolution_and_origin() -> None:
    payload = grid_payload(grid(data=[-1, 0, 100, 50, -128, 127], z=math.sqrt(0.5), w=math.sqrt(0.5)))
    assert payload.cells.tolist() == [[-1, 0, 100], [50, -1, 100]]
    assert payload.cells.dtype == np.int8
    assert payload.resolution_m == 0.05
    origin = payload.T_map_origin
    assert (origin.x_m, origin.y_m, origin.yaw_rad) == pytest.approx((-1.0, 2.0, math.pi / 2))


@pytest.mark.parametrize(
    ("message", "sentence"),
    [
        (grid(0, 0), "is empty"),
        (grid(3, 0), "is empty"),
        (grid(-3, -2, data=range(6)), "is empty"),
        (grid(data=range(5)), "must hold 6 values, found 5"),
        (grid(2**31, 2**31, data=[]), "must hold 4611686018427387904 values, found 0"),
        (grid(resolution=0.0), "resolution must be positive, found 0.0"),
        (grid(resolution=math.nan), "resolution must be positive"),
        (grid(w=0.0), "origin is not usable"),
        (grid(w=math.nan), "origin is not usable"),
        (SimpleNamespace(), "does not have the fields of its type"),
        (SimpleNamespace(info=SimpleNamespace(width=None)), "does not have the fields of its type"),
        (SimpleNamespace(info=grid().info, data=[[0] * 3] * 6), "whole numbers in a row"),
        (SimpleNamespace(info=grid().info, data=[0.5] * 6), "whole numbers in a row"),
        (SimpleNamespace(info=grid().info, data="abcdef"), "does not have the fields"),
    ],
)
def test_grids_that_cannot_be_used(message: Any, sentence: str) -> None:
    with pytest.raises(RecordingError, match=sentence):
        grid_payload(message)


def test_real_grids(shared_data: Path) -> None:
    source = open_source(shared_data / "bags" / "three_robots_sim" / "robot1.bag")
    payloads = [grid_payload(source.decode(message)) for message in source.messages(["/map"])]
    assert len(payloads) == 9
    assert all(payload.resolution_m > 0 and (payload.cells == 100).any() for payload in payloads)

"""The correlation matcher on real maps: pairs whose transform is known, and 30 scans of a recorded building."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from mapgraft.contracts import Observation, Transform
from mapgraft_grid.correlation import Correlation
from mapgraft_grid.grid_map import OCCUPIED, GridMap
from mapgraft_grid.map_type import OccupancyGrid

MakeMap = Callable[..., GridMap]


def walls_of(map_: GridMap) -> NDArray[np.float64]:
    dense = map_.dense()
    rows, columns = np.nonzero(dense.classes == OCCUPIED)
    return np.stack((columns + 0.5, rows + 0.5), axis=1) * dense.resolution_m + np.array(dense.origin_m)


def off_by(found: Transform, truth: Transform, spots: NDArray[np.float64]) -> tuple[float, float]:
    """Mean displacement of the spots in metres, and the turn between both in degrees."""
    turn = math.remainder(found.yaw_rad - truth.yaw_rad, 2 * math.pi)
    return float(np.hypot(*(found.apply(spots) - truth.apply(spots)).T).mean()), abs(math.degrees(turn))


def test_real_pairs_are_right(shared_data: Path, grid_map_of: MakeMap) -> None:
    """Within 0.5 m and 5 degrees, the floor plan of 0.01 m against scans of 0.05 m among them."""
    folder = shared_data / "maps" / "grid_pairs"

    def load(name: str, resolution_m: float) -> GridMap:
        image = cv2.imread(str(folder / name), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        return grid_map_of(np.where(image == 0, 2, np.where(image == 254, 1, 0)), resolution_m)

    wrong = []
    for pair in json.loads((folder / "pairs.json").read_text()):
        target, source = load(pair["a"], pair["res_a"]), load(pair["b"], pair["res_b"])
        best = Correlation().match(target, source)[0]
        a, b, c, d, e, f = pair["T_px_b2a"]  # pixel indices, x to the right and y down, as the maps were loaded
        walls = walls_of(source)
        truth = (walls / pair["res_b"] - 0.5) @ np.array([[a, d], [b, e]]) + (c, f)
        displaced = np.hypot(*(best.T_receiver_donor.apply(walls) - (truth + 0.5) * pair["res_a"]).T).mean()
        turn = math.remainder(best.T_receiver_donor.yaw_rad - math.atan2(d, a), 2 * math.pi)
        if displaced > 0.5 or abs(turn) > math.radians(5.0) or best.margin < 0.3 * best.score:
            wrong.append(pair["id"])
    assert not wrong


@pytest.mark.parametrize(("target_m", "source_m"), [(0.07, 0.07), (0.07, 0.1), (0.1, 0.07)])
def test_thirty_scans_of_a_real_building_are_enough(
    carmen: Callable[[str], list[Observation]], target_m: float, source_m: float
) -> None:
    """Windows of the Intel log that overlap, the second in a frame of its own."""
    log = carmen("intel")
    for first, second in ((140, 520), (420, 30), (840, 520), (100, 330)):
        T_a = Transform.planar(4.0, -7.0, 2.0) @ log[first].T_map_sensor.inverse()
        T_b = Transform.planar(0.0, 0.0, -1.0) @ log[second].T_map_sensor.inverse()
        target = view_of(log[first : first + 30], target_m, T_a)
        source = view_of(log[second : second + 30], source_m, T_b)
        best = Correlation().match(target, source)[0]
        shift_m, turn_deg = off_by(best.T_receiver_donor, T_a @ T_b.inverse(), walls_of(source))
        assert shift_m < 0.3 and turn_deg < 1.5
        assert best.margin > 0.0
        assert best.covariance is not None and best.evidence["sigma_max_m"] < 1.0


def view_of(observations: list[Observation], resolution_m: float, T_map_world: Transform) -> GridMap:
    """The map of these scans in a frame of its own."""
    grids = OccupancyGrid(resolution_m=resolution_m)
    layer = grids.new_layer()
    for o in observations:
        pose = T_map_world @ o.T_map_sensor
        grids.integrate(layer, Observation(o.robot, o.stamp_ns, o.recorded_ns, o.sensor, o.kind, o.payload, pose, pose))
    return grids.view(layer)

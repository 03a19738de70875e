"""What huge clouds cost: ``python tests/bench/large_clouds.py [-n POINTS] [--voxel METRES] [--sweep]``.

A cloud of points on the walls and floors of a hall (100 m × 80 m × 6 m with rows of partitions) goes the way of a map
file: written as PCD, read, mapped, viewed, encoded, decoded, placed in another frame, converted to a grid. With
``--sweep`` it is one sweep seen from the middle, with all the free space. Each line tells the time of one step and the
most memory that the process has had so far; the first line is what it has before, compiled kernels included.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

from mapgraft.contracts import CLOUD, CLOUD_MAP, Cloud, Observation, Points, Transform
from mapgraft_cloud.cloud_file import read
from mapgraft_cloud.grid_conversion import GridConversion
from mapgraft_cloud.map_type import PointCloud
from mapgraft_cloud.pcd import pcd_bytes
from mapgraft_grid.map_type import OccupancyGrid

Result = TypeVar("Result")
SIZE_M = np.array([100.0, 80.0, 6.0])
AISLE_M = 10.0  # between partitions


def hall(points: int) -> Points:
    """Points (n, 3) float32 on a floor, a ceiling, outer walls and partitions, with a centimetre of noise."""
    rng = np.random.default_rng(0)
    found = rng.uniform(0.0, 1.0, (points, 3)).astype(np.float32) * SIZE_M.astype(np.float32)
    surface = rng.integers(0, 4, points)
    found[surface == 0, 2] = 0.0
    found[surface == 1, 2] = SIZE_M[2]
    walls = surface == 2
    found[walls, 0] = np.where(rng.random(int(walls.sum())) < 0.5, 0.0, SIZE_M[0])
    rows = surface == 3
    found[rows, 1] = np.round(found[rows, 1] / AISLE_M) * AISLE_M
    found += rng.normal(0.0, 0.01, found.shape).astype(np.float32)
    return found


def run(points: int, voxel_m: float, sweep: bool, folder: Path) -> None:
    kind, grid, still = PointCloud(resolution_m=voxel_m), OccupancyGrid(), Transform.identity()
    path = folder / "hall.pcd"
    warm_up(kind, grid)
    told("before", lambda: None)
    told("written", lambda: path.write_bytes(pcd_bytes(hall(points))))
    options = {"viewpoint": (SIZE_M / 2.0).tolist()} if sweep else {}
    cloud = told("read", lambda: read(path, **options))
    layer = kind.new_layer()
    seen = Observation("r", 0, 0, "file", CLOUD if sweep else CLOUD_MAP, cloud, still, still)
    told("mapped", lambda: kind.integrate(layer, seen))
    map_ = told("viewed", lambda: kind.view(layer))
    print(
        f"  {layer.own.keys.size} blocks, {len(map_.points_m)} occupied voxels, {layer.nbytes / 1e6:.0f} MB of counts"
    )
    told("region", lambda: len(kind.region(layer)))
    data = told("encoded", lambda: kind.encode(layer))
    print(f"  {len(data) / 1e6:.1f} MB to send")
    told("decoded", lambda: kind.decode(data))
    told("as a grid", lambda: GridConversion().convert(layer, kind, grid))
    told("placed", lambda: kind.place(layer, Transform.planar(3.0, -2.0, 0.7)))


def warm_up(kind: PointCloud, grid: OccupancyGrid) -> None:
    """Compile everything first."""
    layer, still = kind.new_layer(), Transform.identity()
    cloud = Cloud(hall(2000) / 20.0, origin_m=(2.5, 2.0, 0.2))
    kind.integrate(layer, Observation("r", 0, 0, "file", CLOUD, cloud, still, still))
    kind.view(layer)
    kind.region(kind.decode(kind.encode(kind.place(layer, Transform.planar(1.0, 2.0, 0.3)))))
    GridConversion().convert(layer, kind, grid)


def told(what: str, do: Callable[[], Result]) -> Result:
    start = time.process_time()
    result = do()
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(f"{what:10s} {time.process_time() - start:7.2f} s of one core, {peak_mb:7.0f} MB at most so far", flush=True)
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-n", "--points", type=int, default=10_000_000)
    parser.add_argument("--voxel", type=float, default=0.1)
    parser.add_argument("--sweep", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        run(given.points, given.voxel, given.sweep, Path(folder))


if __name__ == "__main__":
    main()

"""Where a robot was, and how high the floor lay there: what a height band is measured from."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Transform
from mapgraft_cloud.kernels.block_keys import BLOCK, VOXEL_LIMIT

MOUNTED_M: Final = 0.05  # a sensor at least so high above the robot's base tells that the base is below
_SEEN_M: Final = 10.0  # around the sensor in which one sweep's floor is looked for
_AXIS_BITS: Final = 21  # of a voxel's place along one axis, none of it negative
_SLAB_M: Final = 0.2  # of heights
_SHARE: Final = 0.1  # of the columns with a hit: the lowest slab that has so many is the floor

Floor = tuple[int, int, int]  # block x, block y, and the first voxel above the floor


class Floors:
    """In how many sweeps a robot was above which block, and the voxel with which the room above the floor begins.

    Sweeps add up, so that nothing far away and no single sweep changes what was found here.
    """

    __slots__ = ("sweeps",)

    def __init__(self) -> None:
        self.sweeps: dict[Floor, int] = {}

    def add(self, floor: Floor, sweeps: int = 1) -> None:
        self.sweeps[floor] = self.sweeps.get(floor, 0) + sweeps

    def rows(self) -> list[list[int]]:
        """Block x, block y, height and sweeps, in ascending order."""
        return [[*floor, self.sweeps[floor]] for floor in sorted(self.sweeps)]

    def below(self, blocks: NDArray[np.int64]) -> NDArray[np.int64]:
        """The floor (n,) below blocks (n, 2) x, y: that of the nearest block in which the robot was.

        Where it was on several heights, the one of most sweeps, of equal ones the lowest. There must be any.
        """
        from scipy.spatial import cKDTree

        best: dict[tuple[int, int], int] = {}
        for x, y, height in sorted(self.sweeps, key=lambda floor: (-self.sweeps[floor], floor[2])):
            best.setdefault((x, y), height)
        places = np.array(sorted(best), np.int64)
        heights = np.array([best[x, y] for x, y in places.tolist()], np.int64)
        _, nearest = cKDTree(places).query(blocks)
        below: NDArray[np.int64] = heights[nearest]
        return below


def floor_beneath(
    points: NDArray[np.float64], T_map_sensor: Transform, T_map_base: Transform, voxel_m: float
) -> Floor | None:
    """The floor beneath a sensor: as high as the robot's base where that lies below, else as one sweep shows it.

    ``points`` (n, 3) are the sweep's in voxels. None where the recording tells no base and the sweep shows no floor.
    """
    if T_map_sensor.z_m - T_map_base.z_m >= MOUNTED_M:
        return floor_at(T_map_sensor, round(T_map_base.z_m / voxel_m), voxel_m)
    sensor = T_map_sensor.matrix[:3, 3] / voxel_m
    near = np.hypot(*(points[:, :2] - sensor[:2]).T) * voxel_m <= _SEEN_M
    height = lowest_slab(np.floor(points[near & (points[:, 2] < sensor[2])]).astype(np.int64), voxel_m)
    return None if height is None else floor_at(T_map_sensor, height, voxel_m)


def floor_at(T_map_sensor: Transform, height: int, voxel_m: float) -> Floor:
    """A floor of which the height is known, below the place of a sensor."""
    x, y = np.floor(T_map_sensor.matrix[:2, 3] / (BLOCK * voxel_m)).astype(np.int64).tolist()
    return x, y, height


def lowest_slab(voxels: NDArray[np.int64], voxel_m: float) -> int | None:
    """The first voxel above the floor: above the fullest level of the lowest 0.2 m in which a tenth of all columns of
    voxels (n, 3) has one; None where there is no such slab."""
    if not len(voxels):
        return None
    thick = max(1, round(_SLAB_M / voxel_m))
    packed = (((voxels[:, 0] + VOXEL_LIMIT) << _AXIS_BITS) | (voxels[:, 1] + VOXEL_LIMIT)) << _AXIS_BITS
    packed = np.sort(packed | (voxels[:, 2] + VOXEL_LIMIT))
    packed = packed[np.concatenate(([True], packed[1:] != packed[:-1]))]
    columns, z = packed >> _AXIS_BITS, (packed & ((1 << _AXIS_BITS) - 1)) - VOXEL_LIMIT
    # a column is in the slabs that begin up to ``thick`` below one of its voxels, once however many it has in one
    begin = z - thick + 1
    same = columns[1:] == columns[:-1]
    begin[1:] = np.where(same, np.maximum(begin[1:], z[:-1] + 1), begin[1:])
    begin, end = np.sort(begin), np.sort(z)
    inside = np.arange(1, len(z) + 1) - np.searchsorted(end, begin, side="left")
    enough = inside >= _SHARE * (1 + np.count_nonzero(~same))
    if not enough.any():
        return None
    low = max(int(begin[np.argmax(enough)]), int(end[0]))
    levels = z[(z >= low) & (z < low + thick)]
    return low + int(np.argmax(np.bincount(levels - low))) + 1

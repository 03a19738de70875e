"""What matchers and metrics see of a point-cloud map."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Final
from weakref import ref

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Map, MapError, Points, Transform
from mapgraft_cloud.kernels import viewing
from mapgraft_cloud.kernels.block_keys import BLOCK, KEY_BITS
from mapgraft_cloud.kernels.placing import STEPS
from mapgraft_cloud.parameters import NAME, Thresholds
from mapgraft_cloud.region import BlockKeys, VoxelRegion, Voxels, voxels_of

if TYPE_CHECKING:
    from mapgraft_cloud.agreement import Agreement
    from mapgraft_cloud.surface import Surface

GROUND_BITS: Final = (1 << (2 * KEY_BITS)) - 1  # of a block's key: its x and y


Offsets = NDArray[np.uint16]  # (n, 3)


class CloudMap:
    """A read-only view: clamped log-odds per voxel, and where in the occupied ones the points lie.

    ``keys`` (k,) ascend; ``log_odds`` (k, 512) int16, 1024 per nat, 0 where nothing is known; ``offsets`` (n, 3) uint16
    the mean positions in the occupied voxels in 1/1024 of their side, in the order of their blocks.
    """

    def __init__(
        self,
        voxel_m: float,
        thresholds: Thresholds,
        keys: BlockKeys,
        log_odds: NDArray[np.int16],
        offsets: Offsets,
    ) -> None:
        self.voxel_m, self.thresholds = voxel_m, thresholds
        self.keys, self.log_odds, self.offsets = keys, log_odds, offsets
        for array in (keys, log_odds, offsets):
            array.setflags(write=False)
        self._agreed: dict[bool, tuple[ref[CloudMap], Agreement]] = {}

    @property
    def map_type(self) -> str:
        return NAME

    def known(self) -> int:
        """How many voxels are occupied or free."""
        return int(np.count_nonzero(self._made_out))

    @property
    def is_empty(self) -> bool:
        return self.known() == 0

    @cached_property
    def _made_out(self) -> NDArray[np.bool_]:
        read = self.thresholds
        return (self.log_odds >= read.occupied) | (self.log_odds <= read.free)

    def known_region(self) -> VoxelRegion:
        """The voxels that are occupied or free."""
        return VoxelRegion.from_mask(self.voxel_m, self.keys, self._made_out)

    @cached_property
    def occupied(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """In which block (n,) and at which place (n,) in it each occupied voxel is."""
        blocks, places = np.nonzero(self.log_odds >= self.thresholds.occupied)
        return blocks, places

    @cached_property
    def has_free_space(self) -> bool:
        """Whether anything is known to be free: a map without poses knows only where something stands."""
        return bool((self.log_odds <= self.thresholds.free).any())

    @cached_property
    def points_m(self) -> Points:
        """The mean points (n, 3) of the occupied voxels, in the order of their blocks."""
        blocks, places = self.occupied
        inside = (self.offsets + 0.5) / STEPS
        return (voxels_of(self.keys[blocks], places) + inside) * self.voxel_m

    def occupied_log_odds(self) -> NDArray[np.int16]:
        """The log-odds (n,) of the occupied voxels, in the order of ``points_m``."""
        blocks, places = self.occupied
        return self.log_odds[blocks, places]

    def voxels_at(self, points_m: Points) -> Voxels:
        """The voxels (n, 3) in which points lie."""
        return np.floor(points_m / self.voxel_m).astype(np.int64)

    def log_odds_at(self, points_m: Points) -> NDArray[np.int16]:
        """The log-odds (n,) at points (n, 3), 0 where nothing is known."""
        found: NDArray[np.int16] = viewing.values_at(self.keys, self.log_odds, self.voxels_at(points_m))
        return found

    def around(self, points_m: Points, reach_m: float) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
        """The lowest and the highest log-odds (n,) in the voxels within ``reach_m`` of points along every axis."""
        reach = max(1, round(reach_m / self.voxel_m))
        low, high = viewing.around(self.keys, self.log_odds, self.voxels_at(points_m), reach)
        return low, high

    def makes_out(self, points_m: Points) -> NDArray[np.bool_]:
        """Whether the voxels at points (n, 3) are occupied or free."""
        odds = self.log_odds_at(points_m)
        made_out: NDArray[np.bool_] = (odds >= self.thresholds.occupied) | (odds <= self.thresholds.free)
        return made_out

    def ground_area_m2(self) -> float:
        """The area of the columns in which something is occupied or free."""
        columns = self._made_out.reshape(-1, BLOCK, BLOCK * BLOCK).any(axis=1)
        grounds, block = np.unique(self.keys & GROUND_BITS, return_inverse=True)
        seen = np.zeros((grounds.size, BLOCK * BLOCK), np.bool_)
        np.logical_or.at(seen, block.ravel(), columns)
        return int(seen.sum()) * self.voxel_m**2

    def agreed(self, donor: CloudMap, walls_only: bool) -> Agreement:
        """How it agrees with a map that lies in its frame; kept while the last one lives: several metrics ask."""
        from mapgraft_cloud.agreement import agreement

        known = self._agreed.get(walls_only)
        if known is None or known[0]() is not donor:
            known = self._agreed[walls_only] = (ref(donor), agreement(self, donor, Transform.identity(), walls_only))
        return known[1]

    @cached_property
    def surface(self) -> Surface:
        """Its surfaces, thinned for matching; made when they are first asked for."""
        from mapgraft_cloud.surface import surface_of

        return surface_of(self.points_m)


def as_map(map_: Map) -> CloudMap:
    """The map as one of this type; raises MapError when it is of another."""
    if not isinstance(map_, CloudMap):
        raise MapError(f"a point cloud map is needed here, found one of type {map_.map_type}: convert it first")
    return map_

"""Sets of voxels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError, Region
from mapgraft_cloud.kernels.block_keys import BLOCK, KEY_BIAS, KEY_BITS, VOLUME

BlockKeys = NDArray[np.int64]  # (k,) see kernels.block_keys
BitLayers = NDArray[np.uint64]  # (k, 8) one word per z of a block, bit = 8 y + x
Voxels = NDArray[np.int64]  # (n, 3) ix, iy, iz

_MASK: Final = (1 << KEY_BITS) - 1


def keys_of(voxels: Voxels) -> BlockKeys:
    """The blocks (n,) in which voxels lie."""
    x, y, z = (voxels[:, axis] >> 3 for axis in range(3))
    keys: BlockKeys = ((z + KEY_BIAS) << (2 * KEY_BITS)) | ((y + KEY_BIAS) << KEY_BITS) | (x + KEY_BIAS)
    return keys


def places_of(voxels: Voxels) -> NDArray[np.int64]:
    """Where in their blocks voxels lie, (n,) in 0 … 511."""
    places: NDArray[np.int64] = (voxels[:, 2] & 7) * 64 + (voxels[:, 1] & 7) * BLOCK + (voxels[:, 0] & 7)
    return places


def corners_of(keys: BlockKeys) -> Voxels:
    """The lowest voxel (k, 3) of blocks."""
    parts = (keys & _MASK, (keys >> KEY_BITS) & _MASK, keys >> (2 * KEY_BITS))
    return (np.stack(parts, axis=1) - KEY_BIAS) * BLOCK


def voxels_of(keys: BlockKeys, places: NDArray[np.int64]) -> Voxels:
    """The voxels (n, 3) at places (n,) of blocks (n,)."""
    inside = np.stack((places % BLOCK, places // BLOCK % BLOCK, places // (BLOCK * BLOCK)), axis=1)
    return corners_of(keys) + inside


def find(keys: BlockKeys, wanted: BlockKeys) -> NDArray[np.int64]:
    """Where wanted keys stand among ascending ones, -1 where they are absent."""
    if not keys.size:
        return np.full(wanted.size, -1, np.int64)
    places = np.minimum(np.searchsorted(keys, wanted), keys.size - 1)
    return np.where(keys[places] == wanted, places, -1)


@dataclass(frozen=True, slots=True, eq=False)
class VoxelRegion:
    """Voxels of one size, immutable: ascending ``keys`` (k,) of the blocks that hold one, and their ``bits`` (k, 8)."""

    voxel_m: float
    keys: BlockKeys
    bits: BitLayers

    def __post_init__(self) -> None:
        self.keys.setflags(write=False)
        self.bits.setflags(write=False)

    @classmethod
    def empty(cls, voxel_m: float) -> VoxelRegion:
        return cls(voxel_m, np.empty(0, np.int64), np.empty((0, BLOCK), np.uint64))

    @classmethod
    def from_bits(cls, voxel_m: float, keys: BlockKeys, bits: BitLayers) -> VoxelRegion:
        """The voxels of blocks in ascending order, of which some may be empty."""
        some = bits.any(axis=1)
        return cls(voxel_m, keys[some], bits[some])

    @classmethod
    def from_mask(cls, voxel_m: float, keys: BlockKeys, mask: NDArray[np.bool_]) -> VoxelRegion:
        """The True voxels of a mask (k, 512) over blocks in ascending order."""
        packed = np.packbits(mask.reshape(-1, VOLUME), axis=1, bitorder="little")
        return cls.from_bits(voxel_m, keys, packed.view("<u8").astype(np.uint64))

    def mask(self) -> NDArray[np.bool_]:
        """(k, 512) True where the region has the voxel of its block."""
        packed = np.ascontiguousarray(self.bits.astype("<u8")).view(np.uint8).reshape(-1, VOLUME // 8)
        return np.unpackbits(packed, axis=1, bitorder="little").view(np.bool_)

    def union(self, other: VoxelRegion) -> VoxelRegion:
        """The voxels in either; raises MapError when both hold voxels of different sizes."""
        if not self.keys.size:
            return other
        if not other.keys.size:
            return self
        self._require_same_size(other)
        keys = np.union1d(self.keys, other.keys)
        bits = np.zeros((keys.size, BLOCK), np.uint64)
        bits[np.searchsorted(keys, self.keys)] |= self.bits
        bits[np.searchsorted(keys, other.keys)] |= other.bits
        return VoxelRegion(self.voxel_m, keys, bits)

    def minus(self, other: VoxelRegion) -> VoxelRegion:
        """The voxels that the other does not have; raises MapError as ``union``."""
        places = self._places_in(other)
        bits = self.bits.copy()
        bits[places >= 0] &= ~other.bits[places[places >= 0]]
        return VoxelRegion.from_bits(self.voxel_m, self.keys, bits)

    def meets(self, other: VoxelRegion) -> bool:
        """Whether any voxel is in both; raises MapError as ``union``."""
        places = self._places_in(other)
        return bool((self.bits[places >= 0] & other.bits[places[places >= 0]]).any())

    def __len__(self) -> int:
        return int(np.unpackbits(np.ascontiguousarray(self.bits).view(np.uint8)).sum())

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, VoxelRegion)
            and (self.voxel_m == other.voxel_m or not (self.keys.size or other.keys.size))
            and np.array_equal(self.keys, other.keys)
            and np.array_equal(self.bits, other.bits)
        )

    def __hash__(self) -> int:
        return hash((self.keys.tobytes(), self.bits.tobytes()))

    def _places_in(self, other: VoxelRegion) -> NDArray[np.int64]:
        if self.keys.size and other.keys.size:
            self._require_same_size(other)
        return find(other.keys, self.keys)

    def _require_same_size(self, other: VoxelRegion) -> None:
        if self.voxel_m != other.voxel_m:
            raise MapError(
                f"two regions must have voxels of one size, found {self.voxel_m} and {other.voxel_m} m: "
                "place the layers in one size first"
            )


def as_region(region: Region) -> VoxelRegion:
    """The region as one of voxels; raises MapError when it is of another type."""
    if not isinstance(region, VoxelRegion):
        raise MapError(f"a point cloud map needs a region of its own voxels, found {type(region).__name__}")
    return region

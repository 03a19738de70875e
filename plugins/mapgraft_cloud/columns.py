"""Named columns of numbers, as files and messages have them, made into a cloud."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Cloud

Columns = Mapping[str, NDArray[np.generic]]  # (n,) each

Number = TypeVar("Number", bound=np.generic)
INTENSITY: Final = ("intensity", "intensities", "scalar_intensity", "i", "reflectivity", "scalar_Intensity")
_COLOURS: Final = (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"))


def cloud_of(columns: Columns, origin_m: tuple[float, float, float] | None) -> Cloud:
    """The cloud in columns that have x, y and z; points that are not finite are left out and counted."""
    points = np.stack([np.asarray(columns[axis]).astype(np.float32) for axis in "xyz"], axis=1)
    finite = np.isfinite(points).all(axis=1)
    keep = slice(None) if finite.all() else finite
    intensities, colours = _intensities(columns), _colours(columns)
    return Cloud(
        _frozen(points[keep]),
        None if intensities is None else _frozen(intensities[keep]),
        None if colours is None else _frozen(colours[keep]),
        origin_m,
        int(np.count_nonzero(~finite)),
    )


def _intensities(columns: Columns) -> NDArray[np.float32] | None:
    name = next((name for name in INTENSITY if name in columns), None)
    return None if name is None else np.asarray(columns[name]).astype(np.float32)


def _colours(columns: Columns) -> NDArray[np.uint8] | None:
    """Red, green, blue from three columns, or from one that packs them into the bits of a number, as PCL does."""
    for names in _COLOURS:
        if all(name in columns for name in names):
            parts = [np.asarray(columns[name]) for name in names]
            whole = all(part.dtype.kind in "ui" for part in parts)
            scaled = parts if whole else [np.nan_to_num(part.astype(np.float64)) * 255.0 for part in parts]
            return np.stack([np.clip(part, 0, 255).astype(np.uint8) for part in scaled], axis=1)
    packed = next((np.asarray(columns[name]) for name in ("rgb", "rgba") if name in columns), None)
    if packed is None or packed.dtype.itemsize != 4:
        return None
    bits = np.ascontiguousarray(packed.astype(packed.dtype.newbyteorder("="))).view(np.uint32)
    return np.stack([((bits >> np.uint32(shift)) & np.uint32(255)).astype(np.uint8) for shift in (16, 8, 0)], axis=1)


def _frozen(array: NDArray[Number]) -> NDArray[Number]:
    array.setflags(write=False)
    return array

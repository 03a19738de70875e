"""The surfaces of a point cloud, thinned evenly, with the direction each faces."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Points

SPACING_M: Final = 0.25  # of the thinned points: dense and sparse clouds become alike
_NEIGHBOURS: Final = 12
_UPRIGHT: Final = 0.5  # of a normal's length may point up or down: walls, not floors nor ceilings
_MOST: Final = 60_000  # points; larger maps are thinned more
_LARGER: Final = 1.25


@dataclass(frozen=True, eq=False)
class Surface:
    """Points (n, 3) about ``spacing_m`` apart with their unit ``normals`` (n, 3); ``upright`` (n,) marks walls."""

    points_m: Points
    normals: NDArray[np.float64]
    upright: NDArray[np.bool_]
    spacing_m: float

    @cached_property
    def tree(self) -> Any:
        """A search tree over the points."""
        from scipy.spatial import cKDTree

        return cKDTree(self.points_m)

    def distances(self, points_m: Points, at_most_m: float) -> NDArray[np.float64]:
        """How far points (n, 3) lie from the nearest of the surface, infinite beyond ``at_most_m``."""
        if not len(self.points_m) or not len(points_m):
            return np.full(len(points_m), np.inf)
        away: NDArray[np.float64] = self.tree.query(points_m, distance_upper_bound=at_most_m)[0]
        return away


def surface_of(points_m: Points, spacing_m: float = SPACING_M) -> Surface:
    """The surface that points (n, 3) lie on; huge clouds get a larger spacing."""
    thin = thinned(points_m, spacing_m)
    while len(thin) > _MOST:
        spacing_m *= _LARGER
        thin = thinned(points_m, spacing_m)
    normals = _normals(thin)
    return Surface(thin, normals, np.abs(normals[:, 2]) < _UPRIGHT, spacing_m)


def thinned(points_m: Points, spacing_m: float) -> Points:
    """The mean points (m, 3) of the cubes of that side, in the order of their cubes."""
    if not len(points_m):
        return np.empty((0, 3))
    cubes = np.floor(points_m / spacing_m).astype(np.int64)
    order = np.lexsort(cubes.T)
    first = np.flatnonzero(np.concatenate(([True], (np.diff(cubes[order], axis=0) != 0).any(axis=1))))
    counts = np.diff(np.append(first, len(points_m)))[:, None]
    means: Points = np.add.reduceat(points_m[order].astype(np.float64), first) / counts
    return means


def _normals(points_m: Points) -> NDArray[np.float64]:
    """Where points of a plane through the nearest neighbours face, (n, 3); up where there are too few."""
    if len(points_m) < 4:
        return np.tile((0.0, 0.0, 1.0), (len(points_m), 1))
    from scipy.spatial import cKDTree

    _, near = cKDTree(points_m).query(points_m, k=min(_NEIGHBOURS, len(points_m)))
    around = points_m[near] - points_m[near].mean(axis=1, keepdims=True)
    _, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))
    normals: NDArray[np.float64] = vectors[:, :, 0]
    return normals

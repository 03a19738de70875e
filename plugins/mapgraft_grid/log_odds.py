"""Fusing by the binary Bayes filter, the donor's evidence applied 0 to 3 times as the quality of both maps says."""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from itertools import pairwise
from typing import Final, Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import ConfigError, Contribution, Donation, Map, MapError, MapType, Match
from mapgraft_grid.grid_map import OCCUPIED, UNKNOWN, GridMap
from mapgraft_grid.kernels.tile_keys import TILE, tile_x, tile_y
from mapgraft_grid.layer import GridLayer
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.quality import WindowQuality, window_quality
from mapgraft_grid.region import GridRegion
from mapgraft_grid.tiles import TileKeys
from mapgraft_grid.weights import MOST, TileWeights

Quality = Literal["windowed", "none"]

CHANCE: Final = 0.2  # sd of the difference of equally good maps, times the root of the metres of wall (simulated)
BESIDE_WALL_M: Final = 0.3  # a donor that is not applied does not fill there: it would smear a better wall


class LogOdds:
    """Adds the donor's log-odds to the receiver's, per tile 0 to 3 times.

    With ``quality="windowed"`` both maps are judged in windows of 2 m. Where both can be judged, the difference d =
    quality(donor) − quality(receiver), averaged over the windows of a tile of 64 × 64 cells, weighted by the wall in
    them and shrunk to the mean of all tiles as far as chance explains it, gives the number of applications: 0 up to
    ``table[0]``, 1 between that and ``table[1]``, 2 from ``table[1]`` and 3 from ``table[2]``; 1 where there is nothing
    to compare. Where a donor is not applied it still fills, once,
    what the receiver does not know, but for 0.3 m around the receiver's walls, where it would only smear them.
    ``quality="none"`` applies everything once: plain Bayes.

    The paper applies the update 0 to 3 times "depending on the quality differences of both map regions" and leaves
    open how; this rule and the windows are this project's own, and the default table was chosen on simulated worlds.
    All that was decided is frozen in the contribution.

    Its summary tells ``tiles_applied_0`` … ``tiles_applied_3``, the tiles with so many applications;
    ``cells_changed``, of which ``cells_filled`` lie in tiles that are not applied; and, where windows exist in which
    both maps can be judged, their number ``windows_judged`` and the means over them weighted by wall,
    ``quality_receiver`` and ``quality_donor``.

    Source: Andersone 2021, section 4.1; S. Thrun, W. Burgard and D. Fox, Probabilistic Robotics (2005), table 4.2.
    """

    def __init__(self, *, quality: Quality = "windowed", table: Sequence[float] = (-0.15, 0.2, 0.4)) -> None:
        if quality not in get_args(Quality):
            raise ConfigError(f"log_odds knows the qualities {', '.join(get_args(Quality))}, found {quality!r}")
        if len(table) != 3 or not all(a < b for a, b in pairwise((-1.0, *table, 1.0))):
            raise ConfigError(
                "log_odds needs a table of three ascending differences of quality between -1 and 1 "
                f"(where 0 ends, where 2 and where 3 applications begin), found {list(table)}"
            )
        self.quality = quality
        self.table = tuple(table)

    def applications(self, difference: float) -> int:
        """How often a donor is applied that is better than the receiver by that difference of quality."""
        if difference <= self.table[0]:
            return 0
        return 1 + bisect.bisect_right(self.table[1:], difference)

    def fuse(self, map_type: MapType, target: Map, source: Donation, match: Match) -> Contribution:
        """The contribution; EmptyMapError when the donor's layer is empty, MapError when one of them is no grid."""
        if not (
            isinstance(map_type, OccupancyGrid) and isinstance(target, GridMap) and isinstance(source.layer, GridLayer)
        ):
            raise MapError(
                f"log_odds fuses occupancy grids, found a receiver of type {map_type.name!r} and a layer of type "
                f"{source.layer.map_type!r}: convert them first"
            )
        T = match.T_receiver_donor.snapped()
        placed = map_type.place(source.layer, T, match.scale)
        covered = map_type.region(placed)
        weights = TileWeights.plain()
        judged: dict[str, float] = {}
        if self.quality == "windowed":
            measured_m = source.layer.lattice.resolution_m * match.scale
            weights, judged = self._weights(target, map_type.view(placed), covered.keys, measured_m)
        fill = _fillable(covered, weights, target)
        region = covered if fill is None else covered.minus(_refused(covered, weights)).union(fill)
        return Contribution(
            provenance=source.provenance,
            layer=placed,
            T_receiver_donor=T,
            scale=match.scale,
            resampler=map_type.resampler(source.layer, match.scale),
            weights=weights,
            fill=fill,
            region=region,
            summary={**_applied(covered, weights), **_changed(region, fill), **judged},
        )

    def _weights(
        self, own: GridMap, donor: GridMap, keys: TileKeys, measured_m: float
    ) -> tuple[TileWeights, dict[str, float]]:
        """How often each tile is applied, and the qualities on which that rests."""
        if own.is_empty or donor.is_empty:
            return TileWeights.plain(), {}
        ours, theirs = window_quality(own.dense()), window_quality(donor.dense(), measured_m)
        differences = shrunk(*tile_differences(ours, theirs, keys))
        counts = np.array([self.applications(d) for d in differences.tolist()], np.uint8)
        return TileWeights(keys[counts != 1], counts[counts != 1]), joint_quality(ours, theirs)


def tile_differences(
    ours: WindowQuality, theirs: WindowQuality, keys: TileKeys
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """quality(theirs) − quality(ours) of tiles (k,), and the metres of wall (k,) on which that rests; 0 without any.

    A tile takes the windows whose centre lies in it, or within half a stride of its own centre where it is smaller.
    Both must lie on one lattice.
    """
    difference, wall_m, first = _joint_windows(ours, theirs)
    block = ours.layout.block_cells
    reach = max(TILE, block) / 2.0
    judged = np.flatnonzero(wall_m)
    rows, columns = np.unravel_index(judged, wall_m.shape)
    x, y = (first[0] + columns + 1) * block, (first[1] + rows + 1) * block
    weight, weighted = wall_m.ravel()[judged], (difference * wall_m).ravel()[judged]
    out, rests_on_m = np.zeros(keys.size), np.zeros(keys.size)
    for index, key in enumerate(keys.tolist()):
        centre_x, centre_y = TILE * tile_x(key) + TILE // 2, TILE * tile_y(key) + TILE // 2
        near = (abs(x - centre_x) <= reach) & (abs(y - centre_y) <= reach)
        if near.any():
            rests_on_m[index] = weight[near].sum()
            out[index] = weighted[near].sum() / rests_on_m[index]
    return out, rests_on_m


def shrunk(differences: NDArray[np.float64], wall_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Differences (k,), drawn to their mean as far as they differ from each other by no more than chance.

    The chance of a tile is that of two equally good maps: ``CHANCE`` over the root of its metres of wall. What lies
    beyond is the true variance between tiles, by the method of moments (DerSimonian and Laird 1986). Tiles without
    wall stay 0.
    """
    rests = wall_m > 0
    d, noise = differences[rests], CHANCE**2 / wall_m[rests]
    if not d.size:
        return differences
    weight = 1.0 / noise
    scatter = (weight * (d - np.average(d, weights=weight)) ** 2).sum() - (d.size - 1)
    between = max(0.0, scatter / (weight.sum() - (weight**2).sum() / weight.sum())) if d.size > 1 else 0.0
    mean = np.average(d, weights=1.0 / (noise + between))
    out = np.zeros_like(differences)
    out[rests] = mean + between / (between + noise) * (d - mean)
    return out


def joint_quality(ours: WindowQuality, theirs: WindowQuality) -> dict[str, float]:
    """The mean quality of both maps over the windows in which both can be judged, and their number; {} without any.

    Both must lie on one lattice.
    """
    a, b = _overlap(ours, theirs)
    _, wall_m, _ = _joint_windows(ours, theirs)
    judged = wall_m > 0
    if not judged.any():
        return {}
    return {
        "quality_receiver": float(np.average(ours.quality[a][judged], weights=wall_m[judged])),
        "quality_donor": float(np.average(theirs.quality[b][judged], weights=wall_m[judged])),
        "windows_judged": float(np.count_nonzero(judged)),
    }


def _joint_windows(
    ours: WindowQuality, theirs: WindowQuality
) -> tuple[NDArray[np.float64], NDArray[np.float64], tuple[int, int]]:
    """Difference of quality and the lesser metres of wall, 0 where one cannot be judged, from a first block on."""
    a, b = _overlap(ours, theirs)
    difference = theirs.quality[b] - ours.quality[a]
    judged = ~np.isnan(difference)
    wall_m = np.where(judged, np.minimum(ours.wall_m[a], theirs.wall_m[b]), 0.0)
    first_x, first_y = ours.layout.first_block
    return np.where(judged, difference, 0.0), wall_m, (first_x + a[1].start, first_y + a[0].start)


def _overlap(ours: WindowQuality, theirs: WindowQuality) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Where in the windows of the one and of the other the windows of both lie."""
    (ax, ay), (bx, by) = ours.layout.first_block, theirs.layout.first_block
    x, y = max(ax, bx), max(ay, by)
    height = max(0, min(ay + ours.quality.shape[0], by + theirs.quality.shape[0]) - y)
    width = max(0, min(ax + ours.quality.shape[1], bx + theirs.quality.shape[1]) - x)
    a = (slice(y - ay, y - ay + height), slice(x - ax, x - ax + width))
    b = (slice(y - by, y - by + height), slice(x - bx, x - bx + width))
    return a, b


def _applied(covered: GridRegion, weights: TileWeights) -> dict[str, float]:
    """How many of the donor's tiles are applied 0, 1, 2 and 3 times."""
    tiles = np.bincount(weights.of(covered.keys), minlength=MOST + 1)
    return {f"tiles_applied_{count}": float(number) for count, number in enumerate(tiles.tolist())}


def _changed(region: GridRegion, fill: GridRegion | None) -> dict[str, float]:
    return {"cells_changed": float(len(region)), "cells_filled": 0.0 if fill is None else float(len(fill))}


def _refused(covered: GridRegion, weights: TileWeights) -> GridRegion:
    """The cells of tiles in which the donor is not applied."""
    refused = weights.of(covered.keys) == 0
    return GridRegion(covered.lattice, covered.keys[refused], covered.rows[refused])


def _fillable(covered: GridRegion, weights: TileWeights, own: GridMap) -> GridRegion | None:
    """Of those the cells that the receiver does not know, nor has a wall beside; None when there are no such tiles."""
    refused = _refused(covered, weights)
    if not len(refused):
        return None
    x0, y0, x1, y1 = own.bounds_cells()
    margin = round(BESIDE_WALL_M / own.resolution_m)
    origin, shape = (x0 - margin, y0 - margin), (y1 - y0 + 2 * margin, x1 - x0 + 2 * margin)
    classes = own.dense_over(origin, shape).classes
    walls = (classes == OCCUPIED).astype(np.uint8)
    beside = cv2.dilate(walls, np.ones((2 * margin + 1, 2 * margin + 1), np.uint8)) > 0
    return refused.minus(GridRegion.from_mask(covered.lattice, origin, (classes != UNKNOWN) | beside))

"""The distance metric DM: how far apart equal cells of two maps lie."""

from __future__ import annotations

import math
from typing import Final, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Comparison, ConfigError, Measurement, Step
from mapgraft_grid.grid_map import FREE, OCCUPIED, Classes, GridMap
from mapgraft_grid.kernels.taxicab import collect, joint_box, reach_beyond, taxicab
from mapgraft_grid.kernels.tile_keys import TILE, tile_x, tile_y
from mapgraft_grid.overlap import pair_of

Variant = Literal["sum", "mean", "pooled"]
Distances = NDArray[np.int32]  # (h, w) cells
Sums = NDArray[np.int64]  # (3, 3) row = class; columns = count, sum, trimmed sum
MARGIN: Final = 64  # cells around the joint box that are looked at first
MOST_SPARED: Final = 2  # where the whole map is at most so many times larger than that, all of it is looked at
_NOTHING = (np.zeros((3, 3), np.int64), np.zeros((3, 3), np.int64))

# A limit between right and wrong merges, from the averages of the paper's tables 1 to 3, where right merges agree in
# cells and wrong ones in metres whatever the resolution: their geometric mean, sqrt(cells · metres / resolution).
RIGHT_CELLS = {"own": 1.7, "merged": 0.9}
WRONG_M = {"own": 1.0, "merged": 0.33}


class Distance:
    """DM: the average L1 distance from the cells of one map to the nearest cell of the same class in the other.

    Of the jointly known cells of each class the distance to the nearest cell of that class in the other map is
    averaged, in both directions; that nearest cell may lie anywhere in the other map. The value is in cells of the
    receiver's grid and sums both classes and, with ``variant="sum"`` (the dissimilarity of Birk and Carpin 2006, and
    what the paper's tables fit), both directions; ``mean`` takes the mean of the two directions, ``pooled`` averages
    over the cells of both maps at once.

    The value is NaN while the maps have less than ``overlap_min_m2`` in common, or when a class is missing in one of
    them or in what they have in common. The support is the number of jointly known cells. Details: all three variants
    (``sum``, ``mean``, ``pooled``), ``occupied`` and ``free`` (the two parts of the chosen variant), ``metres`` (the
    value times the resolution), ``trimmed`` (the chosen variant with every distance cut at ``trim_m``),
    ``occupied_cells`` (of both maps, on which the occupied part rests), ``overlap_m2``, and ``limit``, which a right
    merge should keep.

    Source: Andersone 2021, section 3.3; A. Birk and S. Carpin, Merging occupancy grid maps from multiple robots,
    Proceedings of the IEEE 94 (2006).
    """

    def __init__(self, *, variant: Variant = "sum", overlap_min_m2: float = 1.0, trim_m: float = 1.0) -> None:
        if variant not in get_args(Variant):
            raise ConfigError(f"distance has the variants {', '.join(get_args(Variant))}, found {variant!r}")
        if not (0.0 <= overlap_min_m2 < math.inf and 0.0 < trim_m < math.inf):
            raise ConfigError(f"distance needs overlap_min_m2 >= 0 and trim_m > 0, found {overlap_min_m2} and {trim_m}")
        self.variant: Variant = variant
        self.overlap_min_m2 = overlap_min_m2
        self.trim_m = trim_m

    def track(self, comparison: Comparison) -> DistanceTracker:
        return DistanceTracker(comparison, self)


class DistanceTracker:
    """Measures the overlap and what is needed around it; the donor's distance maps are kept while it stays the same."""

    __slots__ = ("_comparison", "_donor", "_fields", "_metric", "_sums", "_target")

    def __init__(self, comparison: Comparison, metric: Distance) -> None:
        self._comparison = comparison
        self._metric = metric
        self._target: GridMap | None = None
        self._donor: GridMap | None = None
        self._fields: tuple[Distances, Distances] | None = None
        self._sums = _NOTHING

    def update(self, step: Step) -> Measurement:
        target, donor = pair_of(self._comparison, "distance")
        if donor is not self._donor:
            self._donor, self._target = donor, None
            self._fields = distance_maps(donor.dense().classes) if donor.known() else None
        if target is not self._target and self._fields is not None:
            trim = max(1, round(self._metric.trim_m / target.resolution_m))
            self._sums = sums_between(target, donor, self._fields, trim)
            self._target = target
        return _measurement(*self._sums, target.resolution_m, self._comparison.subject, self._metric)


def distance_maps(classes: Classes) -> tuple[Distances, Distances]:
    """L1 distances (h, w) in cells to the nearest free and to the nearest occupied cell; h + w where there is none."""
    far = sum(classes.shape)
    return taxicab(classes, FREE, far), taxicab(classes, OCCUPIED, far)


def sums_between(
    target: GridMap, donor: GridMap, donor_fields: tuple[Distances, Distances], trim: int
) -> tuple[Sums, Sums]:
    """Sums over the jointly known cells: of the target's to the donor's, and of the donor's to the target's.

    ``donor_fields`` are the distance maps over ``donor.dense()``, which hold all that the donor knows. The target is
    looked at in the joint box and, where a nearer cell may lie outside, that much around it: the result is exact. The
    distances of a class that one of them lacks in the joint box mean nothing.
    """
    box = _common_box(target, donor)
    if box is None:
        return _NOTHING
    left, bottom = donor.dense().origin_cell
    rows, columns = slice(box.y - bottom, box.y - bottom + box.height), slice(box.x - left, box.x - left + box.width)
    other = donor.dense().classes[rows, columns]
    margin = _first_margin(target, box)
    seen = _Surroundings.of(target, box, margin)
    if missing := reach_beyond(other, seen.classes, *seen.fields, seen.margins):
        seen = _Surroundings.of(target, box, margin + missing)
    ab = collect(seen.classes, other, donor_fields[0][rows, columns], donor_fields[1][rows, columns], trim)
    return ab, collect(other, seen.classes, *seen.fields, trim)


class _Box(NamedTuple):
    """A rectangle of cells: its lowest column and row, its size."""

    x: int
    y: int
    width: int
    height: int


class _Surroundings(NamedTuple):
    """A map in a box, with distances to what it knows in the box and ``margins`` cells around it."""

    classes: Classes
    fields: tuple[Distances, Distances]
    margins: tuple[int, int, int, int]  # left, below, right, above; everything where the map ends earlier

    @classmethod
    def of(cls, map_: GridMap, box: _Box, margin: int) -> _Surroundings:
        x0, y0, x1, y1 = map_.bounds_cells()
        right, top = box.x + box.width, box.y + box.height
        wide_x, wide_y = min(box.x, max(box.x - margin, x0)), min(box.y, max(box.y - margin, y0))
        wide_right, wide_top = max(right, min(right + margin, x1)), max(top, min(top + margin, y1))
        classes = map_.dense_over((wide_x, wide_y), (wide_top - wide_y, wide_right - wide_x)).classes
        fields = distance_maps(classes)
        rows, columns = slice(box.y - wide_y, top - wide_y), slice(box.x - wide_x, right - wide_x)
        ends = (wide_x <= x0, wide_y <= y0, wide_right >= x1, wide_top >= y1)
        left_m, below_m, right_m, above_m = (sum(classes.shape) if end else margin for end in ends)
        inside = fields[0][rows, columns], fields[1][rows, columns]
        return cls(classes[rows, columns], inside, (left_m, below_m, right_m, above_m))


def _first_margin(map_: GridMap, box: _Box) -> int:
    """Everything the map knows where that costs little more than the box, else ``MARGIN``."""
    x0, y0, x1, y1 = map_.bounds_cells()
    around = (box.width + 2 * MARGIN) * (box.height + 2 * MARGIN)
    return (x1 - x0) + (y1 - y0) if (x1 - x0) * (y1 - y0) <= MOST_SPARED * around else MARGIN


def _common_box(target: GridMap, donor: GridMap) -> _Box | None:
    """The smallest box around the cells known in both, or None."""
    shared = [key for key in donor.tiles if key in target.tiles]
    if not shared or not target.known():
        return None
    theirs = donor.dense()
    (left, bottom), (height, width) = theirs.origin_cell, theirs.classes.shape
    first_x, first_y = (max(TILE * min(map(of, shared)), low) for of, low in ((tile_x, left), (tile_y, bottom)))
    last_x = min(TILE * (max(map(tile_x, shared)) + 1), left + width)
    last_y = min(TILE * (max(map(tile_y, shared)) + 1), bottom + height)
    if last_x <= first_x or last_y <= first_y:
        return None
    own = target.dense_over((first_x, first_y), (last_y - first_y, last_x - first_x)).classes
    other = theirs.classes[first_y - bottom : last_y - bottom, first_x - left : last_x - left]
    top, near, end_row, end_column = joint_box(own, other)
    return _Box(first_x + near, first_y + top, end_column - near, end_row - top) if end_row else None


def _measurement(
    ab: Sums, ba: Sums, resolution_m: float, subject: Literal["own", "merged"], metric: Distance
) -> Measurement:
    known = int(ab[:, 0].sum())
    overlap_m2 = known * resolution_m**2
    enough = overlap_m2 >= metric.overlap_min_m2 and bool((ab[1:, 0] > 0).all() and (ba[1:, 0] > 0).all())
    parts = {v: _parts(v, ab, ba, 1) if enough else (math.nan, math.nan) for v in get_args(Variant)}
    free, occupied = parts[metric.variant]
    value = free + occupied
    details = {
        **{variant: sum(part) for variant, part in parts.items()},
        "occupied": occupied,
        "free": free,
        "metres": value * resolution_m,
        "trimmed": sum(_parts(metric.variant, ab, ba, 2)) if enough else math.nan,
        "occupied_cells": float(ab[OCCUPIED, 0] + ba[OCCUPIED, 0]),
        "overlap_m2": overlap_m2,
        "limit": math.sqrt(RIGHT_CELLS[subject] * WRONG_M[subject] / resolution_m),
    }
    return Measurement("distance", value, "cells", known, "lower", details)


def _parts(variant: Variant, ab: Sums, ba: Sums, column: int) -> tuple[float, float]:
    """The free and the occupied part, from the sums in that column."""
    free, occupied = (_average(variant, ab[c], ba[c], column) for c in (FREE, OCCUPIED))
    return free, occupied


def _average(variant: Variant, ab: NDArray[np.int64], ba: NDArray[np.int64], column: int) -> float:
    if variant == "pooled":
        return int(ab[column] + ba[column]) / int(ab[0] + ba[0])
    both = int(ab[column]) / int(ab[0]) + int(ba[column]) / int(ba[0])
    return both if variant == "sum" else both / 2.0

"""Point landmarks in one planar scan: narrow things that stand free, seen in front of something farther away."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Points, Scan, Transform
from mapgraft_landmarks.cells import Keys, keys_at

_FULL_CIRCLE_GAP = 1.5  # a scan is closed when its first and last beam lie at most this many beam steps apart
_FACE_DEPTH = np.pi / 8.0  # mean depth of the visible half of a round pole before its axis, over its diameter


@dataclass(frozen=True, slots=True)
class Extraction:
    """What counts as a landmark. All lengths in metres.

    A landmark is a run of at least ``beams_min`` neighbouring beams that end within ``range_m`` on something not wider
    than ``width_m``, while the beams on both sides of the run go on for at least ``clear_m`` more.
    """

    width_m: float
    clear_m: float
    range_m: float
    beams_min: int


def landmarks_in(scan: Scan, T_map_sensor: Transform, extraction: Extraction) -> Points:
    """Axes of the narrow free-standing things in the scan: (n, 2) metres in the map frame, in order of bearing.

    Beams may come in any order; a beam that says nothing beside a run leaves the run undecided, hence out.
    """
    order, closed = _by_bearing(scan.directions)
    ranges = scan.ranges_m[order].astype(np.float64)
    origins, ends = _beams_in_map(scan, T_map_sensor, order)
    near = scan.hits[order] & (ranges <= extraction.range_m)
    linked = _links(ends, near, extraction.clear_m, closed)
    if linked.all():
        return np.empty((0, 2))
    first = int(np.flatnonzero(~linked)[0]) + 1  # start behind a break: no run crosses the end of the arrays
    turned = np.roll(np.arange(len(ranges)), -first)
    ranges, near, linked = ranges[turned], near[turned], linked[turned]
    origins, ends = origins[turned], ends[turned]
    breaks = np.flatnonzero(~linked)
    starts = np.concatenate(([0], breaks[:-1] + 1))
    # The seam of an open scan lies wherever the roll has put it: the beams on its two sides are no neighbours.
    seam = None if closed else (len(ranges) - first) % len(ranges)
    found = [
        _axis(origins[a : b + 1], ends[a : b + 1])
        for a, b in zip(starts, breaks, strict=True)
        if near[a] and _stands_free(ranges, ends, int(a), int(b), seam, extraction)
    ]
    return np.array(found).reshape(-1, 2)


def cells_looked_at(scan: Scan, T_map_sensor: Transform, extraction: Extraction, cell_m: float) -> Keys:
    """Cells in which this scan would have shown a landmark: crossed by a beam that goes on for ``clear_m`` more."""
    rays = scan.rays(T_map_sensor)
    along = rays.ends_m - rays.origins_m
    lengths = np.hypot(along[:, 0], along[:, 1])
    reach = np.minimum(lengths - extraction.clear_m, extraction.range_m)
    useful = reach > 0
    unit = along[useful] / lengths[useful, None]
    origins = np.broadcast_to(rays.origins_m, along.shape)[useful]
    steps = np.arange(cell_m / 4, extraction.range_m, cell_m / 2)  # twice per cell: no crossed cell of note is missed
    points = origins[:, None] + unit[:, None] * steps[:, None]
    return np.unique(keys_at(points[steps[None, :] < reach[useful, None]], cell_m))


def _by_bearing(directions: NDArray[np.float64]) -> tuple[NDArray[np.intp], bool]:
    """The order of the beams by bearing, and whether they close a full circle."""
    bearings = np.arctan2(directions[:, 1], directions[:, 0])
    order = np.argsort(bearings, kind="stable")
    if len(order) < 3:
        return order, False
    steps = np.diff(bearings[order])
    gap = bearings[order[0]] + 2.0 * np.pi - bearings[order[-1]]
    return order, bool(gap <= _FULL_CIRCLE_GAP * np.median(steps))


def _beams_in_map(scan: Scan, T_map_sensor: Transform, order: NDArray[np.intp]) -> tuple[Points, Points]:
    """Origins and ends (n, 2) of all beams in the given order; NaN for beams that say nothing."""
    rays = scan.rays(T_map_sensor)
    valid = ~np.isnan(scan.ranges_m)
    origins, ends = np.full((len(valid), 2), np.nan), np.full((len(valid), 2), np.nan)
    origins[valid], ends[valid] = rays.origins_m, rays.ends_m
    return origins[order], ends[order]


def _links(ends: Points, near: NDArray[np.bool_], jump_m: float, closed: bool) -> NDArray[np.bool_]:
    """Whether beam i and the next one end on the same thing; the last one's next is the first."""
    after = np.roll(ends, -1, axis=0)
    close = np.hypot(*(after - ends).T) <= jump_m  # False for NaN
    linked: NDArray[np.bool_] = near & np.roll(near, -1) & close
    linked[-1] &= closed
    return linked


def _stands_free(
    ranges: NDArray[np.float64], ends: Points, a: int, b: int, seam: int | None, extraction: Extraction
) -> bool:
    """Whether the run from beam a to b is narrow, and clearly in front of its neighbours on both sides."""
    if b - a + 1 < extraction.beams_min or np.hypot(*(ends[b] - ends[a])) > extraction.width_m:
        return False
    n = len(ranges)
    if seam is not None and (a == seam or (b + 1) % n == seam):
        return False  # a run at the rim of the scan may go on outside it
    left, right = ranges[a - 1], ranges[(b + 1) % n]
    return bool(left >= ranges[a] + extraction.clear_m and right >= ranges[b] + extraction.clear_m)


def _axis(origins: Points, ends: Points) -> NDArray[np.float64]:
    """Where the axis of a round pole stands of which these beams saw the near side."""
    face, seen_from = ends.mean(axis=0), origins.mean(axis=0)
    width = np.hypot(*(ends[-1] - ends[0])) * len(ends) / (len(ends) - 1)  # half a beam more on each side
    view = face - seen_from
    axis: NDArray[np.float64] = face + view * (_FACE_DEPTH * width / np.hypot(*view))
    return axis

"""What one scan tells: pieces of walls with their information, and the cells it looked through."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError, Observation, Rays, Scan
from mapgraft_lines.kernels import casting, extracting
from mapgraft_lines.kernels.keys import LIMIT
from mapgraft_lines.layer import SPACE_COLUMNS, Evidence
from mapgraft_lines.segments import pieces_of
from mapgraft_lines.table import Table

INCIDENCE_RAD: Final = math.radians(10.0)  # a wall seen under less is not followed from beam to beam
SCATTERED_M: Final = 50.0  # the origins of one scan's beams lie no further apart


@dataclass(frozen=True, slots=True)
class SensorModel:
    """How scans are read. Lengths in metres, angles in radians.

    ``range_sigma_m`` is the noise of a range; ``pose_sigma_m`` and ``pose_sigma_rad`` that of the pose of one scan in
    its map. Points farther than ``split_m`` from the chord split a segment, whose points lie within ``across_m`` (root
    mean square) of its line; it has ``points_min`` points and is ``length_min_m`` long at least. ``jump_m`` apart, two
    neighbouring points are never on one wall. Beams reach ``max_range_m``; one without return is free to
    ``free_range_m``.
    """

    range_sigma_m: float = 0.02
    pose_sigma_m: float = 0.03
    pose_sigma_rad: float = math.radians(0.3)
    split_m: float = 0.08
    across_m: float = 0.05
    length_min_m: float = 0.3
    points_min: int = 4
    jump_m: float = 0.5
    max_range_m: float = 30.0
    free_range_m: float = 5.0


class ScanSegments(NamedTuple):
    """Segments of one scan in the map frame.

    ``ends`` (n, 4) x0, y0, x1, y1, the sensor on the left; ``variance`` (n, 5) as ``kernels.chopping`` takes it: with
    it the covariance of offset and angle, where the pose of the scan is uncertain, too.
    """

    ends: NDArray[np.float64]
    variance: NDArray[np.float64]


def segments_in(rays: Rays, model: SensorModel) -> ScanSegments:
    """The segments in the beams of one scan, which come in their order."""
    origins = np.ascontiguousarray(rays.origins_m)
    ends = np.ascontiguousarray(rays.ends_m)
    usable = rays.hits & (np.hypot(*(ends - origins).T) <= model.max_range_m)
    order, starts = extracting.break_up(origins, ends, usable, INCIDENCE_RAD, model.jump_m, model.range_sigma_m)
    places = origins[order] if len(origins) > 1 else np.repeat(origins, len(order), axis=0)
    found, variances, along = extracting.extract(
        ends[order],
        places,
        starts,
        model.split_m,
        model.across_m,
        model.length_min_m,
        model.points_min,
        model.range_sigma_m,
    )
    # across the wall: of the fit, and of the pose, whose turn moves what lies farther along the wall the more
    variance = np.zeros((len(found), 5))
    variance[:, 0] = variances[:, 0] + model.pose_sigma_m**2
    variance[:, 1], variance[:, 2] = variances[:, 1], along[:, 0]
    variance[:, 3], variance[:, 4] = model.pose_sigma_rad**2, along[:, 1]
    return ScanSegments(found, variance)


def evidence_of(observation: Observation, scan: Scan, model: SensorModel, cell_m: float) -> Evidence:
    """What one scan tells; raises MapError when its beams are not finite or out of reach."""
    rays = scan.rays(observation.T_map_sensor)
    _require_reach(rays, cell_m, observation)
    if not len(rays.ends_m):
        return Evidence()
    found = segments_in(rays, model)
    once = np.ones(len(found.ends), np.int64)
    pieces = pieces_of(found.ends, np.ones(len(found.ends), np.bool_), found.variance, once, cell_m)
    # a beam tells of whole cells: up to a cell before its end, so that no cell with the wall in it seems free
    keys = casting.cast(
        np.ascontiguousarray(rays.origins_m),
        np.ascontiguousarray(rays.ends_m),
        np.ascontiguousarray(rays.hits),
        cell_m,
        model.max_range_m,
        model.free_range_m,
        cell_m,
    )
    return Evidence(pieces, Table(keys, np.ones((len(keys), SPACE_COLUMNS), np.int64)))


def _require_reach(rays: Rays, cell_m: float, observation: Observation) -> None:
    farthest = (LIMIT - 4) * cell_m
    for points in (rays.origins_m, rays.ends_m):
        if points.size and not np.abs(points).max() < farthest:
            raise MapError(
                f"a scan of {observation.robot} reaches beyond ±{farthest:.0f} m or is not finite: check its pose"
            )
    if np.ptp(rays.origins_m, axis=0).max(initial=0.0) > SCATTERED_M:
        raise MapError(f"the beams of one scan of {observation.robot} start too far from each other: check their poses")

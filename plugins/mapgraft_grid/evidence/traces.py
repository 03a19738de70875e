"""What beams and paths say of a placement: nobody looks through walls, and nobody drives through them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final, NamedTuple

from mapgraft.contracts import Anew, Comparison, MapError, Measurement
from mapgraft_grid.evidence.joint import TOLERANCE_M, Distances, Joint, joint_of
from mapgraft_grid.grid_map import Classes
from mapgraft_grid.kernels import standing
from mapgraft_grid.layer import GridLayer

STEP_MAX_M: Final = 1.5  # between two kept poses: beyond it nobody knows where the robot drove


class Beams(NamedTuple):
    """Beams of both robots seen in the other's map: ended at a wall, ended in free space, went through a wall."""

    stood: int
    free_end: int
    through: int

    @property
    def support(self) -> int:
        return self.stood + self.free_end + self.through


class Steps(NamedTuple):
    """Cells of the other's map on the paths of both robots: walls, and all that are known."""

    walls: int
    known: int


class Rays:
    """The share of beams that contradict the other map: those that went through a wall of it or ended in its free
    space, among all that say something; both robots' beams in the other's map.

    Of either robot only the beams count that travel with its layer. The value is NaN, with a support of 0, when there
    are none: rays that were not sent are no agreement. Details: ``stood``, ``free_end`` and ``through`` (beams).
    """

    def track(self, comparison: Comparison) -> Anew:
        return Anew(comparison, _rays)


class Paths:
    """How many occupied cells of the other map (about 0.1 m) the two robots drove through; if right, almost none.

    The value is NaN when neither path leads through what the other map knows; the support is the number of known cells
    on the paths.
    """

    def track(self, comparison: Comparison) -> Anew:
        return Anew(comparison, _paths)


def _rays(comparison: Comparison) -> Measurement:
    found = beams_of(comparison, "rays")
    value = (found.free_end + found.through) / found.support if found.support else math.nan
    details = {name: float(count) for name, count in found._asdict().items()}
    return Measurement("rays", value, "1", found.support, "lower", details)


def _paths(comparison: Comparison) -> Measurement:
    found = steps_of(comparison, "paths")
    return Measurement("paths", float(found.walls) if found.known else math.nan, "cells", found.known, "lower")


def beams_of(comparison: Comparison, metric: str) -> Beams:
    """Both robots' beams in the other's map."""
    joint = joint_of(comparison, metric)
    counts = [0, 0, 0]
    for layer, classes, to_wall_m in _sides(comparison, joint, metric):
        rays = layer.rays()
        if not len(rays.ends_m):
            continue
        origins, ends = joint.cells(rays.origins_m), joint.cells(rays.ends_m)
        found = standing.beams(classes, to_wall_m, origins, ends, rays.hits, joint.unit_m, TOLERANCE_M)
        counts = [a + b for a, b in zip(counts, found.tolist(), strict=True)]
    return Beams(counts[standing.STOOD], counts[standing.FREE_END], counts[standing.THROUGH])


def steps_of(comparison: Comparison, metric: str) -> Steps:
    """Both robots' paths in the other's map."""
    joint = joint_of(comparison, metric)
    walls = known = 0
    for layer, classes, _ in _sides(comparison, joint, metric):
        path = layer.path()
        if len(path):
            found = standing.steps(classes, joint.cells(path[:, :2]), STEP_MAX_M / joint.unit_m)
            walls, known = walls + int(found[0]), known + int(found[1])
    return Steps(walls, known)


def _sides(comparison: Comparison, joint: Joint, metric: str) -> Iterator[tuple[GridLayer, Classes, Distances]]:
    """Each layer with what the other map knows."""
    pairs = (
        (comparison.target_layer, joint.donor, joint.to_donor_m),
        (comparison.donor_layer, joint.own, joint.to_own_m),
    )
    for layer, classes, to_wall_m in pairs:
        if not isinstance(layer, GridLayer):
            raise MapError(f"{metric} looks at the traces of occupancy grids, found a layer of {layer.map_type!r}")
        yield layer, classes, to_wall_m

"""The walls of one source, in fixed point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Layer, Map, MapError
from mapgraft_floorplan.plan import NAME, Segments
from mapgraft_floorplan.region import PlanRegion, Rows, keys_of, rows_of

STEP_M: Final = 2.0**-10  # fixed point of a position
FARTHEST: Final = 1 << 30  # steps: about a thousand kilometres

Counts = NDArray[np.int32]  # (n,) how many sources say a piece of wall


@dataclass(frozen=True, slots=True, eq=False)
class Walls:
    """Pieces of wall in canonical order, and how often each is told; both read-only.

    ``rows`` (n, 4) int32 in steps of 2⁻¹⁰ m, the lesser end first, each once, ascending; ``counts`` (n,) int32.
    """

    rows: Rows
    counts: Counts

    def __post_init__(self) -> None:
        self.rows.setflags(write=False)
        self.counts.setflags(write=False)

    @classmethod
    def empty(cls) -> Walls:
        return cls(np.empty((0, 4), np.int32), np.empty(0, np.int32))

    @classmethod
    def of_steps(cls, steps: NDArray[np.int64]) -> Walls:
        """Pieces (n, 4) told once each; those that are points, or the same as another, are left out.

        Raises MapError when one lies too far out.
        """
        if steps.size and np.abs(steps).max() > FARTHEST:
            raise MapError(f"a floor plan reaches ±{FARTHEST * STEP_M:.0f} m, found walls farther out: check its unit")
        rows = steps.astype(np.int32)
        turned = (rows[:, 0] > rows[:, 2]) | ((rows[:, 0] == rows[:, 2]) & (rows[:, 1] > rows[:, 3]))
        rows[turned] = rows[turned][:, [2, 3, 0, 1]]
        rows = rows[(rows[:, :2] != rows[:, 2:]).any(axis=1)]
        unique = rows_of(np.unique(keys_of(rows)))
        return cls(unique, np.ones(len(unique), np.int32))

    @classmethod
    def of_metres(cls, segments_m: Segments) -> Walls:
        return cls.of_steps(np.round(segments_m / STEP_M).astype(np.int64))

    def plus(self, other: Walls) -> Walls:
        """What both tell together."""
        if not len(other.rows):
            return self
        keys = np.concatenate((keys_of(self.rows), keys_of(other.rows)))
        counts = np.concatenate((self.counts, other.counts))
        unique, inverse = np.unique(keys, return_inverse=True)
        summed = np.zeros(len(unique), np.int64)
        np.add.at(summed, inverse.ravel(), counts)
        return Walls(rows_of(unique), summed.astype(np.int32))

    def without(self, region: PlanRegion) -> Walls:
        kept = ~np.isin(keys_of(self.rows), keys_of(region.rows))
        return Walls(self.rows[kept], self.counts[kept])

    @property
    def segments_m(self) -> Segments:
        """(n, 4) x0, y0, x1, y1 in metres."""
        found: Segments = self.rows.astype(np.float64) * STEP_M
        return found

    def bounds_m(self) -> tuple[float, float, float, float] | None:
        if not len(self.rows):
            return None
        ends = self.segments_m.reshape(-1, 2)
        (x0, y0), (x1, y1) = ends.min(axis=0).tolist(), ends.max(axis=0).tolist()
        return x0, y0, x1, y1

    def length_m(self) -> float:
        """The length of all pieces together."""
        s = self.segments_m
        return float(np.hypot(s[:, 2] - s[:, 0], s[:, 3] - s[:, 1]).sum())


class PlanLayer:
    """The walls of one source in its own frame, and those that were baked in from others.

    Only ``FloorPlanType`` writes it. ``observations`` counts the versions of the plan that were read, ``sensors`` names
    the files or topics they came from.
    """

    __slots__ = ("__weakref__", "absorbed", "observations", "scale_known", "sensors", "walls")

    def __init__(
        self,
        walls: Walls | None = None,
        absorbed: Walls | None = None,
        scale_known: bool = True,
        observations: int = 0,
        sensors: frozenset[str] = frozenset(),
    ) -> None:
        self.walls = Walls.empty() if walls is None else walls
        self.absorbed = Walls.empty() if absorbed is None else absorbed
        self.scale_known = scale_known
        self.observations = observations
        self.sensors = sensors

    @property
    def map_type(self) -> str:
        return NAME

    @property
    def told(self) -> Walls:
        """All walls: its own, and those baked in."""
        return self.walls.plus(self.absorbed)


@dataclass(frozen=True, slots=True, eq=False)
class PlanMap:
    """The walls of one or several sources at one moment, immutable."""

    walls: Walls
    scale_known: bool

    @property
    def map_type(self) -> str:
        return NAME

    def known(self) -> int:
        """How many pieces of wall there are."""
        return len(self.walls.rows)


def as_layer(layer: Layer) -> PlanLayer:
    if not isinstance(layer, PlanLayer):
        raise MapError(f"a floor plan was expected, found a layer of type {layer.map_type!r}: convert it first")
    return layer


def as_map(map_: Map) -> PlanMap:
    if not isinstance(map_, PlanMap):
        raise MapError(f"a floor plan was expected, found a map of type {map_.map_type!r}: convert it first")
    return map_

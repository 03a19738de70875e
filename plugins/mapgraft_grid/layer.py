"""The evidence of one source on a grid."""

from __future__ import annotations

from mapgraft.contracts import Rays
from mapgraft_grid.parameters import Lattice, SensorModel, TraceLimits
from mapgraft_grid.tiles import TilePool
from mapgraft_grid.traces import Path, Traces

NAME = "occupancy_grid"
FROM_SCANS = "scans"
READY_MADE = "ready map"


class GridLayer:
    """Hits and misses of one source in its own frame, with its sensor model and its traces.

    Only ``OccupancyGrid`` writes it. ``observations`` counts what was integrated, ``sensors`` names what saw it,
    ``mapper`` is ``scans``, ``ready map`` or empty before the first observation.
    """

    __slots__ = (
        "__weakref__",
        "lattice",
        "mapper",
        "observations",
        "pool",
        "sensor_model",
        "sensors",
        "spread",
        "traces",
        "version",
    )

    def __init__(self, lattice: Lattice, sensor_model: SensorModel, limits: TraceLimits) -> None:
        self.lattice = lattice
        self.sensor_model = sensor_model
        self.pool = TilePool()
        self.traces = Traces(limits)
        self.observations = 0
        self.sensors: frozenset[str] = frozenset()
        self.mapper = ""
        self.spread: tuple[int, int, int, int] | None = None  # tiles that scans have reached: x0, y0, x1, y1
        self.version = 0  # counts every change, so that what was computed from the layer can be kept

    @property
    def map_type(self) -> str:
        return NAME

    def most_looks(self) -> int:
        """The most hits or misses of any cell; what was baked in is not counted."""
        return self.pool.most()

    def path(self) -> Path:
        """Where the body was: (n, 3) float64 x, y (m), yaw (rad) in the layer's frame, in the order driven."""
        return self.traces.path(self.lattice)

    def rays(self) -> Rays:
        """A bounded sample of the beams, in the layer's frame, in canonical order."""
        return self.traces.rays(self.lattice)

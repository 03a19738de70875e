"""The map type ``occupancy_grid``."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mapgraft.contracts import GRID_MESSAGE, SCAN, Contribution, Layer, Map, MapError, Observation, Region, Scan
from mapgraft_grid.foreign import Applications, own_evidence
from mapgraft_grid.grid_map import GridMap
from mapgraft_grid.kernels import rays, sketch, viewing
from mapgraft_grid.layer import FROM_SCANS, NAME, GridLayer
from mapgraft_grid.parameters import (
    CELL_LIMIT,
    Lattice,
    SensorModel,
    Thresholds,
    TraceLimits,
    in_fixed_point,
    log_odds,
    require,
)
from mapgraft_grid.region import GridRegion
from mapgraft_grid.tile_tree import Tile, TileTree

_NO_BEAM_POSES = np.zeros((0, 3))


class OccupancyGrid:
    """Occupancy grids of hits and misses per cell.

    ``l_hit`` and ``l_miss`` (nats) are the evidence of one hit and one miss (OctoMap's values), ``clamp`` (nats) bounds
    what a reader sees. A cell is occupied above the probability ``occupied``, free below ``free`` (map_server's
    values). Beams are used up to ``max_range_m``; a beam without return frees at most ``free_range_m`` (Cartographer's
    values). Raises ConfigError on an impossible value.
    """

    def __init__(
        self,
        *,
        resolution_m: float = 0.05,
        l_hit: float = 0.85,
        l_miss: float = -0.41,
        clamp: float = 5.0,
        occupied: float = 0.65,
        free: float = 0.196,
        max_range_m: float = 30.0,
        free_range_m: float = 5.0,
        rays_per_tile: int = 64,
        poses_per_tile: int = 256,
    ) -> None:
        require(
            0 < resolution_m < math.inf, f"resolution_m must be above 0, found {resolution_m}: give metres per cell"
        )
        require(0 < l_hit <= 10, f"l_hit must lie in (0, 10] nats, found {l_hit}")
        require(-10 <= l_miss < 0, f"l_miss must lie in [-10, 0) nats, found {l_miss}")
        require(0 < free < occupied < 1, f"free < occupied must be probabilities, found {free} and {occupied}")
        self._lattice = Lattice(resolution_m)
        self._sensor_model = SensorModel(in_fixed_point(l_hit), in_fixed_point(l_miss))
        self.thresholds = Thresholds(
            in_fixed_point(log_odds(occupied)), in_fixed_point(log_odds(free)), in_fixed_point(clamp)
        )
        self._reach = (max_range_m, free_range_m)
        self._limits = TraceLimits(rays_per_tile, poses_per_tile)
        self._applications = Applications()

    @property
    def name(self) -> str:
        return NAME

    def new_layer(self) -> GridLayer:
        return GridLayer(self._lattice, self._sensor_model, self._limits)

    def integrate(self, layer: Layer, observation: Observation) -> GridRegion:
        grid = _grid(layer)
        if isinstance(observation.payload, Scan):
            return self._integrate_scan(grid, observation, observation.payload)
        raise MapError(
            f"an occupancy grid is made from {SCAN} or {GRID_MESSAGE}, found {observation.kind!r} of "
            f"{observation.robot}: choose another map type for this robot"
        )

    def view(
        self,
        own: Layer | None,
        contributions: Sequence[Contribution] = (),
        previous: Map | None = None,
        touched: Region | None = None,
    ) -> GridMap:
        layer = self.new_layer() if own is None else _grid(own)
        foreign = self._applications.total(layer.lattice, contributions)
        if isinstance(previous, GridMap) and isinstance(touched, GridRegion) and previous.lattice == layer.lattice:
            keys, tiles, known = touched.keys, previous.tiles, previous.known()
        else:
            keys, tiles, known = np.union1d(layer.pool.index.keys, foreign.index.keys), TileTree(), 0
        evidence = own_evidence(layer, layer.pool.index.find(keys))
        values = np.empty(evidence.shape, np.int16)
        counts = np.empty(keys.size, np.int32)
        limits = self.thresholds
        viewing.read(
            evidence,
            foreign.index.find(keys),
            foreign.tiles,
            limits.clamp,
            limits.free,
            limits.occupied,
            values,
            counts,
        )
        changes: dict[int, Tile | None] = {}
        for key, value, count in zip(keys.tolist(), values, counts.tolist(), strict=True):
            before = tiles.get(key)
            known += max(count, 0) - (before.known if before else 0)
            if count < 0:
                changes[key] = None
            else:
                cells = value.copy()
                cells.setflags(write=False)
                changes[key] = Tile(cells, count)
        return GridMap(layer.lattice, limits, tiles.changed(changes), known)

    def _integrate_scan(self, layer: GridLayer, observation: Observation, scan: Scan) -> GridRegion:
        lattice = layer.lattice
        beams = np.empty((scan.ranges_m.size, 4))
        kinds = np.empty(scan.ranges_m.size, np.uint8)
        poses = _NO_BEAM_POSES if scan.T_sensor_beam is None else scan.T_sensor_beam
        status, keys, free, hit = rays.cast(
            scan.directions,
            scan.ranges_m,
            scan.hits,
            poses,
            observation.T_map_sensor.matrix,
            (lattice.resolution_m, *lattice.anchor_m),
            self._reach,
            beams,
            kinds,
        )
        if status != rays.OK:
            raise MapError(
                f"a scan of {observation.robot} reaches beyond ±{CELL_LIMIT} cells or is not finite: check its pose"
            )
        layer.pool.count(keys, free, hit)
        layer.traces.insert_rays(*sketch.pick(scan.directions, beams, kinds, self._limits.beam_step_rad))
        layer.traces.add_pose(observation.T_map_base, layer.observations, lattice)
        layer.mapper = FROM_SCANS
        layer.sensors |= {observation.sensor}
        layer.observations += 1
        layer.version += 1
        return GridRegion(lattice, keys, free | hit)


def _grid(layer: Layer) -> GridLayer:
    if not isinstance(layer, GridLayer):
        raise MapError(f"an occupancy grid cannot use a layer of type {layer.map_type}: convert it first")
    return layer

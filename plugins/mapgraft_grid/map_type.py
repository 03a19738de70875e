"""The map type ``occupancy_grid``: everything the engine asks of it, in one place."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

import numpy as np

from mapgraft.contracts import (
    GRID_MESSAGE,
    SCAN,
    ConfigError,
    Contribution,
    EmptyMapError,
    GridMessage,
    Layer,
    Map,
    MapError,
    MapMetadata,
    Observation,
    OutputMessage,
    Points,
    Region,
    Reset,
    Scan,
    Transform,
)
from mapgraft_grid import baking, codec, cutting, map_server, observing, placing, views
from mapgraft_grid.foreign import Applications
from mapgraft_grid.grid_map import GridMap
from mapgraft_grid.layer import NAME, GridLayer
from mapgraft_grid.parameters import (
    COARSEST_M,
    FINEST_M,
    LOG_ODDS_PER_NAT,
    Lattice,
    SensorModel,
    Thresholds,
    TraceLimits,
    in_fixed_point,
    log_odds,
)
from mapgraft_grid.region import GridRegion
from mapgraft_grid.structure import known_at, known_cells, occupied_centres

_MOST_NATS: Final = 10.0  # of one look: 65 535 of them fit the evidence of one source
_MOST_CLAMP: Final = 31.0  # nats: what fits int16
_LONGEST_BEAM: Final = 1 << 19  # cells
_MOST_TRACES: Final = 4096  # per tile


class OccupancyGrid:
    """Occupancy grids that count hits and misses per cell, one update per cell and scan, a hit winning over a miss.

    ``l_hit`` and ``l_miss`` (nats) are the evidence of one hit and one miss (OctoMap's values). ``clamp`` (nats) bounds
    what a reader sees; nothing is clamped when writing. A cell is occupied above the probability ``occupied`` and free
    below ``free`` (map_server's values). A beam that returned from within ``max_range_m`` hits the cell it ends in; any
    other beam is free up to its range, ``free_range_m`` or ``max_range_m``, whichever is least (Cartographer's values).
    Of beams and poses a layer keeps at most ``rays_per_tile`` and ``poses_per_tile``, one beam per ``beam_step_deg``,
    one pose per ``path_step_m`` or ``path_step_deg``.

    An instance whose first observation is a ready-made map takes its lattice, and places others' layers and later maps
    on it.
    Raises ConfigError on an impossible value.
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
        beam_step_deg: float = 5.0,
        path_step_m: float = 0.1,
        path_step_deg: float = 5.0,
    ) -> None:
        self._lattice = Lattice(_within("resolution_m", resolution_m, FINEST_M, COARSEST_M))
        self._sensor_model = SensorModel(
            in_fixed_point(_within("l_hit", l_hit, 1 / LOG_ODDS_PER_NAT, _MOST_NATS)),
            in_fixed_point(_within("l_miss", l_miss, -_MOST_NATS, -1 / LOG_ODDS_PER_NAT)),
        )
        self.thresholds = _thresholds(occupied, free, clamp)
        far_m = _reach("max_range_m", max_range_m, resolution_m)
        self._reach_m = (far_m, min(far_m, _reach("free_range_m", free_range_m, resolution_m)))
        self._limits = TraceLimits(
            _whole("rays_per_tile", rays_per_tile, _MOST_TRACES),
            _whole("poses_per_tile", poses_per_tile, _MOST_TRACES),
            math.radians(_within("beam_step_deg", beam_step_deg, 0.0, 360.0)),
            _within("path_step_m", path_step_m, 0.0, 1e6),
            math.radians(_within("path_step_deg", path_step_deg, 0.0, 360.0)),
        )
        self._adopts = True  # the lattice of a ready-made map, as long as nothing was observed
        self._applications = Applications()

    @property
    def name(self) -> str:
        return NAME

    @property
    def resolution_m(self) -> float:
        """The side of the cells on which other layers are placed."""
        return self._lattice.resolution_m

    @property
    def reach_m(self) -> tuple[float, float]:
        """How far a beam counts that hit something, and one that did not."""
        return self._reach_m

    def new_layer(self) -> GridLayer:
        return GridLayer(self._lattice, self._sensor_model, self._limits)

    def integrate(self, layer: Layer, observation: Observation) -> GridRegion:
        """Count a scan, or take a ready-made map in the place of what was there; never both in one layer.

        Raises MapError on anything else, and on positions that are not finite or beyond ±2³⁰ cells; the layer is then
        as before.
        """
        grid, payload = _grid(layer), observation.payload
        if isinstance(payload, Scan):
            self._adopts = False
            return observing.add_scan(grid, observation, payload, self._reach_m)
        if isinstance(payload, GridMessage):
            adopt = self._adopts and not grid.mapper and not len(grid.pool.index)
            region = observing.replace_content(grid, observation, payload, self.thresholds, adopt)
            self._adopts, self._lattice = False, grid.lattice if adopt else self._lattice
            return region
        raise MapError(
            f"an occupancy grid is made from a {SCAN} or a {GRID_MESSAGE}, found a {observation.kind} of "
            f"{observation.robot}: choose another map type for this robot"
        )

    def view(
        self,
        own: Layer | None,
        contributions: Sequence[Contribution] = (),
        previous: Map | None = None,
        touched: Region | None = None,
    ) -> GridMap:
        """Own evidence plus, for each contribution, the donor's times the weight of the tile; then clamped.

        In a tile of weight 0 the donor's evidence counts once in the cells of ``fill`` and not at all in the others.
        Raises MapError when a contribution does not lie on the own layer's lattice.
        """
        layer = self.new_layer() if own is None else _grid(own)
        foreign = self._applications.total(layer.lattice, contributions)
        if (
            isinstance(previous, GridMap)
            and isinstance(touched, GridRegion)
            and previous.lattice == layer.lattice
            and (touched.lattice == layer.lattice or not touched.keys.size)
            and previous.thresholds == self.thresholds
        ):
            return views.updated(previous, layer, foreign, touched.keys)
        return views.fresh(layer, foreign, self.thresholds)

    def place(self, layer: Layer, T_receiver_donor: Transform, scale: float = 1.0) -> GridLayer:
        """The layer's counts and traces on this instance's lattice; ``resampler`` names the rule.

        On cells as fine or finer, each takes the counts of the donor's cell at its centre. On coarser cells every donor
        cell goes where its centre lies, occupied ones win, and free ones are averaged. Integer arithmetic throughout.
        Raises EmptyMapError when there is nothing to place.
        """
        return placing.place(_grid(layer), T_receiver_donor, scale, self._lattice, self.thresholds)

    def resampler(self, layer: Layer, scale: float = 1.0) -> str:
        """What ``Contribution.resampler`` says of a layer placed by this instance."""
        return placing.resampler(_grid(layer).lattice.resolution_m, self.resolution_m, scale)

    def absorb(self, layer: Layer, contribution: Contribution) -> GridRegion:
        grid = _grid(layer)
        return baking.absorb(grid, self._applications.one(grid.lattice, contribution))

    def reset(self, layer: Layer, foreign: Region, keep: Region) -> Reset:
        return baking.reset(_grid(layer), _region(foreign), _region(keep))

    def region(self, layer: Layer) -> GridRegion:
        return baking.touched(_grid(layer))

    def known_region(self, map_: Map) -> GridRegion:
        return known_cells(_map(map_))

    def encode(self, layer: Layer) -> bytes:
        return codec.encode(_grid(layer))

    def decode(self, data: bytes) -> GridLayer:
        return codec.decode(data)

    def parts(self, layer: Layer) -> Mapping[bytes, bytes]:
        """By tile: counts, what was baked in, rays, poses; and once what there is to say of all."""
        return cutting.cut(_grid(layer))

    def join(self, parts: Mapping[bytes, bytes]) -> GridLayer:
        return cutting.join(parts)

    def preview(self, layer: Layer) -> GridLayer:
        """What this instance sees in the layer: one look at every known cell, without beams and poses."""
        return cutting.preview(_grid(layer), self.view(layer))

    def metadata(self, layer: Layer) -> MapMetadata:
        grid = _grid(layer)
        seen = self.view(grid)
        bounds_m = None
        if not seen.is_empty:
            x0, y0, x1, y1 = seen.bounds_cells()
            bounds_m = (*grid.lattice.corner_m(x0, y0), *grid.lattice.corner_m(x1, y1))
        traces = (("rays",) if grid.traces.has_rays else ()) + (("path",) if grid.traces.last else ())
        return MapMetadata(
            type=NAME,
            resolution_m=grid.lattice.resolution_m,
            bounds_m=bounds_m,
            known_area_m2=seen.known() * grid.lattice.resolution_m**2,
            observations=grid.observations,
            sensor=", ".join(sorted(grid.sensors)),
            mapper=grid.mapper,
            quality=_quality(seen),
            can_send=("counts", *traces),
        )

    def structure(self, map_: Map, within: Map | None = None) -> Points:
        """The centres of occupied cells (n, 2); ``within`` may have another resolution."""
        centres = occupied_centres(_map(map_))
        return centres if within is None else centres[known_at(_map(within), centres)]

    def messages(self, map_: Map) -> Iterable[OutputMessage]:
        """One ``nav_msgs/msg/OccupancyGrid`` of the known cells: -1 without evidence, else the probability in percent.

        None for an empty map.
        """
        grid = _map(map_)
        return () if grid.is_empty else (_occupancy_grid(grid, self.thresholds.clamp),)

    def files(self, map_: Map, stem: str) -> Mapping[str, bytes]:
        """``stem.pgm`` and ``stem.yaml`` for map_server; raises EmptyMapError when nothing is known."""
        grid = _map(map_)
        if grid.is_empty:
            raise EmptyMapError("an empty map cannot be written as an image: integrate observations first")
        return map_server.files(grid.dense(), stem)


def _occupancy_grid(grid: GridMap, clamp: int) -> OutputMessage:
    dense = grid.dense()
    percent = np.round(100.0 / (1.0 + np.exp(-np.arange(-clamp, clamp + 1) / LOG_ODDS_PER_NAT))).astype(np.int8)
    percent[clamp] = -1
    data = percent[dense.log_odds + clamp].ravel()
    height, width = dense.classes.shape
    x, y = dense.origin_m
    info = {
        "map_load_time": {"sec": 0, "nanosec": 0},
        "resolution": dense.resolution_m,
        "width": width,
        "height": height,
        "origin": {
            "position": {"x": x, "y": y, "z": 0.0},
            "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
        },
    }
    return OutputMessage("map", "nav_msgs/msg/OccupancyGrid", {"info": info, "data": data})


def _thresholds(occupied: float, free: float, clamp: float) -> Thresholds:
    high, low = _within("occupied", occupied, 0.5, 0.999), _within("free", free, 0.001, 0.5)
    read = Thresholds(
        # occupied above and free below the thresholds: the first steps of the fixed point beyond them
        math.floor(log_odds(high) * LOG_ODDS_PER_NAT) + 1,
        math.ceil(log_odds(low) * LOG_ODDS_PER_NAT) - 1,
        in_fixed_point(_within("clamp", clamp, 0.0, _MOST_CLAMP)),
    )
    if read.clamp < max(read.occupied, -read.free):
        raise ConfigError(
            f"clamp must reach the thresholds, or no cell can be occupied or free: found {clamp} nats for occupied "
            f"{occupied} and free {free}, give at least {max(read.occupied, -read.free) / LOG_ODDS_PER_NAT:.2f}"
        )
    return read


def _within(name: str, value: float, least: float, most: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
        raise ConfigError(f"{name} of an occupancy grid must lie between {least:.6g} and {most:.6g}, found {value!r}")
    return value


def _reach(name: str, value: float, resolution_m: float) -> float:
    """How far a beam counts, which may not be more cells than fit into a layer; the cells may be what was given."""
    longest_m = _LONGEST_BEAM * resolution_m
    if isinstance(value, int | float) and longest_m < value < math.inf:
        raise ConfigError(
            f"{name} of an occupancy grid must lie between 0 and {longest_m:.6g} with cells of {resolution_m:g} m, "
            f"found {value!r}: take coarser cells (resolution_m) or a shorter range"
        )
    return _within(name, value, 0.0, longest_m)


def _whole(name: str, value: int, most: int) -> int:
    if not isinstance(value, int):
        raise ConfigError(f"{name} of an occupancy grid must be a whole number, found {value!r}")
    return int(_within(name, value, 0, most))


def _grid(layer: Layer) -> GridLayer:
    if not isinstance(layer, GridLayer):
        raise MapError(f"an occupancy grid cannot use a layer of type {layer.map_type}: convert it first")
    return layer


def _map(map_: Map) -> GridMap:
    if not isinstance(map_, GridMap):
        raise MapError(f"an occupancy grid cannot show a map of type {map_.map_type}: use that map's own type")
    return map_


def _region(region: Region) -> GridRegion:
    if not isinstance(region, GridRegion):
        raise MapError(f"an occupancy grid needs a region of its own cells, found {type(region).__name__}")
    return region


def _quality(seen: GridMap) -> float | None:
    """The quality of a map where any window of it can be judged."""
    from mapgraft_grid.quality import window_quality  # loads its model when it is first asked

    try:
        quality = math.nan if seen.is_empty else window_quality(seen.dense()).mean()
    except MapError:  # too wide to be looked at as a whole
        return None
    return None if math.isnan(quality) else quality

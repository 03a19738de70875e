"""The map type ``point_landmarks``: poles, columns and trunks as quantised cells with integer evidence."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from mapgraft.contracts import (
    SCAN,
    ConfigError,
    Contribution,
    EmptyMapError,
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
from mapgraft_landmarks.cells import (
    COLUMNS,
    LOOKS,
    POSITION_STEP_M,
    SIGHTINGS,
    SUM_X,
    SUM_Y,
    CellRegion,
    Cells,
    as_region,
    keys_at,
    unpack,
)
from mapgraft_landmarks.encoding import decode_layer, encode_layer
from mapgraft_landmarks.extraction import Extraction, cells_looked_at, landmarks_in
from mapgraft_landmarks.landmarks import MAP_TYPE, LandmarkMap, as_map, standing_landmarks
from mapgraft_landmarks.layer import LandmarkLayer, as_layer
from mapgraft_landmarks.output import csv_file, point_cloud
from mapgraft_landmarks.placement import place_cells


class PointLandmarks:
    """Maps of narrow free-standing things. Lengths in metres.

    ``cell_m`` is the size of an evidence cell; landmarks nearer to each other than two cells may become one.
    ``width_m``, ``clear_m``, ``range_m``, ``beams_min``: what counts as a landmark in a scan (see ``Extraction``).
    ``sightings_min``, ``share_min``: how often, and in which share of the looks at its place, a landmark must have been
    sighted to stand in the map. Raises ConfigError when a parameter makes no sense.
    """

    name = MAP_TYPE

    def __init__(
        self,
        *,
        cell_m: float = 0.25,
        width_m: float = 0.6,
        clear_m: float = 0.5,
        range_m: float = 8.0,
        beams_min: int = 2,
        sightings_min: int = 3,
        share_min: float = 0.25,
    ) -> None:
        lengths = {"cell_m": cell_m, "width_m": width_m, "clear_m": clear_m, "range_m": range_m}
        wrong = [f"{name}={value} (must be positive)" for name, value in lengths.items() if not _positive(value)]
        if beams_min < 2:
            wrong.append(f"beams_min={beams_min} (must be at least 2)")
        if sightings_min < 1:
            wrong.append(f"sightings_min={sightings_min} (must be at least 1)")
        if not 0.0 <= share_min <= 1.0:
            wrong.append(f"share_min={share_min} (must lie in [0, 1])")
        if wrong:
            raise ConfigError(f"{MAP_TYPE} cannot work with {', '.join(wrong)}")
        self._cell_m = float(cell_m)
        self._extraction = Extraction(width_m, clear_m, range_m, beams_min)
        self._sightings_min, self._share_min = sightings_min, share_min

    def new_layer(self) -> LandmarkLayer:
        return LandmarkLayer(self._cell_m)

    def integrate(self, layer: Layer, observation: Observation) -> CellRegion:
        own = as_layer(layer)
        if observation.kind != SCAN or not isinstance(observation.payload, Scan):
            raise MapError(f"{MAP_TYPE} maps scans, found a {observation.kind}: give the robot another map type")
        scan, T_map_sensor = observation.payload, observation.T_map_sensor
        looked = cells_looked_at(scan, T_map_sensor, self._extraction, own.cell_m)
        landmarks = landmarks_in(scan, T_map_sensor, self._extraction)
        steps = np.round(landmarks / POSITION_STEP_M).astype(np.int64)
        sighted = keys_at(steps * POSITION_STEP_M, own.cell_m)
        keys = np.union1d(looked, sighted)
        looks = np.zeros((len(keys), COLUMNS), np.int64)
        looks[:, LOOKS] = 1  # once per scan and cell, whatever else happens in it
        sightings = np.zeros((len(sighted), COLUMNS), np.int64)
        sightings[:, SIGHTINGS], sightings[:, SUM_X], sightings[:, SUM_Y] = 1, steps[:, 0], steps[:, 1]
        own.cells = own.cells.plus(Cells(keys, looks)).plus(Cells.summed(sighted, sightings))
        own.observations += 1
        own.sensors |= {observation.sensor}
        return CellRegion(own.cell_m, keys)

    def view(
        self,
        own: Layer | None,
        contributions: Sequence[Contribution] = (),
        previous: Map | None = None,
        touched: Region | None = None,
    ) -> LandmarkMap:
        layers = [] if own is None else [(as_layer(own), 1)]
        layers += [(as_layer(c.layer), weight_of(c)) for c in contributions]
        cell_m = layers[0][0].cell_m if len(layers) == 1 and own is not None else self._cell_m
        for layer, _ in layers:
            _check_cell(layer, cell_m)
        if previous is not None and touched is not None and len(layers) > 1:
            cells = _updated(as_map(previous).cells, as_region(touched), layers)
        else:
            cells = Cells.empty()
            for layer, weight in layers:
                cells = cells.plus(layer.cells, weight) if len(cells) or weight != 1 else layer.cells
        return LandmarkMap(cell_m, cells, standing_landmarks(cells, self._sightings_min, self._share_min))

    def place(self, layer: Layer, T_receiver_donor: Transform, scale: float = 1.0) -> LandmarkLayer:
        donor = as_layer(layer)
        if not len(donor.cells):
            raise EmptyMapError("the donor's landmark map is empty: there is nothing to place")
        cells = place_cells(donor.cells, donor.cell_m, T_receiver_donor.snapped(), scale, self._cell_m)
        return LandmarkLayer(self._cell_m, cells, donor.observations, donor.sensors)

    def absorb(self, layer: Layer, contribution: Contribution) -> CellRegion:
        own, donor = as_layer(layer), as_layer(contribution.layer)
        _check_cell(donor, own.cell_m)
        own.cells = own.cells.plus(donor.cells, weight_of(contribution))
        return donor.region()

    def reset(self, layer: Layer, foreign: Region, keep: Region) -> Reset:
        own, theirs = as_layer(layer), as_region(foreign)
        discarded = theirs.minus(as_region(keep))
        before = len(own.cells)
        own.cells = own.cells.without(discarded.keys)
        return Reset(discarded, before - len(own.cells), len(theirs) - len(discarded))

    def region(self, layer: Layer) -> CellRegion:
        return as_layer(layer).region()

    def known_region(self, map_: Map) -> CellRegion:
        seen = as_map(map_)
        return CellRegion(seen.cell_m, seen.cells.keys)

    def encode(self, layer: Layer) -> bytes:
        return encode_layer(as_layer(layer))

    def decode(self, data: bytes) -> LandmarkLayer:
        return decode_layer(data)

    def metadata(self, layer: Layer) -> MapMetadata:
        own = as_layer(layer)
        landmarks = standing_landmarks(own.cells, self._sightings_min, self._share_min)
        quality = float((landmarks.sightings / landmarks.looks).mean()) if len(landmarks) else None
        return MapMetadata(
            type=MAP_TYPE,
            resolution_m=own.cell_m,
            bounds_m=_bounds_m(own),
            known_area_m2=len(own.cells) * own.cell_m**2,
            observations=own.observations,
            sensor=", ".join(sorted(own.sensors)),
            quality=quality,
            extra={"landmarks": len(landmarks)},
        )

    def structure(self, map_: Map, within: Map | None = None) -> Points:
        standing = as_map(map_).landmarks.positions_m
        return standing if within is None else standing[as_map(within).looks_at(standing) > 0]

    def messages(self, map_: Map) -> Iterable[OutputMessage]:
        return (point_cloud(as_map(map_)),)

    def files(self, map_: Map, stem: str) -> Mapping[str, bytes]:
        return {f"{stem}.landmarks.csv": csv_file(as_map(map_))}


def weight_of(contribution: Contribution) -> int:
    """How often each of the donor's looks and sightings counts; raises MapError unless it is a whole number from 1."""
    weight = contribution.weights
    if not isinstance(weight, int) or weight < 1:
        raise MapError(f"a contribution to {MAP_TYPE} is weighted by a whole number from 1, found {weight!r}")
    return weight


def _updated(cells: Cells, touched: CellRegion, layers: Sequence[tuple[LandmarkLayer, int]]) -> Cells:
    """The summed table, of which only the touched rows have changed."""
    counts = np.zeros((len(touched), COLUMNS), np.int64)
    for layer, weight in layers:
        counts += layer.cells.at(touched.keys) * weight
    known = counts.any(axis=1)
    return cells.without(touched.keys).plus(Cells(touched.keys[known], counts[known]))


def _check_cell(layer: LandmarkLayer, cell_m: float) -> None:
    if layer.cell_m != cell_m:
        raise MapError(f"a layer of {layer.cell_m} m cells does not fit a map of {cell_m} m cells: place it first")


def _bounds_m(layer: LandmarkLayer) -> tuple[float, float, float, float] | None:
    if not len(layer.cells):
        return None
    ix, iy = unpack(layer.cells.keys)
    low_x, low_y, high_x, high_y = int(ix.min()), int(iy.min()), int(ix.max()) + 1, int(iy.max()) + 1
    return (low_x * layer.cell_m, low_y * layer.cell_m, high_x * layer.cell_m, high_y * layer.cell_m)


def _positive(value: float) -> bool:
    return math.isfinite(value) and value > 0

"""The map type ``line_segments``: everything the engine asks of it, in one place."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import (
    SCAN,
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
from mapgraft_lines import codec, cutting, output, parameters
from mapgraft_lines.crossing import crossing_m
from mapgraft_lines.extraction import SensorModel, evidence_of
from mapgraft_lines.layer import FROM_SCANS, NAME, READY_MADE, Evidence, LineLayer, as_layer
from mapgraft_lines.line_map import LineMap, Reading, as_map
from mapgraft_lines.placing import RESAMPLER, place_evidence
from mapgraft_lines.region import LineRegion, as_region
from mapgraft_lines.segments import SegmentPoints, from_segments
from mapgraft_lines.table import distinct
from mapgraft_lines.walls import cell_corners_m
from mapgraft_lines.weights import entering

SEGMENTS: Final = "line_segments"  # the payload kind of ready-made maps
STRUCTURE_STEP_M: Final = 0.1
_MOST_OBSERVATIONS: Final = 1 << 31


@dataclass(frozen=True, slots=True, eq=False)
class SegmentMap:
    """A ready-made map of line segments, the payload of kind ``line_segments``; see ``segments.from_segments``."""

    points_m: SegmentPoints
    sigma_m: NDArray[np.float64]
    faced: NDArray[np.bool_]
    looks: NDArray[np.int64]
    free_m: Points


class LineSegments:
    """Walls as straight segments with their uncertainty, and the free space that was looked through.

    Every scan gives segments (``range_sigma_m`` … ``jump_m``, see ``SensorModel``), cut into pieces at cells of
    ``cell_m``; pieces of one cell, direction and seen side add up as integers. A wall is a line through pieces that
    continue each other; pieces count that were seen ``looks_min`` times and in ``share_min`` of all looks at their
    cell, walls from ``wall_min_m`` on. Free space is counted in whole cells, a cell before each beam's end.
    Raises ConfigError on an impossible value.
    """

    def __init__(
        self,
        *,
        cell_m: float = 0.25,
        range_sigma_m: float = 0.02,
        pose_sigma_m: float = 0.03,
        pose_sigma_deg: float = 0.3,
        split_m: float = 0.08,
        across_m: float = 0.05,
        segment_min_m: float = 0.3,
        points_min: int = 4,
        jump_m: float = 0.5,
        max_range_m: float = 30.0,
        free_range_m: float = 5.0,
        looks_min: int = 1,
        share_min: float = 0.2,
        wall_min_m: float = 0.4,
    ) -> None:
        within = parameters.within
        self._cell_m = parameters.cell(cell_m)
        self._sensor_model = SensorModel(
            within("range_sigma_m", range_sigma_m, 1e-4, 1.0),
            within("pose_sigma_m", pose_sigma_m, 0.0, 1.0),
            math.radians(within("pose_sigma_deg", pose_sigma_deg, 0.0, 45.0)),
            within("split_m", split_m, 1e-3, 10.0),
            within("across_m", across_m, 1e-3, 10.0),
            within("segment_min_m", segment_min_m, 0.01, 100.0),
            parameters.whole("points_min", points_min, 2, 10_000),
            within("jump_m", jump_m, 0.01, 100.0),
            within("max_range_m", max_range_m, 0.0, 1000.0),
            within("free_range_m", free_range_m, 0.0, 1000.0),
        )
        self._reading = Reading(
            parameters.whole("looks_min", looks_min, 1, 1_000_000),
            within("share_min", share_min, 0.0, 1.0),
            within("wall_min_m", wall_min_m, 0.0, 1000.0),
        )

    @property
    def name(self) -> str:
        return NAME

    @property
    def cell_m(self) -> float:
        """The side of the cells on which other layers are placed."""
        return self._cell_m

    @property
    def reading(self) -> Reading:
        """How evidence is read."""
        return self._reading

    @property
    def resampler(self) -> str:
        """What ``Contribution.resampler`` says of a layer placed by this type."""
        return RESAMPLER

    def new_layer(self) -> LineLayer:
        return LineLayer(self._cell_m)

    def integrate(self, layer: Layer, observation: Observation) -> LineRegion:
        """Add a scan, or take a ready-made map in the place of what was there; never both in one layer.

        Raises MapError on anything else, and on positions that are not finite or out of reach; the layer is then as
        before.
        """
        own, payload = as_layer(layer), observation.payload
        if isinstance(payload, Scan):
            _require_mapper(own, FROM_SCANS, observation)
            told = evidence_of(observation, payload, self._sensor_model, own.cell_m)
            before, after = told.keys(), own.own.plus(told)
        elif isinstance(payload, SegmentMap):
            _require_mapper(own, READY_MADE, observation)
            after = self._ready_made(payload, observation.T_map_sensor, own.cell_m)
            before = distinct(own.own.keys(), after.keys())
        else:
            raise MapError(
                f"a map of line segments is made from a {SCAN} or from {SEGMENTS}, found a {observation.kind} of "
                f"{observation.robot}: choose another map type for this robot"
            )
        own.own = after
        own.mapper = FROM_SCANS if isinstance(payload, Scan) else READY_MADE
        own.observations += 1
        if observation.sensor:
            own.sensors |= {observation.sensor}
        return LineRegion(own.cell_m, before)

    def _ready_made(self, payload: SegmentMap, T: Transform, cell_m: float) -> Evidence:
        segments = payload.points_m.reshape(-1, 2)
        made = from_segments(
            LineSegments(cell_m=cell_m),
            T.apply(segments).reshape(-1, 2, 2),
            payload.sigma_m,
            faced=payload.faced,
            looks=payload.looks,
            free_m=T.apply(payload.free_m),
        )
        return made.own

    def view(
        self,
        own: Layer | None,
        contributions: Sequence[Contribution] = (),
        previous: Map | None = None,
        touched: Region | None = None,
    ) -> LineMap:
        """Own evidence plus what each contribution adds (``weights.entering``); what was received is added up anew only
        when it has changed.

        Raises MapError when a contribution has cells of another size, or no weight.
        """
        layer = self.new_layer() if own is None else as_layer(own)
        for contribution in contributions:
            _require_cells(as_layer(contribution.layer), layer.cell_m)
        sources = (layer.absorbed, *map(_entering, contributions))
        # evidence never changes: from the same sources as before the same was received, whatever was touched
        if isinstance(previous, LineMap) and previous.sources == sources:
            received = previous.received
        else:
            received = layer.absorbed
            for contribution in contributions:
                received = received.plus(entering(contribution))
        return LineMap(layer.cell_m, layer.own, received, self._reading, sources)

    def place(self, layer: Layer, T_receiver_donor: Transform, scale: float = 1.0) -> LineLayer:
        """The layer's evidence in the receiver's frame and this instance's cells (``placing.place_evidence``).

        Raises EmptyMapError when there is nothing to place.
        """
        donor = as_layer(layer)
        if donor.is_empty:
            raise EmptyMapError("the donor's map of line segments is empty: there is nothing to place")
        T = T_receiver_donor.snapped()
        return LineLayer(
            self._cell_m,
            place_evidence(donor.own, donor.cell_m, T, scale, self._cell_m),
            place_evidence(donor.absorbed, donor.cell_m, T, scale, self._cell_m),
            donor.observations,
            donor.sensors,
            donor.mapper,
        )

    def absorb(self, layer: Layer, contribution: Contribution) -> LineRegion:
        own, donor = as_layer(layer), as_layer(contribution.layer)
        _require_cells(donor, own.cell_m)
        own.absorbed = own.absorbed.plus(entering(contribution))
        return donor.region()

    def reset(self, layer: Layer, foreign: Region, keep: Region) -> Reset:
        own, theirs = as_layer(layer), as_region(foreign)
        discarded = theirs.minus(as_region(keep))
        held = len(own.region()) - len(own.region().minus(discarded))
        own.own, own.absorbed = own.own.without(discarded.keys), own.absorbed.without(discarded.keys)
        return Reset(discarded, held, len(theirs) - len(discarded))

    def region(self, layer: Layer) -> LineRegion:
        return as_layer(layer).region()

    def known_region(self, map_: Map) -> LineRegion:
        seen = as_map(map_)
        return LineRegion(seen.cell_m, seen.known_keys())

    def encode(self, layer: Layer) -> bytes:
        return codec.encode(as_layer(layer))

    def decode(self, data: bytes) -> LineLayer:
        return codec.decode(data)

    def parts(self, layer: Layer) -> Mapping[bytes, bytes]:
        """By square of 16 × 16 cells and table; and once what there is to say of all."""
        return cutting.cut(as_layer(layer))

    def join(self, parts: Mapping[bytes, bytes]) -> LineLayer:
        return cutting.join(parts)

    def metadata(self, layer: Layer) -> MapMetadata:
        """``extra`` tells ``walls``, their length ``wall_m``, and of it what runs across the rest (``crossing_m``)."""
        own = as_layer(layer)
        seen = self.view(own)
        walls = seen.walls
        lengths = walls.lengths_m
        return MapMetadata(
            type=NAME,
            resolution_m=own.cell_m,
            bounds_m=_bounds_m(seen),
            known_area_m2=seen.known() * own.cell_m**2,
            observations=own.observations,
            sensor=", ".join(sorted(own.sensors)),
            mapper=own.mapper,
            can_send=("segments", *(("free space",) if not own.own.space.is_empty else ())),
            extra={
                "crossing_m": crossing_m(walls.angles_rad, lengths),
                "wall_m": float(lengths.sum()),
                "walls": len(walls),
            },
        )

    def structure(self, map_: Map, within: Map | None = None) -> Points:
        """Places (n, 2) along the walls, one for each 0.1 m; ``within`` may have cells of another size."""
        points = as_map(map_).walls.samples(STRUCTURE_STEP_M)
        return points if within is None else points[as_map(within).knows(points)]

    def messages(self, map_: Map) -> Iterable[OutputMessage]:
        """One ``visualization_msgs/msg/MarkerArray`` (``output.markers``); none for an empty map."""
        seen = as_map(map_)
        return (output.markers(seen),) if seen.known() else ()

    def files(self, map_: Map, stem: str) -> Mapping[str, bytes]:
        """``stem.lines.geojson`` and ``stem.lines.svg``; raises EmptyMapError when nothing is known."""
        seen = as_map(map_)
        if not seen.known():
            raise EmptyMapError("an empty map of line segments cannot be written: integrate observations first")
        return {f"{stem}.lines.geojson": output.geojson(seen), f"{stem}.lines.svg": output.svg(seen)}


def _entering(contribution: Contribution) -> tuple[Evidence, Evidence, object, str]:
    """All that decides what a contribution adds, by identity."""
    layer = as_layer(contribution.layer)
    return layer.own, layer.absorbed, contribution.weights, contribution.role


def _require_cells(layer: LineLayer, cell_m: float) -> None:
    if layer.cell_m != cell_m:
        raise MapError(
            f"a layer of {layer.cell_m:g} m cells does not fit a map of {cell_m:g} m cells: place the layer first"
        )


def _require_mapper(layer: LineLayer, mapper: str, observation: Observation) -> None:
    if layer.mapper not in ("", mapper):
        raise MapError(
            f"{observation.robot} was mapped from a {layer.mapper} before and now sends a {mapper}: "
            "choose one of the two for this robot"
        )
    if layer.observations >= _MOST_OBSERVATIONS:
        raise MapError(f"a layer can hold {_MOST_OBSERVATIONS} observations: begin a new one")


def _bounds_m(seen: LineMap) -> tuple[float, float, float, float] | None:
    keys = seen.known_keys()
    if not len(keys):
        return None
    corners = cell_corners_m(keys, seen.cell_m)
    (x0, y0), (x1, y1) = corners.min(axis=0), corners.max(axis=0) + seen.cell_m
    return (float(x0), float(y0), float(x1), float(y1))

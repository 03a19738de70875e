"""The map type ``floor_plan``: everything the engine asks of it, in one place."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from mapgraft.contracts import (
    GRID_MESSAGE,
    Contribution,
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
    Transform,
)
from mapgraft_floorplan import codec, drawing, placing
from mapgraft_floorplan.layer import PlanLayer, PlanMap, Walls, as_layer, as_map
from mapgraft_floorplan.plan import NAME, NO_WALLS, PLAN, Plan, Segments
from mapgraft_floorplan.region import PlanRegion, as_region
from mapgraft_floorplan.tracing import has_walls, plan_of_grid

_POINT_EVERY_M = 0.05
_MOST_POINTS = 200_000
_NEAR_M = 0.5  # what lies nearer than this to a plan's walls lies where the plan tells something


class FloorPlanType:
    """Floor plans: pieces of wall as somebody drew them. Nothing in them was observed.

    A layer holds the latest version of one plan. A plan is a prior: what it says is free, or missing, nobody has seen.
    """

    @property
    def name(self) -> str:
        return NAME

    def new_layer(self) -> PlanLayer:
        return PlanLayer()

    def integrate(self, layer: Layer, observation: Observation) -> PlanRegion:
        """Take a plan, or the walls of a ready-made grid, in the place of what was there.

        Raises MapError on anything else, and on a grid with too many walls; the layer is then as before.
        """
        own, payload = as_layer(layer), observation.payload
        if isinstance(payload, GridMessage):
            payload = plan_of_grid(payload, f"the map of {observation.robot}") if has_walls(payload) else Plan(NO_WALLS)
        if not isinstance(payload, Plan):
            raise MapError(
                f"a floor plan is made from a {PLAN} or a {GRID_MESSAGE}, found a {observation.kind} of "
                f"{observation.robot}: choose another map type for this robot"
            )
        before, T = own.walls, observation.T_map_sensor
        ends = T.apply(payload.segments_m.reshape(-1, 2)).reshape(-1, 4)
        own.walls, own.scale_known = Walls.of_metres(ends), payload.scale_known
        own.observations += 1
        own.sensors = frozenset({observation.sensor} if observation.sensor else ())
        return PlanRegion(before.rows).union(PlanRegion(own.walls.rows))

    def view(
        self,
        own: Layer | None,
        contributions: Sequence[Contribution] = (),
        previous: Map | None = None,
        touched: Region | None = None,
    ) -> PlanMap:
        """All walls of all sources; so few that they are always gathered anew."""
        layer = PlanLayer() if own is None else as_layer(own)
        walls, known = layer.told, layer.scale_known
        for contribution in contributions:
            walls = walls.plus(as_layer(contribution.layer).told)
        return PlanMap(walls, known)

    def place(self, layer: Layer, T_receiver_donor: Transform, scale: float = 1.0) -> PlanLayer:
        return placing.place(as_layer(layer), T_receiver_donor, scale)

    def absorb(self, layer: Layer, contribution: Contribution) -> PlanRegion:
        own, donor = as_layer(layer), as_layer(contribution.layer).told
        own.absorbed = own.absorbed.plus(donor)
        return PlanRegion(donor.rows)

    def reset(self, layer: Layer, foreign: Region, keep: Region) -> Reset:
        own, theirs = as_layer(layer), as_region(foreign)
        discarded = theirs.minus(as_region(keep))
        before = len(own.told.rows)
        own.walls, own.absorbed = own.walls.without(discarded), own.absorbed.without(discarded)
        return Reset(discarded, before - len(own.told.rows), len(theirs) - len(discarded))

    def region(self, layer: Layer) -> PlanRegion:
        return PlanRegion(as_layer(layer).told.rows)

    def known_region(self, map_: Map) -> PlanRegion:
        return PlanRegion(as_map(map_).walls.rows)

    def encode(self, layer: Layer) -> bytes:
        return codec.encode(as_layer(layer))

    def decode(self, data: bytes) -> PlanLayer:
        return codec.decode(data)

    def metadata(self, layer: Layer) -> MapMetadata:
        """Nothing of a plan was looked at: its known area is 0. ``walls_m`` tells the length of its walls."""
        own = as_layer(layer)
        told = own.told
        return MapMetadata(
            type=NAME,
            scale_known=own.scale_known,
            bounds_m=told.bounds_m(),
            observations=own.observations,
            sensor=", ".join(sorted(own.sensors)),
            mapper="floor plan",
            can_send=("walls",),
            extra={"segments": len(told.rows), "walls_m": told.length_m()},
        )

    def structure(self, map_: Map, within: Map | None = None) -> Points:
        """Points (n, 2) along the walls; with ``within`` only those near a wall of it."""
        points = points_along(as_map(map_).walls.segments_m, _POINT_EVERY_M, _MOST_POINTS)
        if within is None or not len(points):
            return points
        from scipy.spatial import cKDTree

        others = points_along(as_map(within).walls.segments_m, _POINT_EVERY_M, _MOST_POINTS)
        if not len(others):
            return points[:0]
        apart, _ = cKDTree(others).query(points, distance_upper_bound=_NEAR_M)
        near: Points = points[np.isfinite(apart)]
        return near

    def messages(self, map_: Map) -> Iterable[OutputMessage]:
        """One ``visualization_msgs/msg/MarkerArray`` with the walls as lines; none for an empty map."""
        walls = as_map(map_).walls
        return (drawing.markers(walls.segments_m),) if len(walls.rows) else ()

    def files(self, map_: Map, stem: str) -> Mapping[str, bytes]:
        """``stem.svg`` in millimetres, which the format ``plan_svg`` reads again; EmptyMapError without walls."""
        return {f"{stem}.svg": drawing.svg(as_map(map_).walls.segments_m)}


def points_along(segments_m: Segments, every_m: float, most: int) -> Points:
    """Points (n, 2) evenly along pieces of wall (n, 4), both ends of each, ``every_m`` apart or as ``most`` allows."""
    if not len(segments_m):
        return np.empty((0, 2))
    lengths = np.hypot(segments_m[:, 2] - segments_m[:, 0], segments_m[:, 3] - segments_m[:, 1])
    every_m = max(every_m, float(lengths.sum()) / max(1, most - 2 * len(segments_m)))
    counts = np.maximum(1, np.ceil(lengths / every_m).astype(np.int64)) + 1
    which = np.repeat(np.arange(len(segments_m)), counts)
    step = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = (step / (counts[which] - 1))[:, None]
    points: Points = segments_m[which, :2] * (1.0 - share) + segments_m[which, 2:] * share
    return points

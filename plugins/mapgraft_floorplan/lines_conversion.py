"""A floor plan as a map of line segments: the walls, and nothing of what is free."""

from __future__ import annotations

from typing import Final

from mapgraft.contracts import Layer, MapError, MapType
from mapgraft_floorplan.layer import as_layer
from mapgraft_lines.layer import LineLayer
from mapgraft_lines.map_type import LineSegments
from mapgraft_lines.parameters import FINEST_CELL_M
from mapgraft_lines.segments import from_segments

SIGMA_M: Final = 0.1  # by which drawn walls lie off those that were built
STRETCH: Final = 4.0  # a plan of unknown scale may be stretched so much before there are gaps in its walls


class PlanToLines:
    """Each piece of wall becomes a segment that was seen once, 0.1 m unsure across; which side is open nobody knows.

    A plan of unknown scale comes in its own units, on cells of a quarter of the target's: in those of a map pieces of
    wall lie one beside the other, and stay so when it is stretched.
    """

    def convert(self, layer: Layer, source: MapType, target: MapType) -> LineLayer:
        """A layer with the target's cells; MapError when the target is no map of line segments."""
        plan = as_layer(layer)
        if not isinstance(target, LineSegments):
            raise MapError(f"this conversion makes line segments of floor plans, found the target {target.name}")
        if not plan.scale_known:
            target = LineSegments(cell_m=max(FINEST_CELL_M, target.cell_m / STRETCH))
        ends = plan.told.segments_m.reshape(-1, 2, 2)
        return from_segments(target, ends, SIGMA_M, observations=plan.observations, sensors=plan.sensors)

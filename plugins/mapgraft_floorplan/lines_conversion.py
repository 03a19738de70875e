"""A floor plan as a map of line segments: the walls, and nothing of what is free."""

from __future__ import annotations

from typing import Final

from mapgraft.contracts import Layer, MapType
from mapgraft_floorplan.layer import as_layer
from mapgraft_lines.layer import LineLayer
from mapgraft_lines.segments import from_segments

SIGMA_M: Final = 0.1  # by which drawn walls lie off those that were built


class PlanToLines:
    """Each piece of wall becomes a segment that was seen once, 0.1 m unsure across; which side is open nobody knows."""

    def convert(self, layer: Layer, source: MapType, target: MapType) -> LineLayer:
        """A layer with the target's cells; MapError when the target is no map of line segments."""
        plan = as_layer(layer)
        ends = plan.told.segments_m.reshape(-1, 2, 2)
        return from_segments(target, ends, SIGMA_M, observations=plan.observations, sensors=plan.sensors)

"""All laws of map types."""

from __future__ import annotations

from mapgraft.testing.layers import LayerLaws
from mapgraft.testing.merging import MergingLaws
from mapgraft.testing.placing import PlacingLaws
from mapgraft.testing.regions import RegionLaws
from mapgraft.testing.travelling import TravellingLaws
from mapgraft.testing.views import ViewLaws


class MapTypeLaws(LayerLaws, TravellingLaws, ViewLaws, PlacingLaws, RegionLaws, MergingLaws):
    """Whatever a map type promises: layers, how they travel, views, placing, regions, and what the reversals make of
    it."""

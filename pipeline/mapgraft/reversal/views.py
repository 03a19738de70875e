"""A map computed from layers when somebody looks, and only where something has changed."""

from __future__ import annotations

from collections.abc import Sequence

from mapgraft.contracts import Contribution, Layer, Map, MapType, Region


class LazyView:
    """The latest view of one layer and some contributions, with the region that has changed since."""

    __slots__ = ("_map", "_map_type", "_touched")

    def __init__(self, map_type: MapType) -> None:
        self._map_type = map_type
        self._map: Map | None = None
        self._touched: list[Region] = []

    def touch(self, region: Region) -> None:
        """Note that the region has changed."""
        if self._map is not None and len(region):
            self._touched.append(region)

    def get(self, layer: Layer, contributions: Sequence[Contribution] = ()) -> Map:
        """The view as of now, equal to a fresh one."""
        if self._map is None:
            self._map = self._map_type.view(layer, contributions)
        elif self._touched:
            touched = self._touched[0]
            for region in self._touched[1:]:
                touched = touched.union(region)
            self._map = self._map_type.view(layer, contributions, self._map, touched)
        self._touched.clear()
        return self._map

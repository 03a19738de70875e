"""A map computed from layers when somebody looks, and only where something has changed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from mapgraft.contracts import Contribution, Layer, Map, MapType, Region
from mapgraft.reversal.gathering import MOST_APART, united
from mapgraft.sound_maps import sound_map


class LazyView:
    """The latest view of one layer and some contributions, with the region that has changed since."""

    __slots__ = ("_map", "_map_type", "_touched")

    def __init__(self, map_type: MapType) -> None:
        self._map_type = map_type
        self._map: Map | None = None
        self._touched: list[Region] = []  # united when somebody looks

    @property
    def is_made(self) -> bool:
        """Whether there is a view that has to be kept up to date."""
        return self._map is not None

    def touch(self, region: Region) -> None:
        """Note that the region has changed."""
        self.mark(region)
        if len(self._touched) > MOST_APART:
            self._touched = [united(self._touched)]

    def mark(self, region: Region) -> None:
        """The same, and nothing of the map type is asked for it: it cannot fail."""
        if self._map is not None:
            self._touched.append(region)

    def advance(self, layer: Layer, contributions: Sequence[Contribution], regions: Iterable[Region]) -> None:
        """The view with other contributions, which changed these regions; as before when it cannot be made."""
        touched = [*self._touched, *regions]
        if self._map is None:
            made = self._map_type.view(layer, contributions)
        else:
            made = self._map_type.view(layer, contributions, self._map, united(touched) if touched else None)
        self._map, self._touched = sound_map(made, self._map_type.name), []

    def get(self, layer: Layer, contributions: Sequence[Contribution] = ()) -> Map:
        """The view as of now, equal to a fresh one."""
        if self._map is None:
            self._map = self._map_type.view(layer, contributions)
        elif self._touched:
            self._map = self._map_type.view(layer, contributions, self._map, united(self._touched))
        self._touched = []
        return self._map

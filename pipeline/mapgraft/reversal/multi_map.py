"""Mapping with multiple maps (section 3.1 of the paper): the original map and every merged map are kept up to date."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from mapgraft.contracts import Contribution, Exactness, Layer, Map, MapType, Observation, Region
from mapgraft.errors import MapError, PluginError, ReversalError
from mapgraft.reversal.views import LazyView


@dataclass(slots=True)
class _Level:
    """One map of the hierarchy: the map below it with one more contribution baked in, updated ever since."""

    merge_id: str
    contribution: Contribution
    layer: Layer
    view: LazyView


class MultiMap:
    """Level 0 is the robot's own map, level n has n donors in it; every observation is written to every level.

    Reverting level n drops it; the levels above are built again from the level below, because they contain it.
    """

    name: Literal["multi_map"] = "multi_map"
    exact = True
    subject: Literal["own"] = "own"

    def __init__(self, map_type: MapType) -> None:
        self._map_type = map_type
        self._layer = map_type.new_layer()
        self.version = 0
        self._own = LazyView(map_type)
        self._levels: list[_Level] = []

    def observe(self, observation: Observation) -> Region:
        touched = self._map_type.integrate(self._layer, observation)
        self.version += 1
        self._own.touch(touched)
        for level in self._levels:
            try:
                level.view.touch(self._map_type.integrate(level.layer, observation))
            except MapError as error:  # no refusal any more: the own map has it
                raise PluginError(f"took into one layer what it refused for another: {error}") from error
        return touched

    def merge(self, merge_id: str, contribution: Contribution) -> None:
        if any(level.merge_id == merge_id for level in self._levels):
            raise ReversalError(f"merge {merge_id} is already in the map: replace it or revert it first")
        self._levels.append(self._level(self._levels, merge_id, contribution))

    def replace(self, merge_id: str, contribution: Contribution) -> None:
        self._rebuild_from(self._index(merge_id), contribution)

    def revert(self, merge_id: str) -> Exactness:
        self._rebuild_from(self._index(merge_id), None)
        return Exactness(exact=True, reason="the merged map was discarded, the original was kept up to date beside it")

    @property
    def contributions(self) -> Mapping[str, Contribution]:
        return {level.merge_id: level.contribution for level in self._levels}

    def recomputed(self, map_type: MapType) -> Map:
        layer = map_type.decode(map_type.encode(self._layer))
        for level in self._levels:
            map_type.absorb(layer, level.contribution)
        return map_type.view(layer)

    def own(self) -> Map:
        return self._own.get(self._layer)

    def fused(self) -> Map:
        if not self._levels:
            return self.own()
        return self._levels[-1].view.get(self._levels[-1].layer)

    def compared_layer(self) -> Layer:
        return self._layer

    def compared(self) -> Map:
        return self.own()

    def offered_layer(self) -> Layer:
        return self._layer

    @property
    def offered_version(self) -> int:
        return self.version

    def _index(self, merge_id: str) -> int:
        for index, level in enumerate(self._levels):
            if level.merge_id == merge_id:
                return index
        raise ReversalError(f"merge {merge_id} is not in the map: it was never made or already reverted")

    def _rebuild_from(self, index: int, replacement: Contribution | None) -> None:
        """The levels stay as they are when one cannot be built."""
        levels, above = self._levels[:index], self._levels[index:]
        if replacement is not None:
            levels.append(self._level(levels, above[0].merge_id, replacement))
        for level in above[1:]:
            levels.append(self._level(levels, level.merge_id, level.contribution))
        self._levels = levels

    def _level(self, below: list[_Level], merge_id: str, contribution: Contribution) -> _Level:
        """The map above these with a contribution baked in; raises what the map type raises when it cannot be."""
        layer = self._map_type.decode(self._map_type.encode(below[-1].layer if below else self._layer))
        self._map_type.absorb(layer, contribution)
        view = LazyView(self._map_type)
        view.advance(layer, (), ())
        return _Level(merge_id, contribution, layer, view)

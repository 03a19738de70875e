"""Mapping with a single map (section 3.2 of the paper): cheap, and never quite free of what was merged into it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Literal

from mapgraft.contracts import Contribution, Exactness, Layer, Map, MapType, Observation, Region
from mapgraft.errors import ReversalError
from mapgraft.reversal.gathering import Gathering
from mapgraft.reversal.views import LazyView


class SingleMap:
    """The merged map and the local update map, which marks what the robot has updated itself.

    A revert resets what the donor changed and the robot never updated. What the robot updated keeps the donor's share,
    and where another standing merge had written too, its evidence goes with the reset: both are counted.
    """

    name: Literal["single_map"] = "single_map"
    exact = False
    subject: Literal["merged"] = "merged"

    def __init__(self, map_type: MapType) -> None:
        self._map_type = map_type
        self._layer = map_type.new_layer()
        self.version = 0
        self._view = LazyView(map_type)
        self._updated = Gathering(map_type.region(self._layer))  # the local update map, of all time
        self._foreign: dict[str, Region] = {}
        self._before: tuple[Layer, int] | None = None  # the last layer that was the robot's own, and its version

    def observe(self, observation: Observation) -> Region:
        touched = self._map_type.integrate(self._layer, observation)
        self.version += 1
        self._updated.add(touched)
        self._view.touch(touched)
        return touched

    def merge(self, merge_id: str, contribution: Contribution) -> None:
        if merge_id in self._foreign:
            raise ReversalError(f"merge {merge_id} is already in the map: revert it first")
        merged = self._map_type.decode(self._map_type.encode(self._layer))
        changed = self._map_type.absorb(merged, contribution)
        self._view.advance(merged, (), (changed,))  # what was raised until here has changed nothing
        if self._before is None:
            self._before = (self._layer, self.version)
        self._layer = merged
        self._foreign[merge_id] = changed

    def replace(self, merge_id: str, contribution: Contribution) -> None:
        raise ReversalError(
            f"merge {merge_id} cannot be replaced: a single map does not know what the donor's share was; "
            "use the reversal ledger or multi_map"
        )

    def revert(self, merge_id: str) -> Exactness:
        """All stays as it is when the map type raises: a copy of the layer is reset."""
        foreign, others = self._foreign.get(merge_id), {n: r for n, r in self._foreign.items() if n != merge_id}
        if foreign is None:
            raise ReversalError(f"merge {merge_id} is not in the map: it was never made or already reverted")
        updated = self._updated.united()
        discarded = foreign.minus(updated)
        lost = len(discarded) - len(_without(discarded, others.values()))
        others = {name: other.minus(discarded) for name, other in others.items()}
        layer = self._map_type.decode(self._map_type.encode(self._layer))
        reset = self._map_type.reset(layer, foreign, updated)
        self._layer, self._foreign = layer, others
        self._view.mark(reset.touched)
        return Exactness(
            exact=reset.cells_contaminated == 0 and lost == 0,
            cells_reset=reset.cells_reset,
            cells_contaminated=reset.cells_contaminated,
            cells_lost=lost,
            reason="what the robot had not updated itself was reset to unknown; what it had keeps the donor's share",
        )

    @property
    def contributions(self) -> Mapping[str, Contribution]:
        return {}

    def recomputed(self, map_type: MapType) -> Map:
        return map_type.view(self._layer)

    def own(self) -> Map:
        return self._view.get(self._layer)

    def fused(self) -> Map:
        return self.own()

    def compared_layer(self) -> Layer:
        return self._layer

    def compared(self) -> Map:
        return self.own()

    def offered_layer(self) -> Layer:
        return self._layer if self._before is None else self._before[0]

    @property
    def offered_version(self) -> int:
        return self.version if self._before is None else self._before[1]


def _without(region: Region, others: Iterable[Region]) -> Region:
    for other in others:
        region = region.minus(other)
    return region

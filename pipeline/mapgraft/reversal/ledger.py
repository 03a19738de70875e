"""The ledger: one live layer per source, never mixed. Reverting is forgetting, exact and at the cost of one map."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from mapgraft.contracts import Contribution, Exactness, Layer, Map, MapType, Observation, Region
from mapgraft.errors import ReversalError
from mapgraft.reversal.gathering import Gathering
from mapgraft.reversal.views import LazyView


class Ledger:
    """``fused = own + Σ contributions``, evaluated where somebody looks and something has changed."""

    name: Literal["ledger"] = "ledger"
    exact = True
    subject: Literal["own"] = "own"

    def __init__(self, map_type: MapType) -> None:
        self._map_type = map_type
        self._layer = map_type.new_layer()
        self.version = 0
        self._contributions: dict[str, Contribution] = {}
        self._own = LazyView(map_type)
        self._fused = LazyView(map_type)
        self._untold = Gathering(map_type.region(self._layer))  # since either map was looked at

    def observe(self, observation: Observation) -> Region:
        touched = self._map_type.integrate(self._layer, observation)
        self.version += 1
        if self._own.is_made or self._fused.is_made:
            self._untold.add(touched)
        return touched

    def merge(self, merge_id: str, contribution: Contribution) -> None:
        if merge_id in self._contributions:
            raise ReversalError(f"merge {merge_id} is already in the map: replace it or revert it first")
        self._admit(merge_id, contribution, (contribution.region,))

    def replace(self, merge_id: str, contribution: Contribution) -> None:
        self._admit(merge_id, contribution, (self._standing(merge_id).region, contribution.region))

    def revert(self, merge_id: str) -> Exactness:
        """Nothing of the map type is asked: this cannot fail."""
        self._fused.mark(self._standing(merge_id).region)
        del self._contributions[merge_id]
        return Exactness(exact=True, reason="the donor's layer was never mixed with another")

    @property
    def contributions(self) -> Mapping[str, Contribution]:
        return self._contributions

    def recomputed(self, map_type: MapType) -> Map:
        return map_type.view(self._layer, tuple(self._contributions.values()))

    def own(self) -> Map:
        self._tell()
        return self._own.get(self._layer)

    def fused(self) -> Map:
        if not self._contributions:
            return self.own()
        self._tell()
        return self._fused.get(self._layer, tuple(self._contributions.values()))

    def compared_layer(self) -> Layer:
        return self._layer

    def compared(self) -> Map:
        return self.own()

    def offered_layer(self) -> Layer:
        return self._layer

    @property
    def offered_version(self) -> int:
        return self.version

    def _admit(self, merge_id: str, contribution: Contribution, regions: tuple[Region, ...]) -> None:
        """Nothing enters that cannot be viewed: the ledger stays as it is when the map type raises."""
        self._tell()
        admitted = {**self._contributions, merge_id: contribution}
        self._fused.advance(self._layer, tuple(admitted.values()), regions)
        self._contributions = admitted

    def _tell(self) -> None:
        """Let both maps know what observations have touched, united once."""
        if self._untold:
            touched = self._untold.united()
            self._own.touch(touched)
            self._fused.touch(touched)
            self._untold.clear()

    def _standing(self, merge_id: str) -> Contribution:
        try:
            return self._contributions[merge_id]
        except KeyError:
            raise ReversalError(f"merge {merge_id} is not in the map: it was never made or already reverted") from None

"""What the three reversals have in common: how a robot keeps contributions and takes them out again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, Protocol

from mapgraft.contracts import Contribution, Exactness, Layer, Map, MapType, Observation, Region


class Reversal(Protocol):
    """One robot's evidence with everything merged into it. ``exact`` ones leave no trace of what they revert."""

    @property
    def name(self) -> Literal["ledger", "single_map", "multi_map"]: ...
    @property
    def exact(self) -> bool: ...
    @property
    def version(self) -> int:
        """How many own observations there were."""
        ...

    @property
    def subject(self) -> Literal["own", "merged"]:
        """What metrics see after a merge: the own map, or the merged one where the own is not kept."""
        ...

    def observe(self, observation: Observation) -> Region:
        """Integrate an own observation; returns what it touched."""
        ...

    def merge(self, merge_id: str, contribution: Contribution) -> None:
        """Take a contribution in; raises ReversalError when the merge is already there.

        What the map type raises comes through, and then nothing has changed.
        """
        ...

    def replace(self, merge_id: str, contribution: Contribution) -> None:
        """Put a newer contribution in the place of a standing one; raises as ``merge`` does."""
        ...

    def revert(self, merge_id: str) -> Exactness:
        """Take a contribution out; raises ReversalError when it is not there.

        A ledger asks the map type for nothing here. What the map type raises otherwise comes through, and then nothing
        has changed.
        """
        ...

    @property
    def contributions(self) -> Mapping[str, Contribution]:
        """What stands in the map and can be told apart, by merge id; empty where it was mixed."""
        ...

    def recomputed(self, map_type: MapType) -> Map:
        """The fused map by another instance of its type, from the layers alone: nothing that was kept is used."""
        ...

    def own(self) -> Map:
        """The best there is of the robot's own map."""
        ...

    def fused(self) -> Map:
        """The robot's map with everything that is merged into it."""
        ...

    def compared_layer(self) -> Layer:
        """The layer that metrics compare with a donor's (see ``subject``)."""
        ...

    def compared(self) -> Map:
        """The view of ``compared_layer``."""
        ...

    def offered_layer(self) -> Layer:
        """What the robot may send: its own evidence and nobody else's."""
        ...

    @property
    def offered_version(self) -> int:
        """How many own observations the offered layer holds."""
        ...

"""What metrics see of a candidate or a merge."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from mapgraft.contracts import Layer, Map, MapType, Match, Sighting, Transform
from mapgraft.reversal import Reversal


@dataclass(slots=True)
class Compared:
    """A live comparison: the receiver's side changes as it goes on mapping, the donor's when a new version comes."""

    map_type: MapType
    subject: Literal["own", "merged"]
    T_receiver_donor: Transform
    match: Match
    donor_layer: Layer
    see: Callable[[], tuple[Layer, Map]]
    converted: bool = False  # whether the receiver's map is converted to be compared
    meetings: Callable[[], Sequence[Sighting]] = tuple
    _donor: Map | None = None

    @property
    def target(self) -> Map:
        return self.see()[1]

    @property
    def target_layer(self) -> Layer:
        return self.see()[0]

    @property
    def sightings(self) -> Sequence[Sighting]:
        return self.meetings()

    @property
    def donor(self) -> Map:
        if self._donor is None:
            self._donor = self.map_type.view(self.donor_layer)
        return self._donor

    def put_donor(self, layer: Layer, T_receiver_donor: Transform, match: Match) -> None:
        """A newer version of the donor's layer, or a better transform."""
        self.donor_layer, self.T_receiver_donor, self.match, self._donor = layer, T_receiver_donor, match, None


@dataclass(slots=True)
class Sight:
    """The receiver's compared map, as it is or converted to the type in which two maps of different types meet."""

    reversal: Reversal
    map_type: MapType
    convert: Callable[[Layer], Layer] | None = None
    _seen: tuple[int, Layer, Map] | None = None
    _changes: int = 0

    def changed(self) -> None:
        """Note that the receiver's map has changed."""
        self._changes += 1

    def __call__(self) -> tuple[Layer, Map]:
        if self.convert is None:
            return self.reversal.compared_layer(), self.reversal.compared()
        if self._seen is None or self._seen[0] != self._changes:
            layer = self.convert(self.reversal.compared_layer())
            self._seen = (self._changes, layer, self.map_type.view(layer))
        return self._seen[1], self._seen[2]

"""A map type as the engine and the tools call it: by its name, in its time, and what it gives is looked at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from mapgraft.contracts import (
    Contribution,
    Layer,
    Map,
    MapMetadata,
    MapType,
    Observation,
    OutputMessage,
    Points,
    Region,
    Reset,
    Transform,
)
from mapgraft.errors import PluginError
from mapgraft.guard import Call, Guard
from mapgraft.sound_maps import (
    sound_bytes,
    sound_files,
    sound_layer,
    sound_messages,
    sound_metadata,
    sound_points,
    sound_region,
    sound_reset,
    sound_view,
)

KIND: Final = "map type"


class GuardedMapType:
    """Stands for a map type: who is handed one cannot tell, and calls it through the guard, too.

    Every method raises what the map type refuses (MapError), FailedPluginError where it fails, takes too long or gives
    what is none, and SetAsideError where that has happened too often. What the map type has beyond its contract is
    there, unguarded.
    """

    __slots__ = ("_guard", "_map_type", "name")

    def __init__(self, map_type: MapType, guard: Guard) -> None:
        name: object = map_type.name
        if not isinstance(name, str):
            raise PluginError(f"a map type has a name of type {type(name).__name__}, a text was wanted")
        self._map_type, self._guard, self.name = map_type, guard, name

    def __getattr__(self, name: str) -> Any:
        if name in GuardedMapType.__slots__:  # who makes a copy asks for them before they are there
            raise AttributeError(name)
        return getattr(self._map_type, name)

    @property
    def __class__(self) -> type[Any]:
        """That of the map type: tools ask with ``isinstance`` whether they are for it."""
        return type(self._map_type)

    @__class__.setter
    def __class__(self, _kind: type[Any]) -> None:
        raise AttributeError("a map type stays what it is")

    def _asked(self, method: str) -> Call:
        if (refused := self._guard.refused(KIND, self.name, method)) is not None:
            raise refused
        return Call(self._guard, KIND, self.name, method)

    def new_layer(self) -> Layer:
        with self._asked("new_layer"):
            return sound_layer(self._map_type.new_layer(), self.name)

    def integrate(self, layer: Layer, observation: Observation) -> Region:
        with self._asked("integrate"):
            return sound_region(self._map_type.integrate(layer, observation))

    def view(
        self,
        own: Layer | None,
        contributions: Sequence[Contribution] = (),
        previous: Map | None = None,
        touched: Region | None = None,
    ) -> Map:
        with self._asked("view"):
            return sound_view(self._map_type.view(own, contributions, previous, touched), self.name)

    def place(self, layer: Layer, T_receiver_donor: Transform, scale: float = 1.0) -> Layer:
        with self._asked("place"):
            return sound_layer(self._map_type.place(layer, T_receiver_donor, scale), self.name)

    def absorb(self, layer: Layer, contribution: Contribution) -> Region:
        with self._asked("absorb"):
            return sound_region(self._map_type.absorb(layer, contribution))

    def reset(self, layer: Layer, foreign: Region, keep: Region) -> Reset:
        with self._asked("reset"):
            return sound_reset(self._map_type.reset(layer, foreign, keep))

    def region(self, layer: Layer) -> Region:
        with self._asked("region"):
            return sound_region(self._map_type.region(layer))

    def known_region(self, map_: Map) -> Region:
        with self._asked("known_region"):
            return sound_region(self._map_type.known_region(map_))

    def encode(self, layer: Layer) -> bytes:
        with self._asked("encode"):
            return sound_bytes(self._map_type.encode(layer))

    def decode(self, data: bytes) -> Layer:
        with self._asked("decode"):
            return sound_layer(self._map_type.decode(data), self.name)

    def metadata(self, layer: Layer) -> MapMetadata:
        with self._asked("metadata"):
            return sound_metadata(self._map_type.metadata(layer), self.name)

    def structure(self, map_: Map, within: Map | None = None) -> Points:
        with self._asked("structure"):
            return sound_points(self._map_type.structure(map_, within))

    def messages(self, map_: Map) -> Sequence[OutputMessage]:
        with self._asked("messages"):
            return sound_messages(self._map_type.messages(map_))

    def files(self, map_: Map, stem: str) -> Mapping[str, bytes]:
        with self._asked("files"):
            return sound_files(self._map_type.files(map_, stem))

"""What passes between robots: first the metadata, then, if it is wanted, the layer. How, is the network's affair."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import NoneType
from typing import Any, Final, Literal

from mapgraft.contracts import Layer, MapError, MapMetadata, MapType, PartedType, PreviewedType, Provenance
from mapgraft.graph.claims import MOST_COUNTED, MOST_NAME_BYTES

Form = Literal["parts", "whole"]
MOST_OFFER: Final = 1 << 14  # bytes; nobody reads more
_UNREADABLE = (ValueError, KeyError, TypeError, OverflowError, RecursionError)  # what strangers' bytes raise
_NUMBER = (float, int)
_KINDS: dict[str, tuple[type, ...]] = {
    "type": (str,),
    "resolution_m": (*_NUMBER, NoneType),
    "scale_known": (bool,),
    "known_area_m2": _NUMBER,
    "observations": (int,),
    "sensor": (str,),
    "mapper": (str,),
    "quality": (*_NUMBER, NoneType),
    "extra": (dict,),
}


@dataclass(frozen=True, slots=True)
class Offer:
    """What a donor tells before anything is fetched.

    ``corrections`` is how often its map was made anew so far, with other poses for what it had observed: of two
    versions that differ in it, what was found out about the one need not hold for the other.
    """

    provenance: Provenance
    metadata: MapMetadata
    corrections: int = 0

    def encode(self) -> bytes:
        """Canonical JSON."""
        content: dict[str, object] = {"provenance": list(self.provenance)}
        content["metadata"] = dataclasses.asdict(self.metadata)
        if self.corrections:
            content["corrections"] = self.corrections
        return json.dumps(content, sort_keys=True, separators=(",", ":")).encode()

    @classmethod
    def decode(cls, data: bytes) -> Offer:
        """Raises MapError when the bytes are not an offer."""
        try:
            content = json.loads(data)
            made = _provenance(*content["provenance"]), _metadata(dict(content["metadata"]))
            return cls(*made, _count(content.get("corrections", 0)))
        except _UNREADABLE as error:
            raise MapError(f"an offer of {len(data)} bytes cannot be read: {error}") from None


def _provenance(source: object, epoch: int, version: int) -> Provenance:
    """A source and version that every message can tell; raises what ``Offer.decode`` catches when it is none."""
    found = Provenance(str(source), int(epoch), int(version))
    if not 0 < len(found.source.encode()) <= MOST_NAME_BYTES:
        raise ValueError(f"its source has a name of {len(found.source)} letters")
    if not (0 <= found.epoch < 1 << 32 and 0 <= found.version < 1 << 63):
        raise ValueError(f"its epoch or version is none that a robot counts to: {str(found[1:])[:60]}")
    return found


def _count(given: object) -> int:
    """How often something happened; raises ValueError when that is nothing that a robot counts to."""
    if type(given) is not int or not 0 <= given < MOST_COUNTED:
        raise ValueError(f"its map was corrected {str(given)[:40]} times")
    return given


def _metadata(given: dict[str, Any]) -> MapMetadata:
    """The metadata in a mapping; ValueError, KeyError or TypeError when it is not what ``Offer.encode`` writes."""
    bounds, can_send = given.pop("bounds_m"), tuple(given.pop("can_send"))
    found = MapMetadata(bounds_m=None if bounds is None else tuple(bounds), can_send=can_send, **given)
    for name, kinds in _KINDS.items():
        if type(getattr(found, name)) not in kinds:
            raise TypeError(f"its {name} is {str(getattr(found, name))[:40]!r}")
    if found.bounds_m is not None and [type(edge) in _NUMBER for edge in found.bounds_m] != [True] * 4:
        raise TypeError("its bounds are not four numbers")
    if not all(isinstance(name, str) for name in can_send):
        raise TypeError("what it can send has no names")
    if not all(isinstance(value, float | int | str) for value in found.extra.values()):
        raise TypeError("it tells more than plain values")
    return found


@dataclass(frozen=True, slots=True, eq=False)
class SentLayer:
    """A donor's layer as it has come: raw, in the donor's own frame, with its provenance.

    ``corrections`` is as in the offer. ``parts`` gives what the map type cut it into (``PartedType``), or its encoding
    as the only one where ``form`` is ``whole``. ``size`` counts the bytes in which it came; what was held before did
    not come again. ``writer`` is who wrote it: two robots of one name are told apart by it, and the source is the one
    with the smallest.
    """

    provenance: Provenance
    map_type: str
    form: Form
    parts: Callable[[], Mapping[bytes, bytes]]
    size: int
    corrections: int = 0
    writer: bytes = b""

    def layer(self, map_type: MapType) -> Layer:
        """The layer, live; raises MapError when the parts do not make one."""
        told = self.parts()
        if self.form == "whole":
            return map_type.decode(b"".join(told[name] for name in sorted(told)))
        if not isinstance(map_type, PartedType):
            raise MapError(f"a layer of {self.map_type} came in parts, which this version of it cannot join: update it")
        return map_type.join(told)


def cut(map_type: MapType, layer: Layer) -> tuple[Form, Mapping[bytes, bytes]]:
    """A layer as it is sent: in the parts of its type, or as a whole."""
    if isinstance(map_type, PartedType):
        return "parts", map_type.parts(layer)
    return uncut(map_type, layer)


def uncut(map_type: MapType, layer: Layer) -> tuple[Form, Mapping[bytes, bytes]]:
    """A layer as a whole."""
    return "whole", {b"": map_type.encode(layer)}


def preview_of(map_type: MapType, layer: Layer) -> Layer:
    """What a map type shows of a layer to who may not want it; raises MapError where it shows nothing."""
    if not isinstance(map_type, PreviewedType):
        raise MapError(f"maps of type {map_type.name} have no previews: ask for the layer")
    return map_type.preview(layer)

"""What passes between robots: bytes. First the metadata, then, if it is wanted, the layer."""

from __future__ import annotations

import dataclasses
import json
import struct
from collections import Counter
from dataclasses import dataclass, field
from types import NoneType
from typing import Any

from mapgraft.contracts import MapError, MapMetadata, Provenance

_LAYER_MAGIC = b"MGL1"
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
    """What a donor tells before anything is fetched."""

    provenance: Provenance
    metadata: MapMetadata

    def encode(self) -> bytes:
        """Canonical JSON."""
        content = {"provenance": list(self.provenance), "metadata": dataclasses.asdict(self.metadata)}
        return json.dumps(content, sort_keys=True, separators=(",", ":")).encode()

    @classmethod
    def decode(cls, data: bytes) -> Offer:
        """Raises MapError when the bytes are not an offer."""
        try:
            content = json.loads(data)
            source, epoch, version = content["provenance"]
            return cls(Provenance(str(source), int(epoch), int(version)), _metadata(dict(content["metadata"])))
        except _UNREADABLE as error:
            raise MapError(f"an offer of {len(data)} bytes cannot be read: {error}") from None


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


@dataclass(frozen=True, slots=True)
class LayerMessage:
    """A donor's layer on its way: raw, in the donor's own frame, with its provenance."""

    provenance: Provenance
    map_type: str
    payload: bytes

    def encode(self) -> bytes:
        header = json.dumps([*self.provenance, self.map_type]).encode()
        return _LAYER_MAGIC + struct.pack("<I", len(header)) + header + self.payload

    @classmethod
    def decode(cls, data: bytes) -> LayerMessage:
        """Raises MapError when the bytes are not a layer message."""
        try:
            if data[:4] != _LAYER_MAGIC:
                raise ValueError(f"it starts with {data[:4]!r}")
            (length,) = struct.unpack_from("<I", data, 4)
            source, epoch, version, map_type = json.loads(data[8 : 8 + length])
            return cls(Provenance(str(source), int(epoch), int(version)), str(map_type), bytes(data[8 + length :]))
        except (*_UNREADABLE, struct.error) as error:
            raise MapError(f"a layer message of {len(data)} bytes cannot be read: {error}") from None


@dataclass(slots=True)
class Traffic:
    """How many bytes went from each donor to each receiver."""

    sent: Counter[tuple[str, str]] = field(default_factory=Counter)

    def carry(self, donor: str, receiver: str, data: bytes) -> bytes:
        """Hand the bytes over and count them."""
        self.sent[donor, receiver] += len(data)
        return data

"""What passes between robots: bytes. First the metadata, then, if it is wanted, the layer."""

from __future__ import annotations

import dataclasses
import json
import struct
from collections import Counter
from dataclasses import dataclass, field

from mapgraft.contracts import MapError, MapMetadata, Provenance

_LAYER_MAGIC = b"MGL1"


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
            metadata = content["metadata"]
            bounds = metadata.pop("bounds_m")
            can_send = tuple(metadata.pop("can_send"))
            return cls(
                Provenance(str(source), int(epoch), int(version)),
                MapMetadata(bounds_m=tuple(bounds) if bounds else None, can_send=can_send, **metadata),
            )
        except (ValueError, KeyError, TypeError) as error:
            raise MapError(f"an offer of {len(data)} bytes cannot be read: {error}") from None


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
        except (ValueError, TypeError, struct.error) as error:
            raise MapError(f"a layer message of {len(data)} bytes cannot be read: {error}") from None


@dataclass(slots=True)
class Traffic:
    """How many bytes went from each donor to each receiver."""

    sent: Counter[tuple[str, str]] = field(default_factory=Counter)

    def carry(self, donor: str, receiver: str, data: bytes) -> bytes:
        """Hand the bytes over and count them."""
        self.sent[donor, receiver] += len(data)
        return data

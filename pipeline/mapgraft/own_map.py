"""One robot's own map towards the others: what it tells and sends of it, what it takes in, and how it shows it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from mapgraft.contracts import Donation, MapMetadata, MapType, Provenance
from mapgraft.errors import MapError, PluginError
from mapgraft.events import DonorMap
from mapgraft.exchange import LayerMessage, Offer
from mapgraft.guard import Call
from mapgraft.history import Journal, Moment
from mapgraft.merge import Merge
from mapgraft.procedures import Workshop
from mapgraft.reversal import Reversal

EPOCH: Final = 1  # a robot's map frame lives from its first to its last observation


@dataclass(slots=True)
class OwnMap:
    """The map of one robot as its reversal keeps it. What it costs to tell is paid once per version."""

    robot: str
    map_type: MapType
    reversal: Reversal
    workshop: Workshop
    journal: Journal
    _encoded: tuple[int, bytes] | None = None
    _described: tuple[int, MapMetadata] | None = None

    def asking(self) -> Call:
        """A context in which the robot's own map type is asked, and its layers, maps and regions."""
        return self.workshop.guard.calling("map type", self.map_type.name)

    def naming(self) -> Call:
        """The same around calls of tools, each of which has a time of its own."""
        return self.workshop.guard.naming("map type", self.map_type.name)

    def offer(self) -> bytes:
        """What this robot tells about its map; raises FailedPluginError or MapError when its type cannot tell."""
        with self.asking():
            return Offer(self.provenance, self.metadata()).encode()

    def metadata(self) -> MapMetadata:
        """What there is to say about the offered layer, found out once per version."""
        version = self.reversal.offered_version
        if self._described is None or self._described[0] != version:
            self._described = (version, self.map_type.metadata(self.reversal.offered_layer()))
        return self._described[1]

    def own_metadata(self) -> MapMetadata:
        """What there is to say about the robot's own map as it is now, which is not always what it may offer."""
        layer = self.reversal.compared_layer()
        return self.metadata() if layer is self.reversal.offered_layer() else self.map_type.metadata(layer)

    def layer(self) -> bytes:
        """This robot's own evidence, raw and in its own frame, ready to send; raises as ``offer``."""
        with self.asking():
            return LayerMessage(self.provenance, self.map_type.name, self.encoded_layer()).encode()

    def encoded_layer(self) -> bytes:
        """The offered layer in its canonical encoding."""
        version = self.reversal.offered_version
        if self._encoded is None or self._encoded[0] != version:
            self._encoded = (version, self.map_type.encode(self.reversal.offered_layer()))
        return self._encoded[1]

    @property
    def provenance(self) -> Provenance:
        return Provenance(self.robot, EPOCH, self.reversal.offered_version)

    def receive(self, data: bytes) -> Donation:
        """A layer that another robot has sent, in its own type."""
        message = LayerMessage.decode(data)
        mine = message.map_type == self.map_type.name
        map_type = self.map_type if mine else self.workshop.map_type(message.map_type)
        return Donation(map_type.decode(message.payload), message.provenance)

    def show(
        self, why: Moment, stamp_ns: int, merge_id: str, merges: tuple[Merge, ...]
    ) -> Sequence[PluginError | MapError]:
        """Take a snapshot, with the donors of these merges; returns why maps cannot be shown, where they cannot."""
        donors = {merge.donor: merge.comparison for merge in merges}
        try:
            with self.asking():
                snapshot = self.journal.snapshot(
                    why,
                    stamp_ns,
                    self.own_metadata,
                    self.encoded_layer,
                    lambda: {name: DonorMap(one.map_type, one.donor) for name, one in donors.items()},
                    merge_id,
                )
        except (PluginError, MapError) as error:  # its evidence is as it was
            return [error]
        if snapshot is not None:  # what writing it costs, or meets, is not the map type's affair
            self.journal.mapped(snapshot)
        return [error for _, error in self.workshop.guard.take_untold()]

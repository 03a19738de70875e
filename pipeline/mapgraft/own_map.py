"""One robot's own map towards the others: what it tells and sends of it, what it takes in, and how it shows it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from mapgraft.contracts import Donation, Layer, MapMetadata, MapType, Observation, Provenance, Region
from mapgraft.errors import MapError, PluginError
from mapgraft.events import DonorMap
from mapgraft.exchange import Form, Offer, SentLayer, cut, preview_of, uncut
from mapgraft.graph.claims import Source
from mapgraft.guard import Call
from mapgraft.history import Journal, Moment
from mapgraft.merge import Merge
from mapgraft.procedures import Workshop
from mapgraft.reversal import Reversal
from mapgraft.reversal.gathering import Gathering
from mapgraft.sound_maps import sound_offer


@dataclass(slots=True)
class OwnMap:
    """The map of one robot as its reversal keeps it. What it costs to tell is paid once per version.

    ``me`` is the source that the robot is to others, ``corrections`` how often the map was made anew from what had
    been observed.
    """

    me: Source
    map_type: MapType
    reversal: Reversal
    workshop: Workshop
    journal: Journal
    corrections: int = 0
    _encoded: tuple[int, bytes] | None = None
    _described: tuple[int, MapMetadata] | None = None
    _offered: tuple[tuple[Provenance, int], bytes] | None = None

    def asking(self) -> Call:
        """A context in which the robot's own map type is asked, and its layers, maps and regions."""
        return self.workshop.guard.calling("map type", self.map_type.name)

    def naming(self) -> Call:
        """The same around calls of tools, each of which has a time of its own."""
        return self.workshop.guard.naming("map type", self.map_type.name)

    def mapped(self, observations: Iterable[Observation]) -> tuple[Layer, Region]:
        """A layer of these observations, beside the one there is, and what they touch.

        Raises what the map type raises.
        """
        with self.asking():
            layer = self.map_type.new_layer()
            touched = Gathering(self.map_type.region(layer))
        for observation in observations:
            with self.asking():
                touched.add(self.map_type.integrate(layer, observation))
        with self.asking():
            return layer, touched.united()

    def offer(self) -> bytes:
        """What this robot tells about its map.

        Raises FailedPluginError or MapError when its type cannot tell, or tells what no other robot would read.
        """
        of = (self.provenance, self.corrections)
        if self._offered is None or self._offered[0] != of:
            with self.asking():
                metadata = self.metadata()
            with self.workshop.guard.calling("map type", self.map_type.name, "metadata"):
                self._offered = of, sound_offer(Offer(self.provenance, metadata, self.corrections))
        return self._offered[1]

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

    def layer(self) -> SentLayer:
        """This robot's own evidence, raw and in its own frame, as one hands it over who is next to the other."""
        with self.asking():
            whole = self.encoded_layer()
        parts = {b"": whole}
        return SentLayer(self.provenance, self.map_type.name, "whole", lambda: parts, len(whole), self.corrections)

    def cut(self, layer: Layer) -> tuple[Form, Mapping[bytes, bytes]]:
        """The offered layer, or its preview, as it is sent, in parts where its type has any; raises as ``offer``."""
        with self.asking():
            return cut(self.map_type, layer)

    def uncut(self, layer: Layer) -> tuple[Form, Mapping[bytes, bytes]]:
        """The same as a whole, whatever its type; raises as ``offer``."""
        with self.asking():
            return uncut(self.map_type, layer)

    def preview(self) -> Layer:
        """What the offered layer looks like; raises MapError when its type has none, and else as ``offer``."""
        with self.asking():
            return preview_of(self.map_type, self.reversal.offered_layer())

    def encoded_layer(self) -> bytes:
        """The offered layer in its canonical encoding."""
        version = self.reversal.offered_version
        if self._encoded is None or self._encoded[0] != version:
            self._encoded = (version, self.map_type.encode(self.reversal.offered_layer()))
        return self._encoded[1]

    @property
    def provenance(self) -> Provenance:
        return Provenance(*self.me, self.reversal.offered_version)

    def receive(self, sent: SentLayer) -> Donation:
        """A layer that another robot has sent, in its own type; raises MapError when it cannot be read."""
        mine = sent.map_type == self.map_type.name
        map_type = self.map_type if mine else self.workshop.map_type(sent.map_type)
        return Donation(sent.layer(map_type), sent.provenance)

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

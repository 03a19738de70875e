"""One robot: it observes, offers its map, considers what others offer, verifies what it merged, and reverts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from mapgraft.attempt import Attempt, Attempts, Grafted
from mapgraft.contracts import Donation, MapMetadata, MapType, Observation, Prior, Provenance, Sample
from mapgraft.decision import DecisionTable, facts_of
from mapgraft.errors import MapError
from mapgraft.exchange import LayerMessage, Offer
from mapgraft.history import Journal, Moment
from mapgraft.merge import Merge
from mapgraft.persons import Hand
from mapgraft.procedures import Tools, Workshop
from mapgraft.reversal import Reversal

Fetch = Callable[[], bytes]
EPOCH = 1  # a robot's map frame lives from its first to its last observation


@dataclass(slots=True)
class Robot:
    """One robot with its map and its merges; it decides for itself and knows the others only from bytes."""

    name: str
    map_type: MapType
    reversal: Reversal
    table: DecisionTable
    workshop: Workshop
    hand: Hand
    journal: Journal
    merges: dict[str, Merge] = field(default_factory=dict)  # donor → its standing merge
    tried: dict[str, int] = field(default_factory=dict)  # donor → attempts so far
    looked_at: dict[str, tuple[int, Provenance]] = field(default_factory=dict)  # donor → versions last considered
    attempts: Attempts = field(init=False)
    _encoded: tuple[int, bytes] | None = None
    _described: tuple[int, MapMetadata] | None = None

    def __post_init__(self) -> None:
        self.attempts = Attempts(self.workshop, self.map_type, self.reversal)

    def observe(self, observation: Observation) -> None:
        """Integrate an own observation, and verify every standing merge whose time has come."""
        touched = self.reversal.observe(observation)
        self.attempts.changed()
        for merge in list(self.merges.values()):
            if merge.observed(observation, touched):
                self.verify(merge, observation.stamp_ns)

    def offer(self) -> bytes:
        """What this robot tells about its map."""
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
        """This robot's own evidence, raw and in its own frame, ready to send."""
        return LayerMessage(self.provenance, self.map_type.name, self.encoded_layer()).encode()

    def encoded_layer(self) -> bytes:
        """The offered layer in its canonical encoding."""
        version = self.reversal.offered_version
        if self._encoded is None or self._encoded[0] != version:
            self._encoded = (version, self.map_type.encode(self.reversal.offered_layer()))
        return self._encoded[1]

    @property
    def provenance(self) -> Provenance:
        return Provenance(self.name, EPOCH, self.reversal.offered_version)

    def consider(self, offer: bytes, fetch: Fetch, stamp_ns: int) -> None:
        """Decide about a donor's offer: turn it away, merge its map, or bring a standing merge up to date."""
        received = Offer.decode(offer)
        donor = received.provenance.source
        if (standing := self.merges.get(donor)) is not None:
            self._update(standing, received.provenance, fetch, stamp_ns)
            return
        both = (self.reversal.version, received.provenance)
        if self.looked_at.get(donor) == both:  # neither map has changed since: the answer would be the same
            return
        self.looked_at[donor] = both
        self.journal.offered(stamp_ns, received.provenance, len(offer))
        if self.hand.forbids(self.name, donor):
            self.journal.forbidden(stamp_ns, donor)
            return
        about_m = _middle(received.metadata)
        prior = self._prior(donor, about_m)
        facts = facts_of(self.own_metadata(), received.metadata, prior is not None, self.reversal.name)
        ruling = self.table.choose(facts)
        if ruling.rule is None or ruling.rejected:
            self.journal.rejected(stamp_ns, donor, ruling)
        else:
            self._attempt(self.workshop.tools(ruling.rule), fetch(), prior, about_m, stamp_ns)

    def _prior(self, donor: str, about_m: Sequence[float]) -> Prior | None:
        """What is known of where the donor's map lies, unless it was taken out from there before."""
        prior = self.hand.priors.get((self.name, donor))
        if prior is None or self.attempts.is_refused(donor, prior.T_receiver_donor, about_m):
            return None
        return prior

    def _attempt(self, tools: Tools, data: bytes, prior: Prior | None, about_m: Sequence[float], stamp_ns: int) -> None:
        donation = self._receive(data)
        donor = donation.provenance.source
        attempt = self.attempts.make(tools, donation, prior, about_m)
        self.tried[donor] = self.tried.get(donor, 0) + 1
        merge_id = f"{self.name}.{donor}.{self.tried[donor]}"
        if attempt.grafted is None:
            self.journal.attempted(stamp_ns, attempt, tools, merge_id, donation.provenance, len(data))
        else:
            merge = self._merge(attempt, attempt.grafted, tools, merge_id, len(data), stamp_ns)
            self._obey(merge, about_m, stamp_ns)

    def _receive(self, data: bytes) -> Donation:
        message = LayerMessage.decode(data)
        mine = message.map_type == self.map_type.name
        map_type = self.map_type if mine else self.workshop.map_type(message.map_type)
        return Donation(map_type.decode(message.payload), message.provenance)

    def _merge(
        self, attempt: Attempt, grafted: Grafted, tools: Tools, merge_id: str, size: int, stamp_ns: int
    ) -> Merge:
        provenance = grafted.contribution.provenance
        self._snapshot("before merge", stamp_ns, merge_id)
        self.reversal.merge(merge_id, grafted.contribution)
        self._fused_changed()
        merge = Merge(merge_id, tools, grafted.match, provenance, grafted.comparison, self.reversal.name)
        self.merges[merge.donor] = merge
        self.journal.attempted(stamp_ns, attempt, tools, merge_id, provenance, size)
        self._snapshot("after merge", stamp_ns, merge_id)
        sample = merge.start(stamp_ns)
        self.journal.changed("verified", stamp_ns, merge, "measured at the merge", "merge", sample)
        return merge

    def _obey(self, merge: Merge, about_m: Sequence[float], stamp_ns: int) -> None:
        """Apply a person's verdict on this merge, if there is one."""
        verdict = self.hand.verdict_on(merge.merge_id, merge.comparison.T_receiver_donor, about_m)
        if verdict is None:
            return
        said = f"a person said {verdict.action}" + (f": {verdict.reason}" if verdict.reason else "")
        by = f"person {verdict.by}".strip()
        if verdict.action == "revert":
            self.revert(merge, stamp_ns, said, by)
        else:
            merge.state, merge.decided_by_person = "confirmed", True
            self.journal.changed("confirmed", stamp_ns, merge, said, by)

    def _update(self, merge: Merge, offered: Provenance, fetch: Fetch, stamp_ns: int) -> None:
        """Put the donor's newer layer in the place of the older one, at the same transform, and look at it again."""
        if offered == merge.provenance or self.reversal.name == "single_map":  # which cannot tell the donor's share
            return
        data = fetch()
        try:
            grafted = self.attempts.graft(merge.tools, self._receive(data), merge.match)
        except MapError as error:
            reason = f"the donor's newer map is left aside: {error}"
            self.journal.changed("verified", stamp_ns, merge, reason, "exchange", size=len(data))
            return
        self.reversal.replace(merge.merge_id, grafted.contribution)
        merge.replace(grafted.contribution.provenance, grafted.comparison)
        self.journal.changed("updated", stamp_ns, merge, "the donor has gone on mapping", "exchange", size=len(data))
        self.verify(merge, stamp_ns, everything=True)

    def verify(self, merge: Merge, stamp_ns: int, everything: bool = False) -> None:
        """Measure a standing merge, let the verifier judge it when all it looks at was measured, and do as it says."""
        sample = merge.measure(stamp_ns, everything)
        if sample is not merge.history[-1]:
            self.journal.changed("verified", stamp_ns, merge, "measured for the record", "log", sample)
            return
        verdict, by = merge.judge(), merge.tools.procedure.verify.use
        if merge.decided_by_person:
            self.journal.changed("verified", stamp_ns, merge, f"confirmed by a person; {verdict.reason}", by, sample)
        elif verdict.action == "revert":
            self.revert(merge, stamp_ns, verdict.reason, by, sample)
        elif verdict.action == "confirm" and merge.state == "provisional":
            merge.state = "confirmed"
            self.journal.changed("confirmed", stamp_ns, merge, verdict.reason, by, sample)
        else:
            self.journal.changed("verified", stamp_ns, merge, verdict.reason, by, sample)

    def revert(self, merge: Merge, stamp_ns: int, reason: str, by: str, sample: Sample | None = None) -> None:
        """Take the donor's data out of the map again, and refuse this transform from now on."""
        self._snapshot("before revert", stamp_ns, merge.merge_id)
        exactness = self.reversal.revert(merge.merge_id)
        del self.merges[merge.donor]
        self._fused_changed()
        merge.state = "reverted"
        self.attempts.refuse(merge.donor, merge.comparison.T_receiver_donor)
        self.journal.changed("reverted", stamp_ns, merge, reason, by, sample, exactness)
        self._snapshot("after revert", stamp_ns, merge.merge_id)

    def _fused_changed(self) -> None:
        """Something came in or went out: where metrics see the merged map, what they know of it no longer holds."""
        self.attempts.changed()
        if self.reversal.subject == "merged":
            for merge in self.merges.values():
                merge.target_changed()

    def finish(self, stamp_ns: int) -> None:
        """The last look at every standing merge, and the last snapshot."""
        for merge in list(self.merges.values()):
            if merge.news:
                self.verify(merge, stamp_ns, everything=True)
        self._snapshot("end", stamp_ns)

    def _snapshot(self, why: Moment, stamp_ns: int, merge_id: str = "") -> None:
        self.journal.snapshot(why, stamp_ns, self.own_metadata, self.encoded_layer, merge_id)


def _middle(metadata: MapMetadata) -> tuple[float, float]:
    """Where a map is, in its own frame: the middle of what is known of it."""
    if metadata.bounds_m is None:
        return 0.0, 0.0
    x0, y0, x1, y1 = metadata.bounds_m
    return (x0 + x1) / 2.0, (y0 + y1) / 2.0

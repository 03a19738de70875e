"""One robot: it observes, offers its map, considers what others offer, verifies what it merged, and reverts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from mapgraft.attempt import Attempt, Attempts, Grafted, Meeting
from mapgraft.candidates import Candidates, LastAttempt
from mapgraft.contracts import Donation, MapMetadata, MapType, Observation, Prior, Provenance, Sample
from mapgraft.decision import DecisionTable, facts_of
from mapgraft.errors import MapError
from mapgraft.events import DonorMap
from mapgraft.exchange import LayerMessage, Offer
from mapgraft.history import Journal, Moment
from mapgraft.merge import Merge
from mapgraft.persons import Hand, sigma_m
from mapgraft.procedures import Tools, Workshop
from mapgraft.refusals import Refusal
from mapgraft.registration import Move, Site
from mapgraft.reversal import Reversal
from mapgraft.trail import Trail

Fetch = Callable[[], bytes]
LONG = 64  # observations: so often it is found out which of them are still needed
EPOCH = 1  # a robot's map frame lives from its first to its last observation


@dataclass(frozen=True, slots=True, eq=False)
class Encounter:
    """What receiver and donor tell of their maps before one attempt, and what is known of how they site."""

    own: MapMetadata
    other: MapMetadata
    prior: Prior | None
    stamp_ns: int

    @property
    def site(self) -> Site:
        return Site.of(self.own, self.other)


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
    candidates: Candidates = field(default_factory=Candidates)
    trail: Trail = field(default_factory=Trail)
    looked_at: dict[str, tuple[int, Provenance]] = field(default_factory=dict)  # donor → versions last considered
    attempts: Attempts = field(init=False)
    _encoded: tuple[int, bytes] | None = None
    _described: tuple[int, MapMetadata] | None = None

    def __post_init__(self) -> None:
        self.attempts = Attempts(self.workshop, self.map_type, self.reversal)

    def observe(self, observation: Observation) -> None:
        """Integrate an own observation; verify and register anew every standing merge whose time has come."""
        self.trail.add(observation, self.reversal.observe(observation))
        self.attempts.changed()
        now = self.trail.now
        due = [merge for merge in self.merges.values() if now >= merge.due_at]
        for merge in due:
            self.verify(merge, observation.stamp_ns)
            if merge.state != "reverted" and merge.is_to_register():
                self._register(merge, observation.stamp_ns)
        if not self.merges or now % LONG == 0:
            self.trail.forget(min((merge.seen for merge in self.merges.values()), default=now))

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
            self._update(standing, received, fetch, stamp_ns)
            return
        both = (self.reversal.version, received.provenance)
        if self.looked_at.get(donor) == both:  # neither map has changed since: the answer would be the same
            return
        self.looked_at[donor] = both
        if self.hand.forbids(self.name, donor):
            self.journal.offered(stamp_ns, received.provenance, len(offer))
            self.journal.forbidden(stamp_ns, donor)
            return
        met = self._encounter(donor, received.metadata, stamp_ns)
        ruling = self.table.choose(facts_of(met.own, met.other, sigma_m(met.prior), self.reversal.name))
        rule = None if ruling.rejected else ruling.rule
        if rule and self.candidates.waits(donor, rule.name, rule.retry.growth, met.own, met.other):
            return
        self.journal.offered(stamp_ns, received.provenance, len(offer))
        if rule is None:
            self.journal.rejected(stamp_ns, donor, ruling)
        else:
            self._attempt(self.workshop.tools(rule), fetch(), met)

    def _encounter(self, donor: str, other: MapMetadata, stamp_ns: int) -> Encounter:
        """A prior is left out where the donor was taken out from there before."""
        own = self.own_metadata()
        prior = self.hand.priors.get((self.name, donor))
        about_m = Site.of(own, other).about_m
        if prior is not None and self.attempts.refusals.at(donor, prior.T_receiver_donor, about_m):
            prior = None
        return Encounter(own, other, prior, stamp_ns)

    def _attempt(self, tools: Tools, data: bytes, met: Encounter) -> None:
        donation = self._receive(data)
        donor = donation.provenance.source
        attempt = self.attempts.make(tools, donation, met.prior, met.site.about_m)
        merge_id = self.candidates.next_id(self.name, donor)
        if before := self.candidates.same_as_before(donor, attempt.match, met.site.about_m):
            attempt = replace(attempt, reason=f"{attempt.reason} (the same place as {before})")
        if attempt.grafted is None:
            last = LastAttempt(merge_id, tools.rule.name, attempt.match, met.own, met.other)
            self.candidates.keep(donor, last)
            self.journal.attempted(met.stamp_ns, attempt, tools, merge_id, donation.provenance, len(data))
        else:
            self.candidates.forget(donor)
            merge = self._merge(attempt, attempt.grafted, tools, merge_id, len(data), met)
            self._obey(merge, met.stamp_ns)

    def _receive(self, data: bytes) -> Donation:
        message = LayerMessage.decode(data)
        mine = message.map_type == self.map_type.name
        map_type = self.map_type if mine else self.workshop.map_type(message.map_type)
        return Donation(map_type.decode(message.payload), message.provenance)

    def _merge(
        self, attempt: Attempt, grafted: Grafted, tools: Tools, merge_id: str, size: int, met: Encounter
    ) -> Merge:
        provenance, stamp_ns = grafted.contribution.provenance, met.stamp_ns
        made = (merge_id, tools, grafted.match, provenance, grafted.comparison, self.reversal.name)
        meeting = grafted.meeting if tools.refines and self.reversal.name != "single_map" else None
        merge = Merge(*made, self.trail, met.site, meeting)
        self._snapshot("before merge", stamp_ns, merge_id, entering=(merge,))
        self.reversal.merge(merge_id, grafted.contribution)
        self._fused_changed()
        self.merges[merge.donor] = merge
        self.journal.attempted(stamp_ns, attempt, tools, merge_id, provenance, size)
        self._snapshot("after merge", stamp_ns, merge_id)
        sample = merge.start(stamp_ns, attempt.measurements)
        self.journal.changed("verified", stamp_ns, merge, "measured at the merge", "merge", sample)
        return merge

    def _obey(self, merge: Merge, stamp_ns: int) -> None:
        """Apply a person's verdict on this merge, if there is one."""
        verdict = self.hand.verdict_on(merge.merge_id, merge.comparison.T_receiver_donor, merge.site.about_m)
        if verdict is None:
            return
        said = f"a person said {verdict.action}" + (f": {verdict.reason}" if verdict.reason else "")
        by = f"person {verdict.by}".strip()
        if verdict.action == "revert":
            self.revert(merge, stamp_ns, said, by, by_person=True)
        else:
            merge.state, merge.decided_by_person = "confirmed", True
            self.journal.changed("confirmed", stamp_ns, merge, said, by)

    def _update(self, merge: Merge, offer: Offer, fetch: Fetch, stamp_ns: int) -> None:
        """Put the donor's newer layer in the place of the older one, where it lies best now, and look at it again."""
        if offer.provenance == merge.provenance or self.reversal.name == "single_map":  # which cannot tell the share
            return
        data = fetch()
        merge.site = replace(Site.of(offer.metadata, offer.metadata), cell_m=merge.site.cell_m)
        try:
            meeting = self.attempts.meet(merge.tools, self._receive(data))
            move = self._find_move(merge, meeting)
            grafted = self.attempts.graft(merge.tools, meeting, move.match if move else merge.match)
        except MapError as error:
            reason = f"the donor's newer map is left aside: {error}"
            self.journal.changed("verified", stamp_ns, merge, reason, "exchange", size=len(data))
            return
        moved = f"; {move.reason}" if move else ""
        self._swap(merge, grafted, f"the donor has gone on mapping{moved}", "exchange", stamp_ns, len(data))

    def _register(self, merge: Merge, stamp_ns: int) -> None:
        """Find out whether both maps, as they are now, tell a better transform, and put it in the place of the old."""
        if merge.meeting is None or (move := self._find_move(merge, merge.meeting)) is None:
            return
        try:
            grafted = self.attempts.graft(merge.tools, merge.meeting, move.match)
        except MapError as error:
            reason = f"{move.reason}, left aside: {error}"
            self.journal.changed("verified", stamp_ns, merge, reason, merge.tools.procedure.match.use)
            return
        self._swap(merge, grafted, move.reason, merge.tools.procedure.match.use, stamp_ns)

    def _find_move(self, merge: Merge, meeting: Meeting) -> Move | None:
        if not merge.may_move or not merge.has_grown(meeting):
            return None
        return self.attempts.find_move(merge.tools, meeting, merge.match, merge.stood[0], merge.site)

    def _swap(self, merge: Merge, grafted: Grafted, reason: str, by: str, stamp_ns: int, size: int = 0) -> None:
        """Replace the contribution by one of another layer, by another transform, or both.

        What was observed until now is judged first, by the transform that stood: what refines one never tests it.
        """
        if merge.has_news:
            self.verify(merge, stamp_ns, everything=True)
        if merge.state == "reverted":
            return
        self.reversal.replace(merge.merge_id, grafted.contribution)
        merge.replace(grafted)
        self.journal.changed("updated", stamp_ns, merge, reason, by, size=size)
        self.verify(merge, stamp_ns, everything=True, tell=True)

    def verify(self, merge: Merge, stamp_ns: int, everything: bool = False, tell: bool = False) -> None:
        """Measure a standing merge, let the verifier judge it when all it looks at was measured, and do as it says.

        A verdict like the last one is only written down at the rhythm of the log, or when somebody wants to ``tell``.
        """
        try:
            sample = merge.measure(stamp_ns, everything)
        except MapError as error:
            self.journal.changed("verified", stamp_ns, merge, f"it cannot be measured: {error}", "merge")
            return
        if sample is None:
            return
        if sample is not merge.history[-1]:
            self.journal.changed("verified", stamp_ns, merge, "measured for the record", "log", sample)
            return
        verdict, by = merge.judge(), merge.tools.procedure.verify.use
        tell = merge.tells(verdict, tell)
        if verdict.action == "revert" and not merge.decided_by_person:
            self.revert(merge, stamp_ns, verdict.reason, by, sample, evidence=verdict.evidence)
        elif verdict.action == "confirm" and merge.state == "provisional":
            merge.state = "confirmed"
            self.journal.changed("confirmed", stamp_ns, merge, verdict.reason, by, sample, evidence=verdict.evidence)
        elif tell:
            said = f"confirmed by a person; {verdict.reason}" if merge.decided_by_person else verdict.reason
            self.journal.changed("verified", stamp_ns, merge, said, by, sample, evidence=verdict.evidence)

    def revert(
        self,
        merge: Merge,
        stamp_ns: int,
        reason: str,
        by: str,
        sample: Sample | None = None,
        by_person: bool = False,
        evidence: Mapping[str, float] | None = None,
    ) -> None:
        """Take the donor's data out of the map again, and refuse its places from now on."""
        self._snapshot("before revert", stamp_ns, merge.merge_id)
        exactness = self.reversal.revert(merge.merge_id)
        del self.merges[merge.donor]
        self._fused_changed()
        merge.state = "reverted"
        refusal = Refusal(merge.merge_id, tuple(merge.stood), merge.match.score, by_person)
        self.attempts.refusals.add(merge.donor, refusal)
        self.journal.changed("reverted", stamp_ns, merge, reason, by, sample, exactness, evidence=evidence)
        self._snapshot("after revert", stamp_ns, merge.merge_id)

    def _fused_changed(self) -> None:
        """Something came in or went out: where metrics see the merged map, what they know of it no longer holds."""
        if self.reversal.subject == "merged":
            self.attempts.changed()
            for merge in self.merges.values():
                merge.target_changed()

    def finish(self, stamp_ns: int) -> None:
        """The last look at every standing merge, and the last snapshot."""
        for merge in list(self.merges.values()):
            if merge.has_news or merge.is_untold:
                self.verify(merge, stamp_ns, everything=True, tell=True)
        self._snapshot("end", stamp_ns)

    def _snapshot(self, why: Moment, stamp_ns: int, merge_id: str = "", entering: tuple[Merge, ...] = ()) -> None:
        def donors() -> Mapping[str, DonorMap]:
            merges = (*self.merges.values(), *entering)
            return {merge.donor: DonorMap(merge.comparison.map_type, merge.comparison.donor) for merge in merges}

        self.journal.snapshot(why, stamp_ns, self.own_metadata, self.encoded_layer, donors, merge_id)

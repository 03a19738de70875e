"""One robot: it observes, offers its map, and considers what others offer; what it merged stands or is reverted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from mapgraft.attempt import Attempt, Attempts, Grafted
from mapgraft.candidates import Candidates, LastAttempt
from mapgraft.contracts import MapMetadata, MapType, Observation, Provenance, Transform
from mapgraft.correction import Correction, Recollection
from mapgraft.decision import DecisionTable
from mapgraft.encounter import Encounter, Rules
from mapgraft.errors import IrreversibleError, MapError, PluginError, ReversalError
from mapgraft.exchange import Offer, SentLayer
from mapgraft.graph.claims import Claims, Source
from mapgraft.graph.consistency import Settings
from mapgraft.graph.member import Member, Through
from mapgraft.history import Journal
from mapgraft.left_out import LeftOut
from mapgraft.merge import Merge
from mapgraft.own_map import OwnMap
from mapgraft.persons import Hand
from mapgraft.procedures import Tools, Workshop
from mapgraft.registration import Site
from mapgraft.rendezvous import Rendezvous
from mapgraft.reversal import Reversal
from mapgraft.standing import Grounds, Standing


@dataclass(slots=True)
class Robot:
    """One robot with its map and its merges; it decides for itself and knows the others only from bytes.

    With a ``recollection`` it keeps what it observes, so that it can be corrected. ``epoch`` counts the lives of its
    map frame. ``name`` is what it is called in its own history, also when others have to know it by another one.
    """

    name: str
    map_type: MapType
    reversal: Reversal
    table: DecisionTable
    workshop: Workshop
    hand: Hand
    journal: Journal
    candidates: Candidates = field(default_factory=Candidates)
    looked_at: dict[str, tuple[int, Provenance]] = field(default_factory=dict)  # donor → versions last considered
    wanted: dict[str, tuple[int, Provenance]] = field(default_factory=dict)  # donor → versions when it was asked for
    left_out: LeftOut = field(default_factory=LeftOut)
    failed: str = ""  # why the robot takes no part any more
    retired: bool = False  # its map frame has begun anew, and another source goes on
    through: Through = "confirmed"
    consistency: Settings = field(default_factory=Settings)
    recollection: Recollection | None = None
    epoch: int = 1
    rendezvous: Rendezvous | None = None
    own: OwnMap = field(init=False)
    attempts: Attempts = field(init=False)
    standing: Standing = field(init=False)
    graph: Member = field(init=False)
    corrected: dict[str, int] = field(default_factory=dict)  # donor → how often its map was corrected
    corrected_ns: list[int] = field(default_factory=list)  # when it mapped anew
    _followed: int = 0

    def __post_init__(self) -> None:
        me = Source(self.name, self.epoch)
        self.own = OwnMap(me, self.map_type, self.reversal, self.workshop, self.journal)
        self.attempts = Attempts(self.workshop, self.map_type, self.reversal, rendezvous=self.rendezvous)
        self.standing = Standing(self.own, self.attempts)
        self.graph = Member(me, self.standing, self.table, self.hand, self.through, self.consistency)

    @property
    def merges(self) -> Mapping[str, Merge]:
        """The standing merges by donor."""
        return self.standing.by_donor

    @property
    def claims(self) -> Claims:
        """What this robot has heard of merges, its own among them."""
        return self.graph.claims

    def observe(self, observation: Observation) -> None:
        """Integrate an own observation; verify and register anew every standing merge whose time has come.

        An observation that the map type refuses is left out and counted; a map type that fails ends the robot's part
        in the run, because nobody knows what it has left of its layer.
        """
        if self.failed:
            self.left_out.add(observation, f"{self.name} takes no part any more: {self.failed}")
            return
        try:
            with self.own.asking():
                touched = self.reversal.observe(observation)
        except MapError as error:
            self.left_out.add(observation, str(error))
            return
        except PluginError as error:
            self.left_out.add(observation, str(error))
            self.fail(error, observation.stamp_ns)
            return
        self.attempts.changed(observation.T_map_base)
        if self.recollection is not None:
            self.recollection.observations.append(observation)
        if self.rendezvous is not None:
            self.rendezvous.moved(observation)
        try:
            self.standing.observed(observation, touched)
            if self.standing.changes != self._followed or self.standing.doubted:
                self.heard(observation.stamp_ns)
        except ReversalError as error:
            self.fail(error, observation.stamp_ns)

    def correct(self, correction: Correction) -> None:
        """Map anew what was observed, at the places at which it belongs by now, and look at every merge again.

        The own layer is then that of a robot that has known from the start. A correction that moves nothing says
        nothing new; one that cannot be followed leaves everything as it was, and says so.
        """
        if self.failed or self.recollection is None:
            return
        if self.reversal.mixed:
            said = "others were merged into its single map, and nobody can tell any more what in it is its own"
            self.journal.uncorrected(correction.stamp_ns, f"{said}: use the reversal ledger or multi_map")
            return
        anew, stamp_ns = self.recollection.corrected(correction), correction.stamp_ns
        if anew is None:
            return
        try:
            layer, touched = self.own.mapped(anew.observations)
            with self.own.asking():
                self.reversal.remap(layer, touched)
        except MapError as error:
            self.journal.uncorrected(stamp_ns, str(error))
            return
        except PluginError as error:
            self.complain(error, stamp_ns)
            return
        self.recollection.observations[:] = anew.observations
        if self.rendezvous is not None:
            self.rendezvous.corrected(anew.observations)
        self.corrected_ns.append(stamp_ns)
        self.own.corrections += 1
        self.attempts.changed()
        self._try_anew(*self.candidates.counts)
        self.journal.corrected(stamp_ns, anew)
        try:
            self.standing.remapped(self.graph.layers, stamp_ns)
            self.heard(stamp_ns)
        except ReversalError as error:
            self.fail(error, stamp_ns)

    def met(self, other: Source, stamp_ns: int) -> None:
        """More is known of where this robot and another saw each other; raises IrreversibleError as ``heard``."""
        self.candidates.forget(other.name)
        self.looked_at.pop(other.name, None)
        if (merge := self.merges.get(other.name)) is not None and not self.failed:
            self.standing.verify(merge, stamp_ns, everything=True, tell=True)

    def heard(self, stamp_ns: int) -> None:
        """Draw the consequences for the own map of all claims and layers that are known by now.

        Raises IrreversibleError when the map type cannot take out again what follows from them.
        """
        if not self.failed:
            self.graph.heard(stamp_ns)
            self._followed = self.standing.changes

    @property
    def T_map_base(self) -> Transform | None:
        """Where the robot knows it was last, where it keeps that."""
        known = self.recollection.observations if self.recollection is not None else []
        return known[-1].T_map_base if known else None

    def rename(self, me: Source, reason: str, stamp_ns: int) -> None:
        """Be another source to others from now on; what it claimed under the old name stays. Raises as ``heard``."""
        self.own.me = self.graph.me = me
        self.journal.renamed(stamp_ns, me, reason)
        self.heard(stamp_ns)

    def retire(self, successor: Source, stamp_ns: int) -> None:
        """The robot has begun again in another map frame."""
        self.finish(stamp_ns)
        self.journal.renamed(stamp_ns, successor, "its map frame has begun anew")
        self.retired = True

    def fail(self, error: PluginError | MapError | ReversalError, stamp_ns: int) -> None:
        """End this robot's part in the run, and say why; what stands in its map stays."""
        self.failed = str(error)
        if not isinstance(error, IrreversibleError):  # which was told of where it came up
            self.complain(error, stamp_ns)

    def complain(self, error: PluginError | MapError | ReversalError, stamp_ns: int) -> None:
        """Write down what plugins did wrong that concerns no merge."""
        self.standing.complain(error, stamp_ns, "")

    def _try_anew(self, *donors: str) -> None:
        """A map is another one now: what was tried with the one that it was need not wait, and is not refused."""
        for donor in donors:
            self.candidates.forget(donor)
            self.attempts.refusals.forget(donor)

    def belongs(self, source: Source, writer: bytes, stamp_ns: int) -> None:
        """A source is that writer's: what came as its from another robot of the name goes. Raises as ``heard``."""
        if self.failed:
            return
        for known in (self.looked_at, self.wanted, self.corrected):
            known.pop(source.name, None)
        self._try_anew(source.name)
        self.graph.belongs(source, writer, stamp_ns)

    def offer(self) -> bytes:
        """What this robot tells about its map; raises FailedPluginError or MapError when its type cannot tell."""
        return self.own.offer()

    def layer(self) -> SentLayer:
        """This robot's own evidence, raw and in its own frame, as a whole; raises as ``offer``."""
        return self.own.layer()

    def wants(self, offer: bytes, size: int, stamp_ns: int) -> bool:
        """Whether a donor's layer is wanted: to bring a standing merge up to date, or to try to merge it.

        ``size`` is how many bytes told of it. What is turned away is written down. Raises MapError when the bytes are
        no offer.
        """
        received = Offer.decode(offer)
        donor = received.provenance.source
        if self.corrected.get(donor, 0) != received.corrections:
            self.corrected[donor] = received.corrections
            self._try_anew(donor)
        if (standing := self.merges.get(donor)) is not None:
            return self.standing.awaits(standing, received)
        both = (self.reversal.version, received.provenance)
        if self.looked_at.get(donor) == both:  # neither map has changed since: the answer would be the same
            return False
        if self.wanted.get(donor) == both:  # it did not come
            return True
        if self.hand.forbids(self.name, donor):
            self.looked_at[donor] = both
            self.journal.offered(stamp_ns, received.provenance, size)
            self.journal.forbidden(stamp_ns, donor)
            return False
        with self.own.asking():
            met = self._encounter(donor, received.metadata, stamp_ns)
        rules = Rules(self.table, self.workshop, met, self.reversal.name)
        rule = rules.next()
        if rule and self.candidates.waits(donor, rule.name, rule.retry.growth, met.own, met.other):
            self.looked_at[donor] = both
            return False
        self.journal.offered(stamp_ns, received.provenance, size)
        if rule is None:
            self.looked_at[donor] = both
            self.journal.rejected(stamp_ns, donor, rules.ruling)
            return False
        self.wanted[donor] = both
        return True

    def consider(self, offer: bytes, sent: SentLayer, stamp_ns: int, preview: bool = False) -> bool:
        """Decide about a donor's layer that was wanted: merge it, or bring a standing merge up to date.

        Of a ``preview`` only this is found out, whether the layer itself is worth to be sent: what comes back.
        """
        received = Offer.decode(offer)
        donor = received.provenance.source
        if (standing := self.merges.get(donor)) is not None:
            was_corrected = sent.corrections != standing.corrections[1]
            if not preview and self.standing.awaits(standing, received):
                self.standing.update(standing, received.metadata, sent, stamp_ns)
            if preview or donor in self.merges or not was_corrected:
                return preview
        with self.own.asking():
            met = self._encounter(donor, received.metadata, stamp_ns)
        worth = self._decide(donor, sent, met, preview)
        if not worth:
            self.looked_at[donor] = (self.reversal.version, received.provenance)
        return worth

    def refused(self, offer: bytes, reason: str, stamp_ns: int) -> None:
        """A donor's layer that was wanted cannot be had."""
        received = Offer.decode(offer)
        if received.provenance.source in self.merges:
            return
        self.looked_at[received.provenance.source] = (self.reversal.version, received.provenance)
        with self.own.asking():
            met = self._encounter(received.provenance.source, received.metadata, stamp_ns)
        rule = Rules(self.table, self.workshop, met, self.reversal.name).next()
        if rule is not None:
            self._unusable(self.workshop.tools(rule), received.provenance, met, reason)

    def _decide(self, donor: str, sent: SentLayer, met: Encounter, preview: bool) -> bool:
        """Try the first rule that applies; where a plugin of it fails, say so and go on with the next one."""
        rules = Rules(self.table, self.workshop, met, self.reversal.name)
        while (rule := rules.next()) is not None:
            if self.candidates.waits(donor, rule.name, rule.retry.growth, met.own, met.other):
                return False
            try:
                tools = self.workshop.tools(rule)
                return self._attempt(tools, sent, met, preview)
            except MapError as error:  # what the donor sent, or the map that would come of it, cannot be used
                self._unusable(tools, sent.provenance, met, str(error))
                return False
            except PluginError as error:
                self.standing.complain(error, met.stamp_ns, donor, rule.name)
                rules.pass_over(rule, str(error))
        self.journal.rejected(met.stamp_ns, donor, rules.ruling)
        return False

    def _unusable(self, tools: Tools, provenance: Provenance, met: Encounter, reason: str) -> None:
        """An attempt that came to nothing, because there was nothing to try."""
        donor = provenance.source
        attempt, merge_id = Attempt("unmatched", reason, 0), self._next_id(provenance)
        self.candidates.keep(donor, LastAttempt(merge_id, tools.rule.name, None, met.own, met.other))
        self.journal.attempted(met.stamp_ns, attempt, tools, merge_id, provenance, 0)

    def _encounter(self, donor: str, other: MapMetadata, stamp_ns: int) -> Encounter:
        """A prior is left out where the donor was taken out from there before."""
        own = self.own.own_metadata()
        prior = self.hand.priors.get((self.name, donor))
        about_m = Site.of(own, other).about_m
        if prior is not None and self.attempts.refusals.at(donor, prior.T_receiver_donor, about_m):
            prior = None
        self.journal.encountered(donor, own, other)
        return Encounter(own, other, prior, stamp_ns)

    def _attempt(self, tools: Tools, sent: SentLayer, met: Encounter, preview: bool) -> bool:
        """One attempt, written down; a preview is only held against the own map, and then says whether to go on."""
        donation = self.own.receive(sent)
        donor = donation.provenance.source
        attempt = self.attempts.make(tools, donation, met.prior, met.site.about_m)
        if preview:
            if attempt.verdict != "unmatched":
                return True
            attempt = replace(attempt, reason=f"{attempt.reason} (from its preview)")
        merge_id = self._next_id(donation.provenance)
        if before := self.candidates.same_as_before(donor, attempt.match, met.site.about_m):
            attempt = replace(attempt, reason=f"{attempt.reason} (the same place as {before})")
        self.journal.attempting(merge_id, donation, attempt, tools)
        if attempt.grafted is None:
            last = LastAttempt(merge_id, tools.rule.name, attempt.match, met.own, met.other)
            self.candidates.keep(donor, last)
            self.journal.attempted(met.stamp_ns, attempt, tools, merge_id, donation.provenance, sent.size)
        else:
            self.candidates.forget(donor)
            merge = self._merge(attempt, attempt.grafted, tools, merge_id, sent, met)
            self._obey(merge, met.stamp_ns)
        return False

    def _next_id(self, donor: Provenance) -> str:
        told = self.claims.of(self.graph.me, Source(donor.source, donor.epoch))
        return self.candidates.next_id(self.name, donor.source, told)

    def _merge(
        self, attempt: Attempt, grafted: Grafted, tools: Tools, merge_id: str, sent: SentLayer, met: Encounter
    ) -> Merge:
        provenance, stamp_ns = grafted.contribution.provenance, met.stamp_ns
        self.graph.make_room(Source(provenance.source, provenance.epoch), stamp_ns)
        made = (merge_id, tools, grafted.match, provenance, grafted.comparison, self.reversal.name)
        meeting = grafted.meeting if tools.refines and self.reversal.name != "single_map" else None
        corrections = (self.own.corrections, sent.corrections)
        merge = Merge(*made, self.standing.trail, met.site, meeting, corrections=corrections, writer=sent.writer)
        self.standing.show("before merge", stamp_ns, merge_id, entering=(merge,))
        with self.workshop.guard.calling("fuser", tools.procedure.fuse.use):
            self.reversal.merge(merge_id, grafted.contribution)
        self.standing.add(merge)
        self.journal.attempted(stamp_ns, attempt, tools, merge_id, provenance, sent.size)
        self.standing.show("after merge", stamp_ns, merge_id)
        try:
            with self.own.naming():
                sample = merge.start(stamp_ns, attempt.measurements)
        except PluginError as error:
            self.standing.revert(merge, stamp_ns, Grounds(f"it cannot be measured: {error}", "merge"), refuse=False)
            raise
        self.journal.measured(merge, sample)
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
            self.standing.revert(merge, stamp_ns, Grounds(said, by, by_person=True))
        else:
            merge.state, merge.decided_by_person = "confirmed", True
            self.journal.changed("confirmed", stamp_ns, merge, said, by)

    def finish(self, stamp_ns: int) -> None:
        """The last look at every standing merge, and the last snapshot."""
        try:
            if not self.failed:
                self.standing.end(stamp_ns)
                self.heard(stamp_ns)
        except ReversalError as error:
            self.fail(error, stamp_ns)
        self.standing.show("end", stamp_ns)

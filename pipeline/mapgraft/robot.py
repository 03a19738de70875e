"""One robot: it observes, offers its map, and considers what others offer; what it merged stands or is reverted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from mapgraft.attempt import Attempt, Attempts, Grafted
from mapgraft.candidates import Candidates, LastAttempt
from mapgraft.contracts import MapMetadata, MapType, Observation, Prior, Provenance
from mapgraft.decision import DecisionTable, facts_of
from mapgraft.errors import IrreversibleError, MapError, PluginError, ReversalError
from mapgraft.exchange import Offer
from mapgraft.history import Journal
from mapgraft.left_out import LeftOut
from mapgraft.merge import Merge
from mapgraft.own_map import OwnMap
from mapgraft.persons import Hand, sigma_m
from mapgraft.procedures import Tools, Workshop
from mapgraft.registration import Site
from mapgraft.reversal import Reversal
from mapgraft.standing import Fetch, Grounds, Standing


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
    candidates: Candidates = field(default_factory=Candidates)
    looked_at: dict[str, tuple[int, Provenance]] = field(default_factory=dict)  # donor → versions last considered
    left_out: LeftOut = field(default_factory=LeftOut)
    failed: str = ""  # why the robot takes no part any more
    own: OwnMap = field(init=False)
    attempts: Attempts = field(init=False)
    standing: Standing = field(init=False)

    def __post_init__(self) -> None:
        self.own = OwnMap(self.name, self.map_type, self.reversal, self.workshop, self.journal)
        self.attempts = Attempts(self.workshop, self.map_type, self.reversal)
        self.standing = Standing(self.own, self.attempts)

    @property
    def merges(self) -> Mapping[str, Merge]:
        """The standing merges by donor."""
        return self.standing.by_donor

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
        self.attempts.changed()
        try:
            self.standing.observed(observation, touched)
        except ReversalError as error:
            self.fail(error, observation.stamp_ns)

    def fail(self, error: PluginError | MapError | ReversalError, stamp_ns: int) -> None:
        """End this robot's part in the run, and say why; what stands in its map stays."""
        self.failed = str(error)
        if not isinstance(error, IrreversibleError):  # which was told of where it came up
            self.complain(error, stamp_ns)

    def complain(self, error: PluginError | MapError | ReversalError, stamp_ns: int) -> None:
        """Write down what plugins did wrong that concerns no merge."""
        self.standing.complain(error, stamp_ns, "")

    def offer(self) -> bytes:
        """What this robot tells about its map; raises FailedPluginError or MapError when its type cannot tell."""
        return self.own.offer()

    def layer(self) -> bytes:
        """This robot's own evidence, raw and in its own frame, ready to send; raises as ``offer``."""
        return self.own.layer()

    def consider(self, offer: bytes, fetch: Fetch, stamp_ns: int) -> None:
        """Decide about a donor's offer: turn it away, merge its map, or bring a standing merge up to date."""
        received = Offer.decode(offer)
        donor = received.provenance.source
        if (standing := self.merges.get(donor)) is not None:
            self.standing.update(standing, received, fetch, stamp_ns)
            return
        both = (self.reversal.version, received.provenance)
        if self.looked_at.get(donor) == both:  # neither map has changed since: the answer would be the same
            return
        self.looked_at[donor] = both
        if self.hand.forbids(self.name, donor):
            self.journal.offered(stamp_ns, received.provenance, len(offer))
            self.journal.forbidden(stamp_ns, donor)
            return
        with self.own.asking():
            met = self._encounter(donor, received.metadata, stamp_ns)
        self._decide(received, len(offer), fetch, met)

    def _decide(self, received: Offer, size: int, fetch: Fetch, met: Encounter) -> None:
        """Try the first rule that applies; where a plugin of it fails, say so and go on with the next one."""
        donor, stamp_ns, told = received.provenance.source, met.stamp_ns, False
        facts = facts_of(met.own, met.other, sigma_m(met.prior), self.reversal.name)
        rules, own, other = [record.rule for record in self.table.records], met.own.type, met.other.type
        passed = {id(rule): why for rule in rules if (why := self.workshop.out_of_order(rule, own, other))}
        while True:
            ruling = self.table.choose(facts, passed)
            rule = None if ruling.rejected else ruling.rule
            if rule and self.candidates.waits(donor, rule.name, rule.retry.growth, met.own, met.other):
                return
            if not told:
                self.journal.offered(stamp_ns, received.provenance, size)
                told = True
            if rule is None:
                self.journal.rejected(stamp_ns, donor, ruling)
                return
            try:
                tools = self.workshop.tools(rule)
                self._attempt(tools, fetch(), met)
                return
            except MapError as error:  # what the donor sent, or the map that would come of it, cannot be used
                attempt, merge_id = Attempt("unmatched", str(error), 0), self.candidates.next_id(self.name, donor)
                self.candidates.keep(donor, LastAttempt(merge_id, rule.name, None, met.own, met.other))
                self.journal.attempted(stamp_ns, attempt, tools, merge_id, received.provenance, 0)
                return
            except PluginError as error:
                self.standing.complain(error, stamp_ns, donor, rule.name)
                passed[id(rule)] = str(error)

    def _encounter(self, donor: str, other: MapMetadata, stamp_ns: int) -> Encounter:
        """A prior is left out where the donor was taken out from there before."""
        own = self.own.own_metadata()
        prior = self.hand.priors.get((self.name, donor))
        about_m = Site.of(own, other).about_m
        if prior is not None and self.attempts.refusals.at(donor, prior.T_receiver_donor, about_m):
            prior = None
        self.journal.encountered(donor, own, other)
        return Encounter(own, other, prior, stamp_ns)

    def _attempt(self, tools: Tools, data: bytes, met: Encounter) -> None:
        donation = self.own.receive(data)
        donor = donation.provenance.source
        attempt = self.attempts.make(tools, donation, met.prior, met.site.about_m)
        merge_id = self.candidates.next_id(self.name, donor)
        if before := self.candidates.same_as_before(donor, attempt.match, met.site.about_m):
            attempt = replace(attempt, reason=f"{attempt.reason} (the same place as {before})")
        self.journal.attempting(merge_id, donation, attempt, tools)
        if attempt.grafted is None:
            last = LastAttempt(merge_id, tools.rule.name, attempt.match, met.own, met.other)
            self.candidates.keep(donor, last)
            self.journal.attempted(met.stamp_ns, attempt, tools, merge_id, donation.provenance, len(data))
        else:
            self.candidates.forget(donor)
            merge = self._merge(attempt, attempt.grafted, tools, merge_id, len(data), met)
            self._obey(merge, met.stamp_ns)

    def _merge(
        self, attempt: Attempt, grafted: Grafted, tools: Tools, merge_id: str, size: int, met: Encounter
    ) -> Merge:
        provenance, stamp_ns = grafted.contribution.provenance, met.stamp_ns
        made = (merge_id, tools, grafted.match, provenance, grafted.comparison, self.reversal.name)
        meeting = grafted.meeting if tools.refines and self.reversal.name != "single_map" else None
        merge = Merge(*made, self.standing.trail, met.site, meeting)
        self.standing.show("before merge", stamp_ns, merge_id, entering=(merge,))
        with self.workshop.guard.calling("fuser", tools.procedure.fuse.use):
            self.reversal.merge(merge_id, grafted.contribution)
        self.standing.add(merge)
        self.journal.attempted(stamp_ns, attempt, tools, merge_id, provenance, size)
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
        except ReversalError as error:
            self.fail(error, stamp_ns)
        self.standing.show("end", stamp_ns)

"""One robot in the graph of merges: what it claims, what it believes of others, and what follows for its own map."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final, Literal, NamedTuple

from mapgraft.contracts import Transform, Verdict
from mapgraft.decision import DecisionTable
from mapgraft.graph.attached import Attachments
from mapgraft.graph.book import Grounds
from mapgraft.graph.chains import Chain, best_chains
from mapgraft.graph.claims import PERSON, Claim, Claims, Edge, Source, State, is_covariance
from mapgraft.graph.consistency import Explanation, Settings, explain
from mapgraft.graph.contradictions import Contradictions, is_contradicted
from mapgraft.graph.held import HeldLayers
from mapgraft.graph.loops import find_loops
from mapgraft.merge import Merge
from mapgraft.persons import Hand
from mapgraft.refusals import Refusal
from mapgraft.standing import Grounds as Reasons
from mapgraft.standing import Standing

CONSISTENCY: Final = "consistency"
NAMESAKE: Final = "namesake"
NEWS: Final = 1.0  # nats by which the support of a merge must move before it is told again
Through = Literal["confirmed", "provisional", "none"]


class Doubt(NamedTuple):
    """Why a claim of others is not believed, and of whose layer it was found out."""

    source: Source
    reason: str


@dataclass(slots=True)
class Member:
    """The claims and layers that one robot has heard of, its own among them, and what it makes of them.

    ``through`` says by which merges of others layers are attached. ``disbelieved`` are claims of others, by edge, epoch
    and corrections, that own observations have contradicted.
    """

    me: Source
    standing: Standing
    table: DecisionTable
    hand: Hand
    through: Through = "confirmed"
    settings: Settings = field(default_factory=Settings)
    claims: Claims = field(default_factory=Claims)
    layers: HeldLayers = field(default_factory=HeldLayers)
    disbelieved: dict[tuple[Edge, int, tuple[int, int]], Doubt] = field(default_factory=dict)
    attachments: Attachments = field(init=False)
    contradictions: Contradictions = field(init=False)
    _written: set[tuple[Edge, int, Transform]] = field(default_factory=set)  # what it told of own merges, by epoch
    _disputed: dict[Edge, int] = field(default_factory=dict)
    _explained: tuple[int, Explanation] = (-1, Explanation())
    _known: tuple[object, ...] = ()
    _latest: Mapping[Source, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.attachments = Attachments(self.standing, self.table)
        self.contradictions = Contradictions(self.standing)

    def publish(self, stamp_ns: int) -> None:
        """Bring the claims about the robot's own merges up to date."""
        merges = {_donor_of(merge): merge for merge in self.standing.by_donor.values()}
        for donor, merge in sorted(merges.items()):
            known = self.claims.of(self.me, donor)
            if known is not None and self._is_anothers(known, merge):
                merge.epoch = known.epoch + 1
            if known is None or known.epoch < merge.epoch:
                self._tell(donor, merge, 0, stamp_ns)
            elif known.is_active and _is_news(known, merge):
                self._tell(donor, merge, known.revision + 1, stamp_ns)
        for claim in self.claims.active():
            if claim.receiver == self.me and claim.donor not in merges:
                self.claims.add(_reverted(claim, stamp_ns, *self._why_ended(claim)))

    def _tell(self, donor: Source, merge: Merge, revision: int, stamp_ns: int) -> None:
        """Write another revision of the claim about an own merge."""
        claim = _claim(self.me, donor, merge, revision, stamp_ns)
        self._written.add((claim.edge, claim.epoch, claim.T_receiver_donor))
        self.claims.add(claim)

    def _has_written(self, claim: Claim) -> bool:
        """Whether a claim says, or takes back, what this robot has told of a merge of its own."""
        return (claim.edge, claim.epoch, claim.T_receiver_donor) in self._written

    def _is_anothers(self, known: Claim, merge: Merge) -> bool:
        """Whether what is known of an own merge is not for it to obey: it is told anew, in an epoch of its own.

        Another robot of the same name has written it, or a donor that had not heard what a person confirmed.
        """
        if known.epoch != merge.epoch:
            return known.epoch > merge.epoch
        if not self._has_written(known):
            return True
        return not known.is_active and (merge.decided_by_person or known.by == NAMESAKE)

    def _why_ended(self, claim: Claim) -> tuple[str, str]:
        """Who ended an own merge that was told of, and why."""
        if not self._has_written(claim):
            return NAMESAKE, f"another robot is called {self.me.name}, too, and has told it"
        ended = self.standing.ended.get(claim.donor.name)
        return (ended.by, ended.reason) if ended else ("", "")

    def heard(self, stamp_ns: int) -> None:
        """Draw the consequences of what is known now: revert, attach, detach.

        The result depends on what is known, and not on the order in which it came.
        """
        self.publish(stamp_ns)
        known = self._state()
        if known == self._known and not self.standing.doubted:
            return
        self.contradictions.settle(self.explanation())
        explanation = self._settled(stamp_ns)
        self.contradictions.lift(self.claims)
        self._tell_disputes(explanation, stamp_ns)
        self._attach(explanation, stamp_ns)
        while self._doubt(stamp_ns):
            self._attach(explanation, stamp_ns)
        self._known = self._state()

    def wants(self) -> Mapping[Source, int]:
        """The sources whose layers the robot can attach or would pass on, with the version it holds, -1 for none."""
        if not self.standing.reversal.exact:
            return {}
        chains = self._wanted(self.explanation())
        return {source: self.version(source) for source in chains}

    def explanation(self) -> Explanation:
        """What the loops of all claims tell that are known now."""
        if self._explained[0] != self.claims.version:
            self._explained = (self.claims.version, explain(self.claims.active(), self.settings))
        return self._explained[1]

    def version(self, source: Source) -> int:
        """How new the layer is that the robot has of a source, its own among them; -1 where it has none."""
        if source == self.me:
            return self.standing.reversal.offered_version
        held = self.layers.version(source)
        return -1 if held is None else held

    def make_room(self, donor: Source, stamp_ns: int) -> None:
        """The robot is about to merge a layer at first hand: a source counts once."""
        self.attachments.detach(donor, "it is merged at first hand now", stamp_ns)

    def belongs(self, source: Source, writer: bytes, stamp_ns: int) -> None:
        """A source is that writer's: what stands of it by others, whom it was taken for, goes, and refuses nothing."""
        self.layers.belongs(source, writer)
        reason = f"it is the map of another robot that is called {source.name}"
        merge, attached = self.standing.by_donor.get(source.name), self.standing.attached.get(source)
        if merge is not None and _donor_of(merge) == source and merge.writer > writer:
            self.standing.revert(merge, stamp_ns, Reasons(reason, NAMESAKE), refuse=False)
        if attached is not None and attached.writer > writer:
            self.attachments.detach(source, reason, stamp_ns)
        self.publish(stamp_ns)
        ended = self.standing.ended.get(source.name)
        if ended is not None and ended.donor == source:  # it tells of the other one's cells
            del self.standing.ended[source.name]
        doubts = {named: doubt for named, doubt in self.disbelieved.items() if doubt.source != source}
        self.disbelieved = doubts

    def _state(self) -> tuple[object, ...]:
        standing = tuple(sorted(merge.merge_id for merge in self.standing.all))
        own, refused = self.standing.reversal.version, self.standing.attempts.refusals.changes
        return self.me, self.claims.version, self.layers.changes, len(self.disbelieved), refused, own, standing

    def _settled(self, stamp_ns: int) -> Explanation:
        """Revert what cannot stand, as far as it is this robot's affair, until nothing more follows."""
        while True:
            self._bear_witness(stamp_ns)
            explanation, before = self.explanation(), self.claims.version
            for claim in [one for one in self.claims if not one.is_active and one.receiver == self.me]:
                self._obey(claim, stamp_ns)
            for edge, grounds in explanation.told.items():
                if edge.receiver == self.me and self.settings.trials:
                    self.contradictions.try_out(grounds.claim, explanation, self.layers, stamp_ns)
            self.publish(stamp_ns)
            if self.claims.version != before:
                continue
            for grounds in explanation.wrong.values():
                self._take_back(grounds, explanation, stamp_ns)
            self.publish(stamp_ns)
            if self.claims.version == before:
                return explanation

    def _bear_witness(self, stamp_ns: int) -> None:
        """Where own cells have spoken against a merge, they speak against the other robot's merge there, too."""
        for ended in self.standing.ended.values():
            claim = self.claims.of(ended.donor, self.me)
            if claim is None or not claim.is_active or claim.is_decided or not ended.against > 0.0:
                continue
            if is_contradicted(claim, self.me, ended, self.settings.margin):
                self.claims.add(_reverted(claim, stamp_ns, ended.by, f"{ended.merge_id} was there, and {ended.reason}"))

    def _take_back(self, grounds: Grounds, explanation: Explanation, stamp_ns: int) -> None:
        """A claim that cannot stand is reverted by its receiver, and if that does not hear of it by its donor."""
        claim = grounds.claim
        if claim.receiver == self.me:
            merge = self.standing.by_donor.get(claim.donor.name)
            if merge is not None and merge.epoch == claim.epoch and not merge.decided_by_person:
                told = Reasons(_said(grounds, merge), CONSISTENCY, evidence=_measured(grounds, merge))
                self.standing.revert(merge, stamp_ns, told)
                self.contradictions.reverted(merge, claim, explanation.loops)
        elif claim.donor == self.me and not claim.is_decided:
            self.claims.add(_reverted(claim, stamp_ns, CONSISTENCY, grounds.sentence))

    def _obey(self, claim: Claim, stamp_ns: int) -> None:
        """The donor has taken back a merge that stands here."""
        merge = self.standing.by_donor.get(claim.donor.name)
        if merge is None or merge.epoch != claim.epoch or merge.decided_by_person:
            return
        stood = _claim(self.me, claim.donor, merge, claim.revision, stamp_ns)
        self.standing.revert(merge, stamp_ns, Reasons(f"{claim.donor.name} says: {claim.reason}", claim.by))
        if claim.by == CONSISTENCY:  # who speaks first makes no difference to how long the place is refused
            loops = find_loops((*self.claims.active(), stood), self.settings.tolerance)
            self.contradictions.reverted(merge, stood, loops)

    def _tell_disputes(self, explanation: Explanation, stamp_ns: int) -> None:
        """Say once of each own merge that it is in dispute."""
        mine = {edge: grounds for edge, grounds in explanation.disputed.items() if edge.receiver == self.me}
        for edge, grounds in mine.items():
            if self._disputed.get(edge) != grounds.claim.epoch:
                merge = self.standing.by_donor.get(edge.donor.name)
                said = f"{_said(grounds, merge)}, and nobody can tell which merge is wrong"
                said += ": nothing is attached through it"
                journal, by = self.standing.journal, CONSISTENCY
                merge_id = merge.merge_id if merge else grounds.claim.merge_id
                journal.told_of("disputed", stamp_ns, grounds.claim, said, by, _measured(grounds, merge), merge_id)
        self._disputed = {edge: grounds.claim.epoch for edge, grounds in mine.items()}

    def _attach(self, explanation: Explanation, stamp_ns: int) -> None:
        def why_not(chain: Chain) -> str:
            return self._why_not(chain, explanation)

        wanted = self._wanted(explanation)
        if not self.standing.reversal.exact:
            for source in wanted:
                self.attachments.leave(source, "a single map cannot take out exactly what is attached", stamp_ns)
            return
        self.attachments.bring_about(wanted, self.layers, why_not, stamp_ns)

    def _wanted(self, explanation: Explanation) -> dict[Source, Chain]:
        """Whose layers belong into the map, each by its best-supported chain."""
        if self.through == "none":
            return {}
        self._latest = self._corrections()
        believed = [claim for claim in self.claims.active() if not self._disbelief(claim, explanation)]
        first_hand = {_donor_of(merge) for merge in self.standing.by_donor.values()}
        return {
            source: chain
            for source, chain in best_chains(self.me, believed).items()
            if source not in first_hand and not self.hand.forbids(self.standing.journal.robot, source.name)
        }

    def _disbelief(self, claim: Claim, explanation: Explanation) -> str:
        """Why nothing is attached through a claim; empty where it is believed."""
        if not claim.is_active:
            return f"{claim.merge_id} was reverted" + (f" by {claim.by}" if claim.by else "")
        if (grounds := explanation.wrong.get(claim.edge)) is not None:
            return f"{claim.merge_id} contradicts other merges: {grounds.sentence}"
        if claim.edge in explanation.disputed:
            return f"{claim.merge_id} is in dispute"
        for end in claim.edge:
            if claim.corrections_of(end) < self._latest.get(end, 0):
                return f"{claim.merge_id} was found before {end.name}'s map was corrected"
        if doubt := self.disbelieved.get((claim.edge, claim.epoch, claim.corrections)):
            return f"{claim.merge_id} is not believed: {doubt.reason}"
        if claim.receiver != self.me and claim.state != "confirmed" and self.through != "provisional":
            return f"{claim.merge_id} is not confirmed"
        return ""

    def _corrections(self) -> dict[Source, int]:
        """How often the map of each source has been corrected, as far as anybody has told."""
        latest = {self.me: self.standing.own.corrections}
        for claim in self.claims.active():
            for end in claim.edge:
                latest[end] = max(latest.get(end, 0), claim.corrections_of(end), self.layers.corrections(end))
        return latest

    def _why_not(self, chain: Chain, explanation: Explanation) -> str:
        """Why something can no longer be attached by a chain, or need not be."""
        if any(chain.source == _donor_of(merge) for merge in self.standing.by_donor.values()):
            return "it is merged at first hand now"
        for old in chain.claims:
            claim = self.claims.of(*old.edge) or old
            if why := self._disbelief(claim, explanation):
                return f"{why}, and there is no other way"
        return "there is no chain of merges to it any more"

    def _doubt(self, stamp_ns: int) -> bool:
        """What own observations speak against has a wrong merge in its chain: the weakest one is not this robot's."""
        doubted, self.standing.doubted = self.standing.doubted, []
        for merge, verdict in doubted:
            if merge.chain is not None and self.standing.attached.get(_donor_of(merge)) is merge:
                self._disbelieve(merge, merge.chain, verdict, stamp_ns)
        return bool(doubted)

    def _disbelieve(self, merge: Merge, chain: Chain, verdict: Verdict, stamp_ns: int) -> None:
        foreign = [claim for claim in chain.claims if claim.receiver != self.me]
        weakest = min(reversed(foreign), key=lambda claim: claim.support)
        self.disbelieved[weakest.edge, weakest.epoch, weakest.corrections] = Doubt(_donor_of(merge), verdict.reason)
        refusal = Refusal(merge.merge_id, tuple(merge.stood), merge.match.score)
        self.standing.attempts.refusals.add(merge.donor, refusal)
        said = f"{weakest.merge_id}, the least supported merge that led to {merge.donor}: {verdict.reason}"
        by = merge.tools.procedure.verify.use
        self.standing.journal.told_of("disbelieved", stamp_ns, weakest, said, by, verdict.evidence)
        self.attachments.detach(_donor_of(merge), f"{weakest.merge_id} is not believed: {verdict.reason}", stamp_ns)


def _said(grounds: Grounds, merge: Merge | None) -> str:
    """What speaks against an own merge."""
    trial = None if merge is None else merge.trial
    return grounds.sentence + (f"; {trial.sentence}" if trial else "")


def _measured(grounds: Grounds, merge: Merge | None) -> dict[str, float]:
    trial = None if merge is None else merge.trial
    return grounds.evidence | (trial.evidence if trial else {})


def _donor_of(merge: Merge) -> Source:
    return Source(merge.provenance.source, merge.provenance.epoch)


def _claim(me: Source, donor: Source, merge: Merge, revision: int, stamp_ns: int) -> Claim:
    state: State = "confirmed" if merge.state == "confirmed" else "provisional"
    T, match = merge.comparison.T_receiver_donor, merge.match
    by = PERSON if merge.decided_by_person else merge.tools.procedure.verify.use
    known = match.covariance is not None and is_covariance((match.covariance + match.covariance.T) / 2.0)
    where = (T, match.scale, match.covariance if known else None)
    support, corrections = merge.support, merge.corrections
    what = (me, donor, merge.epoch, state, revision, *where)
    return Claim(*what, support=support, stamp_ns=stamp_ns, by=by, corrections=corrections)


def _is_news(known: Claim, merge: Merge) -> bool:
    same = known.T_receiver_donor == merge.comparison.T_receiver_donor and known.scale == merge.match.scale
    same = same and known.corrections == merge.corrections
    return not same or known.state != merge.state or abs(known.support - merge.support) >= NEWS


def _reverted(claim: Claim, stamp_ns: int, by: str, reason: str) -> Claim:
    told = (stamp_ns, by, reason)
    return replace(claim, state="reverted", revision=claim.revision + 1, stamp_ns=told[0], by=told[1], reason=told[2])

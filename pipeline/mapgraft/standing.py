"""The merges that stand in one robot's map: measured, judged, registered anew, brought up to date, reverted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from mapgraft.attempt import Attempt, Attempts, Grafted, Meeting
from mapgraft.contracts import Exactness, MapMetadata, Observation, Region, Sample, Transform, Verdict
from mapgraft.errors import FailedPluginError, IrreversibleError, MapError, PluginError, ReversalError
from mapgraft.events import Kind
from mapgraft.exchange import Offer, SentLayer
from mapgraft.graph.claims import Source
from mapgraft.graph.held import Layers
from mapgraft.graph.support import LOG_ODDS_WRONG
from mapgraft.guarded_map_type import KIND
from mapgraft.history import Journal, Moment
from mapgraft.merge import Merge
from mapgraft.own_map import OwnMap
from mapgraft.procedures import Workshop
from mapgraft.refusals import Refusal
from mapgraft.registration import Move, Site
from mapgraft.reversal import Reversal
from mapgraft.trail import Trail

CORRECTION: Final = "correction"
LONG: Final = 64  # observations: so often it is found out which of them are still needed


@dataclass(frozen=True, slots=True)
class Ending:
    """When a merge was reverted, who decided, and why; and where it stood, after how many corrections of both maps.

    ``against`` is what the verifier has found against it (nats), 0 where it was not the one who decided; ``about_m`` is
    where the donor's map is, in its frame.
    """

    merge_id: str
    stamp_ns: int
    by: str
    reason: str
    donor: Source
    T_receiver_donor: Transform
    corrections: tuple[int, int]
    about_m: Sequence[float]
    against: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Grounds:
    """Who wants a merge out, and why; ``sample`` and ``evidence`` are what the verifier judged by."""

    reason: str
    by: str
    sample: Sample | None = None
    evidence: Mapping[str, float] | None = None
    by_person: bool = False


@dataclass(slots=True)
class Standing:
    """What one robot has merged, by donor. It asks the plugins of each merge's rule and writes down what they say.

    ``attached`` is what came in through merges of others, by source; ``doubted`` what of it own observations have
    spoken against since somebody last took that away. ``ended`` tells by donor how the last merge with it ended.
    Whatever reverts raises IrreversibleError when the map type cannot: the robot's part ends with that.
    """

    own: OwnMap
    attempts: Attempts
    trail: Trail = field(default_factory=Trail)
    by_donor: dict[str, Merge] = field(default_factory=dict)
    attached: dict[Source, Merge] = field(default_factory=dict)
    doubted: list[tuple[Merge, Verdict]] = field(default_factory=list)
    ended: dict[str, Ending] = field(default_factory=dict)
    changes: int = 0  # rises with every merge that is made, moved, confirmed or reverted
    _told: set[str] = field(default_factory=set)  # which plugins are not asked again, where that came up

    @property
    def all(self) -> list[Merge]:
        """Everything that is in the map: first what the robot merged itself."""
        return [*self.by_donor.values(), *self.attached.values()]

    @property
    def reversal(self) -> Reversal:
        return self.own.reversal

    @property
    def journal(self) -> Journal:
        return self.own.journal

    @property
    def workshop(self) -> Workshop:
        return self.own.workshop

    def observed(self, observation: Observation, touched: Region) -> None:
        """Verify and register anew every merge whose time has come, after an observation that entered the map."""
        self.trail.add(observation, touched)
        now = self.trail.now
        due = [merge for merge in self.all if now >= merge.due_at]
        for merge in due:
            self.verify(merge, observation.stamp_ns)
            if merge.state != "reverted" and merge.is_to_register():
                self._register(merge, observation.stamp_ns)
        if now % LONG == 0 or not (self.by_donor or self.attached):
            self.trail.forget(min((merge.seen for merge in self.all), default=now))

    def end(self, stamp_ns: int) -> None:
        """The last look at every merge."""
        for merge in self.all:
            if merge.has_news or merge.is_untold:
                self.verify(merge, stamp_ns, everything=True, tell=True)

    def add(self, merge: Merge) -> None:
        """A merge whose contribution has just entered the map."""
        self._fused_changed()
        self.by_donor[merge.donor] = merge
        self.changes += 1

    def awaits(self, merge: Merge, offer: Offer) -> bool:
        """Whether what a donor offers is newer than what stands in the map, and can take its place there."""
        if self.reversal.name == "single_map":  # which cannot tell the share
            return False
        return offer.provenance.version > merge.provenance.version

    def update(self, merge: Merge, metadata: MapMetadata, sent: SentLayer, stamp_ns: int) -> None:
        """Put the donor's newer layer in the place of the older one, where it lies best now, and look at it again."""
        merge.site = replace(Site.of(metadata, metadata), cell_m=merge.site.cell_m)
        try:
            meeting = self.attempts.meet(merge.tools, self.own.receive(sent))
            if sent.corrections != merge.corrections[1]:
                merge.corrections = (merge.corrections[0], sent.corrections)
                self._find_again(merge, meeting, "the donor's map was corrected", stamp_ns, sent.size)
                return
            move = self._find_move(merge, meeting)
            grafted = self.attempts.graft(merge.tools, meeting, move.match if move else merge.match)
            moved = f"; {move.reason}" if move else ""
            self._swap(merge, grafted, f"the donor has gone on mapping{moved}", "exchange", stamp_ns, sent.size)
        except MapError as error:
            reason = f"the donor's newer map is left aside: {error}"
            self.journal.changed("verified", stamp_ns, merge, reason, "exchange", size=sent.size)
        except PluginError as error:
            self.complain(error, stamp_ns, merge.donor, merge=merge)

    def remapped(self, layers: Layers, stamp_ns: int) -> None:
        """The receiver has mapped anew: find every donor anew, and test it from the start."""
        for merge in self.all:
            merge.corrections = (self.own.corrections, merge.corrections[1])
            try:
                self._fuse_anew(merge, layers, stamp_ns)
            except MapError as error:
                self.journal.changed("verified", stamp_ns, merge, f"it is left as it was: {error}", CORRECTION)
            except PluginError as error:
                self._unverifiable(merge, stamp_ns, error)

    def _fuse_anew(self, merge: Merge, layers: Layers, stamp_ns: int) -> None:
        sent = layers.sent(Source(merge.provenance.source, merge.provenance.epoch))
        meeting = merge.meeting
        if sent is not None and sent.provenance == merge.provenance:
            meeting = self.attempts.meet(merge.tools, self.own.receive(sent))
        if meeting is not None:
            self._find_again(merge, meeting, "the own map was corrected", stamp_ns)
            return
        with self.own.naming():
            merge.restart(stamp_ns)
        self.verify(merge, stamp_ns, everything=True, tell=True)

    def _find_again(self, merge: Merge, meeting: Meeting, why: str, stamp_ns: int, size: int = 0) -> None:
        """One of the two maps is another one now: what was found out about it need not hold for what it has become.

        Where a fresh attempt is accepted at the same place, the merge stands there; where it is accepted elsewhere, it
        is taken out, and nothing is refused. Where none is, it stays as near as it lies best, provisionally.
        """
        attempt = self._attempt_again(merge, meeting)
        if attempt is not None and attempt.grafted is not None:
            T = attempt.grafted.comparison.T_receiver_donor
            if merge.is_near(T):
                said = f"{why}; found again, moved by {merge.shift_to(T)}: {attempt.reason}"
                self._put_anew(merge, attempt.grafted, said, stamp_ns, size)
            else:
                said = f"{why}, and the two meet elsewhere now: {attempt.reason}"
                self.revert(merge, stamp_ns, Grounds(said, CORRECTION), refuse=False)
            return
        move = self._find_move(merge, meeting, anyway=True)
        said = f"{why}; {move.reason if move else 'it stays where it is'}"
        if attempt is not None and merge.state == "confirmed":
            merge.state = "provisional"
            said += f"; what confirmed it was another map, and now {attempt.reason}"
        grafted = self.attempts.graft(merge.tools, meeting, move.match if move else merge.match)
        self._put_anew(merge, grafted, said, stamp_ns, size)

    def _put_anew(self, merge: Merge, grafted: Grafted, reason: str, stamp_ns: int, size: int) -> None:
        """Replace the contribution, and measure from the start."""
        with self.workshop.guard.calling("fuser", merge.tools.procedure.fuse.use):
            self.reversal.replace(merge.merge_id, grafted.contribution)
        merge.replace(grafted)
        self.changes += 1
        with self.own.naming():
            merge.restart(stamp_ns)
        kind: Kind = "updated" if merge.chain is None else "reattached"
        self.journal.changed(kind, stamp_ns, merge, reason, CORRECTION, size=size)
        self.verify(merge, stamp_ns, everything=True, tell=True)

    def _attempt_again(self, merge: Merge, meeting: Meeting) -> Attempt | None:
        """A fresh attempt with a merge's tools; None where it stays as it is, whatever becomes of the maps."""
        own, other = self.own.map_type.name, meeting.donor_type
        if not merge.may_move or self.workshop.out_of_order(merge.tools.rule, own, other):
            return None
        return self.attempts.again(merge.tools, meeting, merge.site.about_m)

    def _register(self, merge: Merge, stamp_ns: int) -> None:
        """Find out whether both maps, as they are now, tell a better transform, and put it in the place of the old."""
        by, move = merge.tools.procedure.match.use, None
        try:
            if merge.meeting is None or (move := self._find_move(merge, merge.meeting)) is None:
                return
            grafted = self.attempts.graft(merge.tools, merge.meeting, move.match)
            self._swap(merge, grafted, move.reason, by, stamp_ns)
        except MapError as error:
            reason = f"{move.reason if move else 'registered anew'}, left aside: {error}"
            self.journal.changed("verified", stamp_ns, merge, reason, by)
        except PluginError as error:
            self.complain(error, stamp_ns, merge.donor, merge=merge)

    def _find_move(self, merge: Merge, meeting: Meeting, anyway: bool = False) -> Move | None:
        with self.own.naming():
            if not merge.may_move or not (merge.has_grown(meeting) or anyway):
                return None
        if self.workshop.out_of_order(merge.tools.rule, self.own.map_type.name, meeting.donor_type):
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
        with self.workshop.guard.calling("fuser", merge.tools.procedure.fuse.use):
            self.reversal.replace(merge.merge_id, grafted.contribution)
        merge.replace(grafted)
        self.changes += 1
        kind: Kind = "updated" if merge.chain is None else "reattached"
        self.journal.changed(kind, stamp_ns, merge, reason, by, size=size)
        self.verify(merge, stamp_ns, everything=True, tell=True)

    def verify(self, merge: Merge, stamp_ns: int, everything: bool = False, tell: bool = False) -> None:
        """Measure a standing merge, let the verifier judge it when all it looks at was measured, and do as it says.

        A verdict like the last one is only written down at the rhythm of the log, or when somebody wants to ``tell``.
        """
        try:
            with self.own.naming():
                sample = merge.measure(stamp_ns, everything)
            for complaint in merge.complaints:
                self.complain(complaint, stamp_ns, merge.donor, merge=merge)
            merge.complaints.clear()
            if sample is None:
                return
            if sample is not merge.history[-1]:
                self.journal.measured(merge, sample)
                self.journal.changed("verified", stamp_ns, merge, "measured for the record", "log", sample)
                return
            verdict = merge.judge()
            self.journal.measured(merge, sample, verdict)
        except MapError as error:
            self.journal.changed("verified", stamp_ns, merge, f"it cannot be measured: {error}", "merge")
        except PluginError as error:
            self._unverifiable(merge, stamp_ns, error)
        else:
            self._follow(merge, stamp_ns, verdict, sample, tell)

    def _follow(self, merge: Merge, stamp_ns: int, verdict: Verdict, sample: Sample, tell: bool) -> None:
        """Do as the verifier says."""
        by, tell = merge.tools.procedure.verify.use, merge.tells(verdict, tell)
        if merge.chain is not None:
            self._follow_attached(merge, stamp_ns, verdict, sample, tell)
            return
        if verdict.action == "revert" and not merge.decided_by_person:
            self.revert(merge, stamp_ns, Grounds(verdict.reason, by, sample, verdict.evidence))
        elif verdict.action == "confirm" and merge.state == "provisional":
            merge.state = "confirmed"
            self.changes += 1
            self.journal.changed("confirmed", stamp_ns, merge, verdict.reason, by, sample, evidence=verdict.evidence)
        elif tell:
            said = f"confirmed by a person; {verdict.reason}" if merge.decided_by_person else verdict.reason
            self.journal.changed("verified", stamp_ns, merge, said, by, sample, evidence=verdict.evidence)

    def _follow_attached(self, merge: Merge, stamp_ns: int, verdict: Verdict, sample: Sample, tell: bool) -> None:
        """What a verifier says of an attached layer is about the chain: it is for others to draw the consequence."""
        by = merge.tools.procedure.verify.use
        if verdict.action == "revert":
            self.doubted.append((merge, verdict))
        elif verdict.action == "confirm":
            merge.state = "confirmed"
        if tell or verdict.action == "revert":
            self.journal.changed("verified", stamp_ns, merge, verdict.reason, by, sample, evidence=verdict.evidence)

    def _unverifiable(self, merge: Merge, stamp_ns: int, error: PluginError) -> None:
        """What nobody can judge any more goes if it was provisional, and stays, unwatched, if it was confirmed."""
        self.complain(error, stamp_ns, merge.donor, merge=merge)
        if merge.state == "confirmed" or merge.chain is not None:
            merge.stop_watching()
            self.journal.changed("verified", stamp_ns, merge, f"not verified any more: {error}", "merge")
        else:
            self.revert(merge, stamp_ns, Grounds(f"it cannot be verified any more: {error}", "merge"), refuse=False)

    def revert(self, merge: Merge, stamp_ns: int, grounds: Grounds, refuse: bool = True) -> None:
        """Take the donor's data out of the map again, and refuse its places from now on, if not told otherwise."""
        self.show("before revert", stamp_ns, merge.merge_id)
        exactness = self.take_out(merge, stamp_ns, grounds.reason)
        del self.by_donor[merge.donor]
        self.changes += 1
        self._fused_changed()
        merge.state = "reverted"
        self.ended[merge.donor] = _ending(merge, stamp_ns, grounds)
        if refuse:
            refusal = Refusal(merge.merge_id, tuple(merge.stood), merge.match.score, grounds.by_person)
            self.attempts.refusals.add(merge.donor, refusal)
        told = (grounds.reason, grounds.by, grounds.sample)
        self.journal.changed("reverted", stamp_ns, merge, *told, exactness, evidence=grounds.evidence)
        self.show("after revert", stamp_ns, merge.merge_id)

    def take_out(self, merge: Merge, stamp_ns: int, reason: str) -> Exactness:
        """Take a merge's contribution out of the map; where the map type cannot that is written down."""
        try:
            with self.own.asking():
                return self.reversal.revert(merge.merge_id)
        except (PluginError, MapError) as error:
            named = "" if isinstance(error, PluginError) else f"the map type {self.own.map_type.name!r} refuses: "
            wanted = "reverted" if merge.chain is None else "detached"
            said = f"{named}{error}; {merge.merge_id}, which was to be {wanted} ({reason}), stands"
            method = error.method if isinstance(error, FailedPluginError) else ""
            failure = FailedPluginError(said, (KIND, self.own.map_type.name), method or "reset")
            self.complain(failure, stamp_ns, merge.donor, merge=merge)
            raise IrreversibleError(said) from error

    def _fused_changed(self) -> None:
        """Something came in or went out: where metrics see the merged map, what they know of it no longer holds."""
        if self.reversal.subject == "merged":
            self.attempts.changed()
            for merge in self.by_donor.values():
                merge.target_changed()

    def complain(
        self,
        error: PluginError | MapError | ReversalError,
        stamp_ns: int,
        donor: str,
        rule: str = "",
        merge: Merge | None = None,
    ) -> None:
        """Write down that a plugin failed, and remember it; that one is not asked again is told once."""
        if isinstance(error, PluginError):
            self.workshop.guard.note(error)
        if (said := str(error)) in self.workshop.guard.set_aside.values():
            if said in self._told:
                return
            self._told.add(said)
        self.journal.failed(stamp_ns, donor, error, rule, merge)

    def show(self, why: Moment, stamp_ns: int, merge_id: str = "", entering: tuple[Merge, ...] = ()) -> None:
        """Take a snapshot of the robot's maps; a map type that cannot show them is complained of."""
        for error in self.own.show(why, stamp_ns, merge_id, (*self.all, *entering)):
            self.complain(error, stamp_ns, "")


def _ending(merge: Merge, stamp_ns: int, grounds: Grounds) -> Ending:
    source = Source(merge.provenance.source, merge.provenance.epoch)
    against = 0.0 if grounds.by_person else (grounds.evidence or {}).get(LOG_ODDS_WRONG, 0.0)
    where = (merge.comparison.T_receiver_donor, merge.corrections, merge.site.about_m)
    return Ending(merge.merge_id, stamp_ns, grounds.by, grounds.reason, source, *where, against)

"""The merges that stand in one robot's map: measured, judged, registered anew, brought up to date, reverted."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

from mapgraft.attempt import Attempts, Grafted, Meeting
from mapgraft.contracts import Observation, Region, Sample, Verdict
from mapgraft.errors import FailedPluginError, IrreversibleError, MapError, PluginError, ReversalError
from mapgraft.exchange import Offer
from mapgraft.guarded_map_type import KIND
from mapgraft.history import Journal, Moment
from mapgraft.merge import Merge
from mapgraft.own_map import OwnMap
from mapgraft.procedures import Workshop
from mapgraft.refusals import Refusal
from mapgraft.registration import Move, Site
from mapgraft.reversal import Reversal
from mapgraft.trail import Trail

Fetch = Callable[[], bytes]
LONG: Final = 64  # observations: so often it is found out which of them are still needed


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

    Whatever reverts raises IrreversibleError when the map type cannot: the robot's part ends with that.
    """

    own: OwnMap
    attempts: Attempts
    trail: Trail = field(default_factory=Trail)
    by_donor: dict[str, Merge] = field(default_factory=dict)
    _told: set[str] = field(default_factory=set)  # which plugins are not asked again, where that came up

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
        due = [merge for merge in self.by_donor.values() if now >= merge.due_at]
        for merge in due:
            self.verify(merge, observation.stamp_ns)
            if merge.state != "reverted" and merge.is_to_register():
                self._register(merge, observation.stamp_ns)
        if not self.by_donor or now % LONG == 0:
            self.trail.forget(min((merge.seen for merge in self.by_donor.values()), default=now))

    def end(self, stamp_ns: int) -> None:
        """The last look at every merge."""
        for merge in list(self.by_donor.values()):
            if merge.has_news or merge.is_untold:
                self.verify(merge, stamp_ns, everything=True, tell=True)

    def add(self, merge: Merge) -> None:
        """A merge whose contribution has just entered the map."""
        self._fused_changed()
        self.by_donor[merge.donor] = merge

    def update(self, merge: Merge, offer: Offer, fetch: Fetch, stamp_ns: int) -> None:
        """Put the donor's newer layer in the place of the older one, where it lies best now, and look at it again."""
        if offer.provenance == merge.provenance or self.reversal.name == "single_map":  # which cannot tell the share
            return
        size = 0
        merge.site = replace(Site.of(offer.metadata, offer.metadata), cell_m=merge.site.cell_m)
        try:
            size = len(data := fetch())
            meeting = self.attempts.meet(merge.tools, self.own.receive(data))
            move = self._find_move(merge, meeting)
            grafted = self.attempts.graft(merge.tools, meeting, move.match if move else merge.match)
            moved = f"; {move.reason}" if move else ""
            self._swap(merge, grafted, f"the donor has gone on mapping{moved}", "exchange", stamp_ns, size)
        except MapError as error:
            reason = f"the donor's newer map is left aside: {error}"
            self.journal.changed("verified", stamp_ns, merge, reason, "exchange", size=size)
        except PluginError as error:
            self.complain(error, stamp_ns, merge.donor, merge=merge)

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

    def _find_move(self, merge: Merge, meeting: Meeting) -> Move | None:
        with self.own.naming():
            if not merge.may_move or not merge.has_grown(meeting):
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
        self.journal.changed("updated", stamp_ns, merge, reason, by, size=size)
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
        if verdict.action == "revert" and not merge.decided_by_person:
            self.revert(merge, stamp_ns, Grounds(verdict.reason, by, sample, verdict.evidence))
        elif verdict.action == "confirm" and merge.state == "provisional":
            merge.state = "confirmed"
            self.journal.changed("confirmed", stamp_ns, merge, verdict.reason, by, sample, evidence=verdict.evidence)
        elif tell:
            said = f"confirmed by a person; {verdict.reason}" if merge.decided_by_person else verdict.reason
            self.journal.changed("verified", stamp_ns, merge, said, by, sample, evidence=verdict.evidence)

    def _unverifiable(self, merge: Merge, stamp_ns: int, error: PluginError) -> None:
        """What nobody can judge any more goes if it was provisional, and stays, unwatched, if it was confirmed."""
        self.complain(error, stamp_ns, merge.donor, merge=merge)
        if merge.state == "confirmed":
            merge.stop_watching()
            self.journal.changed("verified", stamp_ns, merge, f"not verified any more: {error}", "merge")
        else:
            self.revert(merge, stamp_ns, Grounds(f"it cannot be verified any more: {error}", "merge"), refuse=False)

    def revert(self, merge: Merge, stamp_ns: int, grounds: Grounds, refuse: bool = True) -> None:
        """Take the donor's data out of the map again, and refuse its places from now on, if not told otherwise."""
        self.show("before revert", stamp_ns, merge.merge_id)
        try:
            with self.own.asking():
                exactness = self.reversal.revert(merge.merge_id)
        except (PluginError, MapError) as error:
            raise self._irreversible(merge, stamp_ns, grounds, error) from error
        del self.by_donor[merge.donor]
        self._fused_changed()
        merge.state = "reverted"
        if refuse:
            refusal = Refusal(merge.merge_id, tuple(merge.stood), merge.match.score, grounds.by_person)
            self.attempts.refusals.add(merge.donor, refusal)
        told = (grounds.reason, grounds.by, grounds.sample)
        self.journal.changed("reverted", stamp_ns, merge, *told, exactness, evidence=grounds.evidence)
        self.show("after revert", stamp_ns, merge.merge_id)

    def _irreversible(
        self, merge: Merge, stamp_ns: int, grounds: Grounds, error: PluginError | MapError
    ) -> IrreversibleError:
        """Write down that a merge stands which was to be taken out."""
        named = "" if isinstance(error, PluginError) else f"the map type {self.own.map_type.name!r} refuses: "
        said = f"{named}{error}; {merge.merge_id}, which was to be reverted ({grounds.reason}), stands"
        method = error.method if isinstance(error, FailedPluginError) else ""
        failure = FailedPluginError(said, (KIND, self.own.map_type.name), method or "reset")
        self.complain(failure, stamp_ns, merge.donor, merge=merge)
        return IrreversibleError(said)

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
        for error in self.own.show(why, stamp_ns, merge_id, (*self.by_donor.values(), *entering)):
            self.complain(error, stamp_ns, "")

"""Turning what happens to one robot into events and snapshots."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from mapgraft.attempt import Attempt
from mapgraft.contracts import (
    Donation,
    Exactness,
    MapMetadata,
    MapType,
    Match,
    Measurement,
    Provenance,
    Sample,
    Transform,
    Verdict,
)
from mapgraft.correction import Corrected
from mapgraft.decision import Ruling
from mapgraft.errors import FailedPluginError, SetAsideError
from mapgraft.events import DonorMap, Event, Kind, Sink, Snapshot
from mapgraft.graph.claims import Claim, Source
from mapgraft.merge import Merge
from mapgraft.onlooker import Attempted, Encountered, Onlooker
from mapgraft.procedures import Tools
from mapgraft.reversal import Reversal

Moment = Literal["before merge", "after merge", "before revert", "after revert", "end"]


@dataclass(slots=True)
class History:
    """The events of all robots so far, numbered as they happen, the sink that they go to, and who looks on."""

    sink: Sink
    events: list[Event] = field(default_factory=list)
    onlookers: list[Onlooker] = field(default_factory=list)

    def record(self, kind: Kind, stamp_ns: int, receiver: str, donor: str, **fields: Any) -> None:
        """Append one event; ``fields`` are those of Event."""
        event = Event(seq=len(self.events), stamp_ns=stamp_ns, kind=kind, receiver=receiver, donor=donor, **fields)
        self.events.append(event)
        self.sink.happened(event)


@dataclass(frozen=True, slots=True)
class Journal:
    """What one robot tells of itself; without ``snapshots`` its maps are shown only at the end."""

    history: History
    robot: str
    map_type: MapType
    reversal: Reversal
    snapshots: bool = True

    def offered(self, stamp_ns: int, provenance: Provenance, size: int) -> None:
        self._record("offered", stamp_ns, provenance.source, **_of_donor(provenance), bytes_received=size)

    def rejected(self, stamp_ns: int, donor: str, ruling: Ruling) -> None:
        rule = ruling.rule.name if ruling.rule else ""
        self._record("rejected", stamp_ns, donor, reason=ruling.reason, by="decision table", rule=rule)

    def forbidden(self, stamp_ns: int, donor: str) -> None:
        self._record("rejected", stamp_ns, donor, reason="a person forbade this pair", by="person")

    def attempted(
        self, stamp_ns: int, attempt: Attempt, tools: Tools, merge_id: str, provenance: Provenance, size: int
    ) -> None:
        """Merged, ambiguous or unmatched: what came of one attempt."""
        merged = attempt.grafted is not None
        kind: Kind = "merged" if merged else "ambiguous" if attempt.verdict == "ambiguous" else "unmatched"
        T = attempt.grafted.comparison.T_receiver_donor if attempt.grafted else None
        fusion, reason = _of_fusion(attempt)
        self._record(
            kind,
            stamp_ns,
            provenance.source,
            **_of_donor(provenance),
            **_of_tools(tools),
            **_of_match(attempt.match, T, {**fusion, **(attempt.place.evidence if attempt.place else {})}),
            merge_id=merge_id,
            state="provisional" if merged else "candidate",
            reason=reason,
            by=tools.procedure.accept.use,
            hypotheses=attempt.hypotheses,
            bytes_received=size,
            measurements=tuple(attempt.measurements),
        )

    def changed(
        self,
        kind: Kind,
        stamp_ns: int,
        merge: Merge,
        reason: str,
        by: str,
        sample: Sample | None = None,
        exactness: Exactness | None = None,
        size: int = 0,
        evidence: Mapping[str, float] | None = None,
    ) -> None:
        """Updated, verified, confirmed or reverted, attached or detached: what became of what is in the map.

        ``evidence`` is the verifier's; the event has it beside the matcher's.
        """
        measurements: Iterable[Measurement] = sample.measurements.values() if sample else ()
        self._record(
            kind,
            stamp_ns,
            merge.donor,
            **_of_donor(merge.provenance),
            **_of_tools(merge.tools),
            **_of_match(merge.match, merge.comparison.T_receiver_donor, evidence),
            merge_id=merge.merge_id,
            state=_state(merge),
            through=_through(merge),
            reason=reason,
            by=by,
            bytes_received=size,
            measurements=tuple(measurements),
            exactness=exactness,
        )

    def told_of(
        self,
        kind: Kind,
        stamp_ns: int,
        claim: Claim,
        reason: str,
        by: str,
        evidence: Mapping[str, float],
        merge_id: str = "",
    ) -> None:
        """What this robot thinks of one claim; of its own ones, with their ``merge_id``, also where the merge lies."""
        of_merge: dict[str, Any] = {}
        if merge_id:
            of_merge = {
                "merge_id": merge_id,
                "state": claim.state,
                "donor_epoch": claim.donor.epoch,
                "T_receiver_donor": claim.T_receiver_donor,
                "scale": claim.scale,
                "covariance": claim.covariance,
            }
        told = {"reason": reason, "by": by, "evidence": evidence, "through": (claim.merge_id,)}
        self._record(kind, stamp_ns, claim.donor.name, **of_merge, **told)

    def corrected(self, stamp_ns: int, anew: Corrected) -> None:
        """The robot has mapped anew what it had observed."""
        moved = {"observations": float(len(anew.observations)), "observations_moved": float(anew.moved)}
        evidence = {**moved, "farthest_m": anew.farthest_m, "most_rad": anew.most_rad}
        self._record("corrected", stamp_ns, "", reason=anew.reason, by="correction", evidence=evidence)

    def uncorrected(self, stamp_ns: int, reason: str) -> None:
        """A correction that cannot be followed."""
        self._record("failed", stamp_ns, "", reason=f"a correction is left aside: {reason}", by="correction")

    def renamed(self, stamp_ns: int, me: Source, reason: str) -> None:
        """The robot is another source to others from now on."""
        self._record("renamed", stamp_ns, "", reason=f"{reason}: from now on it is {me.name}", by="network")

    def left_aside(self, stamp_ns: int, donor: str, reason: str, by: str) -> None:
        """Something that could be attached is not."""
        self._record("unattached", stamp_ns, donor, reason=reason, by=by)

    def encountered(self, donor: str, own: MapMetadata, other: MapMetadata) -> None:
        """The robot and a donor have told of their maps: for who looks on."""
        for onlooker in self.history.onlookers:
            onlooker.encountered(Encountered(self.robot, donor, self.map_type, self.reversal, own, other))

    def attempting(self, merge_id: str, donation: Donation, attempt: Attempt, tools: Tools) -> None:
        """An attempt was made, of which the history tells next: for who looks on."""
        for onlooker in self.history.onlookers:
            onlooker.attempted(Attempted(merge_id, self.robot, donation, attempt, tools))

    def measured(self, merge: Merge, sample: Sample, verdict: Verdict | None = None) -> None:
        """A merge was measured, and judged where there is a verdict: for who looks on."""
        for onlooker in self.history.onlookers:
            onlooker.measured(merge.merge_id, sample, verdict)

    def snapshot(
        self,
        why: Moment,
        stamp_ns: int,
        metadata: Callable[[], MapMetadata],
        layer: Callable[[], bytes],
        donors: Callable[[], Mapping[str, DonorMap]],
        merge_id: str = "",
    ) -> Snapshot | None:
        """The robot's maps as of now, None where they are not wanted; ``layer`` gives what it would offer, encoded,
        ``donors`` what it has from others."""
        if not self.snapshots and why != "end":
            return None
        reversal = self.reversal
        return Snapshot(
            self.robot,
            stamp_ns,
            why,
            self.map_type,
            reversal.own(),
            reversal.fused(),
            layer(),
            metadata(),
            reversal.version,
            merge_id,
            donors(),
        )

    def mapped(self, snapshot: Snapshot) -> None:
        """Hand a snapshot to the sink."""
        self.history.sink.mapped(snapshot)

    def failed(self, stamp_ns: int, donor: str, error: Exception, rule: str = "", merge: Merge | None = None) -> None:
        """A plugin failed; the sentence names it. ``merge`` is the standing merge that it was asked about."""
        of_merge: dict[str, Any] = {}
        if merge is not None:
            of_merge = {
                **_of_donor(merge.provenance),
                **_of_tools(merge.tools),
                **_of_match(merge.match, merge.comparison.T_receiver_donor),
                "merge_id": merge.merge_id,
                "state": _state(merge),
                "through": _through(merge),
            }
        by = " ".join(error.plugin) if isinstance(error, FailedPluginError | SetAsideError) else "plugin"
        self._record("failed", stamp_ns, donor, **{"rule": rule, **of_merge}, by=by, reason=str(error))

    def _record(self, kind: Kind, stamp_ns: int, donor: str, **fields: Any) -> None:
        mine = {"reversal": self.reversal.name, "receiver_version": self.reversal.version}
        self.history.record(kind, stamp_ns, self.robot, donor, **mine, **fields)


def _state(merge: Merge) -> str:
    """What is attached has no state of its own: it is there, or it is not."""
    if merge.chain is None:
        return merge.state
    return "detached" if merge.state == "reverted" else "attached"


def _through(merge: Merge) -> tuple[str, ...]:
    return () if merge.chain is None else tuple(claim.merge_id for claim in merge.chain.claims)


def _of_donor(provenance: Provenance) -> dict[str, Any]:
    return {"donor_epoch": provenance.epoch, "donor_version": provenance.version}


def _of_fusion(attempt: Attempt) -> tuple[Mapping[str, float], str]:
    """How the contribution was fused, and the reason of the attempt; both tell of a prior, which nobody observed."""
    if attempt.grafted is None:
        return {}, attempt.reason
    made = attempt.grafted.contribution
    if made.role == "observation":
        return made.summary, attempt.reason
    return {**made.summary, made.role: 1.0}, f"{attempt.reason}; taken in as a {made.role}, not as an observation"


def _of_tools(tools: Tools) -> dict[str, Any]:
    procedure = tools.procedure
    return {
        "rule": tools.rule.name,
        "matcher": procedure.match.use,
        "fuser": procedure.fuse.use,
        "verifier": procedure.verify.use,
    }


def _of_match(
    match: Match | None, T_receiver_donor: Transform | None, further: Mapping[str, float] | None = None
) -> dict[str, Any]:
    if match is None:
        return {}
    return {
        "T_receiver_donor": T_receiver_donor or match.T_receiver_donor,
        "scale": match.scale,
        "covariance": match.covariance,
        "score": match.score,
        "margin": match.margin,
        "evidence": {**match.evidence, **(further or {})},
    }

"""What the page tells of every merge that was made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from mapgraft.events import Event
from mapgraft.outputs.report.curves import Curve, curves
from mapgraft.outputs.report.gallery import Gallery, View
from mapgraft.outputs.report.words import (
    TONES,
    Clock,
    count,
    done_by,
    duration,
    exactness,
    happened,
    number,
    pose,
    sigma_of,
)

_UPDATES_TOLD: Final = 3  # of a merge's updates; the others are under a fold


@dataclass(frozen=True, slots=True)
class Line:
    """One sentence of a merge's story."""

    tone: str
    when: str
    what: str
    why: str


@dataclass(frozen=True, slots=True)
class MergeCard:
    """One merge as the template shows it."""

    anchor: str
    merge_id: str
    receiver: str
    donor: str
    state: str
    tone: str
    lead: str
    story: Sequence[Line]
    folded: Sequence[Line]
    facts: Sequence[tuple[str, str]]
    exactness: str
    exactness_reason: str
    views: Sequence[View]
    deciding: Sequence[Curve]
    others: Sequence[Curve]
    evidence: Sequence[tuple[str, str, str]]


@dataclass(frozen=True, slots=True)
class MergeRow:
    """One merge as a row of the table of all."""

    anchor: str
    href: str
    merge_id: str
    receiver: str
    donor: str
    state: str
    tone: str
    made: str
    ended: str
    pose: str
    reason: str


def by_merge(decisions: Sequence[Event]) -> dict[str, list[Event]]:
    """The decisions on every merge that was made, in order: the first one is the merge itself."""
    out: dict[str, list[Event]] = {}
    for event in decisions:
        if event.kind == "merged":
            out[event.merge_id] = []
        if event.merge_id in out:
            out[event.merge_id].append(event)
    return out


def most_telling(merges: Mapping[str, Sequence[Event]]) -> list[str]:
    """Merge ids, those first that a reader wants to see: what was reverted, the latest of it first, then the latest."""
    return sorted(merges, key=lambda name: (merges[name][-1].state != "reverted", -merges[name][0].seq))


def anchors_of(merges: Mapping[str, Sequence[Event]]) -> dict[str, str]:
    """Merge id → where on the page it is told; numbers, because ids hold whatever robots are called."""
    return {merge_id: f"merge-{n}" for n, merge_id in enumerate(merges, start=1)}


def row_of(events: Sequence[Event], anchor: str, shown: bool, clock: Clock) -> MergeRow:
    merged, last = events[0], _decisive(events)
    T = events[-1].T_receiver_donor
    return MergeRow(
        "" if shown else anchor,
        f"#{anchor}" if shown else "",
        merged.merge_id,
        merged.receiver,
        merged.donor,
        last.state,
        TONES[last.state],
        clock.at(merged.stamp_ns),
        clock.at(last.stamp_ns) if last is not merged else "",
        pose(T, events[-1].scale) if T is not None else "",
        last.reason,
    )


def card_of(events: Sequence[Event], anchor: str, gallery: Gallery, clock: Clock) -> MergeCard:
    """``events`` are all of one merge, with their measurements."""
    merged = next(event for event in events if event.kind == "merged")
    last = _decisive(events)
    reverted = next((event for event in events if event.kind == "reverted"), None)
    left = reverted.exactness if reverted is not None else None
    drawn = curves(events, clock)
    story, folded = _story(events, clock)
    return MergeCard(
        anchor,
        merged.merge_id,
        merged.receiver,
        merged.donor,
        last.state,
        TONES[last.state],
        _lead(events, clock),
        story,
        folded,
        _facts(events, merged),
        exactness(merged.receiver, left) if left is not None else "",
        left.reason if left is not None else "",
        gallery.views.get(merged.merge_id, ()),
        [curve for curve in drawn if curve.decides],
        [curve for curve in drawn if not curve.decides],
        _evidence(events),
    )


def _decisive(events: Sequence[Event]) -> Event:
    """The event that tells how the merge stands: the last that is more than a measurement."""
    return next(event for event in reversed(events) if event.kind in ("merged", "confirmed", "reverted"))


def _lead(events: Sequence[Event], clock: Clock) -> str:
    """What became of a merge, in a sentence; one that was confirmed may have been taken out all the same."""
    merged, last = next(event for event in events if event.kind == "merged"), _decisive(events)
    made = f"{merged.donor}’s map came into {merged.receiver}’s at {clock.at(merged.stamp_ns)}"
    sure = [event for event in events if event.kind == "confirmed"]
    confirmed = f", was confirmed at {clock.at(sure[-1].stamp_ns)}" if sure else ""
    if last.kind == "reverted":
        stood = duration(clock.seconds(last.stamp_ns) - clock.seconds(merged.stamp_ns))
        return f"{made}{confirmed}, and was taken out again at {clock.at(last.stamp_ns)}, after {stood}."
    return f"{made}{confirmed}, and stands." if sure else f"{made} and stands, not confirmed yet."


def _story(events: Sequence[Event], clock: Clock) -> tuple[list[Line], list[Line]]:
    """What was decided, and the last look; updates beyond the first few are folded."""
    told: list[Line] = []
    folded: list[Line] = []
    updates = 0
    for event in events:
        updates += event.kind == "updated"
        line = Line(
            TONES[event.kind], clock.at(event.stamp_ns), f"{happened(event.kind)}{done_by(event)}", event.reason
        )
        is_routine = event.kind == "verified" and event is not events[-1]
        if is_routine or (event.kind == "updated" and updates > _UPDATES_TOLD):
            folded.append(line)
        else:
            told.append(line)
    return told, folded


def _facts(events: Sequence[Event], merged: Event) -> list[tuple[str, str]]:
    facts = []
    if merged.T_receiver_donor is not None:
        facts.append(
            (f"{merged.donor} in {merged.receiver}", pose(merged.T_receiver_donor, merged.scale, sigma_of(merged)))
        )
    last = events[-1]
    if last.T_receiver_donor is not None and last.T_receiver_donor != merged.T_receiver_donor:
        facts.append(("where it was last", pose(last.T_receiver_donor, last.scale, sigma_of(last))))
    if merged.score is not None:
        margin = "" if merged.margin is None else f"; margin to the next {number(merged.margin)}"
        facts.append(
            ("match", f"score {number(merged.score)}{margin}; {count(merged.hypotheses, 'hypothesis', 'hypotheses')}")
        )
    versions = f"{merged.receiver} after {count(merged.receiver_version, 'observation')}"
    facts.append(("maps", f"{versions}, {merged.donor} after {merged.donor_version:,}"))
    facts.append(("rule", merged.rule))
    tools = [("matcher", merged.matcher), ("accepted by", merged.by), ("fuser", merged.fuser)]
    tools += [("verifier", merged.verifier), ("reversal", merged.reversal)]
    facts.append(("by", ", ".join(f"{role} {name}" for role, name in tools if name)))
    return facts


def _evidence(events: Sequence[Event]) -> list[tuple[str, str, str]]:
    """Every named number, at the merge and last."""
    first: dict[str, float] = {}
    last: dict[str, float] = {}
    for event in events:
        for name, value in event.evidence.items():
            first.setdefault(name, value)
            last[name] = value
    return [(name, number(first[name]), number(last[name])) for name in sorted(first)]

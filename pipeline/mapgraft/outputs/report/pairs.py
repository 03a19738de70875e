"""What did not come to a merge, per ordered pair of robots, with every reason."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from mapgraft.events import Event
from mapgraft.outputs.report.words import TONES, Clock, count, happened

ATTEMPTS: Final = ("rejected", "unmatched", "ambiguous")  # kinds of events after which nothing was merged
_MOST_REASONS: Final = 400  # of a pair
_MOST_PAIRS: Final = 400


@dataclass(frozen=True, slots=True)
class Reason:
    kind: str
    tone: str
    text: str
    by: str
    times: int
    first: str
    last: str


@dataclass(frozen=True, slots=True)
class Pair:
    """One ordered pair; ``left_out`` reasons have no row."""

    receiver: str
    donor: str
    counts: str
    reasons: Sequence[Reason]
    left_out: int


@dataclass(frozen=True, slots=True)
class NotMerged:
    pairs: Sequence[Pair]
    left_out: int


def not_merged(decisions: Sequence[Event], clock: Clock) -> NotMerged:
    """Attempts that were turned away; equal reasons of a pair are one row."""
    by_pair: dict[tuple[str, str], list[Event]] = {}
    for event in decisions:
        if event.kind in ATTEMPTS:
            by_pair.setdefault((event.receiver, event.donor), []).append(event)
    pairs = [_pair(*pair, by_pair[pair], clock) for pair in sorted(by_pair)[:_MOST_PAIRS]]
    return NotMerged(pairs, len(by_pair) - len(pairs))


PLACE: Final = ("deciding_x_m", "deciding_y_m", "deciding_look_x_m", "deciding_look_y_m")  # in an event's evidence


def undecided(decisions: Sequence[Event]) -> dict[str, list[Event]]:
    """By receiver, the last attempts with donors that were put off to the end, where a place would decide."""
    last: dict[tuple[str, str], Event] = {}
    for event in decisions:
        if event.kind in (*ATTEMPTS, "merged"):
            last[event.receiver, event.donor] = event
    out: dict[str, list[Event]] = {}
    for (receiver, _), event in sorted(last.items()):
        if event.kind == "ambiguous" and all(name in event.evidence for name in PLACE):
            out.setdefault(receiver, []).append(event)
    return out


def place_of(event: Event) -> str:
    """Where to look to decide, in words."""
    x_m, y_m, look_x_m, look_y_m = (event.evidence[name] for name in PLACE)
    nats = event.evidence.get("deciding_nats", 0.0)
    return f"look from ({x_m:z.1f}, {y_m:z.1f}) m at ({look_x_m:z.1f}, {look_y_m:z.1f}) m, {nats:.1f} nats expected"


def _pair(receiver: str, donor: str, events: Sequence[Event], clock: Clock) -> Pair:
    alike: dict[tuple[str, str, str], list[Event]] = {}
    for event in events:
        alike.setdefault((event.kind, event.reason, event.by), []).append(event)
    reasons = [
        Reason(
            happened(found[0].kind).lower(),
            TONES[kind],
            reason,
            by,
            len(found),
            clock.at(found[0].stamp_ns),
            clock.at(found[-1].stamp_ns) if len(found) > 1 else "",
        )
        for (kind, reason, by), found in list(alike.items())[:_MOST_REASONS]
    ]
    counted = [(kind, sum(event.kind == kind for event in events)) for kind in ATTEMPTS]
    said = ", ".join(count(n, f"time {kind}", f"times {kind}") for kind, n in counted if n)
    return Pair(receiver, donor, said, reasons, len(alike) - len(reasons))

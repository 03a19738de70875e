"""What plugins failed at in a run, for a person: the history holds every single time."""

from __future__ import annotations

from collections.abc import Sequence

from mapgraft.events import Event
from mapgraft.guard import Guard
from mapgraft.left_out import ALIKE


def failure_sentences(events: Sequence[Event], guard: Guard, start_ns: int) -> list[str]:
    """One sentence per plugin and kind of failure, with its first place and the number, and one per plugin set aside.

    ``start_ns`` is the mission's first stamp, from which the seconds are counted.
    """
    aside = list(guard.set_aside.values())  # some events tell this, too
    found: dict[tuple[str, str], list[Event]] = {}
    for event in events:
        if event.kind == "failed" and event.reason not in aside:
            found.setdefault((event.by, event.reason[:ALIKE]), []).append(event)
    return [*(_sentence(alike, start_ns) for alike in found.values()), *aside]


def _sentence(alike: Sequence[Event], start_ns: int) -> str:
    first = alike[0]
    whose = f"{first.receiver} ← {first.donor}" if first.donor else first.receiver
    often = f"{len(alike):,} times, the first " if len(alike) > 1 else ""
    return f"{first.reason} ({often}at {(first.stamp_ns - start_ns) / 1e9:.1f} s, {whose})"

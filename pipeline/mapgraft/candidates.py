"""What attempts came to that were not merged, so that a pair is tried again when there is something new to try."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from mapgraft.contracts import MapMetadata, Match
from mapgraft.graph.claims import Claim
from mapgraft.persons import same_place


@dataclass(frozen=True, slots=True, eq=False)
class LastAttempt:
    """The last attempt with one donor: by which rule, its best match, and what both maps held."""

    merge_id: str
    rule: str
    match: Match | None
    own: MapMetadata
    other: MapMetadata


@dataclass(slots=True)
class Candidates:
    """One receiver's attempts: how many there were with each donor, and what is left of the last that did not merge."""

    counts: dict[str, int] = field(default_factory=dict)
    last: dict[str, LastAttempt] = field(default_factory=dict)

    def next_id(self, receiver: str, donor: str, told: Claim | None = None) -> str:
        """The id of the attempt that is made now: beyond what is ``told`` of this pair, by whomever."""
        self.counts[donor] = 1 + max(self.counts.get(donor, 0), 0 if told is None else told.epoch)
        return f"{receiver}.{donor}.{self.counts[donor]}"

    def waits(self, donor: str, rule: str, growth: float, own: MapMetadata, other: MapMetadata) -> bool:
        """Whether the last attempt failed by the same rule, and neither map has grown by the share since."""
        last = self.last.get(donor)
        if last is None or last.rule != rule:
            return False
        return not (_grown(last.own, own, growth) or _grown(last.other, other, growth))

    def keep(self, donor: str, attempt: LastAttempt) -> None:
        self.last[donor] = attempt

    def forget(self, donor: str) -> None:
        """The pair was merged, or the merge was reverted: the next attempt need not wait."""
        self.last.pop(donor, None)

    def same_as_before(self, donor: str, match: Match | None, about_m: Sequence[float]) -> str:
        """The id of the last attempt where it came out at the same place, else empty."""
        last = self.last.get(donor)
        if last is None or last.match is None or match is None:
            return ""
        return last.merge_id if same_place(last.match.T_receiver_donor, match.T_receiver_donor, about_m) else ""


def _grown(before: MapMetadata, now: MapMetadata, share: float) -> bool:
    """By known area; where that is not told by the number of observations."""
    if before.known_area_m2 > 0.0 and now.known_area_m2 > 0.0:
        return now.known_area_m2 >= (1.0 + share) * before.known_area_m2
    return now.observations > before.observations and now.observations >= (1.0 + share) * before.observations

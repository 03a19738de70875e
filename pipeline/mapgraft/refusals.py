"""Transforms that were taken out of the map again, and what it needs to take them in once more."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from mapgraft.contracts import Match, Transform
from mapgraft.registration import displacement

NEAR_M: Final = 1.0  # a wrong match that slides a little is the same wrong match
NEAR_RAD: Final = math.radians(10.0)


@dataclass(slots=True)
class Refusal:
    """One reverted merge, and all transforms at which it stood.

    ``score`` is the matcher's when the merge was registered last or, where that is more, when the place came out for
    the first time after the revert: what the maps had gained until then could not save it.
    """

    merge_id: str
    stood: tuple[Transform, ...]
    score: float
    by_person: bool = False
    seen_again: bool = False

    def needs(self, factor: float) -> float:
        """The score above which the transform is taken again."""
        return self.score + (factor - 1.0) * abs(self.score)

    def is_near(self, T_receiver_donor: Transform, about_m: Sequence[float]) -> bool:
        """Whether a transform puts the donor's map where the merge stood, or close by."""
        apart = (displacement(T, T_receiver_donor, about_m) for T in self.stood)
        return any(shift_m <= NEAR_M and turn_rad <= NEAR_RAD for shift_m, turn_rad in apart)

    def see(self, score: float) -> None:
        """Note that the place came out again with that score."""
        if not self.seen_again:
            self.score, self.seen_again = max(self.score, score), True


@dataclass(frozen=True, slots=True)
class Sifted:
    """Matches without those that are refused, and why the first refused one is; ``refused`` is empty without any.

    What is refused is no rival any more: with any the margins are those over each other.
    """

    matches: list[Match]
    refused: str


@dataclass(slots=True)
class Refusals:
    """One receiver's, per donor. What a person took out is never taken again by itself.

    ``changes`` rises with whatever is refused from now on, or no longer.
    """

    by_donor: dict[str, list[Refusal]] = field(default_factory=dict)
    changes: int = 0

    def add(self, donor: str, refusal: Refusal) -> None:
        self.by_donor.setdefault(donor, []).append(refusal)
        self.changes += 1

    def forget(self, donor: str) -> None:
        """One of the maps is another one now: only what a person took out is still refused."""
        self._keep(donor, [refusal for refusal in self.by_donor.get(donor, ()) if refusal.by_person])

    def lift(self, donor: str, merge_id: str) -> None:
        """What spoke against one merge has turned out to be wrong."""
        known = self.by_donor.get(donor, ())
        self._keep(donor, [one for one in known if one.merge_id != merge_id or one.by_person])

    def _keep(self, donor: str, kept: list[Refusal]) -> None:
        if len(kept) < len(self.by_donor.get(donor, ())):
            self.by_donor[donor] = kept
            self.changes += 1

    def at(self, donor: str, T_receiver_donor: Transform, about_m: Sequence[float]) -> list[Refusal]:
        """What was taken out at this place; ``about_m`` is where the donor's map is, in its frame."""
        known = self.by_donor.get(donor, ())
        return [refusal for refusal in known if refusal.is_near(T_receiver_donor, about_m)]

    def sift(self, donor: str, found: Sequence[Match], factor: float, about_m: Sequence[float]) -> Sifted:
        """Leave out matches where the donor was taken out, unless their score has grown by more than the factor."""
        matches, refused = [], ""
        for match in found:
            obstacle = self._obstacle(self.at(donor, match.T_receiver_donor, about_m), match.score, factor)
            if not obstacle:
                matches.append(match)
            refused = refused or obstacle
        return Sifted(_among_themselves(matches) if refused else matches, refused)

    def overcome(self, donor: str, match: Match, about_m: Sequence[float]) -> str:
        """What a match that was let through has grown beyond, in words; empty where nothing was taken out."""
        known = self.at(donor, match.T_receiver_donor, about_m)
        grown = f"to {match.score:.4g}"
        return "; ".join(
            f"reverted before as {one.merge_id}, since then the score has grown from {one.score:.4g} {grown}"
            for one in known
        )

    def _obstacle(self, known: list[Refusal], score: float, factor: float) -> str:
        for refusal in known:
            refusal.see(score)
        if by_person := [refusal for refusal in known if refusal.by_person]:
            return f"{by_person[0].merge_id} was taken out there by a person, so it is not taken again by itself"
        hardest = max(known, key=lambda refusal: refusal.needs(factor), default=None)
        if hardest is None or score > hardest.needs(factor):
            return ""
        return (
            f"{hardest.merge_id} was reverted there, and its score of now {score:.4g} "
            f"must grow above {hardest.needs(factor):.4g} first"
        )


def _among_themselves(matches: list[Match]) -> list[Match]:
    """The matches with their margins over the best other of them."""
    out = []
    for match in matches:
        others = [other.score for other in matches if other is not match]
        out.append(replace(match, margin=match.score - max(others) if others else math.inf))
    return out

"""A direct test of a merge that contradicts others: where it stands against where the others say that it should."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from mapgraft.attempt import Attempts, Meeting
from mapgraft.contracts import MapError, Match
from mapgraft.graph.chains import Similarity
from mapgraft.graph.support import MOST_JUDGED
from mapgraft.persons import same_place
from mapgraft.procedures import Tools
from mapgraft.registration import prior_around

MOST_RIVALS: Final = 3  # places that are tried beside the one where the merge stands


@dataclass(frozen=True, slots=True)
class Trial:
    """What the two maps say by themselves, as they are now, of the places at which one could lie in the other.

    ``standing`` is the log-odds (nats) that the merge is right, ``rivals`` the same of the places where other merges
    put it, as far as the maps meet there; each by itself, within ±6.
    """

    standing: float
    rivals: tuple[float, ...] = ()

    @property
    def support(self) -> float:
        """The log-odds (nats) that the merge is right, when at most one of the places is."""
        others = max((*self.rivals, 0.0))
        alone = math.fsum(math.exp(one - others) for one in (0.0, *self.rivals))
        return self.standing - others - math.log(alone)

    @property
    def evidence(self) -> dict[str, float]:
        """For events."""
        told = {"trial_log_odds": self.standing}
        return told | ({"trial_log_odds.elsewhere": max(self.rivals)} if self.rivals else {})

    @property
    def sentence(self) -> str:
        """For people."""
        here = f"measured on both maps, its log-odds of being right are {self.standing:.1f}"
        if not self.rivals:
            return f"{here}; where the others put it they cannot be compared"
        return f"{here}, and {max(self.rivals):.1f} where the others put it"


def try_out(
    attempts: Attempts, tools: Tools, meeting: Meeting, standing: Match, rivals: Sequence[Similarity],
    about_m: Sequence[float],
) -> Trial | None:  # fmt: skip
    """Hold two maps against each other where a merge stands, and where other claims put the donor.

    The metrics that tell a probability judge all places by the same maps, whatever those knew when the merge was made.
    A composed transform is only about right, so the matcher looks around it first. None where no metric can tell of the
    place where the merge stands. Raises what plugins raise.
    """
    here = attempts.log_odds(tools, meeting, standing)
    if here is None:
        return None
    told: list[float] = []
    for rival in rivals[:MOST_RIVALS]:
        T = rival.T_target_source.snapped()
        if same_place(standing.T_receiver_donor, T, about_m):
            continue
        match = replace(standing, T_receiver_donor=T, scale=rival.scale, covariance=rival.covariance, evidence={})
        there = attempts.log_odds(tools, meeting, _best_around(attempts, tools, meeting, match, about_m))
        if there is not None:
            told.append(_bounded(there))
    return Trial(_bounded(here), tuple(told))


def _best_around(attempts: Attempts, tools: Tools, meeting: Meeting, match: Match, about_m: Sequence[float]) -> Match:
    try:
        found = tools.matcher.match(meeting.target, meeting.source, prior_around(match, about_m))
    except MapError:
        return match
    near = (one for one in found if same_place(match.T_receiver_donor, one.T_receiver_donor, about_m))
    return next(near, match)


def _bounded(log_odds: float) -> float:
    return max(-MOST_JUDGED, min(MOST_JUDGED, log_odds))

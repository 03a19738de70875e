"""What the sequential test makes of a merge that was watched: how sure it ever was that it lies right, or wrong."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from mapgraft.calibrate.labelled import Labelled
from mapgraft.examples.looks import MOST, VERIFIER

WRONG_ODDS: Final = f"{VERIFIER}log_odds_wrong"  # what the verifier ``sequential`` tells of each look
MEETINGS: Final = f"{VERIFIER}rendezvous"  # and what robots that saw each other say (nats), where they did
TELLING: Final = 2.0  # nats from which meetings stand in for new walls, as for the verifier


@dataclass(frozen=True, slots=True)
class Reached:
    """The log-odds of being wrong by which a merge was judged: the highest, and the lowest at any look at which it
    could have been confirmed. ``judged`` is false where there never was new evidence; ``fell`` says that the
    probability, as it was known later, was below the one that reverts by itself.
    """

    lowest: float = math.inf
    highest: float = -math.inf
    judged: bool = False
    fell: bool = False

    def lies_above(self, revert_at: float, *, falls: bool) -> bool:
        """Whether a limit reverts it; ``falls`` says whether the fall of the probability does, too."""
        return self.highest >= revert_at or (falls and self.fell)


@dataclass(frozen=True, slots=True)
class Test:
    """What the rule's verifier ``sequential`` is asked: names, what confirming needs, and where it confirmed so far.

    It remembers what it has found of an example.
    """

    news: str = "news"
    prior: str = "posterior"
    new_m: float = 2.0
    revert_below: float = 0.1
    confirm_at: float = -5.3
    _known: dict[Labelled, Reached] = field(default_factory=dict, init=False, repr=False, compare=False)

    def reached(self, example: Labelled) -> Reached:
        """Between what log-odds a merge was judged while it was watched.

        Of a merge with so many looks that some may have been left out every later one counts as one that judges and may
        confirm: the extremes were kept, what else was known at these may be gone.
        """
        found = self._known.get(example)
        if found is None:
            found = self._known[example] = self._of(example)
        return found

    def _of(self, example: Labelled) -> Reached:
        lowest, highest, judged, fell = math.inf, -math.inf, False, False
        thinned = len(example.looks) > MOST
        for number, known in enumerate(self._states(example)):
            fell |= number > 0 and known.get(self.prior, math.nan) < self.revert_below
            met = known.get(MEETINGS, 0.0)
            seen = known.get(f"{self.news}.agreed", 0.0) + known.get(f"{self.news}.against", 0.0)
            wrong = known.get(WRONG_ODDS, math.nan)
            if math.isnan(wrong) or not (seen > 0.0 or met or (thinned and number)):
                continue
            judged, highest = True, max(highest, wrong)
            if thinned or met >= TELLING or known.get(f"{self.news}.agreed_m", math.inf) >= self.new_m:
                lowest = min(lowest, wrong)
        return Reached(lowest, highest, judged, fell)

    def _states(self, example: Labelled) -> Iterator[dict[str, float]]:
        """What was known at each look: what was not measured again is as it was."""
        details = (f"{self.news}.{detail}" for detail in ("agreed", "against", "agreed_m"))
        names = (self.prior, WRONG_ODDS, MEETINGS, *details)
        known: dict[str, float] = {}
        for look in example.looks:
            known |= {name: look.numbers[name] for name in names if name in look.numbers}
            yield known

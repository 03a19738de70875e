"""Merges to look at: chosen by a criterion that is told, and made again."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from mapgraft.config import ReversalName
from mapgraft.contracts import Map, MapType, Match
from mapgraft.evaluation.building import frame_of
from mapgraft.experiments.andersone2021.keeping import ID, Graft
from mapgraft.experiments.andersone2021.outcome import Experiment, Merge
from mapgraft.experiments.andersone2021.protocol import Laboratory
from mapgraft.experiments.andersone2021.telling.as_published import of, reading
from mapgraft.reversal import Reversal

PASSED: Final = 0.95  # SM that the paper's example of a wrong merge exceeds (section 4.3)
HETEROGENEOUS: Final = "0.07-0.1"  # the resolutions of that example
_HALF: Final = 0.5


@dataclass(frozen=True, slots=True)
class Example:
    """A merge and, in a sentence, why it was chosen."""

    merge: Merge
    why: str


@dataclass(frozen=True, slots=True, eq=False)
class Remade:
    """A merge made again; ``yaw_rad`` turns what is in the receiver's frame as the recording's own map lies.

    ``donor_yaw_rad`` does so with what is in the donor's.
    """

    example: Example
    graft: Graft
    yaw_rad: float
    donor_yaw_rad: float

    @property
    def map_type(self) -> MapType:
        return self.graft.map_type

    @property
    def donor_type(self) -> MapType:
        return self.graft.pair.donor.map_type

    def mapped_on(self, strategy: ReversalName) -> Reversal:
        """The merge kept in that way, after the further scans."""
        reversal = self.graft.merged(strategy)
        for observation in self.graft.pair.further:
            reversal.observe(observation)
        return reversal

    def reverted(self, strategy: ReversalName) -> Map:
        """The robot's map after the merge was taken out again."""
        reversal = self.mapped_on(strategy)
        reversal.revert(ID)
        return reversal.fused()


def right_example(experiment: Experiment) -> Example | None:
    """A right merge whose maps share about half: one sees both what was known and what is new."""
    merges = of(experiment, right=True)
    if not merges:
        return None
    best = min(merges, key=lambda merge: (abs(merge.overlap - _HALF), merge.name))
    return Example(best, f"Of all right merges the one whose maps overlap closest to one half ({best.overlap:.2f}).")


def wrong_example(experiment: Experiment) -> Example | None:
    """A wrong merge that passed a stricter acceptance than the paper's, as its own example did."""
    wrong = of(experiment, right=False)
    if not wrong:
        return None
    wanted = [merge for merge in wrong if merge.combination.name == HETEROGENEOUS] or wrong
    passed = [merge for merge in wanted if _accepted_at(merge) >= PASSED]
    if passed:
        best = max(passed, key=lambda merge: (_end_distance(merge), merge.name))
        which = f"of {len(passed)} wrong merges that passed SM ≥ {PASSED:g} the one with the greatest DM in the end"
        why = which if len(passed) > 1 else f"the only wrong merge that passed SM ≥ {PASSED:g}"
    else:
        best = max(wanted, key=lambda merge: (_accepted_at(merge), merge.name))
        why = f"no wrong merge passed SM ≥ {PASSED:g}; this is the one with the highest SM"
    return Example(best, f"At {best.combination.name}: {why} (accepted at SM {_accepted_at(best):.3f}).")


def remake(laboratory: Laboratory, example: Example) -> Remade:
    """Map both windows again and graft the donor where the match said."""
    merge, plan = example.merge, example.merge.plan
    graft = laboratory.graft(laboratory.built(plan, merge.combination), Match(merge.T_receiver_donor, merge.score, 0.0))
    yaws: Sequence[float] = [
        frame_of(window, turn).inverse().yaw_rad
        for window, turn in ((plan.receiver, plan.receiver_turn_rad), (plan.donor, plan.donor_turn_rad))
    ]
    return Remade(example, graft, *yaws)


def _accepted_at(merge: Merge) -> float:
    """SM between the receiver's own map and the donor's at the merge; NaN is least."""
    value = reading(merge.by["multi_map"], "similarity", "initial")
    return -math.inf if math.isnan(value) else value


def _end_distance(merge: Merge) -> float:
    value = reading(merge.by["multi_map"], "distance", "end")
    return -math.inf if math.isnan(value) else value

"""A matcher and an acceptor that force wrong merges: of what would be merged, every third is put somewhere else."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mapgraft.contracts import Candidate, Decision, Descriptor, Map, Match, Prior, Transform, hookimpl
from mapgraft_grid.correlation import Correlation
from mapgraft_standard.posterior import Posterior

MAPGRAFT_CONTRACT = (1, 0)
LIE = "lie"
OTHERS = 12  # places among which the likeliest wrong one is looked for


class Planting:
    """What correlation finds, and behind it a lie: the best match, moved by 3 to 9 m and turned by quarters.

    With ``likely`` the lie is the best other place that correlation finds, where it finds one.
    """

    def __init__(self, *, returned: int = 2, likely: bool = False) -> None:
        self.returned, self.likely = returned, likely
        self.honest = Correlation(returned=OTHERS if likely else returned)

    def match(self, target: Map, source: Map, prior: Prior | None = None) -> Sequence[Match]:
        found = list(self.honest.match(target, source, prior))
        if not found or prior is not None:
            return found
        found, others = found[: self.returned], found[1:]
        elsewhere = [one for one in others if _is_elsewhere(found[0].T_receiver_donor, one.T_receiver_donor)]
        if self.likely and elsewhere:
            return [*found, replace(elsewhere[0], evidence={LIE: 1.0})]
        rng = np.random.default_rng((target.known(), source.known()))
        far, towards = rng.uniform(3.0, 9.0), rng.uniform(-math.pi, math.pi)
        off = Transform.planar(far * math.cos(towards), far * math.sin(towards), rng.integers(4) * math.pi / 2.0)
        lie = replace(found[0], T_receiver_donor=off @ found[0].T_receiver_donor, evidence={LIE: 1.0})
        return [*found, lie]


def _is_elsewhere(T_a: Transform, T_b: Transform) -> bool:
    shift_m, turn_rad = T_a.difference(T_b)
    return shift_m > 1.0 or turn_rad > 0.2


class Sabotage:
    """Accepts a share ``keep`` of what ``posterior`` does, but every ``every``-th time the lie.

    With ``refuse`` it accepts nothing in the place of a lie.
    """

    def __init__(self, *, every: int = 3, keep: float = 1.0, refuse: bool = False) -> None:
        self.every, self.keep, self.refuse, self.accepted = every, keep, refuse, 0
        self.rng = np.random.default_rng(1)
        self.honest = Posterior(metrics={"posterior": {}, "paths": {"max": 4}})

    def accept(self, candidates: Sequence[Candidate]) -> Decision:
        lies = [n for n, one in enumerate(candidates) if LIE in one.match.evidence]
        decision = self.honest.accept([one for one in candidates if LIE not in one.match.evidence])
        if decision.verdict != "provisional" or not lies:
            return decision
        if self.rng.random() >= self.keep:
            return Decision("unmatched", None, "one merge less")
        self.accepted += 1
        if self.accepted % self.every:
            return decision
        if self.refuse:
            return Decision("unmatched", None, "it would have been a lie")
        return Decision("provisional", lies[0], f"a lie: {decision.reason}")


@hookimpl
def register_matchers(register):
    register(Descriptor("planting", "saboteur:Planting", "lies behind the truth", accepts=("occupancy_grid",)))


@hookimpl
def register_acceptors(register):
    register(Descriptor("sabotage", "saboteur:Sabotage", "takes every third lie"))

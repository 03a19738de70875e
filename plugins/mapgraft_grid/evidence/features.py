"""The numbers on which the posterior rests, each made so that it grows with the evidence and is about linear in it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from mapgraft.contracts import Comparison
from mapgraft_grid.evidence.bayes_factor import meeting_of
from mapgraft_grid.evidence.joint import standing_of
from mapgraft_grid.evidence.traces import beams_of, steps_of
from mapgraft_grid.similarity import kappa

IN_NATS: Final = "log_bayes_factor"  # a matcher with this evidence has L for its score, so that its margin is known
_NATS: Final = 10.0  # differences of L below this mean little
_LEAST_NATS: Final = 20.0  # a margin is a share of L, but not of less than this
_MOST_STEPS: Final = 20  # more walls on a path say no more


def features_of(comparison: Comparison) -> Mapping[str, float]:
    """What is known of a placement, by name; empty when the maps have no wall in common to judge it by.

    ``evidence``: log(1 + L / 10 nats). ``margin``: how far L is above that of the best other hypothesis, as a share of
    it in [-1, 1]; where the matcher's score is L. ``kappa``: Cohen's κ of the classes. ``good``: log(1 + patches of 2 m
    in which the walls of both are clearly near each other); ``patches``: log of these over those that speak against.
    ``beams``: log of the beams for over those against; ``steps``: -log(1 + walls on the paths); both only where beams
    say something. All grow with what speaks for the placement.
    """
    found = meeting_of(comparison, "posterior")
    walls = standing_of(comparison, "posterior")
    if found is None or sum(walls.walls_m) <= 0.0:
        return {}
    evidence = found[0].log_bayes_factor
    agreement = kappa(walls.table)
    out = {
        "evidence": math.copysign(math.log1p(abs(evidence) / _NATS), evidence),
        "kappa": 0.0 if math.isnan(agreement) else agreement,
        "good": math.log1p(walls.good),
        "patches": math.log((walls.good + 0.5) / (walls.bad + 0.5)),
    }
    match = comparison.match
    if IN_NATS in match.evidence:
        out["margin"] = max(-1.0, min(1.0, match.margin / max(match.score, _LEAST_NATS)))
    beams, steps = beams_of(comparison, "posterior"), steps_of(comparison, "posterior")
    if beams.support:
        out["beams"] = math.log((beams.stood + 2.0) / (beams.free_end + beams.through + 2.0))
        out["steps"] = -math.log1p(min(steps.walls, _MOST_STEPS))
    return out

"""The numbers on which the posterior rests, each made so that it grows with the evidence and is about linear in it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from mapgraft.contracts import Comparison
from mapgraft_lines.evidence.standing import standing_of

IN_METRES: Final = "explained_m"  # a matcher with this evidence scores in metres of wall, so that its margin is known
_LEAST_M: Final = 5.0  # a margin is a share of the score, but not of less than this


def features_of(comparison: Comparison) -> Mapping[str, float]:
    """What is known of a placement, by name; empty when no wall lies where the other map knows something.

    ``explained``: log(1 + metres of wall that are explained); ``balance``: log of these over what is against;
    ``share``: the share of the jointly known walls that is explained; ``good``: log(1 + patches of 2 m in which walls
    agree); ``patches``: log of these over those that speak against; ``straight``: minus the residual in decimetres;
    ``margin``: how far the score is above that of the best other hypothesis, as a share of it in [-1, 1], where the
    matcher scores in metres of wall. All grow with what speaks for the placement.
    """
    found = standing_of(comparison)
    if found.joint_m <= 0.0:
        return {}
    out = {
        "explained": math.log1p(found.explained),
        "balance": math.log((found.explained + 1.0) / (found.against + 1.0)),
        "share": min(found.explained / found.joint_m, 1.0),
        "good": math.log1p(found.good),
        "patches": math.log((found.good + 0.5) / (found.bad + 0.5)),
        "straight": -10.0 * math.sqrt(found.squares / found.explained) if found.explained > 0.0 else -2.5,
    }
    match = comparison.match
    if IN_METRES in match.evidence:
        out["margin"] = max(-1.0, min(1.0, match.margin / max(match.score, _LEAST_M)))
    return out

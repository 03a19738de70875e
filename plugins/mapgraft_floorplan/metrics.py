"""Metrics of a plan laid on a robot's map. Nothing that a plan leaves empty counts as seen to be empty."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from mapgraft.contracts import Anew, Comparison, Match, Measurement
from mapgraft_floorplan.evidence_table import Agreement, share_of
from mapgraft_floorplan.findings import findings_of
from mapgraft_floorplan.standing import agreement_of, differences_of
from mapgraft_standard.regression import probability

# Fitted to the best two hypotheses in simulated buildings, with plans of known and of unknown scale, whole and in part,
# with an earlier state of the code; the buildings by which it is judged are others, as it is now
# (tests/bench/fit_floorplan.py, docs/floorplans.md).
COEFFICIENTS: Final = {"drawn": 14.76, "explained": 10.75}
INTERCEPT: Final = -16.14
LEAD: Final = 13.8


class PlanPosterior:
    """The probability that a plan lies where a match puts it.

    The product of two: that walls meet so where a plan lies right (logistic in ``drawn`` and ``explained``), and that
    the place is the right one of those that were found (logistic in ``lead``): behind another it is at most one half.
    The lead is over all that were found, also over those that were refused since: the best of the rest is no better a
    place than it was.

    The value is NaN when one of the maps has no wall, or they have none in common to tell from. The support is the
    number of cells (about 0.1 m) of the robot's map on the plan. Details: ``fits`` and ``first``, the two factors, and
    the features (``features``).
    """

    def track(self, comparison: Comparison) -> Anew:
        return Anew(comparison, _posterior)


class PlanAgreement:
    """The share of the plan's walls that the robot has, too, among those that it looked at.

    Walls behind others, and those where the robot knows nothing, do not count, nor does what a plan leaves empty:
    furniture and doors change nothing. The value is NaN when the robot looked at no wall of the plan. The support is
    the number of cells (about 0.1 m) of such walls. Details: ``built``, the share of the robot's walls on the plan that
    the plan has, and ``common_m``, the length of the walls that both have.
    """

    def track(self, comparison: Comparison) -> Anew:
        return Anew(comparison, _agreement)


class PlanDeviations:
    """Where the robot's observations contradict the plan: walls that are missing, added or displaced.

    A wall of the plan within 0.12 m (one and a half cells in coarse grids) of a wall of the robot stands as drawn;
    within 0.5 m it is displaced; with none there it is missing if the robot saw through its place. A wall of the robot
    farther than 0.5 m from any of the plan, inside it, is added; that is what furniture is, too. The value is the share
    of displaced and missing walls among all the plan's that were looked at, NaN when there are none; the support is the
    number of cells of them. Details: ``agreed_m``, ``displaced_m``, ``missing_m``, ``added_m`` (lengths),
    ``displaced_mean_m`` and ``displaced_max_m`` (how far off). The findings tell each piece of wall of 0.5 m and more.
    """

    def track(self, comparison: Comparison) -> Anew:
        return Anew(comparison, _deviations)


def features(met: Agreement, match: Match) -> Mapping[str, float]:
    """What is known of a placement, by name; all grow with what speaks for it.

    ``lead``: how far the match's score lay above that of the best other place when both were found, as a share of it,
    in [-1, 1], and stays so when the merge is registered anew. Of a search around a prior it is over what lies there.
    ``drawn``: the share of the plan's walls that the robot has among those it looked at. ``explained``: the share of
    the robot's walls that the plan has.
    """
    told = match.evidence
    walls = met.table[2]
    return {
        "lead": told.get("lead", told.get("lead_here", share_of(match.margin, match.score))),
        "drawn": met.common / max(1, met.common + met.missing),
        "explained": float(walls[2:].sum()) / max(1, int(walls.sum())),
    }


def _built(met: Agreement) -> float:
    rows = met.table.tolist()
    with_plan = rows[2][2] + rows[2][3] + rows[2][4]
    return float(with_plan / max(1, with_plan + met.added))


def _posterior(comparison: Comparison) -> Measurement:
    met, match = agreement_of(comparison, "plan_posterior"), comparison.match
    support = 0 if met is None else int(met.table[1:, 1:].sum())
    if met is None or not support:
        return Measurement("plan_posterior", math.nan, "1", support, "higher")
    known = features(met, match)
    fits, first = chances(known)
    details = {"fits": fits, "first": first, **known}
    return Measurement("plan_posterior", fits * first, "1", support, "higher", details)


def chances(known: Mapping[str, float]) -> tuple[float, float]:
    """The two factors of the probability: that the walls meet as at a right place, and that it is the right one."""
    fits = INTERCEPT + math.fsum(c * known[name] for name, c in COEFFICIENTS.items())
    return probability(fits), probability(LEAD * known["lead"])


def _agreement(comparison: Comparison) -> Measurement:
    met = agreement_of(comparison, "plan_agreement")
    looked_at = 0 if met is None else met.common + met.missing
    if met is None or not looked_at:
        return Measurement("plan_agreement", math.nan, "1", 0, "higher")
    unit_m = max(0.1, getattr(comparison.target, "resolution_m", 0.1))
    details = {"built": _built(met), "common_m": met.common * unit_m}
    return Measurement("plan_agreement", met.common / looked_at, "1", looked_at, "higher", details)


def _deviations(comparison: Comparison) -> Measurement:
    found = differences_of(comparison, "plan_deviations")
    lengths = {} if found is None else dict(found.lengths_m())
    seen_m = sum(lengths.get(name, 0.0) for name in ("agreed_m", "displaced_m", "missing_m"))
    if found is None or seen_m <= 0.0:
        return Measurement("plan_deviations", math.nan, "1", 0, "lower", lengths)
    off = found.off_m[found.plan == 2]
    lengths["displaced_mean_m"] = float(off.mean()) if off.size else 0.0
    lengths["displaced_max_m"] = float(off.max()) if off.size else 0.0
    value = (lengths["displaced_m"] + lengths["missing_m"]) / seen_m
    support = round(seen_m / found.unit_m)
    return Measurement("plan_deviations", value, "1", support, "lower", lengths, findings_of(found))

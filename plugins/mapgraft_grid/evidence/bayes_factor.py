"""The log Bayes factor of a standing placement, as a metric."""

from __future__ import annotations

import math

from mapgraft.contracts import Anew, Comparison, EmptyMapError, Measurement, Transform
from mapgraft_grid.bayes import Meeting, meet
from mapgraft_grid.overlap import pair_of
from mapgraft_grid.prepared import canonical_m, prepare


class BayesFactor:
    """L = Σ log BF over the jointly known cells, in nats at 0.1 m or the receiver's resolution when that is coarser.

    Positive where both maps see the same cell, negative where they contradict each other (see ``bayes``). The value is
    NaN when a map has no wall. The support is the number of jointly known cells. Details: ``agreement``,
    ``disagreement``, ``occupied_agreement`` (cells), ``per_metre``, L per metre of walls that both have.
    """

    def track(self, comparison: Comparison) -> Anew:
        return Anew(comparison, _measured)


def _measured(comparison: Comparison) -> Measurement:
    found = meeting_of(comparison, "bayes_factor")
    if found is None:
        return Measurement("bayes_factor", math.nan, "nat", 0, "higher", {})
    meeting, unit_m = found
    common_m = meeting.near_agreement * unit_m
    details = {
        "agreement": float(meeting.agreement),
        "disagreement": float(meeting.disagreement),
        "occupied_agreement": float(meeting.occupied_agreement),
        "per_metre": meeting.log_bayes_factor / common_m if common_m > 0.0 else math.nan,
    }
    return Measurement("bayes_factor", meeting.log_bayes_factor, "nat", meeting.overlap, "higher", details)


def meeting_of(comparison: Comparison, metric: str) -> tuple[Meeting, float] | None:
    """How the cells of both maps meet, and their size (m); None when a map has no wall."""
    target, donor = pair_of(comparison, metric)
    unit_m = canonical_m(target.resolution_m)
    try:
        ours, theirs = prepare(target, unit_m), prepare(donor, unit_m)
    except EmptyMapError:
        return None
    return meet(ours, theirs, Transform.identity()), ours.unit_m

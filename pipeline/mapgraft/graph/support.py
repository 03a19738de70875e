"""How sure a robot is of a merge it made: the one place where that is said as a number."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final

from mapgraft.contracts import Measurement, Sample, Verdict
from mapgraft.graph.claims import MOST_SUPPORT

LOG_ODDS_WRONG: Final = "log_odds_wrong"  # evidence of verifiers that test sequentially: nats, that the merge is wrong
LOG_ODDS: Final = "log_odds"  # detail of metrics whose value is the probability that a match is right: nats
MOST_JUDGED: Final = 6.0  # nats: no judgement of a robot counts for more, however often it has looked
ACCEPTED: Final = 2.2  # nats: a merge of which nobody tells a probability was accepted with nine in ten
CONFIRMED: Final = 5.3  # nats: 0.995, as verifiers confirm


def support_of(history: Sequence[Sample], verdict: Verdict | None, confirmed: bool, by_person: bool) -> float:
    """The log-odds (nats) that a merge is right, as its robot judges now, within ±12.

    What a person decided is sure. Else the latest word of the verifier, where it tells how its test stands; else what
    the metrics said when the match was accepted; else what merges of that state usually are. Neither is surer than 6
    nats that it is right: a test that goes on counts the same walls again, and in rooms that look alike all that it
    counts agrees. A confirmed merge is evidence, and no proof.
    """
    if by_person:
        return MOST_SUPPORT
    told = None if verdict is None else verdict.evidence.get(LOG_ODDS_WRONG)
    if told is not None and math.isfinite(told):
        return max(-MOST_SUPPORT, min(MOST_JUDGED, -told))
    first = history[0].measurements.values() if history else ()
    found = log_odds_of(first)
    if found is not None and not confirmed:
        return max(-MOST_JUDGED, min(MOST_JUDGED, found))
    return CONFIRMED if confirmed else ACCEPTED


def log_odds_of(measurements: Iterable[Measurement]) -> float | None:
    """The log-odds (nats) that a match is right, by the metrics that tell a probability; None where none does."""
    return min((m.details[LOG_ODDS] for m in measurements if _is_probability(m)), default=None)


def as_believed(history: Iterable[Sample], support: float) -> list[Sample]:
    """The samples of an attached layer as its verifier is to see them; ``support`` is that of the chain.

    What was attached was never matched here: the probability that it lies right is that of the chain, and not what a
    metric makes of two maps that perhaps do not even touch.
    """
    return [replace(sample, measurements=_believed(sample.measurements, support)) for sample in history]


def _believed(measurements: Mapping[str, Measurement], support: float) -> dict[str, Measurement]:
    probability = 1.0 / (1.0 + math.exp(min(-support, 700.0)))
    return {
        name: replace(m, value=probability, details={**m.details, LOG_ODDS: support}) if _is_probability(m) else m
        for name, m in measurements.items()
    }


def _is_probability(m: Measurement) -> bool:
    return m.sufficient and math.isfinite(m.details.get(LOG_ODDS, math.nan))

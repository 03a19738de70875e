"""What a list of judged pairs comes to: right, wrong, no answer, false merges, and how well each number tells."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mapgraft.evaluation.statistics import Area, Share, Spread, Weights, area, resampled, share, spread
from mapgraft.evaluation.summary import BINS, MUCH_OVERLAP, SOME_OVERLAP, bin_of
from mapgraft.matching.judging import Error, Judged
from mapgraft.matching.pairing import Hypothesis

SEED = 0  # of the resampling
EVIDENCE = "evidence."  # begins the names of a matcher's own numbers


@dataclass(frozen=True, slots=True)
class Off:
    """How far the right first hypotheses are off: median and 95th percentile of each measure."""

    metres: Spread
    pixels: Spread
    degrees: Spread


@dataclass(frozen=True, slots=True)
class Tally:
    """Shares of pairs with truth and, where said, of unrelated ones.

    ``recall`` are right first hypotheses by the bins of true overlap of ``mapgraft evaluate``, ``recall_from_some``
    those from .3 on; ``first_*`` count the first hypotheses and ``accepted_*`` what the rules took of all pairs with
    truth, ``accepted_of_right`` of those whose first hypothesis is right at an overlap of .5 and more. ``merged`` are
    unrelated pairs that were merged. ``areas`` says how well each number of a first hypothesis tells the right ones
    from all others.
    """

    pairs: int
    unrelated: int
    rejected: int
    ambiguous: int
    first_right: Share
    first_wrong: Share
    first_none: Share
    recall: tuple[Share, ...]
    recall_from_some: Share
    accepted_right: Share
    accepted_wrong: Share
    accepted_of_right: Share
    merged: Share
    off: Off
    areas: dict[str, Area]
    match_s: Spread
    longest_s: float


def tally(judged: Sequence[Judged]) -> Tally:
    """Count; the intervals are by bootstrap over the map files, because one file is in many pairs."""
    files: dict[Path, int] = {}
    blocks = [[files.setdefault(path, len(files)) for path in (j.pair.a.path, j.pair.b.path)] for j in judged]
    weights = resampled(np.array(blocks, np.int64).reshape(-1, 2), SEED)
    true = [j.overlap is not None for j in judged]
    overlaps = [-1.0 if j.overlap is None else j.overlap for j in judged]
    bins = [bin_of(overlap) if overlap >= 0.0 else -1 for overlap in overlaps]
    right, wrong = _answers([j.first for j in judged])
    accepted, mistaken = _answers([j.accepted for j in judged])
    much = [overlap >= MUCH_OVERLAP and is_right for overlap, is_right in zip(overlaps, right, strict=True)]
    times = [j.pairing.match_s for j in judged if j.pairing.verdict != "rejected"]
    return Tally(
        pairs=sum(true),
        unrelated=len(judged) - sum(true),
        rejected=sum(j.pairing.verdict == "rejected" for j in judged),
        ambiguous=sum(j.pairing.verdict == "ambiguous" for j in judged),
        first_right=share(right, true, weights),
        first_wrong=share(wrong, true, weights),
        first_none=share([j.first is None for j in judged], true, weights),
        recall=tuple(share(right, [n == number for n in bins], weights) for number in range(len(BINS))),
        recall_from_some=share(right, [overlap >= SOME_OVERLAP for overlap in overlaps], weights),
        accepted_right=share(accepted, true, weights),
        accepted_wrong=share(mistaken, true, weights),
        accepted_of_right=share(accepted, much, weights),
        merged=share([j.merged for j in judged], [not is_true for is_true in true], weights),
        off=_off([j.first for j in judged if j.first is not None and j.first.right]),
        areas=_areas(judged, weights),
        match_s=spread(times),
        longest_s=max(times, default=math.nan),
    )


def _answers(errors: Sequence[Error | None]) -> tuple[list[bool], list[bool]]:
    """Which are right, and which are wrong; no answer is neither."""
    right = [error is not None and error.right for error in errors]
    return right, [error is not None and not error.right for error in errors]


def _off(errors: Sequence[Error]) -> Off:
    def of(values: Sequence[float | None]) -> Spread:
        return spread([value for value in values if value is not None])

    return Off(
        of([error.displacement_m for error in errors]),
        of([error.keypoint_px for error in errors]),
        of([error.rotation_deg for error in errors]),
    )


def _areas(judged: Sequence[Judged], weights: Weights) -> dict[str, Area]:
    """For each number of the first hypotheses; the larger one speaks for a match where the metric says so."""
    answered = [number for number, j in enumerate(judged) if j.pairing.hypotheses]
    rows = [_numbers(judged[number].pairing.hypotheses[0]) for number in answered]
    names = dict.fromkeys(name for row in rows for name in row)
    right, _ = _answers([judged[number].first for number in answered])
    return {name: area([row.get(name, math.nan) for row in rows], right, weights[:, answered]) for name in names}


def _numbers(hypothesis: Hypothesis) -> dict[str, float]:
    """Score, margin, the metrics' values, and the matcher's evidence; turned so that more is better where known."""
    match = hypothesis.match
    out = {"score": match.score, "margin": match.margin}
    for measurement in hypothesis.measurements or ():
        out[measurement.name] = measurement.value if measurement.better == "higher" else -measurement.value
    return out | {f"{EVIDENCE}{name}": value for name, value in match.evidence.items()}

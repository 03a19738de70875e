"""What a list of judged pairs comes to: right, wrong, no answer, false merges, and how well each number tells."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mapgraft.evaluation.statistics import Area, Share, Weights, area, resampled, share
from mapgraft.matching.judging import Error, Judged
from mapgraft.matching.pairing import Hypothesis

SEED = 0  # of the resampling
EVIDENCE = "evidence "  # begins the names of a matcher's own numbers


@dataclass(frozen=True, slots=True)
class Answers:
    """Answers to pairs with truth, and the median error of the right ones in the units of their truths."""

    right: Share
    wrong: Share
    none: Share
    median_m: float
    median_deg: float
    median_px: float


@dataclass(frozen=True, slots=True)
class Tally:
    """``first`` counts the matcher's first hypotheses, ``accepted`` what the rules took, ``merged`` the unrelated pairs
    that were merged. ``areas`` says how well each number of a first hypothesis tells the right ones from all others.
    """

    pairs: int
    unrelated: int
    first: Answers
    accepted: Answers
    merged: Share
    areas: dict[str, Area]
    median_s: float
    longest_s: float


def tally(judged: Sequence[Judged]) -> Tally:
    """Count; the intervals are by bootstrap over the map files, because one file is in many pairs."""
    files: dict[Path, int] = {}
    blocks = [[files.setdefault(path, len(files)) for path in (j.pair.a.path, j.pair.b.path)] for j in judged]
    weights = resampled(np.array(blocks, np.int64).reshape(-1, 2), SEED)
    true = np.array([j.pair.kind != "unrelated" for j in judged], np.bool_)
    times = [j.pairing.match_s for j in judged if j.pairing.verdict != "rejected"]
    return Tally(
        int(true.sum()),
        int((~true).sum()),
        _answers([j.first for j in judged], true, weights),
        _answers([j.accepted for j in judged], true, weights),
        share([j.merged for j in judged], ~true, weights),
        _areas(judged, weights),
        float(np.median(times)) if times else math.nan,
        max(times, default=math.nan),
    )


def _answers(errors: Sequence[Error | None], true: np.ndarray, weights: Weights) -> Answers:
    right = [error is not None and error.right for error in errors]
    wrong = [error is not None and not error.right for error in errors]
    good = [error for error in errors if error is not None and error.right]
    return Answers(
        share(right, true, weights),
        share(wrong, true, weights),
        share([error is None for error in errors], true, weights),
        _median([error.displacement_m for error in good]),
        _median([error.rotation_deg for error in good]),
        _median([error.keypoint_px for error in good]),
    )


def _median(values: Sequence[float | None]) -> float:
    there = [value for value in values if value is not None]
    return float(np.median(there)) if there else math.nan


def _areas(judged: Sequence[Judged], weights: Weights) -> dict[str, Area]:
    """For each number of the first hypotheses; the larger one speaks for a match where the metric says so."""
    answered = [number for number, j in enumerate(judged) if j.pairing.hypotheses]
    rows = [_numbers(judged[number].pairing.hypotheses[0]) for number in answered]
    names = dict.fromkeys(name for row in rows for name in row)
    right = []
    for number in answered:
        error = judged[number].first
        right.append(error is not None and error.right)
    return {name: area([row.get(name, math.nan) for row in rows], right, weights[:, answered]) for name in names}


def _numbers(hypothesis: Hypothesis) -> dict[str, float]:
    """Score, margin, the metrics' values, and the matcher's evidence; turned so that more is better where known."""
    match = hypothesis.match
    out = {"score": match.score, "margin": match.margin}
    for measurement in hypothesis.measurements or ():
        out[measurement.name] = measurement.value if measurement.better == "higher" else -measurement.value
    return out | {f"{EVIDENCE}{name}": value for name, value in match.evidence.items()}

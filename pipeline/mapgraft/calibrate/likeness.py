"""How far the scores of some examples are from those of others, whatever shares of them are right."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from mapgraft.calibrate.labelled import Labelled
from mapgraft.calibrate.regression import Vector
from mapgraft.calibrate.scoring import Score

KOLMOGOROV: Final = 1.63  # of two samples' distance that chance exceeds in 1 % of cases
LEAST: Final = 30  # examples: fewer tell nothing of a distribution


def unlike(scores: Vector, right: Vector, wrong: Vector) -> float:
    """How far a distribution of scores is from the nearest mixture of right and wrong ones (Kolmogorov's distance).

    How many are right elsewhere is not known and may differ; how right and wrong ones score should not. NaN where there
    are fewer than 30 scores, or none of one kind.
    """
    told, right, wrong = (values[np.isfinite(values)] for values in (scores, right, wrong))
    if len(told) < LEAST or not len(right) or not len(wrong):
        return math.nan
    at = np.unique(np.concatenate((told, right, wrong)))
    here, of_right, of_wrong = (np.searchsorted(np.sort(v), at, side="right") / len(v) for v in (told, right, wrong))
    shares = np.linspace(0.0, 1.0, 101)[:, None]
    return float(np.abs(here - (shares * of_right + (1.0 - shares) * of_wrong)).max(axis=1).min())


def by_label(examples: Sequence[Labelled], score: Score) -> tuple[Vector, Vector]:
    """The scores of the right ones, and of the wrong ones."""
    right, wrong = ([e for e in examples if e.right is kind] for kind in (True, False))
    return score.all(right), score.all(wrong)

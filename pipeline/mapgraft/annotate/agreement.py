"""How far annotators agree, beyond what chance would do."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.annotate.shown import Agreement

Codes = NDArray[np.int8]  # (n,) what somebody said of each example: 0 nothing, else 1 + the position in ``Said``
CATEGORIES: Final = 3  # right, wrong, unsure
MOST_COMPARED: Final = 12  # annotators; those who said most


def agreements(codes: Mapping[str, Codes], annotator: str | None = None) -> tuple[Agreement, ...]:
    """How far every two annotators agree on what both have judged; those of ``annotator`` first.

    Of more than a dozen annotators those are compared who said most, and ``annotator``.
    """
    most = sorted(codes, key=lambda name: (name != annotator, -int(np.count_nonzero(codes[name])), name))
    compared = most[:MOST_COMPARED]
    return tuple(agreement(one, other, codes[one], codes[other]) for one, other in combinations(compared, 2))


def agreement(one: str, other: str, said_one: Codes, said_other: Codes) -> Agreement:
    """How far two annotators agree, with Cohen's kappa.

    J. Cohen, A coefficient of agreement for nominal scales, Educational and Psychological Measurement 20, 1960; over
    the three categories right, wrong and unsure. ``said_one`` and ``said_other`` are (n,), of the same examples.
    """
    common = (said_one > 0) & (said_other > 0)
    pairs = (said_one[common].astype(np.int64) - 1) * CATEGORIES + (said_other[common] - 1)
    table = np.bincount(pairs, minlength=CATEGORIES**2).reshape(CATEGORIES, CATEGORIES)
    both, same = int(table.sum()), int(np.trace(table))
    by_chance = int(table.sum(axis=0) @ table.sum(axis=1))  # times both²
    if both * both == by_chance:  # nothing in common, or one and the same word of everything
        return Agreement(one, other, both, same, None)
    return Agreement(one, other, both, same, (same * both - by_chance) / (both * both - by_chance))


def mean_kappa(pairs: tuple[Agreement, ...]) -> float | None:
    """The mean of the kappas of all pairs that have one, for three and more annotators; None without any.

    R. J. Light, Measures of response agreement for qualitative data, Psychological Bulletin 76, 1971.
    """
    kappas = [pair.kappa for pair in pairs if pair.kappa is not None]
    return sum(kappas) / len(kappas) if kappas else None

"""Rates with exact intervals, and how surely a rate is above what was promised."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mapgraft.evaluation.statistics import LEVEL


@dataclass(frozen=True, slots=True)
class Rate:
    """``count`` of ``of`` independent things, with the interval of Clopper and Pearson; NaN where there is nothing."""

    count: int
    of: int
    value: float
    low: float
    high: float

    @classmethod
    def counted(cls, count: int, of: int, level: float = LEVEL) -> Rate:
        """The rate and its interval (C. J. Clopper and E. S. Pearson, Biometrika 26, 1934)."""
        count, of = int(count), int(of)  # numbers of NumPy cannot be written as JSON
        if not 0 <= count <= of:
            raise ValueError(f"a rate counts some of all, found {count} of {of}")
        if of == 0:
            return cls(0, 0, math.nan, math.nan, math.nan)
        from scipy.special import betaincinv

        tail = (1.0 - level) / 2.0
        low = 0.0 if count == 0 else float(betaincinv(count, of - count + 1, tail))
        high = 1.0 if count == of else float(betaincinv(count + 1, of - count, 1.0 - tail))
        return cls(count, of, count / of, low, high)

    @property
    def text(self) -> str:
        """``1.2 % (0.3 to 3.4) 4/333``."""
        if not self.of:
            return "none to count"
        return f"{_percent(self.value)} % ({_percent(self.low)} to {_percent(self.high)}) {self.count}/{self.of}"


def _percent(share: float) -> str:
    """Two digits below ten percent, and one place after the point above."""
    percent = 100.0 * share
    return f"{percent:.2g}" if percent < 9.95 else f"{percent:.1f}".removesuffix(".0")


def above(count: int, of: int, rate: float) -> float:
    """The probability of so many or more of ``of`` independent things where each happens at the rate ``rate``.

    Small values speak against the rate being that low.
    """
    if count <= 0:
        return 1.0
    from scipy.special import betainc

    return float(betainc(count, of - count + 1, rate))

"""One number of all that is known of a hypothesis: what the acceptor ``calibrated`` computes, and how it is fitted."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from mapgraft.calibrate.labelled import Labelled
from mapgraft.calibrate.regression import Vector, logistic
from mapgraft.evaluation.statistics import area

UNFITTED: Final = "score"  # the number to go by where there is nothing to fit
MOST_TERMS: Final = 8  # more follow the buildings that they were fitted on
_TELLS: Final = 0.6  # area under the curve from which a number is worth a term
_ALIKE: Final = 0.98  # correlation from which two numbers are one
_LARGE: Final = 20.0  # numbers that grow beyond that are taken by their logarithm
_NO_EVIDENCE: Final = ("degenerate_dir_rad", "resolution_m")


@dataclass(frozen=True, slots=True)
class Term:
    """One number with its weight; ``log`` takes sign(x) log(1 + abs(x)) of it, ``most`` bounds it to both sides."""

    number: str
    weight: float
    log: bool = False
    most: float = math.inf

    def value(self, numbers: Mapping[str, float]) -> float:
        """What enters the sum before it is weighed; NaN where the number is not told."""
        told = numbers.get(self.number, math.nan)
        if math.isnan(told):
            return math.nan
        given = max(-self.most, min(self.most, told))
        return math.copysign(math.log1p(abs(given)), given) if self.log else given

    @property
    def parameters(self) -> Any:
        """As the acceptor takes it."""
        told: dict[str, Any] = {"weight": self.weight}
        if self.log:
            told["log"] = True
        if math.isfinite(self.most):
            told["most"] = self.most
        return self.weight if told == {"weight": self.weight} else told


@dataclass(frozen=True, slots=True)
class Score:
    """The sum of terms; NaN where one of the numbers is not told. ``fitted_on`` names buildings, empty where it was
    not fitted here."""

    terms: tuple[Term, ...]
    intercept: float = 0.0
    fitted_on: tuple[str, ...] = ()

    def of(self, numbers: Mapping[str, float]) -> float:
        return self.intercept + sum(term.weight * term.value(numbers) for term in self.terms)

    def all(self, examples: Sequence[Labelled]) -> Vector:
        return np.array([self.of(example.numbers) for example in examples], np.float64)

    @property
    def name(self) -> str:
        """What it is called for persons."""
        if len(self.terms) == 1 and not self.fitted_on:
            return self.terms[0].number
        return "a regression on " + ", ".join(term.number for term in self.terms)


# Makes a score of examples, and says which of them are left to set thresholds.
Choose = Callable[[Sequence[Labelled]], tuple[Score, Sequence[Labelled]]]


def single(number: str) -> Score:
    """A number as it is."""
    return Score((Term(number, 1.0),))


def fitted(examples: Sequence[Labelled]) -> Score | None:
    """A logistic regression on the numbers that tell right from wrong; None where none does.

    Of the numbers that all examples have those are taken that tell most, at most 8, each in the direction in which it
    tells; no coefficient goes the other way. Buildings count the same, however many examples they have.
    """
    known = [example for example in examples if example.right is not None]
    right = np.array([example.right for example in known], np.bool_)
    if not right.any() or right.all():
        return None
    terms, values = _telling(known, right)
    if not terms:
        return None
    middle, size = values.mean(axis=0), values.std(axis=0)
    coefficients, intercept = logistic((values - middle) / size, right, _weights(known))
    used = [
        Term(t.number, _short(t.weight * c / s), t.log, t.most)
        for t, c, s in zip(terms, coefficients, size, strict=True)
        if c > 0.0
    ]
    offset = intercept - float((coefficients * middle / size).sum())
    return Score(tuple(used), _short(offset), tuple(sorted({b for e in known for b in e.buildings}))) if used else None


def _telling(examples: Sequence[Labelled], right: Any) -> tuple[list[Term], Vector]:
    """The terms that are worth it, each with weight 1 or -1, and their values (n, k) in that direction."""
    names = sorted(set.intersection(*(set(example.numbers) for example in examples)))
    found: list[tuple[float, Term, Vector]] = []
    for name in names:
        if name.rpartition(".")[2] in _NO_EVIDENCE:
            continue
        given = np.array([example.numbers[name] for example in examples], np.float64)
        finite = given[np.isfinite(given)]
        if np.isnan(given).any() or not finite.size or finite.min() == finite.max():
            continue
        most = float(np.abs(finite).max())
        bound = _short(most) if not np.isfinite(given).all() else math.inf
        term = Term(name, 1.0, log=most > _LARGE, most=bound)
        values = np.array([term.value(example.numbers) for example in examples])
        told = area(values, right, np.ones((1, len(examples)))).value
        sign = 1.0 if told >= 0.5 else -1.0
        if max(told, 1.0 - told) >= _TELLS:
            found.append((max(told, 1.0 - told), Term(name, sign, term.log, bound), sign * values))
    found.sort(key=lambda one: (-one[0], one[1].number))
    kept: list[tuple[Term, Vector]] = []
    for _, term, values in found:
        if len(kept) < MOST_TERMS and all(abs(np.corrcoef(values, other)[0, 1]) < _ALIKE for _, other in kept):
            kept.append((term, values))
    return [term for term, _ in kept], np.column_stack([v for _, v in kept]) if kept else np.ones((len(examples), 0))


def _weights(examples: Sequence[Labelled]) -> Vector:
    """Every environment counts the same."""
    sizes: dict[str, int] = {}
    for example in examples:
        sizes[example.environment] = sizes.get(example.environment, 0) + 1
    return np.array([len(examples) / (len(sizes) * sizes[example.environment]) for example in examples])


def _short(value: float) -> float:
    return float(f"{value:.5g}")

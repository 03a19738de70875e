"""Accepting the matcher's first hypothesis when its score is above a threshold that labels have set."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from mapgraft.contracts import Candidate, ConfigError, Decision, PluginError
from mapgraft_standard.acceptance import Thresholds
from mapgraft_standard.limits import limits_of, mapping_of, number_of
from mapgraft_standard.rendezvous import REFUTED, refutations

_WHERE = "acceptor calibrated"
_LIMITS = ("score_min", "margin_min", "evidence", "metrics")  # what the acceptor ``thresholds`` takes


@dataclass(frozen=True, slots=True)
class Term:
    """One number of a candidate with its weight; ``log`` takes sign(x) log(1 + abs(x)) of it, ``most`` bounds it."""

    number: str
    weight: float
    log: bool = False
    most: float = math.inf

    def value(self, given: float) -> float:
        """What it adds to the score."""
        if math.isnan(given):
            return math.nan
        bounded = max(-self.most, min(self.most, given))
        return self.weight * (math.copysign(math.log1p(abs(bounded)), bounded) if self.log else bounded)


class Calibrated:
    """Takes the first candidate if its score is above ``accept_above``, and no other.

    The score is ``intercept`` plus the sum of ``score``: names of numbers with their weights, or with
    ``{weight, log, most}``, where ``log`` takes the logarithm of 1 + the number (with its sign) and ``most`` bounds it
    to both sides. Numbers are ``score`` and ``margin`` of the match, its evidence as ``evidence.<name>``, a metric by
    its name and its details as ``<metric>.<detail>``. Where one of them is not told the candidate is not taken. Without
    a threshold (``accept_above`` null) nothing is: labels have set none. Above ``ambiguous_above``, which is no
    higher, the verdict is ``ambiguous``.

    Only the first candidate is taken, because that is the one of which the labels told how often it is wrong above the
    threshold. Vetoes can only make it rarer. ``metrics`` names what is measured; limits on them (``{name: {min, max,
    support_min, details: {name: {min, max}}}}``) are vetoes; what cannot be measured breaks none. Where robots saw each
    other the metric ``rendezvous`` is a veto at ``refuted`` nats or below. ``limits`` are those of the acceptor
    ``thresholds``, under its names: what that would not take is not taken here, either.
    """

    def __init__(
        self,
        *,
        score: Mapping[str, Any] | None = None,
        intercept: float = 0.0,
        accept_above: float | None = None,
        ambiguous_above: float | None = None,
        metrics: Mapping[str, Any] | None = None,
        limits: Mapping[str, Any] | None = None,
        refuted: float = REFUTED,
    ) -> None:
        self.terms = [_term(name, given) for name, given in (score or {"score": 1.0}).items()]
        self.intercept = number_of(intercept, f"{_WHERE}, intercept")
        self.above = math.inf if accept_above is None else number_of(accept_above, f"{_WHERE}, accept_above")
        told = self.above if ambiguous_above is None else number_of(ambiguous_above, f"{_WHERE}, ambiguous_above")
        if told > self.above:
            raise ConfigError(f"{_WHERE} needs ambiguous_above <= accept_above, found {told:g} and {self.above:g}")
        self.ambiguous = told
        self.vetoes = limits_of({name: options for name, options in (metrics or {}).items() if options}, _WHERE)
        self.limits = None if limits is None else _thresholds(limits)
        self.refuted = number_of(refuted, f"{_WHERE}, refuted")

    def accept(self, candidates: Sequence[Candidate]) -> Decision:
        """Provisional, ambiguous or unmatched, with the score and the threshold that made it so."""
        if not candidates:
            return Decision("unmatched", None, "the matcher found no hypothesis")
        first = candidates[0]
        score = self.score(first)
        if math.isnan(score):
            lacking = ", ".join(term.number for term in self.terms if math.isnan(_number(first, term.number)))
            return Decision("unmatched", None, f"the score cannot be told: {lacking} could not be measured")
        if faults := "; ".join(self._broken(first)):
            return Decision("unmatched", None, f"the first hypothesis scores {score:.4g}, but {faults}")
        said = f"the first hypothesis scores {score:.4g}"
        if math.isinf(self.above):
            return Decision("unmatched", None, f"{said}; labels have set no threshold for such maps")
        if score > self.above:
            return self._within_limits(candidates, f"{said} > {self.above:.4g}")
        if score > self.ambiguous:
            return Decision("ambiguous", None, f"{said} ≤ {self.above:.4g}")
        return Decision("unmatched", None, f"{said} ≤ {self.ambiguous:.4g}")

    def score(self, candidate: Candidate) -> float:
        """The score of a candidate; NaN where one of its numbers is not told."""
        return self.intercept + sum(term.value(_number(candidate, term.number)) for term in self.terms)

    def _within_limits(self, candidates: Sequence[Candidate], said: str) -> Decision:
        """What becomes of a first candidate that scores high enough, ``said`` so: it must be the one within limits."""
        if self.limits is None:
            return Decision("provisional", 0, said)
        found = self.limits.accept(candidates)
        if found.chosen == 0:
            return Decision("provisional", 0, f"{said}; {found.reason}")
        verdict: Literal["ambiguous", "unmatched"] = "ambiguous" if found.verdict == "ambiguous" else "unmatched"
        return Decision(verdict, None, f"{said}, but by its limits: {found.reason}")

    def _broken(self, candidate: Candidate) -> list[str]:
        """The vetoes that a candidate breaks."""
        out = [check.text for check in refutations(candidate.measurements, self.refuted)]
        for name, limit in self.vetoes.items():
            if name not in candidate.measurements:
                raise PluginError(f"the metric {name} was not measured: an acceptor must get what its rule names")
            out += [check.text for check in limit.checks(candidate.measurements[name]) if check.passed is False]
        return out


def _thresholds(limits: object) -> Thresholds:
    given = mapping_of(limits, f"{_WHERE}, limits")
    if unknown := sorted(set(given) - set(_LIMITS)):
        raise ConfigError(f"{_WHERE}, limits takes {', '.join(_LIMITS)}, found {', '.join(unknown)}")
    return Thresholds(**given)


def _term(name: str, given: object) -> Term:
    where = f"{_WHERE}, score of {name}"
    if not isinstance(given, Mapping):
        return Term(name, number_of(given, where))
    options = mapping_of(given, where)
    if unknown := sorted(set(options) - {"weight", "log", "most"}):
        raise ConfigError(f"{where} takes weight, log and most, found {', '.join(unknown)}")
    if not isinstance(options.get("log", False), bool):
        raise ConfigError(f"{where} takes log true or false, found {options['log']!r}")
    most = number_of(options.get("most", math.inf), f"{where}, most")
    if not most > 0.0:
        raise ConfigError(f"{where} needs most > 0, found {most:g}")
    return Term(name, number_of(options.get("weight", 1.0), f"{where}, weight"), options.get("log", False), most)


def _number(candidate: Candidate, name: str) -> float:
    """A number of a candidate by its name; NaN where there is none."""
    match = candidate.match
    if name in ("score", "margin"):
        return match.score if name == "score" else match.margin
    head, _, rest = name.partition(".")
    if head == "evidence":
        return match.evidence.get(rest, math.nan)
    metric = candidate.measurements.get(name)
    if metric is not None:
        return metric.value
    owner = candidate.measurements.get(head)
    return math.nan if owner is None else owner.details.get(rest, math.nan)

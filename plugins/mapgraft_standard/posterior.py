"""Accepting a candidate when it is probably enough right."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from mapgraft.contracts import Candidate, ConfigError, Decision, PluginError
from mapgraft_standard.limits import Check, limits_of
from mapgraft_standard.rendezvous import REFUTED, refutations, told_by

_LEAST: Final = 1e-12  # nothing is surer than that
_LEAST_SHOWN: Final = 1e-9  # what a probability lacks to 1, in words


class Posterior:
    """Takes the candidate that is most probably right, if its probability is at least ``provisional``.

    What the metric ``metric`` measures, which ``metrics`` must name, is the probability of each candidate by itself;
    one that it cannot tell is 0. At most one candidate is right, so the probabilities are weighed against each other:
    each is its odds over 1 + the sum of all odds. Where robots saw each other the metric ``rendezvous`` multiplies the
    odds, and at ``refuted`` nats or below is a veto. Below ``provisional`` and from ``ambiguous`` on the verdict is
    ``ambiguous``. Limits on further ``metrics`` (``{name: {min, max, support_min, details: {name: {min, max}}}}``) are
    vetoes: a candidate that breaks one is out; what cannot be measured breaks none.
    """

    def __init__(
        self,
        *,
        provisional: float = 0.9,
        ambiguous: float = 0.5,
        metric: str = "posterior",
        metrics: Mapping[str, Any] | None = None,
        refuted: float = REFUTED,
    ) -> None:
        if not 0.0 < ambiguous <= provisional < 1.0:
            raise ConfigError(
                "acceptor posterior needs 0 < ambiguous <= provisional < 1 (probabilities), found "
                f"ambiguous={ambiguous}, provisional={provisional}"
            )
        self.provisional = provisional
        self.ambiguous = ambiguous
        self.metric = metric
        self.refuted = refuted
        self.vetoes = limits_of({n: o for n, o in (metrics or {}).items() if n != metric or o}, "acceptor posterior")

    def accept(self, candidates: Sequence[Candidate]) -> Decision:
        """Provisional, ambiguous or unmatched, with the probabilities and vetoes that made it so."""
        if not candidates:
            return Decision("unmatched", None, "the matcher found no hypothesis")
        vetoes = [self._vetoes(candidate) for candidate in candidates]
        probable = [
            0.0 if said else self._probability(candidate) for candidate, said in zip(candidates, vetoes, strict=True)
        ]
        shares = _shares(probable)
        chosen = max(range(len(candidates)), key=lambda n: shares[n])
        said = f"candidate {chosen + 1} of {len(candidates)} is right with probability {_shown(shares[chosen])}"
        rivals = [n for n in range(len(candidates)) if n != chosen and probable[n] >= self.ambiguous]
        faults = "".join(f"; by itself candidate {n + 1} would be with {_shown(probable[n])}" for n in rivals)
        faults += "".join(f"; candidate {n + 1}: {why.text}" for n, made in enumerate(vetoes) for why in made)
        if shares[chosen] >= self.provisional:
            return Decision("provisional", chosen, f"{said} ≥ {self.provisional:g}{faults}")
        if probable[chosen] >= self.ambiguous:
            return Decision("ambiguous", None, f"{said} < {self.provisional:g}{faults}")
        return Decision("unmatched", None, f"{said} < {self.ambiguous:g}{faults}")

    def _probability(self, candidate: Candidate) -> float:
        if self.metric not in candidate.measurements:
            raise PluginError(f"the metric {self.metric} was not measured: an acceptor must get what its rule names")
        value, met = candidate.measurements[self.metric].value, told_by(candidate.measurements)
        if math.isnan(value):
            return 0.0
        if not met:
            return value
        odds = value / max(1.0 - value, _LEAST) * math.exp(met)
        return odds / (1.0 + odds)

    def _vetoes(self, candidate: Candidate) -> list[Check]:
        """The limits that a candidate breaks."""
        out = list(refutations(candidate.measurements, self.refuted))
        for name, limit in self.vetoes.items():
            if name not in candidate.measurements:
                raise PluginError(f"the metric {name} was not measured: an acceptor must get what its rule names")
            out += [check for check in limit.checks(candidate.measurements[name]) if check.passed is False]
        return out


def _shares(probable: Sequence[float]) -> list[float]:
    """The probabilities of candidates of which at most one is right, from those of each by itself."""
    odds = [p / max(1.0 - p, _LEAST) for p in probable]
    return [one / (1.0 + math.fsum(odds)) for one in odds]


def _shown(probability: float) -> str:
    """A probability with the digits in which those near 1 differ."""
    lack = 1.0 - probability
    if lack > 0.01:
        return f"{probability:.3g}"
    if lack < _LEAST_SHOWN:
        return f"over {1.0 - _LEAST_SHOWN:.9g}"
    return f"{probability:.{1 - math.floor(math.log10(lack))}f}"

"""Accepting a candidate when its numbers keep their limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mapgraft.contracts import Candidate, ConfigError, Decision, PluginError
from mapgraft_standard.limits import Bounds, Check, bounds_of, limits_of, mapping_of, number_of
from mapgraft_standard.rendezvous import REFUTED, refutations


class Thresholds:
    """Takes the first candidate that keeps every limit, unless another one does so nearly as well.

    ``score_min`` bounds the matcher's score, ``evidence`` named numbers of the matcher (``{name: {min, max}}``) and
    ``metrics`` the measurements: ``{name: {min, max, support_min, details: {name: {min, max}}}}``, where a metric
    without min and max must keep the limit that it names itself (the detail ``limit``). A metric that cannot be
    measured is a limit that is not kept. So is what robots that saw each other say (``rendezvous``), where that speaks
    clearly against a candidate. When a second candidate keeps every limit too and the margin of the first is
    below ``margin_min``, the verdict is ``ambiguous``.
    """

    def __init__(
        self,
        *,
        score_min: float | None = None,
        margin_min: float = 0.0,
        evidence: Mapping[str, Any] | None = None,
        metrics: Mapping[str, Any] | None = None,
    ) -> None:
        where = "acceptor thresholds"
        self.score = Bounds(min=None if score_min is None else number_of(score_min, f"{where}, score_min"))
        self.margin_min = number_of(margin_min, f"{where}, margin_min")
        if self.margin_min < 0.0:
            raise ConfigError(f"{where} needs margin_min >= 0, found {self.margin_min:g}")
        self.evidence = {
            name: bounds_of(mapping_of(options, f"{where}, {name}"), f"{where}, {name}")
            for name, options in (evidence or {}).items()
        }
        self.limits = limits_of(metrics or {}, where)

    def accept(self, candidates: Sequence[Candidate]) -> Decision:
        """Provisional, ambiguous or unmatched, with the numbers and limits that made it so."""
        if not candidates:
            return Decision("unmatched", None, "the matcher found no hypothesis")
        checks = [self._checks(candidate) for candidate in candidates]
        passing = [index for index, made in enumerate(checks) if all(check.passed for check in made)]
        if not passing:
            faults = [
                f"candidate {n}: {', '.join(c.text for c in made if not c.passed)}" for n, made in enumerate(checks, 1)
            ]
            return Decision("unmatched", None, f"none of {len(candidates)} keeps the limits; " + "; ".join(faults))
        chosen = passing[0]
        said = ", ".join(check.text for check in checks[chosen]) or "no limit was set"
        match = candidates[chosen].match
        rival = self._rival(candidates, passing)
        if rival is not None:
            reason = (
                f"candidates {chosen + 1} and {rival + 1} both keep the limits and the margin {match.margin:.4g} < "
                f"{self.margin_min:.4g} (scores {match.score:.4g} and {candidates[rival].match.score:.4g}); {said}"
            )
            return Decision("ambiguous", None, reason)
        margin = f"margin {match.margin:.4g}" + (f" ≥ {self.margin_min:.4g}" if match.margin >= self.margin_min else "")
        return Decision("provisional", chosen, f"candidate {chosen + 1} of {len(candidates)}: {said}, {margin}")

    def _rival(self, candidates: Sequence[Candidate], passing: list[int]) -> int | None:
        """Another passing candidate that the chosen one does not beat by the margin."""
        match = candidates[passing[0]].match
        if match.margin >= self.margin_min:
            return None
        near = [n for n in passing[1:] if candidates[n].match.score > match.score - self.margin_min]
        return near[0] if near else None

    def _checks(self, candidate: Candidate) -> list[Check]:
        match = candidate.match
        checks = [self.score.check("score", match.score), *refutations(candidate.measurements, REFUTED)]
        for name, bounds in self.evidence.items():
            if name not in match.evidence:
                found = ", ".join(match.evidence) or "nothing"
                raise ConfigError(f"the matcher gives no evidence {name!r}, it gives {found}: correct the rule")
            checks.append(bounds.check(name, match.evidence[name]))
        for name, limit in self.limits.items():
            if name not in candidate.measurements:
                raise PluginError(f"the metric {name} was not measured: an acceptor must get what its rule names")
            checks += limit.checks(candidate.measurements[name])
        return checks

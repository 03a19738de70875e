"""Judging a merge by limits on its measurements while mapping goes on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mapgraft.contracts import ConfigError, PluginError, Sample, Verdict
from mapgraft_standard.limits import Check, Limit, limits_of, mapping_of, number_of
from mapgraft_standard.rendezvous import NAME, REFUTED, refutations

REVERSALS = ("ledger", "multi_map", "single_map")
_OVERRIDES = ("metrics", "patience", "confirm_after", "new_support")


@dataclass(frozen=True, slots=True)
class Demands:
    """What is demanded under one reversal. ``limits`` None means: of every metric that names its own limit."""

    limits: Mapping[str, Limit] | None
    patience: int
    confirm_after: int | None
    new_support: float

    def limits_for(self, sample: Sample) -> Mapping[str, Limit]:
        if self.limits is not None:
            return self.limits
        found = {name: Limit() for name, m in sample.measurements.items() if "limit" in m.details}
        if not found:
            raise ConfigError("no measured metric names a limit of its own: give the verifier limits under `metrics`")
        return found


class Thresholds:
    """Reverts a merge that keeps breaking a limit, confirms one that keeps them all on new evidence.

    ``metrics`` is ``{name: {min, max, support_min, details: {name: {min, max}}}}``; a metric without min and max must
    keep the limit that it names itself (the detail ``limit``), and without ``metrics`` all that name one are judged.
    A merge is reverted when one metric breaks its limit in ``patience`` consecutive samples in which it could be
    measured, and confirmed when, ``confirm_after`` observations after the merge or later, every metric kept its limit
    in the last ``patience`` samples and its support has grown by the share ``new_support`` since the merge, because
    what the transform was chosen on cannot test it; with ``confirm_after`` null it is never confirmed. A metric that
    cannot be measured never confirms nor reverts. What robots that saw each other say (``rendezvous``) reverts by
    itself where it speaks clearly against the merge.
    ``reversals`` replaces any of these under a reversal, metric by metric, because a merged map agrees with a donor
    that it contains: ``{single_map: {metrics: {similarity: {min: 0.95}}, confirm_after: null}}``.
    """

    def __init__(
        self,
        *,
        metrics: Mapping[str, Any] | None = None,
        patience: int = 3,
        confirm_after: int | None = 50,
        new_support: float = 0.1,
        reversals: Mapping[str, Mapping[str, Any]] | None = None,
    ) -> None:
        common = {
            "metrics": metrics,
            "patience": patience,
            "confirm_after": confirm_after,
            "new_support": new_support,
        }
        special = mapping_of(reversals or {}, "verifier thresholds, reversals")
        if unknown := sorted(set(special) - set(REVERSALS)):
            raise ConfigError(f"verifier thresholds knows the reversals {', '.join(REVERSALS)}, found {unknown}")
        self.demands = {name: _demands(common, special.get(name, {}), name) for name in REVERSALS}

    def verify(self, history: Sequence[Sample], reversal: str) -> Verdict:
        """Keep, confirm or revert, with the numbers and limits that made it so."""
        if not history:
            return Verdict("keep", "nothing has been measured yet")
        if reversal not in self.demands:
            raise PluginError(f"verifier thresholds knows the reversals {', '.join(REVERSALS)}, found {reversal!r}")
        demands = self.demands[reversal]
        limits = demands.limits_for(history[-1])
        evidence = _evidence(history[-1], limits, demands.confirm_after is not None)
        if refuted := [check.text for check in refutations(history[-1].measurements, REFUTED)]:
            return Verdict(
                "revert",
                f"{refuted[0]}: the robots saw each other elsewhere",
                {**evidence, f"{NAME}.revert_at": REFUTED},
            )
        standing = []
        for name, limit in limits.items():
            streak = _streak(history, name, limit)
            latest = _check(history[-1], name, limit)
            if latest.passed is False and streak >= demands.patience:
                samples = f"{streak} sample{'s' * (streak != 1)} in a row"
                suffice = f"{demands.patience} suffice{'s' * (demands.patience == 1)}"
                return Verdict("revert", f"{latest.text}, in {samples} ({suffice})", evidence)
            standing.append(latest.text + (f" ({streak} of {demands.patience} in a row)" if streak else ""))
        missing = _missing(history, limits, demands)
        said = ", ".join(standing)
        if missing:
            return Verdict("keep", f"{said}; not confirmed: {', '.join(missing)}", evidence)
        grown = ", ".join(f"{name} +{100 * _growth(history, name):.0f} %" for name in limits)
        seen = history[-1].observations
        since = f"{seen} observation{'s' * (seen != 1)} since the merge"
        return Verdict("confirm", f"{said}; {since}, support: {grown}", evidence)


def _demands(common: Mapping[str, Any], special: Mapping[str, Any], reversal: str) -> Demands:
    where = f"verifier thresholds, {reversal}"
    if unknown := sorted(set(mapping_of(special, where)) - set(_OVERRIDES)):
        raise ConfigError(f"{where} may replace {', '.join(_OVERRIDES)}, found {', '.join(unknown)}")
    chosen = {**common, **special}
    metrics = {**(common["metrics"] or {}), **mapping_of(special.get("metrics") or {}, where)}
    patience, new_support = (number_of(chosen[name], f"{where}, {name}") for name in ("patience", "new_support"))
    after = chosen["confirm_after"]
    confirm_after = None if after is None else int(number_of(after, f"{where}, confirm_after"))
    if patience < 1 or new_support < 0.0 or (confirm_after is not None and confirm_after < 0):
        raise ConfigError(
            f"{where} needs patience >= 1, confirm_after >= 0 or null, and new_support >= 0, "
            f"found patience={patience:g}, confirm_after={after}, new_support={new_support:g}"
        )
    return Demands(limits_of(metrics, where) if metrics else None, int(patience), confirm_after, new_support)


def _evidence(sample: Sample, limits: Mapping[str, Limit], confirms: bool) -> dict[str, float]:
    """The limits in force: at one and the same value a metric begins to speak for reverting and ceases to for
    confirming."""
    out: dict[str, float] = {}
    for limit, measurement in ((limit, sample.measurements.get(name)) for name, limit in limits.items()):
        for subject, bounds in limit.told(measurement) if measurement else ():
            sides = {side: at for side, at in (("min", bounds.min), ("max", bounds.max)) if at is not None}
            for side, at in sides.items():
                suffix = f".{side}" if len(sides) == 2 else ""
                out[f"{subject}.revert_at{suffix}"] = at
                if confirms:
                    out[f"{subject}.confirm_at{suffix}"] = at
    return out


def _check(sample: Sample, name: str, limit: Limit) -> Check:
    if name not in sample.measurements:
        raise PluginError(f"the metric {name} was not measured: a verifier must get what its rule names")
    return limit.check(sample.measurements[name])


def _streak(history: Sequence[Sample], name: str, limit: Limit) -> int:
    """How often in a row, up to now, the metric broke its limit; samples without a measurement are skipped."""
    count = 0
    for sample in reversed(history):
        passed = _check(sample, name, limit).passed
        if passed:
            break
        count += passed is False
    return count


def _missing(history: Sequence[Sample], limits: Mapping[str, Limit], demands: Demands) -> list[str]:
    """What a confirmation still lacks."""
    lacks = []
    now = history[-1].observations
    if demands.confirm_after is None:
        return ["the rule never confirms what it sees here"]
    if now < demands.confirm_after:
        lacks.append(f"{now} of {demands.confirm_after} observation{'s' * (demands.confirm_after != 1)}")
    recent = history[-demands.patience :]
    for name, limit in limits.items():
        if len(recent) < demands.patience or not all(_check(sample, name, limit).passed for sample in recent):
            lacks.append(
                f"{name} has not kept its limit in {demands.patience} sample{'s' * (demands.patience != 1)} in a row"
            )
        growth = _growth(history, name)
        if growth < demands.new_support:
            lacks.append(f"support of {name} grew by {100 * growth:.0f} of {100 * demands.new_support:.0f} %")
    return lacks


def _growth(history: Sequence[Sample], name: str) -> float:
    """By what share the support of a metric has grown since the merge."""
    first, last = (sample.measurements[name].support for sample in (history[0], history[-1]))
    return last / max(first, 1) - 1.0

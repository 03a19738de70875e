"""Limits on numbers, as rules write them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from mapgraft.contracts import ConfigError, Measurement

OWN_LIMIT = "limit"  # the detail in which a metric tells the limit it would set itself


@dataclass(frozen=True, slots=True)
class Bounds:
    """A lowest and a highest value; both are included."""

    min: float | None = None
    max: float | None = None

    def check(self, name: str, value: float) -> Check:
        """How the value lies to the bounds, in words with numbers."""
        if self.min is not None and not value >= self.min:
            return Check(False, f"{name} {value:.4g} < {self.min:.4g}")
        if self.max is not None and not value <= self.max:
            return Check(False, f"{name} {value:.4g} > {self.max:.4g}")
        low = f" ≥ {self.min:.4g}" if self.min is not None else ""
        high = f" ≤ {self.max:.4g}" if self.max is not None else ""
        return Check(True, f"{name} {value:.4g}{low}{high}")


@dataclass(frozen=True, slots=True)
class Check:
    """Whether a limit is kept, and the sentence that says so. ``passed`` is None when there was nothing to judge."""

    passed: bool | None
    text: str


@dataclass(frozen=True, slots=True)
class Limit:
    """What a rule demands of one metric.

    Without ``min`` and ``max`` the limit is the one that the metric names itself, in the detail ``limit``.
    Below ``support_min`` the measurement says nothing, ``details`` bounds further named values of it.
    """

    bounds: Bounds | None = None
    support_min: int = 0
    details: Mapping[str, Bounds] = field(default_factory=dict)

    def checks(self, measurement: Measurement) -> Iterator[Check]:
        """One check for the value, and one for every further demand; ConfigError when there is no limit at all."""
        name = measurement.name
        if not measurement.sufficient:
            yield Check(None, f"{name} cannot be measured with a support of {measurement.support}")
            return
        if measurement.support < self.support_min:
            yield Check(None, f"{name} rests on a support of {measurement.support} < {self.support_min}")
            return
        yield self._bounds(measurement).check(name, measurement.value)
        for detail, bounds in self.details.items():
            yield bounds.check(f"{detail} of {name}", measurement.details.get(detail, math.nan))

    def told(self, measurement: Measurement) -> Iterator[tuple[str, Bounds]]:
        """What is bounded, the metric as ``<metric>`` and its details as ``<metric>.<detail>``, and how."""
        if self.bounds is not None or OWN_LIMIT in measurement.details:
            yield measurement.name, self._bounds(measurement)
        for detail, bounds in self.details.items():
            yield f"{measurement.name}.{detail}", bounds

    def check(self, measurement: Measurement) -> Check:
        """All checks as one: passed when all are, otherwise the first that is not."""
        checks = list(self.checks(measurement))
        failed = [check for check in checks if not check.passed]
        return failed[0] if failed else Check(True, ", ".join(check.text for check in checks))

    def _bounds(self, measurement: Measurement) -> Bounds:
        if self.bounds is not None:
            return self.bounds
        own = measurement.details.get(OWN_LIMIT)
        if own is None:
            raise ConfigError(
                f"the metric {measurement.name} names no limit of its own: give the rule a min or a max for it"
            )
        return Bounds(min=own) if measurement.better == "higher" else Bounds(max=own)


def limit_of(options: Mapping[str, Any], where: str) -> Limit:
    """A limit from ``{min, max, support_min, details: {name: {min, max}}}``; ConfigError when it is not that."""
    unknown = set(options) - {"min", "max", "support_min", "details"}
    if unknown:
        raise ConfigError(f"{where} takes min, max, support_min and details, found {', '.join(sorted(unknown))}")
    bounds = bounds_of({key: options[key] for key in ("min", "max") if key in options}, where)
    details = mapping_of(options.get("details", {}), f"{where}, details")
    return Limit(
        bounds=None if bounds == Bounds() else bounds,
        support_min=int(number_of(options.get("support_min", 0), f"{where}, support_min")),
        details={name: bounds_of(mapping_of(d, f"{where}, {name}"), f"{where}, {name}") for name, d in details.items()},
    )


def limits_of(metrics: Mapping[str, Any], where: str) -> dict[str, Limit]:
    """A limit for every metric; an empty or missing mapping means the metric's own limit."""
    return {
        name: limit_of(mapping_of(options or {}, f"{where}, {name}"), f"{where}, {name}")
        for name, options in metrics.items()
    }


def bounds_of(options: Mapping[str, Any], where: str) -> Bounds:
    unknown = set(options) - {"min", "max"}
    if unknown:
        raise ConfigError(f"{where} takes min and max, found {', '.join(sorted(unknown))}")
    low, high = (
        None if options.get(key) is None else number_of(options[key], f"{where}, {key}") for key in ("min", "max")
    )
    if low is not None and high is not None and low > high:
        raise ConfigError(f"{where} has min {low:g} above max {high:g}: no value can pass")
    return Bounds(low, high)


def mapping_of(value: object, where: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise ConfigError(f"{where} must be a mapping, found {value!r}")
    return value


def number_of(value: object, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or math.isnan(value):
        raise ConfigError(f"{where} must be a number, found {value!r}")
    return float(value)

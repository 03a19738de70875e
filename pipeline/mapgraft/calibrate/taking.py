"""What the rules that come of a calibration merge: first hypotheses above a threshold that no veto stops."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from mapgraft.calibrate.acceptance import Threshold
from mapgraft.calibrate.groups import Group
from mapgraft.calibrate.labelled import Labelled
from mapgraft.calibrate.scoring import Score
from mapgraft.decision import Rule

_KEEPING: Final = ("posterior", "calibrated")  # acceptors whose limits on metrics stay as vetoes


@dataclass(frozen=True, slots=True)
class Veto:
    """The lowest and highest number that a rule takes; what cannot be measured breaks none."""

    number: str
    low: float
    high: float

    def stops(self, numbers: Mapping[str, float]) -> bool:
        value = numbers.get(self.number, math.nan)
        return value < self.low or value > self.high


@dataclass(frozen=True, slots=True, eq=False)
class Taking:
    """Score, thresholds by group, and vetoes: calling it with an example says whether it would be merged."""

    score: Score
    limits: Mapping[Group, Threshold]
    vetoes: tuple[Veto, ...] = ()

    def __call__(self, example: Labelled) -> bool:
        if not self.limits[example.group].passes(self.score.of(example.numbers)):
            return False
        return not any(veto.stops(example.numbers) for veto in self.vetoes)


def vetoes_of(rule: Rule) -> tuple[Veto, ...]:
    """The limits on metrics that a calibrated rule keeps.

    One that counts from a certain support on only is left out: examples do not tell the support, and a veto less makes
    no promise wrong.
    """
    accept = rule.accept
    if accept is None or accept.use not in _KEEPING or not isinstance(accept.metrics, dict):
        return ()
    return tuple(veto for name, limits in accept.metrics.items() for veto in _of_metric(name, limits or {}))


def _of_metric(name: str, limits: Mapping[str, Any]) -> Iterator[Veto]:
    if limits.get("support_min"):
        return
    for number, bounds in ((name, limits), *((f"{name}.{k}", v) for k, v in limits.get("details", {}).items())):
        low, high = bounds.get("min"), bounds.get("max")
        if low is not None or high is not None:
            yield Veto(number, -math.inf if low is None else float(low), math.inf if high is None else float(high))

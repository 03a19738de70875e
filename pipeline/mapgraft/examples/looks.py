"""What verification measured of one merge over time, as much of it as an example keeps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from mapgraft.contracts import Measurement, Sample, Verdict
from mapgraft.outputs.tables import Row

MOST: Final = 256  # looks of one merge; with twice as many every second one goes
VERIFIER: Final = "verifier."  # before the names of what the verifier made of it


class _Look(NamedTuple):
    """What was new when a merge was looked at: name → value and support. Those that ``turned`` the verdict stay."""

    stamp_ns: int
    observations: int
    numbers: Mapping[str, tuple[float, int]]
    turned: bool


@dataclass(slots=True)
class Looks:
    """The looks at one merge, in order.

    Of more than ``2 * MOST`` every second one goes. The first and the last stay, those that turned the verdict, and
    those at which a metric, or a number of the verifier, was the lowest or the highest since the merge: limits are set
    by these. What was new at a look that goes is told at the next one, so that what was known at any other stays right.
    """

    _looks: list[_Look] = field(default_factory=list)
    _measured: dict[str, Measurement] = field(default_factory=dict)
    _latest: dict[str, float] = field(default_factory=dict)
    _action: str = ""

    def add(self, sample: Sample, verdict: Verdict | None) -> None:
        """Take what has been measured anew, and what the verifier made of it."""
        numbers: dict[str, tuple[float, int]] = {}
        for name, measurement in sample.measurements.items():
            if self._measured.get(name) is measurement:  # it was not asked again
                continue
            self._measured[name] = measurement
            numbers[name] = float(measurement.value), measurement.support
            numbers |= {f"{name}.{detail}": (float(value), 0) for detail, value in measurement.details.items()}
        said = {} if verdict is None else {f"{VERIFIER}{n}": float(value) for n, value in verdict.evidence.items()}
        numbers |= {name: (value, 0) for name, value in said.items() if self._latest.get(name) != value}
        turned = verdict is not None and verdict.action != self._action
        if verdict is not None:
            self._action = verdict.action
        if not numbers:
            return
        self._latest |= {name: value for name, (value, _) in numbers.items()}
        self._looks.append(_Look(sample.stamp_ns, sample.observations, numbers, turned))
        if len(self._looks) > 2 * MOST:
            self._thin()

    def _thin(self) -> None:
        stay = {0, len(self._looks) - 1, *self._extremes()}
        kept: list[_Look] = []
        gone: Mapping[str, tuple[float, int]] = {}
        for place, look in enumerate(self._looks):
            numbers = {**gone, **look.numbers}
            if place % 2 == 0 or look.turned or place in stay:
                kept.append(look._replace(numbers=numbers))
                gone = {}
            else:
                gone = numbers
        self._looks = kept

    def _extremes(self) -> set[int]:
        """Where each metric, and each number of the verifier, was first the lowest and the highest since the merge."""
        low: dict[str, tuple[float, int]] = {}
        high: dict[str, tuple[float, int]] = {}
        for place, look in enumerate(self._looks[1:], 1):
            for name, (value, _) in look.numbers.items():
                if "." in name.removeprefix(VERIFIER) or math.isnan(value):  # details are many, and judge nothing
                    continue
                if name not in low or value < low[name][0]:
                    low[name] = value, place
                if name not in high or value > high[name][0]:
                    high[name] = value, place
        return {place for _, place in (*low.values(), *high.values())}

    def columns(self) -> Row:
        """The columns ``history`` and ``later``."""
        rows = [
            {"stamp": look.stamp_ns, "observations": look.observations, "metric": name, "value": value, "support": n}
            for look in self._looks
            for name, (value, n) in look.numbers.items()
        ]
        return {"history": rows, "later": dict(self._latest)}

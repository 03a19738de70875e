"""What verification measured of one merge over time, as much of it as an example keeps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from mapgraft.contracts import Measurement, Sample, Verdict
from mapgraft.outputs.tables import Row

MOST: Final = 256  # looks of one merge; with twice as many every second one goes


class _Look(NamedTuple):
    """What was new when a merge was looked at: name → value and support. Those that ``turned`` the verdict stay."""

    stamp_ns: int
    observations: int
    numbers: Mapping[str, tuple[float, int]]
    turned: bool


@dataclass(slots=True)
class Looks:
    """The looks at one merge, in order."""

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
        said = {} if verdict is None else {f"verifier.{name}": float(value) for name, value in verdict.evidence.items()}
        numbers |= {name: (value, 0) for name, value in said.items() if self._latest.get(name) != value}
        turned = verdict is not None and verdict.action != self._action
        if verdict is not None:
            self._action = verdict.action
        if not numbers:
            return
        self._latest |= {name: value for name, (value, _) in numbers.items()}
        self._looks.append(_Look(sample.stamp_ns, sample.observations, numbers, turned))
        if len(self._looks) > 2 * MOST:
            first, *rest, last = self._looks
            self._looks = [first, *(look for n, look in enumerate(rest) if n % 2 or look.turned), last]

    def columns(self) -> Row:
        """The columns ``history`` and ``later``."""
        rows = [
            {"stamp": look.stamp_ns, "observations": look.observations, "metric": name, "value": value, "support": n}
            for look in self._looks
            for name, (value, n) in look.numbers.items()
        ]
        return {"history": rows, "later": dict(self._latest)}

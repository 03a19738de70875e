"""Scales of drawings: where a value lies, and which values to write beside it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mapgraft.outputs.report.words import number

_STEPS = (1.0, 2.0, 5.0, 10.0)


@dataclass(frozen=True, slots=True)
class Axis:
    """Maps values from ``low`` to ``high`` to drawing units from ``start`` to ``end``."""

    low: float
    high: float
    start: float
    end: float

    @classmethod
    def over(cls, values: list[float], start: float, end: float) -> Axis:
        """An axis that holds all values, with some room at both ends where they do not differ."""
        low, high = min(values), max(values)
        if high - low < 1e-9 * max(abs(high), 1.0):
            room = 0.5 * max(abs(high), 1.0) if high else 0.5
            low, high = low - room, high + room
        return cls(low, high, start, end)

    def at(self, value: float) -> float:
        share = (value - self.low) / (self.high - self.low)
        return round(self.start + share * (self.end - self.start), 1)

    def ticks(self, most: int) -> list[tuple[float, str]]:
        """Round values on the axis, at most so many, with what to write there."""
        rough = (self.high - self.low) / most
        power = 10.0 ** math.floor(math.log10(rough))
        step = next(s * power for s in _STEPS if s * power >= rough * (1.0 - 1e-9))
        first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
        values = [n * step for n in range(first, last + 1)]
        return [(self.at(value), number(float(f"{value:.10g}"))) for value in values]

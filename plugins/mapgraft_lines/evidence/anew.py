"""The tracker of metrics that look at both maps as they are, whatever has happened since."""

from __future__ import annotations

from collections.abc import Callable

from mapgraft.contracts import Comparison, Measurement, Step


class Anew:
    """Measures anew whenever it is asked; what costs much is kept with the map (``standing``)."""

    __slots__ = ("_comparison", "_measure")

    def __init__(self, comparison: Comparison, measure: Callable[[Comparison], Measurement]) -> None:
        self._comparison = comparison
        self._measure = measure

    def update(self, step: Step) -> Measurement:
        return self._measure(self._comparison)

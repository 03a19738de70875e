"""Observations that did not enter a robot's map."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from mapgraft.contracts import Observation

ALIKE: Final = 40  # characters: sentences that begin alike tell one reason, with other numbers


@dataclass(slots=True)
class LeftOut:
    """Observations that a robot's map type refused: how many, and the first one's stamp and sentence per reason."""

    count: int = 0
    reasons: dict[str, tuple[int, str]] = field(default_factory=dict)  # how it begins → (count, sentence)

    def add(self, observation: Observation, why: str) -> None:
        self.count += 1
        count, first = self.reasons.get(why[:ALIKE], (0, f"the first, at {observation.stamp_ns / 1e9:.3f} s: {why}"))
        self.reasons[why[:ALIKE]] = (count + 1, first)

    def sentences(self, robot: str) -> list[str]:
        """What a person should know."""
        return [
            f"{robot}: {count} observation{'s' * (count != 1)} did not enter the map; {first}"
            for count, first in self.reasons.values()
        ]

"""What the experiment is made of, and what the paper leaves to whoever repeats it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from mapgraft.config import ReversalName
from mapgraft.errors import UsageError

STRATEGIES: Final[tuple[ReversalName, ...]] = ("single_map", "multi_map", "ledger")
SHORT: Final[dict[ReversalName, str]] = {"single_map": "1M", "multi_map": "2M", "ledger": "ledger"}  # as in the paper
MAP_TYPE: Final = "occupancy_grid"
METRICS: Final = ("similarity", "distance")
DRAWS_PER_MERGE: Final = 50  # pairs that are tried for each merge that is wanted, before the search is given up


class Combination(NamedTuple):
    """The resolutions (m) of the receiver's and the donor's map."""

    own_m: float
    other_m: float

    @property
    def name(self) -> str:
        """As the paper writes it: 0.07-0.1."""
        return f"{self.own_m:g}-{self.other_m:g}"


PAPER: Final = (Combination(0.07, 0.07), Combination(0.07, 0.1), Combination(0.1, 0.07))


@dataclass(frozen=True, slots=True)
class Settings:
    """As many ``right`` and ``wrong`` merges are sought per combination of resolutions.

    Maps are of ``scans`` scans, after which the receiver maps ``further`` ones; pairs are drawn by ``seed``.
    ``matcher`` takes the place of Carpin's. After ``draws`` pairs the search for merges of a combination is given up,
    by default after 50 for each that is wanted.
    """

    right: int = 20
    wrong: int = 20
    seed: int = 0
    matcher: str | None = None
    scans: int = 30
    further: int = 10
    draws: int | None = None
    combinations: Sequence[Combination] = PAPER

    def __post_init__(self) -> None:
        for name, least in (("right", 0), ("wrong", 0), ("seed", 0), ("scans", 1), ("further", 1)):
            if getattr(self, name) < least:
                raise UsageError(f"{name} must be at least {least}, found {getattr(self, name)}")
        if self.draws is not None and self.draws < 1:
            raise UsageError(f"draws must be at least 1, found {self.draws}")
        if self.right + self.wrong == 0:
            raise UsageError("there is nothing to do: ask for right or wrong merges, with --right or --wrong")

    @property
    def most_draws(self) -> int:
        """So many pairs are tried per combination before the search for merges is given up."""
        return self.draws or DRAWS_PER_MERGE * (self.right + self.wrong)

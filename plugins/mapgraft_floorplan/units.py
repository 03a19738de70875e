"""How long the units of drawings are."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from mapgraft.contracts import ConfigError

PAPER_M: Final = 3.0  # a drawing no larger shows a building on paper: its scale is that of the print
LARGEST_M: Final = 5_000.0


def told_unit(unit_m: float | None, name: str) -> float | None:
    """What a person told; raises ConfigError when it is no length."""
    if unit_m is None:
        return None
    if isinstance(unit_m, bool) or not isinstance(unit_m, int | float) or not (math.isfinite(unit_m) and unit_m > 0):
        raise ConfigError(
            f"unit_m of {name}, the length of one unit of the drawing, must be above 0 m, found {unit_m!r}"
        )
    return float(unit_m)


def believable(unit_m: float, extent: float, name: str, warn: Callable[[str], None] | None) -> float | None:
    """The unit that a file tells, or None where the drawing would be as small as a sheet of paper.

    ``extent`` is the longer side of the walls' rectangle in units.
    """
    across_m = unit_m * extent
    if across_m < PAPER_M:
        if warn:
            warn(
                f"{name} says that its walls are {across_m:.3g} m across, which is the size of paper: its scale is "
                "taken as unknown; tell the length of one unit with the option unit_m"
            )
        return None
    if across_m > LARGEST_M and warn:
        warn(f"{name} says that its walls are {across_m:.3g} m across: is its unit right? The option unit_m tells it")
    return unit_m

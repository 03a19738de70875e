"""Checks of what configurations say."""

from __future__ import annotations

import math

from mapgraft.contracts import ConfigError
from mapgraft_lines.kernels.keys import STEPS_PER_M
from mapgraft_lines.layer import NAME

FINEST_CELL_M = 0.0625
COARSEST_CELL_M = 4.0


def within(name: str, value: float, low: float, high: float) -> float:
    """The number; raises ConfigError unless it lies in [low, high]."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise ConfigError(f"{NAME} needs {name} from {low:g} to {high:g}, found {value!r}")
    return float(value)


def whole(name: str, value: int, low: int, high: int) -> int:
    """The whole number; raises ConfigError unless it is one in [low, high]."""
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise ConfigError(f"{NAME} needs {name} as a whole number from {low} to {high}, found {value!r}")
    return value


def cell(value: float) -> float:
    """The size of the cells; raises ConfigError unless it is a whole number of steps of 1/1024 m."""
    size = within("cell_m", value, FINEST_CELL_M, COARSEST_CELL_M)
    if not math.isclose(size * STEPS_PER_M, round(size * STEPS_PER_M), rel_tol=0.0, abs_tol=1e-9):
        raise ConfigError(f"{NAME} needs cell_m in steps of 1/{STEPS_PER_M} m, such as 0.25, found {value!r}")
    return size

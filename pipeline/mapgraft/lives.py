"""The names of robots that begin again: what a map frame's life is called after the first one."""

from __future__ import annotations

from typing import Final

MARK: Final = "~"


def life_name(name: str, life: int) -> str:
    """The first life has the robot's own name, the second is called ``name~2``."""
    return name if life == 1 else f"{name}{MARK}{life}"


def base_name(name: str) -> str:
    """A robot's own name, whichever of its lives is named, and also where it is not the only one of its name."""
    return name.partition(MARK)[0]

"""Names that other systems accept: robots as ROS topics and frames, and as file names."""

from __future__ import annotations

import re
from collections.abc import Callable

RESERVED = ("merge", "tf", "tf_static", "rosout", "world")  # our own topics and our root frame


class Names:
    """Robot → its name elsewhere. Injective: robots that would get one name are numbered in order of appearance.

    ``clean`` turns a robot's name into one that is allowed; ``taken`` names nobody gets.
    """

    def __init__(self, clean: Callable[[str], str], taken: tuple[str, ...] = ()) -> None:
        self._clean = clean
        self._taken = set(taken)
        self._given: dict[str, str] = {}

    def __getitem__(self, robot: str) -> str:
        given = self._given.get(robot)
        return given if given is not None else self._give(robot)

    def _give(self, robot: str) -> str:
        wanted = self._clean(robot)
        name, n = wanted, 2
        while name in self._taken:
            name, n = f"{wanted}_{n}", n + 1
        self._taken.add(name)
        self._given[robot] = name
        return name

    @property
    def given(self) -> dict[str, str]:
        """Robot → name, in order of appearance."""
        return dict(self._given)


def ros_names() -> Names:
    """Names for topics and frames: ASCII letters, digits and single underscores, not beginning with a digit."""
    return Names(_ros_token, RESERVED)


def file_names() -> Names:
    """Names for files: as the robot is called, with '_' for what a file name cannot hold."""
    return Names(_file_token)


def _ros_token(robot: str) -> str:
    token = re.sub(r"_+", "_", re.sub(r"[^A-Za-z0-9]", "_", robot)).strip("_") or "robot"
    return f"robot_{token}" if token[0].isdigit() else token


def _file_token(robot: str) -> str:
    token = re.sub(r"[^\w@.-]", "_", robot) or "robot"
    return token if token.strip(".") and token[0] not in ".-" else f"robot_{token}"

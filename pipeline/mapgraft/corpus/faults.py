"""Faults that are found one after another, and told together."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from mapgraft.errors import ConfigError, MapgraftError

_NAMED = 3  # of many that share a fault; the others are counted


def combination(config: str, mission: str) -> str:
    """What a configuration with all that a mission lays over it is called."""
    return f"the configuration {config} of the mission {mission}"


class Faults:
    """What is wrong with a corpus, in the order in which it was found; what is wrong in many places is told once."""

    def __init__(self) -> None:
        self._errors: list[MapgraftError] = []
        self._kinds: set[type[MapgraftError]] = set()
        self._combined: dict[str, dict[str, list[str]]] = {}  # missions by configuration, by what is wrong

    @property
    def found(self) -> bool:
        return bool(self._kinds)

    @contextmanager
    def noted(self) -> Iterator[None]:
        """What is raised inside is told later."""
        try:
            yield
        except MapgraftError as error:
            self._errors.append(error)
            self._kinds.add(type(error))

    @contextmanager
    def noted_of(self, config: str, mission: str) -> Iterator[None]:
        """As ``noted``, for what is wrong with a combination, under whose name ``parse_config`` lists its faults."""
        try:
            yield
        except MapgraftError as error:
            head, *listed = str(error).split("\n  ")
            under_name = bool(listed) and head.startswith(combination(config, mission))
            for wrong in listed if under_name else [str(error)]:
                self._combined.setdefault(wrong, {}).setdefault(config, []).append(mission)
            self._kinds.add(type(error))

    def tell(self) -> None:
        """Raise what was noted, if anything.

        One error is raised as it is; several are one with all their sentences, of their kind, or ConfigError where they
        are of several.
        """
        if len(self._errors) == 1 and not self._combined:
            raise self._errors[0]
        sentences = dict.fromkeys([*map(str, self._errors), *self._of_combinations()])
        if sentences:
            kind = next(iter(self._kinds)) if len(self._kinds) == 1 else ConfigError
            raise kind("\n".join(sentences))

    def _of_combinations(self) -> Iterator[str]:
        for wrong, missions_of in self._combined.items():
            configs_of: dict[tuple[str, ...], list[str]] = {}
            for config, missions in missions_of.items():
                configs_of.setdefault(tuple(missions), []).append(config)
            for sharing, configs in configs_of.items():
                yield f"the {_listed('configuration', configs)} of the {_listed('mission', sharing)}: {wrong}"


def _listed(noun: str, names: Sequence[str]) -> str:
    if len(names) == 1:
        return f"{noun} {names[0]}"
    more = len(names) - _NAMED
    return f"{noun}s {', '.join(names[:_NAMED])}" + (f" and {more} more" if more > 0 else "")

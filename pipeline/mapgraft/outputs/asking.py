"""Map types as the outputs ask them: in their time, and by their name where they fail."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

from mapgraft.contracts import MapType
from mapgraft.errors import FailedPluginError, PluginError
from mapgraft.guard import Guard

T = TypeVar("T")


@dataclass(slots=True)
class Asking:
    """Calls map types for messages and files. Only the call itself is watched: what writing takes is not its time."""

    guard: Guard = field(default_factory=Guard)
    _hung: dict[str, str] = field(default_factory=dict)  # map type → what is said of it

    def ask(self, robot: str, map_type: MapType, call: Callable[[], T]) -> T:
        """What ``call`` gives, which asks this map type for something about a robot's map.

        Raises MapError where the type refuses, and PluginError, which names it, where it fails or takes too long; one
        that took too long is not asked again. A failure waits in the guard until somebody makes an event of it.
        """
        if said := self._hung.get(map_type.name):
            raise PluginError(said)
        try:
            with self.guard.calling("map type", map_type.name):
                return call()
        except FailedPluginError as error:
            if error.took_too_long:
                self._hung[map_type.name] = f"{error}; it took so long before and is not asked again"
            self.guard.untold.append((robot, error))
            raise

"""When robots exchange their maps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol, runtime_checkable

from mapgraft.contracts.geometry import Transform


class Meeting(NamedTuple):
    """One exchange. ``pairs`` holds (receiver, donor); None means that everybody hears everybody."""

    stamp_ns: int
    pairs: tuple[tuple[str, str], ...] | None = None


class Signal(NamedTuple):
    """A message on a topic of the recording, by the mission's clock; ``text`` where it is a string, else empty."""

    topic: str
    stamp_ns: int
    text: str


@dataclass(frozen=True, slots=True)
class Situation:
    """What a policy may look at: the time since it was last asked, and where the robots are.

    ``start_ns`` is the mission's first stamp; the policy answers for (``previous_ns``, ``now_ns``]. ``T_map_base`` is
    each robot's last pose in its own map frame, ``T_world_map`` where the recording itself places that frame in one
    world, for robots of which it does. ``ending`` is True once, after the last observation. ``T_receiver_donor`` is
    where robots have merged others' maps, by (receiver, donor).
    """

    start_ns: int
    previous_ns: int
    now_ns: int
    T_map_base: Mapping[str, Transform] = field(default_factory=dict)
    T_world_map: Mapping[str, Transform] = field(default_factory=dict)
    ending: bool = False
    T_receiver_donor: Mapping[tuple[str, str], Transform] = field(default_factory=dict)


class Policy(Protocol):
    def due(self, situation: Situation) -> Sequence[Meeting]:
        """The exchanges that fall into the situation's time, in time order."""
        ...


@runtime_checkable
class ListeningPolicy(Policy, Protocol):
    """A policy that goes by topics of the recording."""

    @property
    def topics(self) -> Sequence[str]: ...
    def hear(self, signals: Sequence[Signal]) -> None:
        """All messages on its topics, in time order, told once before it is asked for meetings."""
        ...

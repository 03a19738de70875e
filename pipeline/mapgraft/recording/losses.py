"""What of a mission's recordings could not be used, counted by file or robot, topic and cause."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mapgraft.contracts.sources import Fault

if TYPE_CHECKING:
    from mapgraft.recording.mission import Mission


@dataclass(frozen=True, slots=True)
class Loss:
    """Something lost or odd: ``where`` is the name of a file or of a robot, ``topic`` is empty for a file as a whole.

    ``cause`` is a short word for machines, ``sentence`` tells a person what the first of ``count`` was.
    """

    where: str
    topic: str
    cause: str
    count: int
    sentence: str


def losses(mission: Mission) -> tuple[Loss, ...]:
    """What was lost so far: of the files as they were read, then of the messages that were to become observations."""
    of_files = [Loss(name, f.topic, f.cause, f.count, f.sentence) for name, f in mission.faults]
    of_robots = [
        Loss(topic.robot, topic.topic, cause, dropped.count, f"at {dropped.first_ns / 1e9:.3f} s: {dropped.why}")
        for topic in mission.tally
        for cause, dropped in (*topic.dropped.items(), *topic.noticed.items())
    ]
    return (*of_files, *of_robots)


def fault_sentences(faults: Iterable[tuple[str, Fault]]) -> list[str]:
    """What was lost or odd in files, each given by its name, for a person: one sentence per file, topic and cause."""
    return [fault.text if _is_named(name, fault) else f"{name}: {fault.text}" for name, fault in faults]


def _is_named(name: str, fault: Fault) -> bool:
    """Whether the sentence names its file itself, as those about lines of a log do; a folder may be called anything."""
    return "." in name and name in fault.sentence.split()

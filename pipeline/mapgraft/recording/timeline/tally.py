"""What became of every message: read, used, left out on purpose, or dropped and why."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field


@dataclass(slots=True)
class Dropped:
    """Messages dropped or noticed for one cause: how many, the time of the first, and a clause that says why."""

    count: int
    first_ns: int
    why: str


@dataclass(slots=True)
class TopicTally:
    """One topic of one robot. ``read`` is the sum of ``used``, ``outside``, ``thinned`` and all dropped.

    ``outside`` lay before the start or after the end that was asked for, or outside the robot's window; ``thinned``
    fell to ``every``. ``sweeps_ignored`` counts used scans whose ``time_increment`` cannot be true. ``noticed`` are
    messages with something odd that was put right, whether they were used in the end or not.
    """

    robot: str
    topic: str
    kind: str
    read: int = 0
    used: int = 0
    outside: int = 0
    thinned: int = 0
    sweeps_ignored: int = 0
    dropped: dict[str, Dropped] = field(default_factory=dict)
    noticed: dict[str, Dropped] = field(default_factory=dict)

    def drop(self, cause: str, stamp_ns: int, why: str) -> None:
        """Count a dropped message; ``why`` is kept of the first one of its cause."""
        _count(self.dropped, cause, stamp_ns, why)

    def notice(self, cause: str, stamp_ns: int, why: str) -> None:
        """Count a message with something odd that was put right; ``why`` is kept of the first one of its cause."""
        _count(self.noticed, cause, stamp_ns, why)

    @property
    def wanted(self) -> int:
        """How many were to become observations: files are read a little beyond the limits and a robot's window."""
        return self.used + self.lost

    @property
    def lost(self) -> int:
        """How many were dropped, whatever the cause."""
        return sum(dropped.count for dropped in self.dropped.values())

    def sentences(self) -> Iterator[str]:
        """What a person should know about this topic."""
        noun = "maps" if self.kind == "grid_message" else f"{self.kind}s"
        for cause, dropped in self.dropped.items():
            were = "was" if dropped.count == 1 else "were"
            yield (
                f"{self.robot}: {dropped.count} of {self.wanted} {noun} on {self.topic} {were} left out ({cause}); the "
                f"first, at {dropped.first_ns / 1e9:.3f} s: {dropped.why}"
            )
        for cause, odd in self.noticed.items():
            are = "is" if odd.count == 1 else "are"
            yield (
                f"{self.robot}: {odd.count} of {self.read} {noun} on {self.topic} {are} odd ({cause}); the first, at "
                f"{odd.first_ns / 1e9:.3f} s: {odd.why}"
            )
        if self.sweeps_ignored:
            yield (
                f"{self.robot}: the time_increment of {self.sweeps_ignored} {noun} on {self.topic} cannot be true "
                "(a sweep of more than a second), so their beams are placed as if fired at once"
            )


def _count(causes: dict[str, Dropped], cause: str, stamp_ns: int, why: str) -> None:
    known = causes.get(cause)
    if known is None:
        causes[cause] = Dropped(1, stamp_ns, why)
    else:
        known.count += 1


@dataclass(slots=True)
class Tally:
    """The tallies of all topics of all robots, in the order of the robots."""

    topics: dict[tuple[str, str], TopicTally] = field(default_factory=dict)

    def of(self, robot: str, topic: str, kind: str) -> TopicTally:
        """The tally of one topic of one robot, made when it is asked for first."""
        return self.topics.setdefault((robot, topic), TopicTally(robot, topic, kind))

    def __iter__(self) -> Iterator[TopicTally]:
        return iter(self.topics.values())

    def of_robot(self, robot: str) -> tuple[int, int]:
        """How many payloads of a robot were wanted, and how many became observations."""
        topics = [topic for topic in self if topic.robot == robot]
        return sum(topic.wanted for topic in topics), sum(topic.used for topic in topics)

    def sentences(self) -> list[str]:
        """What a person should know: one sentence per robot, topic and cause."""
        return [sentence for topic in self for sentence in topic.sentences()]

"""Drawing pairs of windows: stretches of consecutive scans that two robots could have mapped."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Observation
from mapgraft.errors import UsageError
from mapgraft.evaluation.courses import Course

APART_SCANS, APART_NS = 40, 60_000_000_000  # what lies so far apart was not seen in one go
_SALT = {"within": 1, "across": 2, "turns": 3}  # so that no two streams of random numbers are the same


@dataclass(frozen=True, slots=True)
class Drawing:
    """What to draw: ``pairs`` pairs of windows of ``scans`` scans, after which ``further`` ones are mapped.

    ``across`` is the share of pairs whose windows come from two recordings, where there are several.
    """

    pairs: int = 200
    scans: int = 30
    further: int = 10
    across: float = 0.5
    seed: int = 0

    def __post_init__(self) -> None:
        for name, least in (("pairs", 1), ("scans", 1), ("further", 0), ("seed", 0)):
            if getattr(self, name) < least:
                raise UsageError(f"{name} must be at least {least}, found {getattr(self, name)}")
        if not 0.0 <= self.across <= 1.0:
            raise UsageError(f"across must be a share between 0 and 1, found {self.across:g}")

    @property
    def span(self) -> int:
        """Scans of a window together with its further ones."""
        return self.scans + self.further


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """Consecutive scans of a course from ``first`` on, and those that follow."""

    course: Course
    first: int
    scans: int
    further: int

    @property
    def observations(self) -> Sequence[Observation]:
        return self.course.observations[self.first : self.first + self.scans]

    @property
    def following(self) -> Sequence[Observation]:
        """The further scans."""
        return self.course.observations[self.first + self.scans : self.first + self.scans + self.further]

    @property
    def block(self) -> tuple[int, int]:
        """The stretch of its course in which it lies; windows of one stretch share scans."""
        span = self.scans + self.further
        return self.course.number, (self.first + span // 2) // span


@dataclass(frozen=True, slots=True, eq=False)
class PairPlan:
    """Two windows, and by how much each map frame is turned; ``across`` recordings there is nothing to find."""

    number: int
    receiver: Window
    donor: Window
    receiver_turn_rad: float
    donor_turn_rad: float

    @property
    def across(self) -> bool:
        return self.receiver.course.site != self.donor.course.site


@dataclass(frozen=True, slots=True, eq=False)
class _Choice:
    """All pairs of windows of two courses: those of a receiver's start are ``[0, left)`` and ``[right, starts)``."""

    receiver: Course
    donor: Course
    starts: int
    left: NDArray[np.int64]
    right: NDArray[np.int64]

    @property
    def counts(self) -> NDArray[np.int64]:
        return self.left + self.starts - self.right

    def at(self, number: int) -> tuple[int, int]:
        """The starts of the pair of that number."""
        ends = np.cumsum(self.counts)
        own = int(np.searchsorted(ends, number, side="right"))
        other = number - int(ends[own] - self.counts[own])
        left = int(self.left[own])
        return own, other if other < left else int(self.right[own]) + other - left


def draw_pairs(courses: Sequence[Course], drawing: Drawing) -> list[PairPlan]:
    """Draw pairs of windows at random, no two the same; the same for the same courses and drawing.

    Within a recording every two windows are as likely, if with their further scans they lie at least 40 scans or 60 s
    apart, or come from two robots whose relative pose the recording tells. Recordings take turns. Raises UsageError
    when there are not as many pairs.
    """
    usable = [course for course in courses if len(course) >= drawing.span]
    across = _groups(_across(usable, drawing)) if drawing.across > 0.0 else []
    count = round(drawing.pairs * drawing.across) if across else 0
    within = _groups(_within(usable, drawing)) if count < drawing.pairs else []
    if count < drawing.pairs and not within:
        raise _no_two_windows(courses, drawing)
    drawn = {
        "within": _drawn(within, drawing.pairs - count, drawing, "within"),
        "across": _drawn(across, count, drawing, "across"),
    }
    return [_plan(number, *next(drawn[kind]), drawing) for number, kind in enumerate(_turns(drawing.pairs, count))]


def draw_on(courses: Sequence[Course], drawing: Drawing) -> Iterator[PairPlan]:
    """The pairs within recordings that ``draw_pairs`` begins with, one after the other, until there is no other left.

    ``drawing.pairs`` and ``across`` are not looked at. Raises UsageError when no recording holds two windows.
    """
    usable = [course for course in courses if len(course) >= drawing.span]
    groups = _groups(_within(usable, drawing))
    if not groups:
        raise _no_two_windows(courses, drawing)
    streams = [_of_group(group, _pairs_of(group), drawing, "within", k) for k, group in enumerate(groups)]
    number = 0
    while streams:
        for stream in list(streams):
            if (drawn := next(stream, None)) is None:
                streams.remove(stream)
                continue
            yield _plan(number, *drawn, drawing)
            number += 1


def _no_two_windows(courses: Sequence[Course], drawing: Drawing) -> UsageError:
    longest = max(map(len, courses), default=0)
    return UsageError(
        f"no recording holds two windows: {2 * drawing.span + APART_SCANS} scans in a row would do for windows of "
        f"{drawing.scans} scans and {drawing.further} further ones, the longest has {longest}: "
        "take shorter windows with --scans and --further"
    )


def _turns(pairs: int, across: int) -> Iterator[str]:
    """Which pairs are drawn across recordings: evenly spread over all."""
    for number in range(pairs):
        yield "across" if (number + 1) * across // pairs > number * across // pairs else "within"


def _drawn(
    groups: Sequence[Sequence[_Choice]], pairs: int, drawing: Drawing, kind: str
) -> Iterator[tuple[_Choice, int, int]]:
    """That many different pairs, the groups taking turns."""
    streams = [_of_group(group, -(-(pairs - k) // len(groups)), drawing, kind, k) for k, group in enumerate(groups)]
    for number in range(pairs):
        yield next(streams[number % len(streams)])


def _pairs_of(group: Sequence[_Choice]) -> int:
    return sum(int(choice.counts.sum()) for choice in group)


def _of_group(
    group: Sequence[_Choice], pairs: int, drawing: Drawing, kind: str, number: int
) -> Iterator[tuple[_Choice, int, int]]:
    ends = np.cumsum([int(choice.counts.sum()) for choice in group])
    total = int(ends[-1])
    if total < pairs:
        names = sorted({course.recording for choice in group for course in (choice.receiver, choice.donor)})
        raise UsageError(
            f"{' and '.join(names)} hold {total} different pairs of windows, {pairs} are wanted: ask for fewer pairs"
        )
    rng = np.random.default_rng([drawing.seed, _SALT[kind], number])
    taken: set[int] = set()
    for _ in range(pairs):
        pick = int(rng.integers(total))
        while pick in taken:
            pick = (pick + 1) % total
        taken.add(pick)
        which = int(np.searchsorted(ends, pick, side="right"))
        before = int(ends[which - 1]) if which else 0
        yield group[which], *group[which].at(pick - before)


def _plan(number: int, choice: _Choice, own: int, other: int, drawing: Drawing) -> PairPlan:
    turns = np.random.default_rng([drawing.seed, _SALT["turns"], number]).uniform(-math.pi, math.pi, 2)
    return PairPlan(
        number,
        Window(choice.receiver, own, drawing.scans, drawing.further),
        Window(choice.donor, other, drawing.scans, drawing.further),
        float(turns[0]),
        float(turns[1]),
    )


def _groups(choices: Sequence[_Choice]) -> list[list[_Choice]]:
    """The choices by the recordings they are from, in order; without those that leave nothing to choose."""
    groups: dict[frozenset[tuple[str, ...]], list[_Choice]] = {}
    for choice in choices:
        if choice.counts.sum():
            groups.setdefault(frozenset((choice.receiver.site, choice.donor.site)), []).append(choice)
    return list(groups.values())


def _within(courses: Sequence[Course], drawing: Drawing) -> list[_Choice]:
    pairs = [(a, b) for a in courses for b in courses if a is not b and a.world == b.world and a.site == b.site]
    return [*(_of_one(course, drawing) for course in courses), *(_of_two(a, b, drawing) for a, b in pairs)]


def _across(courses: Sequence[Course], drawing: Drawing) -> list[_Choice]:
    return [_of_two(a, b, drawing) for a in courses for b in courses if not set(a.site) & set(b.site)]


def _of_two(a: Course, b: Course, drawing: Drawing) -> _Choice:
    starts = len(b) - drawing.span + 1
    all_of_them = np.full(len(a) - drawing.span + 1, starts, np.int64)
    return _Choice(a, b, starts, all_of_them, all_of_them)


def _of_one(course: Course, drawing: Drawing) -> _Choice:
    span = drawing.span
    starts = len(course) - span + 1
    first = np.arange(starts)
    left, right = first - span - APART_SCANS + 1, first + span + APART_SCANS
    if course.stamps_ns is not None:
        stamps = course.stamps_ns
        early = np.searchsorted(stamps, stamps[first] - APART_NS, side="right") - span + 1
        late = np.searchsorted(stamps, stamps[first + span - 1] + APART_NS, side="left")
        left = np.maximum(left, np.minimum(early, first - span + 1))
        right = np.minimum(right, np.maximum(late, first + span))
    return _Choice(course, course, starts, np.clip(left, 0, starts), np.clip(right, 0, starts))

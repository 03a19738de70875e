"""Which clock tells a robot's time."""

from __future__ import annotations

import pytest

from mapgraft.recording.poses.frames import Stamped
from mapgraft.recording.robots.clocks import clock_of, is_other_clock, offset_of

S = 10**9


def times(*pairs: tuple[float, float]) -> list[Stamped]:
    return [Stamped(round(log * S), round(stamp * S)) for log, stamp in pairs]


@pytest.mark.parametrize(
    ("given", "clock"),
    [
        (times((10, 9), (11, 10)), "header"),
        (times((10, 9)), "header"),
        (times((10, 0), (11, 0)), "log"),
        (times((10, 0)), "log"),
        (times((10, 5), (11, 5)), "log"),
        (times((10, 6), (11, 5)), "log"),
        (times((10, 5), (10, 5)), "index"),
        (times((10, 0), (9, 0)), "index"),
    ],
)
def test_the_best_clock_that_advances(given, clock):
    assert clock_of([given]) == clock
    assert clock_of([times((1, 1), (2, 2)), given]) == clock


def test_stamps_far_from_the_others_are_of_another_clock():
    assert offset_of(times((10, 9), (20, 19), (30, 25))) == -S
    assert not is_other_clock(times((10, 9.5), (20, 19.5)), -S)
    assert is_other_clock(times((10, 5010), (20, 5020)), -S)
    assert is_other_clock(times((10, 0)), 0) is False
    assert is_other_clock(times((100, 0)), 0)
    assert not is_other_clock([], 0)


def test_a_clock_that_runs_slower_is_no_other_clock():
    slow = times(*((3.0 * k, 1.0 * k) for k in range(30)))
    assert not is_other_clock(slow, 0)

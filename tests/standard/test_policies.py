"""When robots meet."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.contracts import ConfigError, Situation
from mapgraft_standard.policies import At, Every

S = 1_000_000_000


def stamps(policy, times_ns, start_ns=0):
    """All meetings when the policy is asked at these times, and at the end."""
    out, previous = [], start_ns
    for now in times_ns:
        out += [m.stamp_ns for m in policy.due(Situation(start_ns, previous, now))]
        previous = now
    out += [m.stamp_ns for m in policy.due(Situation(start_ns, previous, previous, ending=True))]
    return out


@given(times=st.lists(st.integers(0, 300 * S), min_size=1).map(sorted), start=st.integers(0, 10**18))
def test_every_meets_at_each_multiple_once_however_it_is_asked(times, start):
    asked = stamps(Every(seconds=30, at_end=False), [start + t for t in times], start)
    assert asked == [start + n * 30 * S for n in range(1, times[-1] // (30 * S) + 1)]


def test_a_hole_of_years_makes_two_meetings():
    hole = 50 * 365 * 86400
    assert stamps(Every(seconds=30, at_end=False), [40 * S, hole * S]) == [30 * S, 60 * S, hole // 30 * 30 * S]


def test_every_meets_once_more_at_the_end():
    assert stamps(Every(seconds=30), [10 * S, 70 * S]) == [30 * S, 60 * S, 70 * S]


def test_at_meets_at_the_given_seconds():
    assert stamps(At(seconds=[20, 5]), [6 * S, 19 * S, 40 * S]) == [5 * S, 20 * S]
    assert stamps(At(at_end=True), [6 * S]) == [6 * S]


@pytest.mark.parametrize("make", [lambda: Every(seconds=0), lambda: Every(seconds=float("nan")), At,
                                  lambda: At(seconds="12"), lambda: At(seconds=[-1])])  # fmt: skip
def test_impossible_times_are_refused(make):
    with pytest.raises(ConfigError, match="the exchange policy"):
        make()

"""Which pairs of windows are drawn."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import Observation, Transform
from mapgraft.errors import UsageError
from mapgraft.evaluation import Course, Drawing, PairPlan, draw_pairs

S = 1_000_000_000
HERE = Transform.identity()


def course(number: int, place: str, scans: int, seconds: float = 0.0, robot: str = "") -> Course:
    """A robot that stands still; without ``seconds`` between its scans nobody knows when they were made."""
    stamps = [round(k * seconds * S) for k in range(scans)]
    seen = [Observation("r", stamp, stamp, "lidar", "scan", None, HERE, HERE) for stamp in stamps]
    made = Course.of(number, robot or f"r{number}", place, seen)
    stamps_ns = made.stamps_ns if seconds else None
    return Course(number, made.robot, (place,), place, HERE, made.observations, stamps_ns, "given", "")


def starts(plans: list[PairPlan]) -> list[tuple[int, int, int, int]]:
    return [(p.receiver.course.number, p.receiver.first, p.donor.course.number, p.donor.first) for p in plans]


def allowed(scans: int, span: int, seconds: float) -> set[tuple[int, int]]:
    """All pairs of one course, by the definition: disjoint, and 40 scans or 60 s apart."""
    found = set()
    for i in range(scans - span + 1):
        for j in range(scans - span + 1):
            first, second = min(i, j), max(i, j)
            between = second - (first + span)  # scans
            later_s = (second - (first + span - 1)) * seconds
            if between >= 0 and (between >= 40 or (seconds and later_s >= 60.0)):
                found.add((i, j))
    return found


@settings(max_examples=40, deadline=None)
@given(
    st.integers(20, 120), st.integers(1, 20), st.integers(0, 10), st.sampled_from([0.0, 0.5, 2.0, 7.0]), st.integers(0)
)
def test_every_pair_far_enough_apart_can_be_drawn_and_no_other(scans, window, further, seconds, seed):
    expected = allowed(scans, window + further, seconds)
    drawing = Drawing(max(1, len(expected)), window, further, seed=seed)
    one = [course(0, "here", scans, seconds)]
    if not expected:
        with pytest.raises(UsageError, match="no recording holds two windows"):
            draw_pairs(one, drawing)
        return
    plans = draw_pairs(one, drawing)
    assert sorted((i, j) for _, i, _, j in starts(plans)) == sorted(expected)
    with pytest.raises(UsageError, match=f"{len(expected)} different pairs of windows, {len(expected) + 1} are wanted"):
        draw_pairs(one, Drawing(len(expected) + 1, window, further, seed=seed))


def test_pairs_across_recordings_are_as_many_as_asked_for_and_spread_out():
    places = [course(0, "a", 200, 1.0), course(1, "b", 150, 1.0), course(2, "c", 130, 1.0)]
    plans = draw_pairs(places, Drawing(pairs=60, seed=1))
    across = [plan for plan in plans if plan.across]
    assert len(across) == 30
    assert [plan.across for plan in plans[:6]] == [False, True] * 3
    assert {frozenset(p.receiver.course.files + p.donor.course.files) for p in across} == {
        frozenset("ab"),
        frozenset("ac"),
        frozenset("bc"),
    }
    within = [plan.receiver.course.number for plan in plans if not plan.across]
    assert [within.count(number) for number in range(3)] == [10, 10, 10]
    for share, count in ((0.0, 0), (0.1, 6), (1.0, 60)):
        assert sum(p.across for p in draw_pairs(places, Drawing(pairs=60, across=share))) == count


def test_two_robots_of_one_world_make_pairs_whenever_they_were_there():
    together = [course(0, "a", 40), course(1, "a", 45)]
    plans = draw_pairs(together, Drawing(pairs=12))
    assert sorted(starts(plans)) == sorted([(0, 0, 1, j) for j in range(6)] + [(1, j, 0, 0) for j in range(6)])
    assert not any(plan.across for plan in plans)


def test_the_same_seed_draws_the_same_pairs_and_another_one_others():
    places = [course(0, "a", 300, 1.0), course(1, "b", 300, 1.0)]
    first, again = (draw_pairs(places, Drawing(pairs=50, seed=3)) for _ in range(2))
    other = draw_pairs(places, Drawing(pairs=50, seed=4))
    assert starts(first) == starts(again) != starts(other)
    turns = [[(p.receiver_turn_rad, p.donor_turn_rad) for p in plans] for plans in (first, again, other)]
    assert turns[0] == turns[1] != turns[2]
    assert len(np.unique(np.round(turns[0], 9))) == 100
    assert len(set(starts(first))) == 50


def test_windows_of_one_stretch_are_of_one_block():
    far = draw_pairs([course(0, "a", 400, 1.0)], Drawing(pairs=200))
    for plan in far:
        for window in (plan.receiver, plan.donor):
            number, stretch = window.block
            assert number == 0 and abs(window.first - 40 * stretch) <= 20


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"pairs": 0}, "pairs must be at least 1, found 0"),
        ({"scans": 0}, "scans must be at least 1"),
        ({"further": -1}, "further must be at least 0"),
        ({"seed": -3}, "seed must be at least 0"),
        ({"across": 1.5}, "across must be a share"),
    ],
)
def test_what_cannot_be_drawn_is_refused(values, sentence):
    with pytest.raises(UsageError, match=sentence):
        Drawing(**values)


def test_short_recordings_do_not_do():
    with pytest.raises(UsageError, match=r"120 scans in a row would do .*, the longest has 119"):
        draw_pairs([course(0, "a", 119), course(1, "b", 60)], Drawing())
    assert len(draw_pairs([course(0, "a", 119), course(1, "b", 60)], Drawing(pairs=5, across=1.0))) == 5

"""The timeline and the curves: nothing that stands out is lost, whatever the number of events."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.contracts import Exactness, Measurement, Transform
from mapgraft.events import Event
from mapgraft.outputs.report.axes import Axis
from mapgraft.outputs.report.curves import curves, thinned
from mapgraft.outputs.report.timeline import timeline
from mapgraft.outputs.report.words import Clock, duration, exactness, listed, number, pose

S = 1_000_000_000
FINITE = st.floats(-1e6, 1e6)


def event(seq: int, at_s: float, kind: str, merge: int = 1, **more: object) -> Event:
    state = {"merged": "provisional", "verified": "provisional", "rejected": ""}.get(kind, kind)
    return Event(seq, round(at_s * S), kind, "a", "b", f"a.b.{merge}", state, "because", **more)


@given(st.lists(FINITE, min_size=1), st.integers(2, 9))
def test_an_axis_holds_its_values_and_its_ticks(values: list[float], most: int) -> None:
    axis = Axis.over(values, 10.0, 200.0)
    assert all(9.95 <= axis.at(value) <= 200.05 for value in values)
    ticks = axis.ticks(most)
    assert len(ticks) <= most + 1 and all(9.9 <= at <= 200.1 for at, _ in ticks)
    assert [at for at, _ in ticks] == sorted(at for at, _ in ticks)


@given(st.lists(FINITE, min_size=1, max_size=3000))
def test_a_thinned_line_keeps_what_stands_out(values: list[float]) -> None:
    points = [(float(n), value) for n, value in enumerate(values)]
    kept = thinned(points)
    assert len(kept) <= 161 and set(kept) <= set(points)
    assert [x for x, _ in kept] == sorted(x for x, _ in kept)
    assert (min(y for _, y in kept), max(y for _, y in kept)) == (min(values), max(values))


def test_curves_have_the_limits_that_were_told_last_and_the_decisions() -> None:
    def measured(value: float) -> tuple[Measurement, ...]:
        return (Measurement("news", value, "m", 5, "lower", {"places": value, "rest": 1.0}),)

    told = [
        event(0, 0.0, "merged", measurements=measured(0.1)),
        event(1, 1.0, "verified", measurements=measured(math.nan), evidence={"Λ": 1.0, "Λ.revert_at": 6.0}),
        event(2, 2.0, "verified", measurements=measured(0.3), evidence={"news.places.revert_at": 3.0}),
        event(3, 3.0, "reverted", evidence={"Λ": 7.0, "Λ.revert_at": 6.9, "Λ.confirm_at": -5.0, "other": 2.0}),
    ]
    drawn = {curve.name: curve for curve in curves(told, Clock(0, 3 * S))}
    assert list(drawn) == ["news.places", "Λ", "news"]  # those with limits first; nothing else was measured
    assert [limit.text for limit in drawn["Λ"].limits] == ["reverted at 6.9", "confirmed at −5"]
    assert (drawn["news"].last, drawn["news"].missing, drawn["news"].unit) == ("0.3", 1, "m")
    assert [title for _, _, title in drawn["news"].marks] == ["merged at 0.0 s", "reverted at 3.0 s"]
    assert not drawn["news"].decides and drawn["Λ"].decides


def test_two_sided_limits_are_both_drawn() -> None:
    evidence = {"m": 1.0, "m.revert_at.min": 0.5, "m.revert_at.max": 0.9}
    (curve,) = curves([event(0, 0.0, "merged", evidence=evidence)], Clock(0, S))
    assert [limit.value for limit in curve.limits] == [0.5, 0.9]


def test_what_cannot_be_drawn_is_left_out() -> None:
    infinite = Measurement("margin", math.inf, "1", 5, "higher")
    assert curves([event(0, 0.0, "merged", measurements=(infinite,))], Clock(0, S)) == []


def test_a_merge_is_a_bar_that_changes_with_its_state_and_ends_with_its_revert() -> None:
    told = [event(0, 10, "merged"), event(1, 20, "confirmed"), event(2, 40, "reverted"), event(3, 50, "merged", 2)]
    (row,) = timeline(told, Clock(0, 100 * S), {"a.b.2": "#merge-2"}).rows
    assert [(bar.tone, bar.href) for bar in row.bars] == [("wait", ""), ("good", ""), ("wait", "#merge-2")]
    assert [bar.width for bar in row.bars] == [80.0, 160.0, 400.0]
    assert [mark.kind for mark in row.marks] == ["merged", "merged", "confirmed", "reverted"]


def test_events_that_lie_together_are_one_mark_that_counts_them() -> None:
    told = [event(n, n * 0.01, "rejected", n) for n in range(1000)]
    (row,) = timeline(told, Clock(0, 100 * S), {}).rows
    counts = [int(mark.title.split()[0]) if mark.title[0].isdigit() else 1 for mark in row.marks]
    assert sum(counts) == 1000 and len(row.marks) <= 170
    assert all(mark.href == "#not-merged" for mark in row.marks)


def test_pairs_that_merged_have_a_row_before_those_that_did_not() -> None:
    told = [Event(n, n, "rejected", f"r{n:03}", "x") for n in range(200)]
    told += [event(200, 1, "merged")]
    drawn = timeline(told, Clock(0, S), {})
    assert len(drawn.rows) == 60 and drawn.left_out == 141
    assert drawn.rows[0].label == "a ← b"


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (-3.0, "−3"), (12345.0, "12,345"), (1234.56, "1,234.6"), (0.000123456, "0.0001235"), (math.inf, "∞")],
)
def test_numbers_say_what_they_tell(value: float, text: str) -> None:
    assert number(value) == text


def test_times_and_lists_read_as_people_say_them() -> None:
    assert [duration(seconds) for seconds in (4.25, 599.9, 600.0, 3725.0, 36_000.0, 90_061.0)] == [
        *("4.2 s", "599.9 s", "10 min 00 s", "62 min 05 s", "10 h 00 min", "25 h 01 min"),
    ]
    assert Clock(0, 700 * S).at(65 * S) == "1:05 min" and Clock(0, 70 * S).at(65 * S) == "65.0 s"
    assert [listed(names) for names in ([], ["a"], ["a", "b"], list("abcdefg"))] == [
        *("nobody", "a", "a and b", "a, b, c, d, e and 2 more"),
    ]


def test_what_is_left_of_a_revert_is_told_as_one_says_it() -> None:
    said = exactness("a", Exactness(False, 1, 1, 0, "why"))
    assert said.startswith("Approximate: 1 cell was set back to unknown, 1 still holds something of the donor, 0 lost")


def test_nothing_lies_at_minus_nought() -> None:
    assert pose(Transform.planar(-1e-6, -2.0, -1e-6), 1.0) == "x 0.000 m, y −2.000 m, yaw 0.00°"

"""Which stamps are believed, and what counts instead of those that are not."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.recording.robots.stamps import StampWatch

S = 10**9
MS = 10**6


def judged(pairs, usual_s=None):
    """(cause, time in seconds) of (log_s, stamp_s) pairs; no time for a message that is not to be used."""
    watch = StampWatch(None if usual_s is None else round(usual_s * S))
    found = []
    for log_s, stamp_s in pairs:
        log_ns, stamp_ns = round(log_s * S), round(stamp_s * S)
        odd = watch.judge(log_ns, stamp_ns)
        found.append(("", stamp_ns / S) if odd is None else (odd.cause, odd.time_ns / S if odd.used else None))
    return found


def causes(pairs, usual_s=None):
    return [cause for cause, _ in judged(pairs, usual_s)]


def steady(n=20, offset_s=-3.0, from_s=100.0):
    return [(from_s + k / 10, from_s + k / 10 + offset_s) for k in range(n)]


def spoilt(stamps, n=20):
    """A steady stream in which some stamps, by number, are others."""
    return [(log, stamps.get(k, stamp)) for k, (log, stamp) in enumerate(steady(n))]


@pytest.mark.parametrize(
    ("stamp", "cause"), [(5000.0, "stamp_jump"), (50.0, "stamp_backwards"), (-7.0, "stamp_backwards")]
)
def test_a_message_with_an_odd_stamp_may_have_come_late_and_is_not_used(stamp, cause):
    found = judged(spoilt({9: stamp}))
    assert found[9] == (cause, None)
    assert [c for k, (c, _) in enumerate(found) if k != 9] == [""] * 19


def test_a_stamp_of_zero_gives_way_to_the_time_of_recording():
    found = judged(spoilt({9: 0.0, 10: 0.0, 15: 0.0}))
    assert [found[k] for k in (9, 10, 15)] == [("stamp_zero", pytest.approx(97 + k / 10)) for k in (9, 10, 15)]
    assert [c for c, _ in found].count("") == 17


def test_a_repeated_stamp_counts_at_its_recording():
    found = judged(spoilt({9: 97.8}))
    assert found[9] == ("stamp_repeated", pytest.approx(97.9))
    assert [c for c, _ in found].count("") == 19


def test_a_clock_that_stands_still_goes_on_with_the_recording():
    stood = [(100 + k / 10, 97.0 + min(k, 9) / 10 if k < 60 else 97.9 + (k - 59) / 10) for k in range(80)]
    found = judged(stood)
    assert [c for c, _ in found] == [""] * 10 + ["stamp_repeated"] * 50 + ["stamp_backwards"] * 20
    times = [t for _, t in found]
    assert times[60:69] == [None] * 9
    assert times[:60] + times[69:] == pytest.approx([97.0 + k / 10 for k in range(80) if not 60 <= k < 69])


def test_a_clock_that_is_set_back_goes_on_with_the_recording_even_when_it_has_caught_up():
    back = [(100 + k / 10, 100 + k / 10 - (5 if k >= 20 else 0)) for k in range(120)]
    found = judged(back, usual_s=-5)
    assert [c for c, _ in found] == [""] * 20 + ["stamp_backwards"] * 100
    times = [t for _, t in found]
    assert times[20:29] == [None] * 9
    assert times[:20] + times[29:] == pytest.approx([log for log, _ in back[:20] + back[29:]])


def test_a_clock_that_is_set_forward_is_believed_when_that_lasts():
    forward = [(100 + k / 10, 100 + k / 10 + (500 if k >= 20 else 0)) for k in range(50)]
    found = causes(forward)
    assert found == [""] * 20 + ["stamp_jump"] * 9 + [""] * 21
    assert causes(forward, usual_s=500) == [""] * 50


@pytest.mark.parametrize(
    "pairs",
    [
        pytest.param(steady(), id="steady"),
        pytest.param([(100 + k, 0.1 * k) for k in range(50)], id="a slow simulation"),
        pytest.param([(100 + k / 100, k / 10) for k in range(50)], id="a fast simulation"),
        pytest.param([(100 + k + (500 if k > 9 else 0), k / 10) for k in range(20)], id="a simulation that paused"),
        pytest.param([(t + (900 if t > 101 else 0), s + (900 if t > 101 else 0)) for t, s in steady()], id="a pause"),
        pytest.param([(100, 7), *((200 + k, 107 + k) for k in range(9))], id="a pause after the first"),
        pytest.param(
            [*steady(), *((122 + k / 1000, 99 + k / 10) for k in range(200)), *steady(20, -3.0, 122.2)],
            id="messages that came late, all at once",
        ),
    ],
)
def test_what_is_late_slow_or_pausing_is_believed(pairs):
    assert set(causes(pairs)) == {""}


def test_late_messages_of_which_some_were_dropped_are_believed_where_their_offset_is_usual():
    burst = [*steady(40), *((124 + k / 1000, 101 + k / 10) for k in range(5)), (124.1, 121.1), (124.2, 121.2)]
    assert set(causes(burst, usual_s=-3)) == {""}


@pytest.mark.parametrize("first", [4000.0, 3.0, 0.0])
def test_a_first_stamp_that_is_odd_spoils_none_of_the_others(first):
    found = judged(spoilt({0: first}))
    assert [c for c, _ in found] == [""] * 20  # nothing to measure the first by
    assert [t for _, t in found[1:]] == pytest.approx([stamp for _, stamp in steady()[1:]])


def test_messages_that_changed_places_keep_their_stamps():
    swapped = steady()
    swapped[9], swapped[10] = (swapped[9][0], swapped[10][1]), (swapped[10][0], swapped[9][1])
    found = judged(swapped)
    assert found[10] == ("stamp_backwards", pytest.approx(97.9))
    assert [c for c, _ in found].count("") == 19


@given(st.integers(0, 2**32), st.sets(st.integers(6, 99), max_size=20))
def test_whatever_is_odd_the_times_that_count_stay_near_the_recording(seed, odd):
    rng = random.Random(seed)
    watch = StampWatch()
    for k in range(100):
        log_ns = 10**18 + k * 100 * MS + rng.randrange(20 * MS)
        true_ns = 10**18 + k * 100 * MS - 50 * MS
        stamp_ns = rng.choice([0, 1, -5, 2**62, true_ns - 50 * S, rng.randrange(2**61)]) if k in odd else true_ns
        found = watch.judge(log_ns, stamp_ns)
        if found is None or found.used:
            assert abs((stamp_ns if found is None else found.time_ns) - true_ns) < S
        assert (found is None) == (k not in odd)

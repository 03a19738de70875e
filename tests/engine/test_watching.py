"""Measuring standing merges: only what is concerned is asked, little is written down, nothing grows without bound."""

from __future__ import annotations

import pytest
from beacons import Disagreement, Places
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.contracts import RECENT_SAMPLES, LocalTracker, Measurement, Meeting, Observation, Step, Transform
from mapgraft.trail import Trail

SECOND = 1_000_000_000
ALIKE = ((0, "alpha", 0, 2, 5), (0, "bravo", 10, 12, 15))


def heard(*at: int, second: int = 0) -> Observation:
    T = Transform.identity()
    return Observation("alpha", second * SECOND, second * SECOND, "ear", "heard", at, T, T)


def rules(every: int = 1, **changes) -> list[dict]:
    verify = {"use": "at_most", "metrics": ["disagreement"], "every": every, "limit": 99.0, **changes}
    rule = {
        "name": "beacons",
        "match": {"use": "slide"},
        "accept": {"use": "first_one"},
        "fuse": {"use": "sum"},
        "verify": verify,
    }
    return [rule]


class Near:
    """Counts the donor's beacons that the receiver has heard as well: nothing else matters to it."""

    def __init__(self, comparison):
        self.comparison = comparison
        self.concerns = Places(frozenset(comparison.donor.counts))
        self.asked: list[Step] = []

    def update(self, step):
        self.asked.append(step)
        both = self.comparison.target.counts.keys() & self.comparison.donor.counts.keys()
        return Measurement("disagreement", -float(len(both)), "beacons", 1, "lower")


def standing(play, table, tracker=None):
    """Alpha with bravo's map in its own, and its merge; ``tracker`` makes another tracker of the merge's comparison."""
    memory, robots, exchange = play(*ALIKE, rules=table)
    made, original = [], Disagreement.track
    if tracker is not None:
        Disagreement.track = lambda self, comparison: made.append(tracker(comparison)) or made[-1]
    try:
        exchange.hold(Meeting(SECOND, (("alpha", "bravo"),)))
    finally:
        Disagreement.track = original
    alpha = robots["alpha"]
    return memory, alpha, alpha.merges["bravo"], made[-1] if made else None


def test_a_tracker_is_not_asked_while_nothing_touches_what_concerns_it(play):
    _, alpha, merge, tracker = standing(play, rules(every=2), Near)
    assert isinstance(tracker, LocalTracker)
    samples = len(merge.history)
    for second in range(2, 8):
        alpha.observe(heard(30, second=second))
    assert len(tracker.asked) == 1 and len(merge.history) == samples
    alpha.observe(heard(2, second=8))
    assert len(tracker.asked) == 2 and len(merge.history) == samples + 1
    step = tracker.asked[-1]
    assert [o.payload for o in step.observations] == [(30,), (2,)]  # since it was last time to ask
    assert step.touched.at == {2, 30}
    assert not step.donor_changed


@given(places=st.lists(st.integers(-3, 9), max_size=30), every=st.integers(1, 4))
def test_what_a_local_tracker_said_last_equals_a_fresh_measurement(places, every):
    """The law that lets the engine leave a tracker alone, by the trail that the engine keeps for it."""
    from beacons import Beacons

    from mapgraft.comparison import Compared
    from mapgraft.contracts import Match
    from mapgraft.merge import _Watch

    kind, layer = Beacons(), Beacons().new_layer()
    donor = kind.decode(b"[[0, 1], [2, 1], [5, 1]]")
    match = Match(Transform.identity(), 1.0, 1.0)
    compared = Compared(kind, "own", match.T_receiver_donor, match, donor, lambda: (layer, kind.view(layer)))
    trail, tracker = Trail(), Near(compared)
    watch = _Watch.begin(tracker, 0, converted=False)
    watch.ask(trail)
    for n, at in enumerate(places, start=1):
        trail.add(heard(at), kind.integrate(layer, heard(at)))
        if n % every == 0:
            if watch.is_concerned(trail):
                watch.ask(trail)
            watch.seen = trail.now
            assert watch.latest == Near(compared).update(Step())
            trail.forget(watch.seen)


@given(
    regions=st.lists(st.sets(st.integers(0, 6), max_size=3), min_size=1, max_size=12),
    start=st.integers(0, 11),
    other=st.sets(st.integers(0, 6), max_size=4),
)
def test_a_stretch_of_the_trail_is_what_happened_since(regions, start, other):
    start = min(start, len(regions) - 1)
    trail, kept = Trail(), 0
    for n, region in enumerate(regions):
        trail.add(heard(n), Places(frozenset(region)))
        if n < start and n % 3 == 0:
            trail.forget(n)
            kept = n
    assert (trail.now, len(trail)) == (len(regions), len(regions) - kept)
    stretch = trail.since(start)
    assert stretch is trail.since(start)
    assert [o.payload for o in stretch.observations] == [(n,) for n in range(start, len(regions))]
    touched = set().union(*regions[start:])
    assert stretch.touched() == Places(frozenset(touched))
    assert stretch.meets(Places(frozenset(other))) == bool(touched & other)


def test_regions_are_united_only_for_those_who_ask():
    asked = []

    def unite() -> Places:
        asked.append(1)
        return Places(frozenset({1}))

    step = Step(unite, (heard(1),))
    assert asked == []
    assert step.touched is step.touched
    assert asked == [1]


@pytest.mark.parametrize(
    ("every", "log", "told"),
    (
        (1, {}, [10, 20, 30]),
        (2, {}, [20]),
        (1, {"log": {"every": 4}}, [4, 8, 12, 16, 20, 24, 28, 32]),
        (3, {"log": {"every": 7}}, [9, 15, 21, 30]),
        (5, {"log": {"every": 5}}, [5, 10, 15, 20, 25, 30]),
    ),
)
def test_what_goes_on_as_before_is_written_down_at_the_rhythm_of_the_log_and_at_the_end(play, every, log, told):
    memory, alpha, merge, _ = standing(play, rules(every=every, **log))
    while alpha.standing.trail.now < 34:
        alpha.observe(heard(2, second=alpha.standing.trail.now))
    events = [e for e in memory.events if e.receiver == "alpha" and e.kind == "verified"][1:]
    assert [e.receiver_version for e in events] == told
    assert len(merge.history) == 1 + (34 // every - 1 // every)
    alpha.finish(99 * SECOND)
    last = [e for e in memory.events if e.receiver == "alpha" and e.kind == "verified"]
    assert last[-1].receiver_version == 34 and len(last) == len(told) + 2
    alpha.finish(99 * SECOND)
    assert len([e for e in memory.events if e.kind == "verified" and e.receiver == "alpha"]) == len(last)


def test_a_change_is_written_down_at_once(play):
    memory, alpha, _, _ = standing(play, rules(confirm_after=3, limit=0.5))
    for second, at in enumerate((2, 5, 0, 2, 2, 3), start=2):
        alpha.observe(heard(at, second=second))
    changes = [(e.kind, e.receiver_version) for e in memory.events if e.receiver == "alpha"][2:]
    assert changes == [("verified", 1), ("confirmed", 4), ("reverted", 7)]


def test_confirmed_merges_are_judged_on_and_their_samples_say_so(play):
    _, alpha, merge, _ = standing(play, rules(confirm_after=2))
    for second in range(2, 7):
        alpha.observe(heard(2, second=second))
    assert [sample.state for sample in merge.history] == ["provisional"] * 3 + ["confirmed"] * 3


def test_the_history_holds_the_first_sample_and_the_latest(play):
    _, alpha, merge, _ = standing(play, rules())
    for second in range(2, RECENT_SAMPLES + 60):
        alpha.observe(heard(2, second=second))
    counts = [sample.observations for sample in merge.history]
    assert len(counts) == 1 + RECENT_SAMPLES
    assert counts[0] == 0
    assert counts[1:] == list(range(merge.observations - RECENT_SAMPLES + 1, merge.observations + 1))
    assert len(alpha.standing.trail) < 100

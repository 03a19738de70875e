"""How robots come to a common start."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.recording.robots.clocks import Range
from mapgraft.recording.timeline.shifts import shifts

S = 10**9
ranges = st.builds(lambda first, length: Range(first, first + length), st.integers(0, 200 * S), st.integers(0, 60 * S))
robots = st.dictionaries(st.sampled_from("abcdefgh"), ranges, min_size=1)


def groups(given_: dict[str, Range]) -> list[set[str]]:
    """Robots that share time, by brute force: join whoever overlaps by more than a second until nothing changes."""
    found = [{name} for name in given_]
    changed = True
    while changed:
        changed = False
        for one in found:
            for other in found:
                if one is not other and any(_share(given_[a], given_[b]) for a in one for b in other):
                    one |= other
                    found.remove(other)
                    changed = True
                    break
            if changed:
                break
    return found


def _share(a: Range, b: Range) -> bool:
    early, late = sorted((a, b))
    return late.first_ns + min(S, late.last_ns - late.first_ns) <= early.last_ns


@settings(deadline=None)
@given(robots)
def test_recorded_moves_nobody(given_):
    assert shifts(given_, "recorded") == dict.fromkeys(given_, 0)


@settings(deadline=None)
@given(robots)
def test_aligned_starts_every_group_with_the_earliest(given_):
    moved = shifts(given_, "aligned")
    first = min(r.first_ns for r in given_.values())
    assert set(moved) == set(given_)
    assert min(given_[name].first_ns + moved[name] for name in given_) == first
    for group in groups(given_):
        joint = {moved[name] for name in group}
        assert len(joint) == 1, "robots that recorded together keep their distance"
        assert min(given_[name].first_ns for name in group) + joint.pop() == first


@settings(deadline=None)
@given(robots)
def test_aligning_twice_changes_nothing(given_):
    moved = shifts(given_, "aligned")
    once = {name: Range(r.first_ns + moved[name], r.last_ns + moved[name]) for name, r in given_.items()}
    if all(r.last_ns - r.first_ns > S for r in once.values()):
        assert set(shifts(once, "aligned").values()) == {0}


def test_two_windows_of_one_log_only_touch():
    assert shifts({"a": Range(0, 676 * S), "b": Range(676 * S - S // 2, 1200 * S)}, "aligned")["b"] == S // 2 - 676 * S


def test_the_lives_of_one_robot_are_moved_together():
    lives = {"a": Range(0, 10 * S), "a~2": Range(30 * S, 40 * S), "b": Range(100 * S, 110 * S)}
    assert shifts(lives, "aligned") == {"a": 0, "a~2": 0, "b": -100 * S}


def test_no_robots():
    assert shifts({}, "aligned") == {}

"""The laws of reversals, over any interleaving of observing, merging, replacing and reverting."""

from __future__ import annotations

from collections import Counter

import pytest
from beacons import Beacons, Heard, Places
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.contracts import Contribution, Observation, Provenance, ReversalError, Transform
from mapgraft.reversal import new_reversal

EXACT = ("ledger", "multi_map")
PLACE = st.integers(-3, 6)
DONORS = ("bravo", "charlie", "delta")


def observation(at: list[int]) -> Observation:
    T = Transform.identity()
    return Observation("alpha", 0, 0, "ear", "heard", tuple(at), T, T)


def contribution(donor: str, version: int, at: list[int]) -> Contribution:
    layer = Heard(Counter(at))
    T = Transform.identity()
    return Contribution(Provenance(donor, 1, version), layer, T, 1.0, "none", None, None, Places(frozenset(at)))


STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("observe"), st.lists(PLACE, max_size=3)),
        st.tuples(st.just("merge"), st.sampled_from(DONORS), st.lists(PLACE, min_size=1, max_size=4)),
        st.tuples(st.just("replace"), st.sampled_from(DONORS), st.lists(PLACE, min_size=1, max_size=4)),
        st.tuples(st.just("revert"), st.sampled_from(DONORS)),
        st.tuples(st.just("look")),
    ),
    max_size=25,
)


@pytest.mark.parametrize("name", EXACT)
@given(steps=STEPS)
def test_any_interleaving_ends_with_the_layers_that_are_left(name, steps):
    reversal = new_reversal(name, Beacons())
    own: Counter[int] = Counter()
    left: dict[str, Counter[int]] = {}
    for number, (what, *given_) in enumerate(steps):
        if what == "observe":
            reversal.observe(observation(given_[0]))
            own.update(given_[0])
        elif what == "merge" and given_[0] not in left:
            reversal.merge(given_[0], contribution(given_[0], number, given_[1]))
            left[given_[0]] = Counter(given_[1])
        elif what == "replace" and given_[0] in left:
            reversal.replace(given_[0], contribution(given_[0], number, given_[1]))
            left[given_[0]] = Counter(given_[1])
        elif what == "revert" and given_[0] in left:
            assert reversal.revert(given_[0]).exact
            del left[given_[0]]
        elif what == "look":
            reversal.fused()
    assert dict(reversal.own().counts) == dict(own)
    assert dict(reversal.fused().counts) == dict(sum(left.values(), start=own.copy()))


@pytest.mark.parametrize("name", EXACT)
@given(own=st.lists(PLACE), late=st.lists(PLACE), foreign=st.lists(PLACE, min_size=1))
def test_a_reverted_map_has_the_bytes_of_one_that_never_merged(name, own, late, foreign):
    map_type = Beacons()
    merged, alone = new_reversal(name, map_type), new_reversal(name, map_type)
    merged.observe(observation(own))
    merged.merge("bravo", contribution("bravo", 1, foreign))
    merged.observe(observation(late))
    merged.revert("bravo")
    alone.observe(observation(own))
    alone.observe(observation(late))
    assert map_type.encode(merged.offered_layer()) == map_type.encode(alone.offered_layer())
    assert merged.fused() == alone.fused()


@pytest.mark.parametrize("name", EXACT)
@given(order=st.permutations(DONORS), places=st.lists(st.lists(PLACE, min_size=1), min_size=3, max_size=3))
def test_the_order_of_merges_changes_nothing(name, order, places):
    donated = dict(zip(DONORS, places, strict=True))
    one, other = new_reversal(name, Beacons()), new_reversal(name, Beacons())
    for reversal, donors in ((one, DONORS), (other, order)):
        reversal.observe(observation([0, 1]))
        for donor in donors:
            reversal.merge(donor, contribution(donor, 1, donated[donor]))
    assert one.fused() == other.fused()


@given(
    own=st.lists(PLACE, max_size=4),
    late=st.lists(PLACE, max_size=4),
    foreign=st.lists(PLACE, min_size=1, max_size=4),
    other=st.lists(PLACE, min_size=1, max_size=4),
)
def test_a_single_map_says_truly_what_it_lost(own, late, foreign, other):
    map_type = Beacons()
    reversal, right = new_reversal("single_map", map_type), new_reversal("ledger", map_type)
    for each in (reversal, right):
        each.observe(observation(own))
        each.merge("bravo", contribution("bravo", 1, foreign))
        each.merge("charlie", contribution("charlie", 1, other))
        each.observe(observation(late))
    said = reversal.revert("bravo")
    right.revert("bravo")
    updated = set(own) | set(late)
    assert said.cells_reset == len(set(foreign) - updated)
    assert said.cells_contaminated == len(set(foreign) & updated)
    assert said.cells_lost == len((set(foreign) - updated) & set(other))
    differs = {at for at in range(-3, 7) if reversal.fused().counts.get(at) != right.fused().counts.get(at)}
    assert len(differs) == said.cells_contaminated + said.cells_lost
    assert said.exact == (not differs)


def test_a_single_map_offers_what_was_its_own_before_the_first_merge():
    map_type = Beacons()
    reversal = new_reversal("single_map", map_type)
    reversal.observe(observation([1, 2]))
    before, version = map_type.encode(reversal.offered_layer()), reversal.offered_version
    reversal.merge("bravo", contribution("bravo", 1, [5]))
    reversal.observe(observation([3]))
    assert map_type.encode(reversal.offered_layer()) == before
    assert reversal.offered_version == version
    assert dict(reversal.own().counts) == {1: 1, 2: 1, 3: 1, 5: 1}


@pytest.mark.parametrize("name", ("ledger", "multi_map", "single_map"))
def test_what_is_not_there_cannot_be_taken_out(name):
    reversal = new_reversal(name, Beacons())
    reversal.observe(observation([0]))
    with pytest.raises(ReversalError, match="never made or already reverted"):
        reversal.revert("bravo")
    reversal.merge("bravo", contribution("bravo", 1, [1]))
    with pytest.raises(ReversalError, match="already in the map"):
        reversal.merge("bravo", contribution("bravo", 1, [1]))


def test_a_single_map_refuses_to_replace():
    reversal = new_reversal("single_map", Beacons())
    reversal.merge("bravo", contribution("bravo", 1, [1]))
    with pytest.raises(ReversalError, match="use the reversal ledger or multi_map"):
        reversal.replace("bravo", contribution("bravo", 2, [1]))

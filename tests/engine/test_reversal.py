"""The laws of reversals, over any interleaving of observing, merging, replacing and reverting."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping

import pytest
from beacons import Beacons, Heard
from hypothesis import example, given
from hypothesis import strategies as st

from mapgraft.contracts import Contribution, Observation, Provenance, ReversalError, Transform
from mapgraft.reversal import Reversal, SingleMap, new_reversal

EXACT = ("ledger", "multi_map")
DONORS = ("bravo", "charlie", "delta")
PLACE = st.integers(-3, 6)
# how much more often a beacon was heard at a place than not: what robots say of a place may cancel
HEARD = st.dictionaries(PLACE, st.integers(-2, 2), max_size=4)
GIVEN = st.dictionaries(PLACE, st.sampled_from((-2, -1, 1, 2)), min_size=1, max_size=4)

Balance = Mapping[int, int]
Entry = tuple[str, str, Balance]  # what was done, with which merge, and what was heard


def observation(balance: Balance) -> Observation:
    T = Transform.identity()
    return Observation("alpha", 0, 0, "ear", "heard", balance, T, T)


def contribution(donor: str, version: int, balance: Balance) -> Contribution:
    layer = Heard(Counter(balance))
    T = Transform.identity()
    return Contribution(Provenance(donor, 1, version), layer, T, 1.0, "none", None, None, Beacons().region(layer))


def remap(reversal: Reversal, balances: Collection[Balance]) -> None:
    """Put these observations in the place of all that were made before."""
    map_type, before = Beacons(), reversal.version
    layer = map_type.new_layer()
    touched = map_type.region(layer)
    for balance in balances:
        touched = touched.union(map_type.integrate(layer, observation(balance)))
    reversal.remap(layer, touched)
    assert reversal.version == before + 1


def total(balances: Iterable[Balance]) -> dict[int, int]:
    """The sums that are not zero."""
    out: Counter[int] = Counter()
    for balance in balances:
        out.update(balance)
    return {at: n for at, n in out.items() if n}


STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("observe"), HEARD),
        st.tuples(st.just("merge"), st.sampled_from(DONORS), GIVEN),
        st.tuples(st.just("replace"), st.sampled_from(DONORS), GIVEN),
        st.tuples(st.just("revert"), st.sampled_from(DONORS)),
        st.tuples(st.just("remap"), st.lists(HEARD, max_size=3)),
        st.tuples(st.just("look")),
    ),
    max_size=25,
)


@pytest.mark.parametrize("name", EXACT)
@given(steps=STEPS)
def test_any_interleaving_ends_with_the_layers_that_are_left(name, steps):
    reversal = new_reversal(name, Beacons())
    own: list[Balance] = []
    left: dict[str, Balance] = {}
    for number, (what, *given_) in enumerate(steps):
        if what == "observe":
            reversal.observe(observation(given_[0]))
            own.append(given_[0])
        elif what == "merge" and given_[0] not in left:
            reversal.merge(given_[0], contribution(given_[0], number, given_[1]))
            left[given_[0]] = given_[1]
        elif what == "replace" and given_[0] in left:
            reversal.replace(given_[0], contribution(given_[0], number, given_[1]))
            left[given_[0]] = given_[1]
        elif what == "revert" and given_[0] in left:
            assert reversal.revert(given_[0]).exact
            del left[given_[0]]
        elif what == "remap":
            remap(reversal, given_[0])
            own = list(given_[0])
        elif what == "look":
            reversal.fused()
    assert dict(reversal.own().counts) == total(own)
    assert dict(reversal.fused().counts) == total([*own, *left.values()])


@pytest.mark.parametrize("name", EXACT)
@given(own=HEARD, late=HEARD, foreign=GIVEN)
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
@given(order=st.permutations(DONORS), places=st.lists(GIVEN, min_size=3, max_size=3))
def test_the_order_of_merges_changes_nothing(name, order, places):
    donated = dict(zip(DONORS, places, strict=True))
    one, other = new_reversal(name, Beacons()), new_reversal(name, Beacons())
    for reversal, donors in ((one, DONORS), (other, order)):
        reversal.observe(observation({0: 1, 1: 1}))
        for donor in donors:
            reversal.merge(donor, contribution(donor, 1, donated[donor]))
    assert one.fused() == other.fused()


@given(
    own=HEARD,
    late=HEARD,
    donated=st.lists(GIVEN, min_size=1, max_size=3),
    reverted=st.sampled_from(DONORS),
)
@example({}, {0: 1}, [{0: 1}, {0: -1}], "bravo")  # two cancel where the robot updated
@example({}, {}, [{0: 1}, {0: -1}], "bravo")  # and where it did not
@example({}, {}, [{0: 1}, {0: 1}, {0: 1}], "charlie")  # a place of three donors is lost once
@example({}, {}, [{0: 1}, {0: 2}, {0: -2}], "bravo")  # also when what is lost cancels
@example({0: -1}, {}, [{0: 1}], "bravo")  # the donor cancels the robot itself
def test_a_single_map_says_truly_what_it_lost(own, late, donated, reverted):
    map_type = Beacons()
    given_ = dict(zip(DONORS, donated, strict=False))
    foreign = given_.pop(reverted, None)
    if foreign is None:
        reverted, foreign = given_.popitem()
    reversal, right = new_reversal("single_map", map_type), new_reversal("ledger", map_type)
    for each in (reversal, right):
        each.observe(observation(own))
        for donor, balance in {reverted: foreign, **given_}.items():
            each.merge(donor, contribution(donor, 1, balance))
        each.observe(observation(late))
    before = set(reversal.fused().counts)
    said = reversal.revert(reverted)
    right.revert(reverted)
    kept, gone = set(foreign) & {*own, *late}, set(foreign) - {*own, *late}
    assert said.cells_reset == len(gone & before)
    assert said.cells_contaminated == len(kept)
    assert said.cells_lost == len([at for at in gone if any(at in other for other in given_.values())])
    differs = {at for at in range(-3, 7) if reversal.fused().counts.get(at) != right.fused().counts.get(at)}
    assert differs == kept | (gone & set(total(given_.values())))
    assert said.exact == (said.cells_contaminated == said.cells_lost == 0)


@given(steps=STEPS)
# what the robot had updated before the first merge counts, even where that had cancelled by then
@example(
    [
        ("merge", "bravo", {1: 1}),
        ("observe", {0: 1}),
        ("observe", {0: -1}),
        ("merge", "charlie", {0: 1}),
        ("revert", "charlie"),
        ("revert", "bravo"),
    ]
)
def test_whatever_happened_a_single_map_says_truly_what_each_revert_cost(steps):
    entries: list[Entry] = []
    standing: dict[str, str] = {}
    for number, (what, *given_) in enumerate(steps):
        if what == "observe":
            entries.append((what, "", given_[0]))
        elif what == "merge" and given_[0] not in standing:
            standing[given_[0]] = f"{given_[0]} {number}"
            entries.append((what, standing[given_[0]], given_[1]))
        elif what == "revert" and given_[0] in standing:
            merge_id = standing.pop(given_[0])
            require_true_statement(entries, merge_id, standing.values())
            entries.append((what, merge_id, {}))


def require_true_statement(entries: list[Entry], merge_id: str, others: Collection[str]) -> None:
    """Revert a merge, and compare the statement with runs of the same entries in which it, and others, never were."""
    reversal, never = single_map(entries), single_map(entries, merge_id)
    before, without = content(reversal), content(never)
    said = reversal.revert(merge_id)
    after = content(reversal)
    updated = {at for what, _, balance in entries if what == "observe" for at in balance}
    share = differing(before, without)
    gone = share - updated
    lost = gone & {at for other in others for at in differing(without, content(single_map(entries, merge_id, other)))}
    assert said.cells_reset == len(gone & before.keys())
    assert said.cells_contaminated == len(share & updated)
    assert said.cells_lost == len(lost)
    assert share & updated <= differing(after, without) <= (share & updated) | lost
    assert said.exact == (not share & updated and not lost)
    if said.exact:
        assert Beacons().encode(reversal.compared_layer()) == Beacons().encode(never.compared_layer())


def single_map(entries: list[Entry], *never: str) -> SingleMap:
    """What comes of the entries without those of some merges."""
    reversal = SingleMap(Beacons())
    for number, (what, merge_id, balance) in enumerate(entries):
        if what == "observe":
            reversal.observe(observation(balance))
        elif merge_id not in never and what == "merge":
            reversal.merge(merge_id, contribution(merge_id, number, balance))
        elif merge_id not in never:
            reversal.revert(merge_id)
    return reversal


def content(reversal: SingleMap) -> Balance:
    return dict(reversal.fused().counts)


def differing(a: Balance, b: Balance) -> set[int]:
    return {at for at in a.keys() | b.keys() if a.get(at) != b.get(at)}


def test_a_single_map_offers_what_was_its_own_before_the_first_merge():
    map_type = Beacons()
    reversal = new_reversal("single_map", map_type)
    reversal.observe(observation({1: 1, 2: 1}))
    before, version = map_type.encode(reversal.offered_layer()), reversal.offered_version
    reversal.merge("bravo", contribution("bravo", 1, {5: 1}))
    reversal.observe(observation({3: 1}))
    assert map_type.encode(reversal.offered_layer()) == before
    assert reversal.offered_version == version
    assert dict(reversal.own().counts) == {1: 1, 2: 1, 3: 1, 5: 1}


@pytest.mark.parametrize("name", ("ledger", "multi_map", "single_map"))
def test_what_is_not_there_cannot_be_taken_out(name):
    reversal = new_reversal(name, Beacons())
    reversal.observe(observation({0: 1}))
    with pytest.raises(ReversalError, match="never made or already reverted"):
        reversal.revert("bravo")
    reversal.merge("bravo", contribution("bravo", 1, {1: 1}))
    with pytest.raises(ReversalError, match="already in the map"):
        reversal.merge("bravo", contribution("bravo", 1, {1: 1}))


def test_a_single_map_refuses_to_replace():
    reversal = new_reversal("single_map", Beacons())
    reversal.merge("bravo", contribution("bravo", 1, {1: 1}))
    with pytest.raises(ReversalError, match="use the reversal ledger or multi_map"):
        reversal.replace("bravo", contribution("bravo", 2, {1: 1}))

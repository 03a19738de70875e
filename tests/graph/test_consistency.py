"""Loops, and the claims that best explain why some of them do not close."""

from __future__ import annotations

import itertools
import math
import random
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.graph.claims import Edge, Source
from mapgraft.graph.consistency import Settings, explain
from mapgraft.graph.hitting import Problem, solve
from mapgraft.graph.loops import LONGEST, find_loops

FAR = (4.0, -2.0, math.pi / 2.0)


def edges(*pairs: str) -> set[Edge]:
    return {Edge(Source(a, 1), Source(b, 1)) for a, b in pairs}


def ring(count: int) -> list[str]:
    names = "abcdefghijkl"[:count]
    return [x + y for x, y in zip(names, names[1:] + names[0], strict=True)]


@pytest.mark.parametrize("count", [2, 3, 5, LONGEST])
def test_a_ring_is_one_loop_that_closes(claim, count) -> None:
    loops = find_loops([claim(pair) for pair in ring(count)])
    assert [len(loop.claims) for loop in loops] == [count]
    assert loops[0].consistent
    assert loops[0].shift_m < 1.0


def test_longer_rings_are_not_looked_at(claim) -> None:
    assert find_loops([claim(pair) for pair in ring(LONGEST + 1)]) == ()


def test_a_loop_with_a_wrong_claim_does_not_close(claim) -> None:
    (loop,) = find_loops([claim("ab"), claim("bc"), claim("ca", off=FAR)])
    assert not loop.consistent
    assert loop.mahalanobis2 > loop.limit


def test_what_was_found_on_a_map_before_its_correction_does_not_blame_what_was_found_after(claim) -> None:
    old, new = claim("ab", support=9.0, off=FAR), {"corrections": (1, 0)}
    assert find_loops([old, claim("ba", **new)]) == ()
    assert find_loops([old, claim("bc", **new), claim("ca")]) == ()
    (loop,) = find_loops([claim("ab", corrections=(0, 1)), claim("bc", **new), claim("ca")])
    assert loop.consistent
    assert len(find_loops([claim("ab", corrections=(0, 1), off=FAR), claim("ba", **new)])) == 1


def test_residuals_are_exactly_what_the_claims_say(claim, place) -> None:
    """Mahalanobis distance and shift by hand for two claims about one pair."""
    ab, ba = claim("ab"), claim("ba", off=(0.2, 0.0, 0.0))
    (loop,) = find_loops([ab, ba])
    whole = ab.T_receiver_donor @ ba.T_receiver_donor
    assert loop.shift_m == pytest.approx(math.hypot(whole.x_m, whole.y_m), abs=1e-6)
    assert loop.turn_rad == pytest.approx(abs(whole.yaw_rad), abs=1e-6)


def test_chords_make_loops_short(claim) -> None:
    loops = find_loops([claim(pair) for pair in ("ab", "bc", "cd", "da", "ac")])
    assert sorted(len(loop.claims) for loop in loops) == [3, 3]


def test_every_claim_in_a_ring_is_in_a_loop(claim) -> None:
    pairs = [x + y for x, y in itertools.permutations("abcdefg", 2)]
    told = [claim(pair) for pair in pairs]
    covered = {one.edge for loop in find_loops(told) for one in loop.claims}
    assert covered == {one.edge for one in told}


def test_a_wrong_claim_among_right_ones_is_found(claim) -> None:
    pairs = [x + y for x, y in itertools.permutations("abcd", 2)]
    said = explain([claim(pair, off=FAR if pair == "cb" else None) for pair in pairs])
    assert set(said.wrong) == edges("cb")
    assert said.disputed == {}
    grounds = said.wrong[next(iter(said.wrong))]
    assert grounds.consistent == 0
    assert grounds.inconsistent > 2
    assert grounds.evidence["loops_inconsistent"] == grounds.inconsistent
    assert grounds.margin >= Settings().margin


def test_in_one_loop_the_claim_with_little_support_is_wrong(claim) -> None:
    said = explain([claim("ab", 8.0), claim("bc", 8.0), claim("ca", 1.0, off=FAR)])
    assert set(said.wrong) == edges("ca")


def test_where_nobody_can_tell_nobody_is_wrong(claim) -> None:
    said = explain([claim("ab", 5.0), claim("bc", 6.0), claim("ca", 4.0, off=FAR)])
    assert said.wrong == {}
    assert set(said.disputed) == edges("ab", "bc", "ca")
    assert set(explain([claim("ab", 9.0), claim("bc", 6.0), claim("ca", 4.0, off=FAR)]).disputed) == edges("bc", "ca")


def test_two_that_contradict_each_other_are_in_dispute(claim) -> None:
    said = explain([claim("ab", 5.0), claim("ba", 5.0, off=FAR)])
    assert set(said.disputed) == edges("ab", "ba")


def test_wings_that_look_alike_agree_and_are_outvoted_only_with_more_support(claim) -> None:
    """The same wrong place found from both sides closes; the others must outweigh it."""
    ab = claim("ab", 6.0, off=FAR)
    ba = claim("ba", 6.0)
    turned = ab.T_receiver_donor.inverse()
    alias = type(ba)(ba.receiver, ba.donor, 1, "provisional", 0, turned, 1.0, ba.covariance, 6.0)
    rest = [claim(pair, 6.0) for pair in ("ac", "ca", "bc", "cb")]
    assert explain([ab, alias, *rest]).wrong == {}
    more = [claim(x + y, 6.0) for x, y in itertools.permutations("abcd", 2) if {x, y} != {"a", "b"}]
    assert set(explain([ab, alias, *more]).wrong) == edges("ab", "ba")


def test_who_is_seen_wrongly_from_both_sides_is_one_opinion_against_one(claim) -> None:
    """Two claims that agree about the same two maps do not outvote a third: what deceives one deceives the other."""
    ab = claim("ab", 6.0, off=FAR)
    ba = replace(claim("ba", 6.0), T_receiver_donor=ab.T_receiver_donor.inverse())
    said = explain([ab, ba, claim("bc", 6.0), claim("ca", 6.0), claim("ac", 6.0)])
    assert said.wrong == {}
    assert set(said.disputed) == edges("ab", "ba", "bc", "ca", "ac")
    tried = [replace(one, support=-2.0) for one in (ab, ba)]
    assert set(explain([*tried, claim("bc", 6.0), claim("ca", 6.0), claim("ac", 6.0)]).wrong) == edges("ab", "ba")


def test_what_speaks_against_a_claim_tells_it_from_the_others_of_its_loop(claim) -> None:
    told = [claim("ab", -4.0, off=FAR), claim("bc", 0.5), claim("ca", -0.5)]
    said = explain(told)
    assert set(said.wrong) == edges("ab")
    assert said.disputed == {}
    assert said.wrong[next(iter(said.wrong))].margin >= Settings().margin


def test_a_doubtful_claim_is_not_blamed_for_a_loop_that_another_explains(claim) -> None:
    told = [claim("ab", -6.0, off=FAR), claim("bc", 5.0), claim("ca", 5.0), claim("bd", -5.0), claim("da", 5.0)]
    said = explain(told)
    assert set(said.wrong) == edges("ab")
    assert said.disputed == {}


@pytest.mark.parametrize("pairs", [("ab", "bc", "ca"), ("ba", "bc", "ac"), ("ab", "ba"), ("ab", "bc", "dc", "da")])
def test_what_the_rest_of_a_loop_says_of_one_claim(claim, place, pairs) -> None:
    told = [claim(pair) for pair in pairs]
    (loop,) = find_loops(told)
    for one in told:
        truth = place(one.receiver.name).inverse() @ place(one.donor.name)
        shift_m, turn_rad = loop.without(one).T_target_source.difference(truth)
        assert shift_m < 1.0 and turn_rad < 0.03


def test_reverted_claims_are_in_no_loop(claim) -> None:
    assert explain([claim("ab"), claim("ba", off=FAR, state="reverted")]).loops == ()


@given(st.integers(0, 10_000), st.integers(4, 7), st.integers(0, 3))
@settings(max_examples=40, deadline=None)
def test_all_wrong_claims_in_loops_with_enough_right_ones_are_found(claim, seed, count, wrong) -> None:
    chosen = random.Random(seed)
    pairs = [x + y for x, y in itertools.permutations("abcdefg"[:count], 2)]
    off = set(chosen.sample(pairs, wrong))
    places = {pair: (chosen.uniform(3, 9), chosen.uniform(-9, 9), chosen.uniform(-3, 3)) for pair in pairs}
    told = [claim(pair, chosen.uniform(2, 6), off=places[pair] if pair in off else None) for pair in pairs]
    said = explain(told)
    assert set(said.wrong) | set(said.disputed) >= edges(*off)
    assert set(said.wrong) <= edges(*off)
    chosen.shuffle(told)
    again = explain(told)
    assert (again.wrong, again.disputed, again.loops) == (said.wrong, said.disputed, said.loops)


def cost_of(problem: Problem, wrong: set[int]) -> float:
    mask = sum(1 << at for at in wrong)
    if any(not one & mask for one in problem.broken):
        return math.inf
    total = math.fsum(problem.costs[at] for at in sorted(wrong))
    total += math.fsum(one for at, one in enumerate(problem.penalties) if at not in wrong)
    for one in problem.closed:
        hit = (one & mask).bit_count()
        total += 0.0 if hit == 0 else problem.by_chance if hit == 1 else problem.by_alias
    return total


def test_two_improbable_claims_are_wrong_together() -> None:
    """Each alone is not worth what the loop that they share says for it."""
    problem = Problem((2.0, 0.1, 0.1, 0.1, 0.1, 0.1), (), (0b100001,), 7.0, 2.0, (4.0, 0.0, 0.0, 0.0, 0.0, 0.5))
    found = solve(problem)
    assert (found.wrong, found.exact) == ((0, 5), True)
    assert found.cost == pytest.approx(4.1)


@given(st.data())
@settings(max_examples=150, deadline=None)
def test_the_search_finds_what_trying_everything_finds(data) -> None:
    count = data.draw(st.integers(2, 7))
    masks = st.lists(st.integers(1, (1 << count) - 1), max_size=8)
    costs = tuple(data.draw(st.lists(st.integers(1, 80), min_size=count, max_size=count)))
    penalties = data.draw(st.lists(st.sampled_from([0.0, 0.0, 0.5, 4.0]), min_size=count, max_size=count))
    loops = tuple(data.draw(masks)), tuple(data.draw(masks))
    problem = Problem(tuple(c / 10 for c in costs), *loops, 7.0, 2.0, tuple(penalties))
    right = data.draw(st.one_of(st.none(), st.integers(0, count - 1)))
    sets = (set(c) for n in range(count + 1) for c in itertools.combinations(range(count), n))
    least = min((cost_of(problem, one) for one in sets if right not in one), default=math.inf)
    found = solve(problem, () if right is None else (right,))
    assert found.exact
    assert found.cost == pytest.approx(least) if math.isfinite(least) else math.isinf(found.cost)
    if math.isfinite(found.cost):
        assert cost_of(problem, set(found.wrong)) == pytest.approx(found.cost)

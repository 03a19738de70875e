"""Loops that are kept up to date are those that are found anew, whatever was known before."""

from __future__ import annotations

import itertools
import random
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import Transform
from mapgraft.graph.book import Book
from mapgraft.graph.loops import Tolerance, find_loops

OFF = [None, None, (4.0, -2.0, 1.5), (0.05, 0.0, 0.0)]
PAIRS = [x + y for x, y in itertools.permutations("abcde", 2)]


@given(st.integers(0, 10_000), st.lists(st.integers(1, 12), min_size=2, max_size=5))
@settings(max_examples=40, deadline=None)
def test_what_is_kept_up_to_date_is_what_is_found_anew(claim, seed, steps) -> None:
    chosen, known = random.Random(seed), {}
    book = Book(Tolerance())
    for step in steps:
        for pair in chosen.sample(PAIRS, step):
            if pair in known and chosen.random() < 0.3:
                del known[pair]
            else:
                corrections = chosen.choice([(0, 0), (0, 0), (0, 0), (1, 0)])
                support = chosen.uniform(-2, 6)
                known[pair] = claim(pair, support, off=chosen.choice(OFF), corrections=corrections)
        told = list(known.values())
        chosen.shuffle(told)
        book.bring_up_to(told)
        fresh = Book(Tolerance())
        fresh.bring_up_to(known.values())
        assert book.loops == fresh.loops == find_loops(known.values())
        assert book.rounds.keys() == fresh.rounds.keys()
        assert [one.merged for one in book.rounds.values()] == [one.merged for one in fresh.rounds.values()]
        grounds = book.told()
        assert grounds == fresh.told() and list(grounds) == sorted(grounds)
        assert {book.views[edge] for edge in grounds} == {fresh.views[edge] for edge in grounds}
        assert set(grounds) == {edge for loop in book.loops if not loop.consistent for edge in loop.edges}


def test_only_what_has_changed_is_looked_at_again(claim) -> None:
    told = {pair: claim(pair) for pair in PAIRS}
    book = Book(Tolerance())
    book.bring_up_to(told.values())
    before = dict(book.rounds)
    told["ab"] = claim("ab", 1.0)
    book.bring_up_to(told.values())
    again = {cycle for cycle, one in book.rounds.items() if one is not before[cycle]}
    assert again == {cycle for cycle in book.rounds if {"a", "b"} <= {source.name for source in cycle}}
    assert 0 < len(again) < len(before)


def test_what_was_broken_off_begins_anew(claim) -> None:
    """A tolerance that knows nothing of loops in space breaks it off, as Ctrl-C would; one claim had been taken in."""
    told = {pair: claim(pair) for pair in PAIRS}
    book = Book(Tolerance(chi2=Tolerance().chi2[:1]))
    book.bring_up_to(told.values())
    told["ab"] = claim("ab", off=OFF[2])
    tilted = replace(told["cd"], T_receiver_donor=Transform.from_quaternion((0.0, 0.0, 1.0), (0.6, 0.0, 0.0, 0.8)))
    with pytest.raises(KeyError):
        book.bring_up_to([*told.values(), replace(tilted, epoch=2)])
    book.bring_up_to(told.values())
    fresh = Book(book.tolerance)
    fresh.bring_up_to(told.values())
    assert book.loops == fresh.loops and book.told() == fresh.told() != {}

"""Copies by part and version: whatever comes in what order, what is complete is what was sent."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import MapError
from mapgraft.network.held import Held, joined, messages_of, pieces_of, raw
from mapgraft.network.wire import PIECE, Piece, digest_of

W, V = b"writer-1", b"writer-2"
PARTS = st.dictionaries(st.sampled_from([b"a", b"b", b"c", b"dd"]), st.binary(max_size=40), max_size=4)
HISTORIES = st.lists(PARTS, min_size=1, max_size=5)


def published(*versions, writer=W) -> Held:
    held = Held()
    for number, parts in enumerate(versions, start=1):
        held.publish(writer, b"offer %d" % number, number, "parts", parts)
    return held


def deliver(source: Held, to: Held, since=None, plain=False) -> str:
    pieces = tuple(source.pieces(to.version if since is None else since, to.got(), plain))
    return to.take(source.whole, pieces)


def contents(held: Held) -> dict[bytes, bytes]:
    return raw(held.whole_parts)


@given(history=HISTORIES, known=st.integers(0, 4))
def test_a_delta_brings_anybody_up_to_date(history, known):
    source, other = Held(), Held()
    for number, parts in enumerate(history, start=1):
        source.publish(W, b"offer", number, "parts", parts)
        if number <= known:
            deliver(source, other)
    assert deliver(source, other) == ("complete" if known < len(history) else "nothing new")
    assert contents(other) == history[-1] and other.whole == source.whole


@given(history=HISTORIES, seed=st.integers(0, 999))
def test_pieces_of_all_versions_in_any_order_and_twice_make_the_newest_whole(history, seed):
    source, random = Held(), Random(seed)
    told = []
    for number, parts in enumerate(history, start=1):
        source.publish(W, b"offer", number, "parts", parts)
        pieces = tuple(source.pieces(0, {}, False)) + tuple(source.pieces(number - 1, {}, True))
        told += [(source.whole, (piece,)) for piece in pieces] + [(source.whole, ())]
    told += random.choices(told, k=len(told))
    random.shuffle(told)
    other, versions = Held(), []
    for head, pieces in told:
        other.take(head, pieces)
        versions.append(other.version)
    assert versions == sorted(versions)
    for _ in range(2):  # what came of older ones may be in the way, and is left out then
        if other.version < len(history) and deliver(source, other) != "complete":
            other.start_anew()
    assert other.version == len(history) and contents(other) == history[-1]


@given(history=st.lists(PARTS, min_size=3, max_size=5))
def test_who_holds_it_passes_it_on_exactly(history):
    source, relay, last = Held(), Held(), Held()
    for number, parts in enumerate(history, start=1):
        source.publish(W, b"offer", number, "parts", parts)
        if number != 2:
            deliver(source, relay)
        if number == 2:  # a version that the relay never saw
            deliver(source, last)
    if deliver(relay, last) == "other base":
        assert deliver(relay, last, plain=True) == "complete"
    assert contents(last) == history[-1] and last.whole == source.whole


def test_who_never_heard_of_a_part_tells_that_it_is_gone():
    """The late one took version 2 in from nothing: it has no tombstone for b, and cannot have one."""
    source, early, late = published({b"a": b"1", b"b": b"1", b"c": b"1"}), Held(), Held()
    deliver(source, early)
    source.publish(W, b"offer 2", 2, "parts", {b"a": b"2", b"c": b"1"})
    deliver(source, late)
    a, b, c = (name + b"\0\0" for name in (b"a", b"b", b"c"))
    assert b not in late.parts
    assert deliver(late, early) == "incomplete"  # what has changed does not tell what has not
    early.start_anew()
    pieces = tuple(late.pieces(1, {}, True))
    assert [(piece.name, piece.change) for piece in pieces] == [(a, "whole"), (c, "kept")]
    assert early.take(late.whole, pieces[:1]) == "incomplete" and early.parts[b].packed is not None
    assert early.take(late.whole, pieces[1:]) == "complete"  # in however many messages
    assert contents(early) == {b"a": b"2", b"c": b"1"} and early.whole == source.whole
    assert early.parts[b].version == 2 and early.parts[b].packed is None
    assert [piece for piece in early.pieces(1, {}, False) if piece.change == "gone"] == [Piece(b, 2, "gone")]


def test_the_newest_version_is_not_cut_down_to_an_older_one():
    """Part of version 3 is here already when all that is live in version 2 is named."""
    source, early, late = published({b"a": b"1", b"b": b"1"}), Held(), Held()
    deliver(source, early)
    source.publish(W, b"offer 2", 2, "parts", {b"a": b"1"})
    deliver(source, late)
    source.publish(W, b"offer 3", 3, "parts", {b"a": b"1", b"b": b"3", b"d": b"3"})
    newer = tuple(source.pieces(1, {}, True))
    assert early.take(source.whole, newer[1:2]) == "incomplete"
    assert deliver(late, early, plain=True) == "incomplete"
    assert early.got() == {b"b\0\0": 3} and early.head == source.whole
    assert early.take(source.whole, newer[2:]) == "complete"
    assert contents(early) == {b"a": b"1", b"b": b"3", b"d": b"3"}


@given(history=st.lists(PARTS, min_size=2, max_size=5), seed=st.integers(0, 999))
def test_who_came_late_brings_anybody_up_to_date_in_any_order(history, seed):
    random, source, late = Random(seed), Held(), Held()
    early = [Held() for _ in history]
    for number, parts in enumerate(history, start=1):
        source.publish(W, b"offer", number, "parts", parts)
        for other in early[number - 1 :]:
            if other is early[number - 1] or random.random() < 0.5:
                deliver(source, other, plain=random.random() < 0.5)
    deliver(source, late)
    for other in early[:-1]:
        other.start_anew()
        pieces = [piece for plain in (True, False) for piece in late.pieces(other.version, {}, plain)]
        random.shuffle(pieces)
        for piece in (*pieces, *random.choices(pieces or [None], k=3)):
            other.take(late.whole, () if piece is None else (piece,))
        assert contents(other) == history[-1] and other.whole == source.whole


def test_only_what_has_changed_travels_and_as_a_difference():
    random = Random(1)
    tile = bytearray(random.randbytes(4096))
    source, other = Held(), Held()
    source.publish(W, b"", 1, "parts", {b"a": bytes(tile), b"b": random.randbytes(4096), b"c": b"same"})
    deliver(source, other)
    for at in range(0, 4096, 8):
        tile[at] = (tile[at] + 1) % 256
    source.publish(W, b"", 2, "parts", {b"a": bytes(tile), b"c": b"same"})
    pieces = tuple(source.pieces(1, {}, False))
    assert [(piece.name[:1], piece.change) for piece in pieces] == [(b"a", "difference"), (b"b", "gone")]
    assert sum(len(piece.packed) for piece in pieces) < 100
    assert other.take(source.whole, pieces) == "complete" and contents(other)[b"a"] == bytes(tile)


def test_a_base_that_is_not_there_is_noticed():
    long = Random(2).randbytes(1000)
    source, other = published({b"a": long}), Held()
    deliver(source, other)
    source.publish(W, b"", 2, "parts", {b"a": long + b"x"})
    other._forget()
    other.publish(W, b"", 1, "parts", {b"a": b"another content"})
    assert deliver(source, other) == "other base"
    assert deliver(source, other, plain=True) == "complete"


def test_what_is_asked_is_answered_from_the_last_complete_version():
    source, other = published({b"a": b"1", b"b": b"1"}), Held()
    deliver(source, other)
    source.publish(W, b"", 2, "parts", {b"a": b"2", b"b": b"2"})
    first, _ = source.pieces(1, {}, True)
    assert other.take(source.whole, (first,)) == "incomplete"
    assert other.got() == {first.name: 2} and contents(other) == {b"a": b"1", b"b": b"1"}
    assert list(source.pieces(1, other.got(), True)) != [first]
    assert deliver(source, other) == "complete"


def test_of_two_writers_the_smaller_one_holds():
    first, second = published({b"a": b"1"}), published({b"a": b"2"}, {b"a": b"3"}, writer=V)
    for order in ((first, second), (second, first)):
        other = Held()
        told = [deliver(one, other, since=0) for one in order]
        assert contents(other) == {b"a": b"1"} and other.whole.writer == W
        assert told[-1] == ("nothing new" if order[0] is first else "complete")


def test_one_version_with_two_contents_is_a_conflict():
    first, second, other = published({b"a": b"1"}), published({b"a": b"2"}), Held()
    deliver(first, other)
    assert other.take(second.whole, ()) == "conflict"
    assert "two contents" in other.conflict and contents(other) == {b"a": b"1"}
    assert deliver(published({b"a": b"1"}, {b"a": b"5"}), other) == "conflict"


def test_a_version_is_published_once_and_never_taken_back():
    held = published({b"a": b"1"}, {b"a": b"2"})
    held.publish(W, b"offer", 2, "parts", {b"a": b"2"})
    for version in (1, 2):
        with pytest.raises(MapError, match="needs a newer version"):
            held.publish(W, b"offer", version, "parts", {b"a": b"3"})


@pytest.mark.parametrize(
    ("piece", "sentence"),
    [
        (Piece(b"", 1, "gone"), "without a name"),
        (Piece(b"a\0\0", 9, "gone"), "version 9 in one of version 1"),
        (Piece(b"a\0\0", 1, "whole", b"", b"no frame"), "cannot be read"),
    ],
)
def test_parts_that_cannot_be_are_refused(piece, sentence):
    with pytest.raises(MapError, match=sentence):
        Held().take(published({b"a": b"1"}).whole, (piece,))


@settings(max_examples=20)
@given(sizes=st.lists(st.integers(0, 3 * PIECE), max_size=4))
def test_long_parts_travel_in_pieces(sizes):
    parts = {bytes([65 + n]): bytes([n]) * size for n, size in enumerate(sizes)}
    pieces = dict(pieces_of(parts))
    assert all(len(data) <= PIECE for data in pieces.values())
    assert joined(pieces) == parts
    for name in pieces:
        if any(other[:-2] == name[:-2] and other > name for other in pieces):
            with pytest.raises(MapError, match="missing"):
                joined({other: data for other, data in pieces.items() if other != name})


def test_messages_are_as_few_as_fit():
    pieces = [Piece(b"%d" % n, 1, "whole", b"", bytes(1000)) for n in range(40)]
    told = messages_of(iter(pieces))
    assert [piece for some in told for piece in some] == pieces
    assert max(sum(len(piece.packed) for piece in some) for some in told) <= PIECE and len(told) <= 4
    assert messages_of(iter(())) == [()]


def test_names_that_are_too_long_are_refused():
    with pytest.raises(MapError, match="cannot be sent"):
        dict(pieces_of({bytes(80): b""}))
    assert digest_of(b"x") != digest_of(b"y")

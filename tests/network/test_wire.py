"""Messages as bytes: what comes out is what went in, and nothing else is taken for a message."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.contracts import MapError
from mapgraft.graph.claims import Source
from mapgraft.network import wire
from mapgraft.network.packing import Reader, Writer, difference, pack, restored, unpack
from mapgraft.network.wire import Copy, Head, Hello, Namesake, Parts, Piece, Summary, Told, Want, decode, encode

NUMBERS = st.integers(0, 2**40)
NAMES = st.binary(min_size=1, max_size=20)
SHORT = st.binary(max_size=60)
WRITERS, DIGESTS = st.binary(min_size=8, max_size=8), st.binary(min_size=16, max_size=16)
SOURCES = st.builds(Source, st.text(min_size=1, max_size=9), st.integers(0, 2**32 - 1))
SCOPES = st.lists(SOURCES, max_size=2).map(tuple)
COPIES = st.builds(Copy, SOURCES, st.sampled_from(("layer", "preview")))
HEADS = st.builds(Head, WRITERS, SHORT, NUMBERS, st.sampled_from(("parts", "whole")), DIGESTS)
PIECES = st.one_of(
    st.builds(Piece, NAMES, NUMBERS, st.sampled_from(("gone", "kept"))),
    st.builds(Piece, NAMES, NUMBERS, st.just("whole"), st.just(b""), SHORT),
    st.builds(
        Piece, NAMES, NUMBERS, st.sampled_from(("difference", "against")), st.binary(min_size=4, max_size=4), SHORT
    ),
)
MESSAGES = st.one_of(
    st.builds(Hello, WRITERS, SHORT, DIGESTS, DIGESTS, st.lists(SHORT, max_size=3).map(tuple)),
    st.builds(Summary, st.dictionaries(SOURCES, DIGESTS, max_size=3), SCOPES, st.booleans()),
    st.builds(Told, st.lists(SHORT, max_size=4).map(tuple)),
    st.builds(Want, COPIES, NUMBERS, WRITERS, st.booleans(), st.dictionaries(NAMES, NUMBERS, max_size=3)),
    st.builds(Parts, COPIES, NUMBERS, HEADS, st.just(1), st.just(3), st.lists(PIECES, max_size=3).map(tuple)),
    st.builds(Parts, COPIES, NUMBERS, st.none(), st.just(0), st.just(1), st.just(()), st.text(max_size=9)),
    st.builds(Namesake, SOURCES, WRITERS),
)  # fmt: skip


@given(message=MESSAGES)
def test_a_message_survives_the_way(message):
    data = encode(message)
    assert decode(data) == message
    assert encode(decode(data)) == data


@given(message=MESSAGES, data=st.data())
def test_a_damaged_message_is_told_from_a_whole_one(message, data):
    whole = encode(message)
    at = data.draw(st.integers(0, len(whole) - 1))
    flipped = whole[:at] + bytes([whole[at] ^ data.draw(st.integers(1, 255))]) + whole[at + 1 :]
    for damaged in (flipped, whole[:at], whole + b"x"):
        with pytest.raises(MapError, match="cannot be read"):
            decode(damaged)


@given(data=st.binary(max_size=80))
def test_noise_is_no_message(data):
    for noise in (data, wire.MAGIC + data, wire.sealed(wire.MAGIC + data)):
        try:
            message = decode(noise)
        except MapError:
            continue
        assert decode(encode(message)) == message


def test_what_is_too_long_is_neither_sent_nor_read():
    with pytest.raises(MapError, match="too long"):
        encode(Told((bytes(4000),) * 20))
    with pytest.raises(MapError, match="cannot be read"):
        decode(wire.sealed(wire.MAGIC + bytes(1 << 16)))


def test_an_offer_that_nobody_would_read_is_not_sent():
    """Whatever cannot be packed is longer packed than it was; what is all alike unpacks to more than is read."""
    noise = random.Random(1).randbytes(wire.MOST_OFFER)
    most = bytes(wire.MOST_OFFER)
    head = Head(bytes(8), most, 1, "parts", bytes(16))
    for message in (
        Hello(bytes(8), most, bytes(16), bytes(16)),
        Parts(Copy(Source("a", 1), "layer"), 0, head),
    ):
        assert decode(encode(message)) == message
    for offer in (noise, most + b" "):
        for message in (
            Hello(bytes(8), offer, bytes(16), bytes(16)),
            Parts(Copy(Source("a", 1), "layer"), 0, replace(head, offer=offer)),
        ):
            with pytest.raises(MapError, match=r"an offer of \d+ bytes is too long to be sent: 16384 are read"):
                encode(message)


@pytest.mark.parametrize(
    "body",
    [
        b"\x02\xff\xff\xff\xff\x7f",  # more claims than anybody has
        b"\x02\x01\xff\x7f",  # a claim longer than any
        b"\x09",  # no kind
        b"\x02\x80\x00",  # a number written too long
        b"\x03\x00\x01\x00\x00\x00\x00",  # a source without a name
    ],
)
def test_what_promises_too_much_is_refused_before_room_is_made(body):
    with pytest.raises(MapError, match="cannot be read"):
        decode(wire.sealed(wire.MAGIC + body))


@given(data=st.binary(max_size=300), against=st.binary(max_size=300))
def test_packing_is_undone_by_unpacking(data, against):
    assert unpack(pack(data, against), 300, against) == data
    assert restored(difference(data, against), against) == data


def test_what_unpacks_to_more_than_allowed_is_refused():
    bomb = pack(bytes(1 << 20))
    assert len(bomb) < 200
    with pytest.raises(ValueError, match="allowed"):
        unpack(bomb, 1 << 14)


@given(numbers=st.lists(st.integers(0, 2**63 - 1), max_size=9))
def test_numbers_take_the_bytes_that_they_need(numbers):
    writer = Writer()
    for number in numbers:
        writer.number(number)
    reader = Reader(bytes(writer.data))
    assert [reader.number() for _ in numbers] == numbers
    reader.end()
    assert len(writer.data) == sum(max(1, (number.bit_length() + 6) // 7) for number in numbers)

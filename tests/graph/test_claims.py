"""Claims: their bytes, and the laws of their join."""

from __future__ import annotations

import contextlib
import random
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import MapError, Transform
from mapgraft.graph.claims import MOST_TEXT_BYTES, Claim, Claims, Source

A, B = Source("a", 1), Source("b", 1)


def claim(epoch: int = 1, state: str = "provisional", revision: int = 0, **fields: Any) -> Claim:
    made = Claim(A, B, epoch, "provisional", revision, Transform.planar(1.0, 2.0, 0.3))
    return replace(made, state=state, **fields)


@given(st.data())
def test_a_claim_is_what_its_bytes_say(claims, data) -> None:
    made = data.draw(claims)
    assert Claim.decode(made.encode()) == made
    assert Claim.decode(made.encode()).encode() == made.encode()


@given(st.data())
@settings(max_examples=200)
def test_who_heard_the_same_knows_the_same(claims, data) -> None:
    heard = data.draw(st.lists(claims, max_size=12))
    order = random.Random(data.draw(st.integers(0, 1000)))
    again = [*heard, *heard[:3]]
    order.shuffle(again)
    assert Claims(heard).digest() == Claims(again).digest()
    assert list(Claims(heard)) == list(Claims(again))


@given(st.data())
def test_join_is_that_of_a_semilattice(claims, data) -> None:
    x, y, z = (Claims(data.draw(st.lists(claims, max_size=6))) for _ in range(3))

    def joined(*parts: Claims) -> bytes:
        out = Claims()
        for part in parts:
            out.join(part)
        return out.digest()

    left, right = Claims(x), Claims(y)
    left.join(y)
    right.join(z)
    assert joined(left, z) == joined(x, right)
    assert joined(x, y) == joined(y, x)
    assert joined(x, x) == x.digest()


def test_a_revert_outlives_what_is_told_late_of_the_same_epoch() -> None:
    known = Claims([claim(state="reverted", revision=3)])
    assert not known.add(claim(state="confirmed", revision=9))
    assert known.active() == ()


def test_what_is_told_after_a_correction_goes_before_what_was_confirmed_before_it() -> None:
    known = Claims([claim(state="confirmed", revision=9)])
    assert known.add(claim(state="provisional", revision=1, corrections=(0, 1)))
    assert not known.add(claim(state="confirmed", revision=10))
    assert known.add(claim(state="reverted", revision=2))
    assert not known.add(claim(state="confirmed", revision=11, corrections=(1, 1)))


def test_corrections_cost_nothing_where_there_are_none() -> None:
    corrected = claim(corrections=(0, 3))
    assert len(corrected.data) == len(claim().data) + 8
    assert (corrected.corrections_of(corrected.receiver), corrected.corrections_of(corrected.donor)) == (0, 3)


def test_merging_again_is_a_new_epoch() -> None:
    known = Claims([claim(state="reverted")])
    assert known.add(claim(epoch=2))
    assert not known.add(claim(epoch=1, state="reverted", revision=5))
    assert [one.epoch for one in known.active()] == [2]


def test_only_changes_count() -> None:
    known = Claims()
    assert known.add(claim())
    assert not known.add(claim())
    assert known.join([claim(), claim(revision=1)]) == [claim(revision=1)]
    assert known.version == 2


def test_what_is_said_is_bounded() -> None:
    made = claim(support=1e9, reason="ü" * 5000)
    assert made.support == 12.0
    assert len(made.reason.encode()) <= MOST_TEXT_BYTES
    assert Claim.decode(made.encode()) == made


@pytest.mark.parametrize("cut", [0, 3, 20, -1])
def test_damaged_bytes_are_refused(cut: int) -> None:
    with pytest.raises(MapError, match="cannot be read"):
        Claim.decode(claim().encode()[:cut])


@given(st.integers(0, 200), st.integers(1, 255))
def test_flipped_bytes_never_raise_anything_else(at: int, by: int) -> None:
    data = bytearray(claim(covariance=np.eye(6), reason="all is well").encode())
    data[at % len(data)] ^= by
    with contextlib.suppress(MapError):
        assert Claim.decode(bytes(data)).encode() == bytes(data)


@pytest.mark.parametrize(
    "wrong",
    [
        claim(receiver=B),
        claim(scale=0.0),
        claim(covariance=-np.eye(6)),
        claim(covariance=np.full((6, 6), np.inf)),
        claim(T_receiver_donor=Transform(2.0 * np.eye(4))),
    ],
)
def test_what_cannot_be_true_is_refused(wrong: Claim) -> None:
    with pytest.raises(MapError, match="cannot be read"):
        Claim.decode(wrong.encode())


@given(st.data())
def test_what_has_changed_since_is_what_holds_now_and_did_not_then(claims, data) -> None:
    known, before = Claims(), {0: Claims()}
    for one in data.draw(st.lists(claims, max_size=12)):
        if known.add(one):
            before[known.version] = Claims(known)
    for version, then in before.items():
        changed = [one for one in known if then.of(*one.edge) != one]
        assert sorted(known.since(version), key=lambda one: one.edge) == changed

"""What one robot tells of claims: sums that follow every change are those that are made anew."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from mapgraft.contracts import Transform
from mapgraft.graph.claims import Claim, Claims, Source
from mapgraft.network.gossip import Gossip
from mapgraft.network.wire import Summary, Told

ME, PEER = Source("a", 1), Source("b", 1)
SOURCES = [Source(name, 1) for name in "abcd"]
CLAIMS = st.builds(
    Claim,
    receiver=st.sampled_from(SOURCES),
    donor=st.sampled_from(SOURCES),
    epoch=st.integers(1, 2),
    state=st.sampled_from(["provisional", "confirmed", "reverted"]),
    revision=st.integers(0, 3),
    T_receiver_donor=st.just(Transform.identity()),
).filter(lambda claim: claim.receiver != claim.donor)
STEPS = st.lists(st.tuples(st.sampled_from(["wrote", "heard", "asked"]), CLAIMS), max_size=20)


def lived(steps: list[tuple[str, Claim]]) -> tuple[Claims, Gossip]:
    """What a robot knows that wrote claims and heard some, and told a peer of them now and then."""
    claims = Claims()
    gossip = Gossip(claims)
    for what, claim in steps:
        if what == "wrote":
            claims.add(claim)
        elif what == "heard":
            gossip.learn([claim.data])
        else:
            gossip.hello("now and then", ME, PEER)
    return claims, gossip


@given(steps=STEPS)
def test_what_is_said_of_claims_is_what_is_said_by_who_hears_them_all_at_once(steps):
    claims, gossip = lived(steps)
    anew = Gossip(Claims(claims))
    assert gossip.hello("b", ME, PEER)[:2] == anew.hello("b", ME, PEER)[:2]
    for asked in (Summary({}), Summary({PEER: bytes(16)}, (PEER,)), Summary({Source("x", 1): bytes(16)})):
        assert list(gossip.answer(asked)) == list(anew.answer(asked))
    told = [Told(tuple(claim.data for claim in claims))] if len(claims) else []
    assert list(gossip.answer(Summary({}))) == told


@given(steps=STEPS)
def test_a_peer_is_told_once_what_was_written_here_and_nothing_else(steps):
    claims, gossip = lived(steps)
    written: dict[tuple[Source, Source], bytes] = {}
    again = Claims()
    for what, claim in steps:
        if what != "asked" and again.add(claim):
            written.pop(claim.edge, None)
            if what == "wrote":
                written[claim.edge] = claim.data
    assert gossip.has_news_for("c") == bool(written)
    assert sorted(gossip.news_for("c")) == sorted(written.values())
    assert not gossip.has_news_for("c") and gossip.news_for("c") == ()
    newer = Claim(ME, PEER, 3, "provisional", 0, Transform.identity())
    claims.add(newer)
    assert gossip.has_news_for("c") and gossip.news_for("c") == (newer.data,)

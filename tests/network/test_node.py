"""What robots say to each other: on contact, when something is lost, through third robots, and under one name."""

from __future__ import annotations

from dataclasses import replace

import pytest
from swarm import Robot, Swarm

from mapgraft.contracts import MapError, Transform
from mapgraft.graph.claims import Claim, Source
from mapgraft.network.radio import NS_PER_S, Conditions
from mapgraft.network.wire import Copy, Parts, Told, Want, encode

S = NS_PER_S


def swarm_of(*addresses: str, conditions: Conditions | None = None, scans: int = 4, **options) -> Swarm:
    swarm = Swarm(conditions or Conditions())
    for address in addresses:
        robot = swarm.add(address, **options)
        for _ in range(scans):
            robot.observe()
    return swarm


def met(swarm: Swarm, *pairs: str, seconds: int = 10) -> dict[str, int]:
    """Let pairs meet; returns how many bytes of which kind were sent meanwhile."""
    before = dict(swarm.traffic.bytes)
    for pair in pairs:
        swarm.meet(pair[0], pair[1])
    swarm.advance(seconds * S)
    kinds: dict[str, int] = {}
    for key, size in swarm.traffic.bytes.items():
        if size > before.get(key, 0):
            kinds[key[2]] = kinds.get(key[2], 0) + size - before.get(key, 0)
    return kinds


def held(robot: Robot, of: Robot) -> int:
    return robot.node.replica.version(Copy(of.source, "layer"))


def test_what_is_known_is_not_told_again():
    swarm = swarm_of("a", "b")
    first = met(swarm, "ab")
    assert set(first) == {"hello", "want", "preview", "layer", "claims"}
    assert set(met(swarm, "ab")) == {"hello"}
    assert swarm.disagreements() == []


def test_a_newer_layer_comes_as_what_has_changed():
    swarm = swarm_of("a", "b", scans=30)
    first = met(swarm, "ab")
    swarm.robots["a"].observe()
    second = met(swarm, "ab")
    assert set(second) == {"hello", "want", "layer"}
    assert second["layer"] < first["layer"] / 3
    assert swarm.disagreements() == []


def test_a_layer_comes_through_a_third_robot_that_was_never_met():
    swarm = swarm_of("a", "b", "c")
    a, _, c = (swarm.robots[name] for name in "abc")
    met(swarm, "ab")
    met(swarm, "bc")
    assert held(c, a) == a.version  # b had it
    met(swarm, "ab")
    assert held(a, c) == c.version and "c" not in a.node.peers
    a.observe()
    met(swarm, "ab")
    assert held(c, a) == a.version - 1
    met(swarm, "bc")
    assert held(c, a) == a.version


def test_only_those_are_asked_who_may_know_more():
    swarm = swarm_of("a", "b", "c")
    for pairs in (("ab",), ("bc",), ("ab", "bc", "ac")):
        met(swarm, *pairs)
    wants = met(swarm, "ab", "bc", "ac")
    assert set(wants) == {"hello"}  # everybody is here, and nobody has anything new


def test_what_is_lost_is_asked_for_again():
    conditions = Conditions(latency_ns=S // 100, loss=0.5, seed=4)
    swarm = swarm_of("a", "b", conditions=conditions)
    swarm.window_ns = 60 * S
    met(swarm, *["ab"] * 6, seconds=60)
    assert swarm.radio.fates.lost > 10
    a, b = swarm.robots["a"], swarm.robots["b"]
    assert held(a, b) == b.version and held(b, a) == a.version


def test_nobody_asks_for_ever():
    swarm = swarm_of("a", "b", conditions=Conditions(latency_ns=S // 100, loss=0.9, seed=1))
    swarm.window_ns = 10_000 * S
    met(swarm, *["ab"] * 20, seconds=20_000)
    assert swarm.radio.next_ns is None
    assert all(robot.node.wake_ns is None for robot in swarm.robots.values())


def test_a_preview_that_is_not_liked_saves_the_layer(monkeypatch):
    monkeypatch.setattr(Robot, "consider", lambda *_: "nothing")
    swarm = swarm_of("a", "b", previews=True)
    kinds = met(swarm, "ab")
    assert "preview" in kinds and "layer" not in kinds


def test_who_cannot_send_says_why(monkeypatch):
    swarm = swarm_of("a", "b", previews=False)

    def broken(aspect, stamp_ns):
        raise MapError("its disk is full")

    monkeypatch.setattr(swarm.robots["b"], "cut", broken)
    swarm.meet("a", "b")
    with pytest.raises(MapError, match="its disk is full"):  # whoever runs the robots ends this one's part
        swarm.advance(S)
    swarm._flush("b")
    for delivery in swarm.radio.due(swarm.now_ns):
        swarm.robots[delivery.receiver].node.hear(delivery.sender, delivery.data, delivery.arrival_ns)
    assert swarm.robots["a"].refusals == ["its disk is full"]


def test_what_cannot_be_read_is_counted_and_nothing_else():
    node = swarm_of("a").robots["a"].node
    for data in (b"", b"noise", encode(Told((b"no claim",)))[:-1]):
        node.hear("x", data, 0)
    node.hear("x", encode(Told((b"no claim",))), 0)
    assert (node.unreadable, node.gossip.refused, node.said()) == (3, 1, [])


def test_parts_that_nobody_asked_for_are_left_aside():
    swarm = swarm_of("a", "b", "c")
    met(swarm, "ab")
    a, c = swarm.robots["a"].node, swarm.robots["c"].node
    (parts,) = swarm.robots["b"].node.replica.answer(c.replica.wish(Copy(Source("b", 1), "layer")))
    c.hear("b", encode(parts), 0)
    assert not c.replica.copies and not c.said()
    a.hear("b", encode(Parts(Copy(Source("a", 1), "layer"), 0, parts.head, 0, 1, parts.pieces)), 0)
    assert a.replica.version(Copy(Source("a", 1), "layer")) == swarm.robots["a"].version  # nobody else writes it


def test_parts_of_which_the_offer_is_none_are_counted_and_left_aside():
    """Its bytes are sound; what it says of itself is no offer, or that of another map. A later answer is taken."""
    swarm = swarm_of("a", "b", "c", previews=False)
    a, b = swarm.robots["a"].node, swarm.robots["b"].node
    met(swarm, "ac")
    a.hear("b", encode(b.greeting("a")), swarm.now_ns)
    b._publish(Copy(b.source, "layer"), swarm.now_ns)
    (parts,) = b.replica.answer(Want(Copy(b.source, "layer"), 0))
    offer_of_c = swarm.robots["c"].offer()
    for number, offer in enumerate((b"{}", parts.head.offer[:-1], offer_of_c), start=1):
        a.hear("b", encode(replace(parts, head=replace(parts.head, offer=offer))), swarm.now_ns)
        assert a.unreadable == number and a.replica.version(parts.copy) == 0
    a.hear("b", encode(parts), swarm.now_ns)
    assert a.replica.version(parts.copy) == swarm.robots["b"].version


def test_what_strangers_make_up_leaves_room_for_ones_own_claims(monkeypatch):
    monkeypatch.setattr("mapgraft.network.gossip.MOST_EDGES", 2)
    swarm = swarm_of("a", "b", "x")
    made_up = swarm.robots["x"]
    for number in range(5):
        made_up.claims.add(_claim("x", f"y{number}"))
    a = swarm.robots["a"]
    a.node.hear("x", encode(Told(tuple(claim.data for claim in made_up.claims))), 0)
    assert (len(a.claims), a.node.gossip.refused) == (2, 3)
    met(swarm, "ab")
    assert a.claims.of(a.source, Source("b", 1)) is not None
    known = made_up.claims.of(Source("x", 1), Source("y0", 1))
    newer = replace(known, state="reverted", revision=1)
    a.node.hear("x", encode(Told((newer.data,))), 0)
    assert a.claims.of(*newer.edge) == newer  # there is always room for what is known to end


def _claim(receiver: str, donor: str) -> Claim:
    return Claim(Source(receiver, 1), Source(donor, 1), 1, "provisional", 0, Transform.identity())


def test_a_robot_takes_no_name_that_it_has_heard_of():
    """``alpha~2`` was told of in a claim, and is not to be met any more."""
    swarm = Swarm()
    a, b = (swarm.add(address, "alpha") for address in "ab")
    b.claims.add(replace(_claim("x", "y"), donor=Source("alpha~2", 2)))
    for robot in (a, b):
        robot.observe()
    met(swarm, "ab")
    assert b.source == Source("alpha~3", 3)


def test_a_robot_that_begins_again_is_another_source_and_the_old_one_stays():
    swarm = swarm_of("a", "b")
    met(swarm, "ab")
    old = swarm.robots["a"].source
    swarm.add("a", epoch=2).observe()
    met(swarm, "ab")
    b = swarm.robots["b"]
    attached = {contribution.provenance[:2] for contribution in b.reversal.contributions.values()}
    assert attached == {("a", 1), ("a", 2)}
    assert b.node.replica.version(Copy(old, "layer")) == 4
    assert swarm.disagreements() == []


def test_parts_that_went_before_anybody_here_looked_are_gone_for_all(monkeypatch):
    """c has never heard of the cells that b once had and a still has; b itself is no more when a and c meet."""
    swarm = swarm_of("a", "b", "c", previews=False)
    old = swarm.robots["b"].source
    layers = iter(({b"x": b"1", b"y": b"1", b"z": b"1"}, {b"x": b"2", b"z": b"1"}))
    parts = next(layers)
    monkeypatch.setattr(swarm.robots["b"], "cut", lambda aspect, stamp_ns: ("parts", parts))
    for robot in swarm.robots.values():
        monkeypatch.setattr(robot, "heard", lambda stamp_ns: None)
    met(swarm, "ab")
    parts = next(layers)
    swarm.robots["b"].observe()
    met(swarm, "bc")
    swarm.add("b", epoch=2)
    met(swarm, "ac")
    for address in "ac":
        whole = swarm.robots[address].node.replica.whole(Copy(old, "layer"))
        assert (whole.head.version, whole.parts()) == (5, parts)


@pytest.mark.parametrize("first", ["ab", "ac", "bc"])
def test_of_two_robots_of_one_name_the_second_gets_another(first):
    """c meets both, and tells the second of the first, before they have met each other."""
    swarm = Swarm()
    for address, name in (("a", "alpha"), ("b", "alpha"), ("c", "charlie")):
        swarm.add(address, name).observe()
    swarm.robots["a"].observe()
    for pair in (first, "ac", "bc", "ac", "bc", "ab"):
        met(swarm, pair)
    a, b, c = (swarm.robots[name] for name in "abc")
    assert a.source == Source("alpha", 1) and b.source == Source("alpha~2", 2)
    assert Source("alpha", 1) in a.node.writers.shared | b.node.writers.shared
    swarm.heal()
    assert {held(c, a), held(c, b)} == {2, 1}
    assert swarm.disagreements() == []


def test_what_is_on_its_way_from_who_has_no_right_to_the_name_is_left_aside():
    """Both robots called alpha are asked; what the one says that has to take another name comes last, or first."""
    for answered in ("ab", "ba"):
        swarm = Swarm()
        a, b, c = (swarm.add(*given, previews=False).node for given in (("a", "alpha"), ("b", "alpha"), ("c",)))
        for _ in range(3):
            swarm.robots["b"].observe()
        swarm.robots["a"].observe()
        for sender, node in (("b", b), ("a", a)):
            c.hear(sender, encode(node.greeting("c")), 0)
        wants = [(one.receiver, one.message) for one in c.said() if isinstance(one.message, Want)]
        assert [receiver for receiver, _ in wants] == ["b", "a"]
        for receiver, want in sorted(wants, key=lambda one: answered.index(one[0])):
            node = swarm.robots[receiver].node
            node.hear("c", encode(replace(want, writer=bytes(8))), 0)
            for one in node.said():
                c.hear(receiver, encode(one.message), 0)
        assert c.replica.head(Copy(Source("alpha", 1), "layer")).writer == a.writer
        assert held(swarm.robots["c"], swarm.robots["a"]) == 1


def test_who_asks_and_who_answers_learn_whose_a_source_is():
    """c and d have each met another alpha, and then each other only."""
    for asks, answers in ("cd", "dc"):
        swarm = Swarm()
        for address, name in (("a", "alpha"), ("b", "alpha"), ("c", "c"), ("d", "d")):
            swarm.add(address, name, previews=False).observe()
        met(swarm, "ac", "bd")
        nodes = {address: swarm.robots[address].node for address in "cd"}
        copy = Copy(Source("alpha", 1), "layer")
        want = nodes[asks].replica.wish(copy)
        nodes[answers].hear(asks, encode(want), swarm.now_ns)
        knows = {address for address, node in nodes.items() if node.writers.of(copy.source)[:1] == b"a"}
        assert knows == ({"c", "d"} if asks == "c" else {"c"})
        assert (nodes["d"].replica.head(copy) is None) == (asks == "c")
        if asks == "c":
            assert not swarm.robots["d"].claims.of(Source("d", 1), copy.source).is_active


def test_three_robots_of_one_name_become_three():
    swarm = Swarm()
    for address in "abc":
        swarm.add(address, "alpha").observe()
    swarm.heal()
    assert sorted(robot.source.name for robot in swarm.robots.values()) == ["alpha", "alpha~2", "alpha~3"]
    swarm.heal()
    assert swarm.disagreements() == []


def test_claims_are_told_once_to_everybody_by_who_wrote_them():
    swarm = swarm_of("a", "b", "c", scans=2)
    met(swarm, "ab", "bc", "ac")
    met(swarm, "ab", "bc", "ac")
    quiet = met(swarm, "ab", "bc", "ac")
    swarm.robots["a"].claim(Source("b", 1), "confirmed")
    told = met(swarm, "ab", "bc", "ac")
    assert set(told) == {"hello"}
    claim = len(swarm.robots["a"].claims.of(Source("a", 1), Source("b", 1)).data)
    assert told["hello"] - quiet["hello"] == pytest.approx(2 * claim, abs=12)


def test_what_others_missed_comes_after_a_partition():
    swarm = swarm_of("a", "b", "c", "d")
    met(swarm, "ab", "cd")
    kinds = met(swarm, "ac")
    assert {"summary", "claims"} <= set(kinds)
    a, c = swarm.robots["a"], swarm.robots["c"]
    assert a.claims.digest() == c.claims.digest() and len(a.claims) == 6
    assert "summary" not in met(swarm, "ac")


def test_who_answers_slowly_is_not_asked_ever_more_often():
    """Half a second of patience, and a radio on which one map takes ten."""
    swarm = swarm_of("a", "b", conditions=Conditions(bandwidth_bytes_s=60.0), scans=20, previews=False)
    swarm.window_ns = 900 * S
    slow = met(swarm, "ab", seconds=900)
    a, b = swarm.robots["a"], swarm.robots["b"]
    assert held(a, b) == b.version and held(b, a) == a.version
    fast = met(swarm_of("a", "b", scans=20, previews=False), "ab")
    assert fast["layer"] > 10 * 60 and slow["layer"] <= 6 * fast["layer"]

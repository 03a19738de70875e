"""Maps that must be converted to be compared: looked at together, the more rarely the more has been observed."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import beacons
import pytest
import taps
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.config import LimitsConfig
from mapgraft.contracts import Donation, Meeting, Observation, Provenance, Transform
from mapgraft.decision import build_table
from mapgraft.exchange import LayerMessage, Offer
from mapgraft.history import History, Journal
from mapgraft.persons import Hand
from mapgraft.plugins import Origin, load_plugin
from mapgraft.procedures import Workshop
from mapgraft.replay import Exchange
from mapgraft.reversal import new_reversal
from mapgraft.rhythm import SPARING, Rhythm
from mapgraft.robot import Robot
from mapgraft.standing import Grounds

SECOND = 1_000_000_000
NAMES = ("alpha", "bravo", "charlie")


def rules(**verify) -> list[dict]:
    return [
        {
            "name": "taps",
            "via": "beacons",
            "match": {"use": "slide"},
            "accept": {"use": "first_one"},
            "fuse": {"use": "sum_of_taps"},
            "verify": {"use": "at_most", "metrics": ["disagreement"], "limit": 99.0, **verify},
        }
    ]


class Silent:
    def observed(self, observation) -> None:
        pass

    def happened(self, event) -> None:
        pass

    def mapped(self, snapshot) -> None:
        pass


def heard(robot: str, *at: int) -> Observation:
    T = Transform.identity()
    return Observation(robot, SECOND, SECOND, "ear", "heard", at, T, T)


@pytest.fixture
def meet(plugins):
    """Alpha with bravo's and charlie's maps in its own; all three hear the same three taps, each on its own line."""

    def make(reversal: str = "ledger", **verify):
        load_plugin(plugins, taps, Origin("taps", "tap-plugin", "1.0"))
        workshop, history, table = Workshop(plugins), History(Silent()), build_table(plugins, rules(**verify))
        robots = {}
        for place, name in enumerate(NAMES):
            kind = taps.Taps()
            kept = new_reversal(reversal, kind)
            robots[name] = Robot(name, kind, kept, table, workshop, Hand(), Journal(history, name, kind, kept))
            robots[name].observe(heard(name, *(10 * place + at for at in (0, 2, 5))))
        Exchange(None, robots).hold(Meeting(SECOND, (("alpha", "bravo"), ("alpha", "charlie"))))
        taps.ToBeacons.converted.clear()
        return history, robots["alpha"]

    return make


@given(st.integers(1, 12), st.integers(0, 20_000))
def test_a_sparing_look_waits_no_longer_than_its_share(every: int, now: int) -> None:
    plain, sparing = Rhythm(every), Rhythm(every, sparing=True)
    assert plain.next_after(now) == now + every - now % every
    due = sparing.next_after(now)
    assert sparing.is_due(due)
    assert not any(sparing.is_due(between) for between in range(now + 1, due))
    assert plain.is_due(due)  # so that what costs nothing is looked at with it
    assert now < due <= now + max(every, now // SPARING)
    assert now >= 2 * every * SPARING or due == plain.next_after(now)


def test_the_looks_of_a_mission_of_any_length_are_few() -> None:
    rhythm, looks, now = Rhythm(10, sparing=True), [], 0
    while now < 102_400:
        now = rhythm.next_after(now)
        looks.append(now)
    assert len([look for look in looks if look <= 400]) == 40
    for doubling in range(8):
        low = 400 * 2**doubling
        assert len([look for look in looks if low < look <= 2 * low]) == 20


def test_one_conversion_does_for_all_merges_of_a_look(meet) -> None:
    _, alpha = meet(every=3)
    assert len(alpha.merges) == 2
    for _ in range(12):
        alpha.observe(heard("alpha", 2))
    assert len(taps.ToBeacons.converted) == 4  # after 3, 6, 9 and 12 observations


def test_a_long_mission_converts_ever_more_rarely_and_misses_nothing(meet) -> None:
    _, alpha = meet(every=2)
    while alpha.standing.trail.now < 1_280:
        alpha.observe(heard("alpha", alpha.standing.trail.now % 4))
    assert len(taps.ToBeacons.converted) == 80 // 2 + 4 * 20
    merge = alpha.merges["bravo"]
    assert merge.history[-1].observations == 1_279
    assert len(alpha.standing.trail) <= 64


def test_what_a_late_look_finds_is_reverted(meet) -> None:
    history, alpha = meet(every=1, limit=0.0)
    while alpha.standing.trail.now < 402:
        alpha.observe(heard("alpha", 2))
    alpha.observe(heard("alpha", 3))  # bravo heard nothing there
    assert len(alpha.merges) == 2
    while alpha.standing.trail.now < 403 + 20:
        alpha.observe(heard("alpha", 2))
    assert not alpha.merges
    reverted = [event.receiver_version for event in history.events if event.kind == "reverted"]
    assert reverted == [416, 416]  # each sixteen from 320 observations on
    assert alpha.reversal.fused().counts == alpha.reversal.own().counts


def test_what_comes_in_or_goes_out_changes_no_own_map(meet) -> None:
    _, alpha = meet(every=1)
    alpha.observe(heard("alpha", 2))
    assert len(taps.ToBeacons.converted) == 1
    alpha.standing.revert(alpha.merges["bravo"], SECOND, Grounds("a person said so", "person", by_person=True))
    alpha.finish(SECOND)
    assert len(taps.ToBeacons.converted) == 1


def test_where_the_merged_map_is_compared_a_revert_changes_it(meet) -> None:
    _, alpha = meet("single_map", every=1)
    alpha.observe(heard("alpha", 2))
    before = len(taps.ToBeacons.converted)
    alpha.standing.revert(alpha.merges["bravo"], SECOND, Grounds("a person said so", "person", by_person=True))
    alpha.standing.verify(alpha.merges["charlie"], SECOND, everything=True)
    assert len(taps.ToBeacons.converted) == before + 1


@pytest.mark.parametrize(("at", "made"), [((100, 101), 0), ((100, 102), 1)])
def test_what_the_fuser_gets_is_converted_only_when_it_is_fused(meet, at: tuple[int, int], made: int) -> None:
    _, alpha = meet(every=1)
    taps.FromBeacons.converted.clear()
    donation = Donation(beacons.Heard(beacons.Counter(at)), Provenance("delta", 1, 1))
    attempt = alpha.attempts.make(alpha.merges["bravo"].tools, donation, None, (0.0, 0.0))
    assert (attempt.grafted is not None) == (made == 1)
    assert len(taps.FromBeacons.converted) == made


@pytest.fixture
def failing(monkeypatch) -> Callable[[], list[int]]:
    """From the call on the conversion fails; what it gives counts how often it was asked."""

    def begin() -> list[int]:
        asked: list[int] = []

        def fail(*_: object) -> None:
            asked.append(1)
            raise OSError("no dictionary")

        monkeypatch.setattr(taps.ToBeacons, "convert", fail)
        return asked

    return begin


def offer_more(receiver: Robot, versions: Iterable[int]) -> None:
    """Newer maps of bravo's, one after the other."""
    kind = taps.Taps()
    for version in versions:
        layer = kind.new_layer()
        kind.integrate(layer, heard("bravo", version))
        told = Provenance("bravo", 1, version)
        sent = LayerMessage(told, kind.name, kind.encode(layer)).encode()
        receiver.consider(Offer(told, kind.metadata(layer)).encode(), lambda sent=sent: sent, version * SECOND)


def test_that_a_standing_merges_conversion_is_not_asked_again_is_told_once(meet, failing) -> None:
    history, alpha = meet()
    asked, before = failing(), len(history.events)
    offer_more(alpha, range(4, 14))
    times = LimitsConfig().failures
    assert len(asked) == times
    said = [event.reason for event in history.events[before:] if event.kind == "failed"]
    assert len(said) == times + 1
    assert "'taps_to_beacons' failed 3 times (limits.failures) and is not asked again" in said[-1]
    assert alpha.merges["bravo"].provenance.version < 4  # the merge stands as it was


def test_a_conversion_that_fails_too_often_is_not_asked_again(meet, failing) -> None:
    asked = failing()
    history, alpha = meet()
    offer_more(alpha, range(4, 9))
    failed = [event for event in history.events if event.kind == "failed"]
    assert len(asked) == len(failed) == LimitsConfig().failures
    assert {event.by for event in failed} == {"conversion taps_to_beacons"}
    assert history.events[-1].kind == "rejected"
    assert "the conversion 'taps_to_beacons' failed 3 times" in history.events[-1].reason

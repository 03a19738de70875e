"""Plugins that raise, hang or give nonsense are named in an event; the run goes on, and no ledger is touched."""

from __future__ import annotations

import dataclasses
import math
import threading
import time

import beacons
import numpy as np
import pytest

from mapgraft.config import LimitsConfig
from mapgraft.contracts import Contribution, Decision, Finding, Match, Measurement, Provenance, Transform, Verdict
from mapgraft.errors import FailedPluginError, MapError, OutputError
from mapgraft.failures import failure_sentences
from mapgraft.guard import Guard
from mapgraft.outputs.memory_sink import MemorySink

ALIKE = ((0, "alpha", 0, 2, 5), (0, "bravo", 10, 12, 15))
LATER = (2, "alpha", 5)
SECOND = 1_000_000_000
SHORT = LimitsConfig(plugin_s=0.05)
RULE = {
    "match": {"use": "slide"},
    "accept": {"use": "first_one"},
    "fuse": {"use": "sum"},
    "verify": {"use": "at_most", "metrics": ["disagreement"], "every": 1, "confirm_after": 3},
}
SHEARED = np.array([[1.0, 0.5, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
SOUND = Match(Transform.planar(-10.0, 0.0, 0.0), 3.0, 1.0)


def told(memory, receiver: str = "alpha") -> list[str]:
    return [event.kind for event in memory.events if event.receiver == receiver]


def failures(memory, receiver: str = "alpha") -> list[str]:
    return [event.reason for event in memory.events if event.receiver == receiver and event.kind == "failed"]


def alone(play, *observations) -> bytes:
    _, robots, _ = play(*observations)
    return robots["alpha"].own.encoded_layer()


def broken(monkeypatch, name: str, method: str, answer) -> None:
    """Let the plugin's method answer otherwise; what is an exception is raised."""

    def wrong(*args):
        if isinstance(answer, BaseException):
            raise answer
        return answer(*args) if callable(answer) else answer

    monkeypatch.setattr(getattr(beacons, name), method, wrong)


NONSENSE = [
    ("Slide", "match", None, "where a sequence of matches was wanted"),
    ("Slide", "match", "a text", "where a sequence of matches was wanted"),
    ("Slide", "match", [5], "gave a int among its matches"),
    ("Slide", "match", [dataclasses.replace(SOUND, T_receiver_donor=Transform(SHEARED.copy()))], "must be rigid"),
    ("Slide", "match", [dataclasses.replace(SOUND, T_receiver_donor=Transform(np.full((4, 4), np.nan)))], "last row"),
    ("Slide", "match", [dataclasses.replace(SOUND, T_receiver_donor=np.eye(4))], "where a Transform was wanted"),
    ("Slide", "match", [dataclasses.replace(SOUND, T_receiver_donor=Transform(np.eye(3)))], "a Transform was wanted"),
    ("Slide", "match", [dataclasses.replace(SOUND, score=math.nan)], "gave a score of nan"),
    ("Slide", "match", [dataclasses.replace(SOUND, score=None)], "gave a score of None"),
    ("Slide", "match", [dataclasses.replace(SOUND, scale=0.0)], "it must be above 0"),
    ("Slide", "match", [dataclasses.replace(SOUND, covariance=np.eye(3))], "not six by six finite numbers"),
    ("Slide", "match", [dataclasses.replace(SOUND, evidence={"x": "y"})], "whose x is 'y'"),
    ("FirstOne", "accept", True, "where a Decision was wanted"),
    ("FirstOne", "accept", Decision("provisional", None, "yes"), "chose number None"),
    ("FirstOne", "accept", Decision("provisional", 99, "yes"), "chose number 99"),
    ("FirstOne", "accept", Decision("perhaps", 0, "yes"), "where a Decision was wanted"),
    ("Sum", "fuse", None, "gave None where a Contribution was wanted"),
    ("Disagreement", "track", None, "gave a NoneType where a tracker was wanted"),
    ("_Disagreeing", "update", 0.5, "where a Measurement was wanted"),
    ("_Disagreeing", "update", Measurement("d", "much", "", 1, "lower"), "a number was wanted"),
    ("_Disagreeing", "update", Measurement("d", 1.0, "", -1, "lower"), "gave a support of -1"),
    *(
        ("_Disagreeing", "update", Measurement("d", 1.0, "", 1, "lower", findings=findings), sentence)
        for findings, sentence in (
            (None, "gave findings of type NoneType"),
            ([("hole", 0.5)], "gave ('hole', 0.5) among its findings"),
            ([Finding("hole", (0.0, 0.0, 0.0), (math.nan, 0.0, 0.0), 1.0, "m")], "a coordinate of a finding of nan"),
            ([Finding("hole", (0.0, 0.0), (1.0, 0.0), 1.0, "m")], "x, y and z were wanted"),
            ([Finding("hole", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), "long", "m")], "the value of a finding of 'long'"),
        )
    ),
    ("AtMost", "verify", None, "gave None where a Verdict was wanted"),
    ("AtMost", "verify", Verdict("explode", "why not"), "where a Verdict was wanted"),
]


@pytest.mark.parametrize(("name", "method", "answer", "sentence"), NONSENSE)
def test_nonsense_is_named_and_enters_no_ledger(play, monkeypatch, name, method, answer, sentence):
    observations = (*ALIKE, (2, "alpha", 5), (3, "bravo", 12))
    untouched = alone(play, *observations)
    broken(monkeypatch, name, method, answer)
    memory, robots, _ = play(*observations, meet=(1,), rules=[{"name": "first", **RULE}])
    assert sentence in failures(memory)[0]
    alpha = robots["alpha"]
    assert alpha.own.encoded_layer() == untouched
    assert not alpha.merges
    assert alpha.reversal.fused() is alpha.reversal.own()
    assert told(memory)[-1] in ("rejected", "reverted")


def _contribution(**changes):
    def fuse(_self, map_type, target, source, match):
        T = match.T_receiver_donor.snapped()
        placed = map_type.place(source.layer, T)
        good = Contribution(source.provenance, placed, T, 1.0, "", None, None, map_type.region(placed))
        return dataclasses.replace(good, **changes)

    return fuse


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"layer": None}, "where a layer of beacons was wanted"),
        ({"T_receiver_donor": Transform(SHEARED.copy())}, "must be rigid"),
        ({"T_receiver_donor": Transform.planar(0.1234567891, 0, 0)}, "not in fixed point"),
        ({"scale": math.nan}, "gave a scale of nan"),
        ({"provenance": Provenance("mallory", 1, 1)}, "the donor's was"),
        ({"region": None}, "gave a region of type NoneType"),
        ({"role": "bribe"}, "in the role 'bribe'"),
        ({"summary": 5}, "gave a summary of type int"),
    ],
)
@pytest.mark.parametrize("reversal", ("ledger", "multi_map", "single_map"))
def test_a_contribution_is_checked_before_it_enters(play, monkeypatch, changes, sentence, reversal):
    untouched = alone(play, *ALIKE, LATER)
    broken(monkeypatch, "Sum", "fuse", _contribution(**changes))
    memory, robots, _ = play(*ALIKE, LATER, meet=(1,), rules=[{"name": "first", **RULE}], reversal=reversal)
    assert sentence in failures(memory)[0]
    assert robots["alpha"].own.encoded_layer() == untouched
    assert dict(robots["alpha"].reversal.fused().counts) == {0: 1, 2: 1, 5: 2}


@pytest.mark.parametrize("reversal", ("ledger", "multi_map", "single_map"))
def test_what_the_map_type_cannot_show_does_not_enter(play, monkeypatch, reversal):
    original = beacons.Beacons.view
    absorb = beacons.Beacons.absorb

    def view(self, own, contributions=(), previous=None, touched=None):
        if contributions:
            raise ZeroDivisionError("no such sum")
        return original(self, own, contributions, previous, touched)

    def refuse(self, layer, contribution):
        absorb(self, layer, contribution)  # half of the work is done when it fails
        raise ZeroDivisionError("no such sum")

    monkeypatch.setattr(beacons.Beacons, "view", view)
    monkeypatch.setattr(beacons.Beacons, "absorb", refuse)
    memory, robots, _ = play(*ALIKE, LATER, meet=(1,), reversal=reversal)
    assert failures(memory) == ["the map type 'beacons' failed: ZeroDivisionError: no such sum"]
    assert dict(robots["alpha"].reversal.fused().counts) == {0: 1, 2: 1, 5: 2}
    assert not robots["alpha"].merges


def test_the_run_goes_on_with_the_next_rule(play, monkeypatch):
    class Failing(beacons.Slide):
        def match(self, target, source, prior=None):
            raise OSError("no network")

    monkeypatch.setattr(beacons, "SlideNear", Failing)
    first = {"name": "broken", **RULE, "match": {"use": "slide_near"}, "priority": 5}
    memory, robots, _ = play(*ALIKE, (2, "alpha", 5), meet=(1,), rules=[{"name": "sound", **RULE}, first])
    assert told(memory)[:3] == ["offered", "failed", "merged"]
    (failed,) = [event for event in memory.events if event.receiver == "alpha" and event.kind == "failed"]
    assert (failed.by, failed.rule) == ("matcher slide_near", "broken")
    assert failed.reason == "the matcher 'slide_near' failed: OSError: no network"
    assert robots["alpha"].merges["bravo"].tools.rule.name == "sound"


def test_a_plugin_that_fails_too_often_is_not_asked_again(play, monkeypatch):
    calls = []

    def match(*_):
        calls.append(1)
        raise OSError("no network")

    broken(monkeypatch, "Slide", "match", match)
    further = [(2 * n, name, n) for n in range(1, 9) for name in ("alpha", "bravo")]
    memory, _, _ = play(*ALIKE, *further, meet=range(1, 18, 2), rules=[{"name": "first", **RULE}])
    assert len(calls) == LimitsConfig().failures
    assert len([event for event in memory.events if event.kind == "failed"]) == len(calls)
    assert "is not asked again" in memory.events[-1].reason


def test_a_merge_that_cannot_be_verified_any_more_goes_unless_it_was_confirmed(play, monkeypatch):
    update = beacons._Disagreeing.update
    for confirmed in (False, True):
        calls = []

        def failing(self, step, calls=calls, confirmed=confirmed):
            calls.append(step)
            if len(calls) > (12 if confirmed else 4):
                raise IndexError("boom")
            return update(self, step)

        monkeypatch.setattr(beacons._Disagreeing, "update", failing)
        further = [(2 + n, "alpha", (0, 2, 5)[n % 3]) for n in range(14)]
        memory, robots, _ = play(*ALIKE, *further, meet=(1,))
        assert failures(memory)[0] == "the metric 'disagreement' failed: IndexError: boom"
        assert ("bravo" in robots["alpha"].merges) is confirmed
        if confirmed:
            assert robots["alpha"].merges["bravo"].unwatched
        else:
            assert not robots["alpha"].attempts.refusals.by_donor, "the place did nothing wrong"


def test_a_map_type_that_fails_ends_its_robots_part_and_nobody_elses(play, monkeypatch):
    integrate = beacons.Beacons.integrate

    def failing(self, layer, observation):
        if observation.robot == "bravo" and observation.stamp_ns >= 2 * SECOND:
            raise KeyError("lost")
        return integrate(self, layer, observation)

    monkeypatch.setattr(beacons.Beacons, "integrate", failing)
    more = ((2, "bravo", 11), (3, "bravo", 13), (3, "alpha", 5), (4, "alpha", 2))
    memory, robots, _ = play(*ALIKE, *more, meet=(1, 3.5))
    assert failures(memory, "bravo") == ["the map type 'beacons' failed: KeyError: 'lost'"]
    assert robots["bravo"].left_out.count == 2
    assert robots["alpha"].reversal.version == 3
    assert "bravo" in robots["alpha"].merges, "what it had sent before is sound"


def test_what_a_map_type_refuses_is_left_out_and_counted(play, monkeypatch):
    integrate = beacons.Beacons.integrate

    def refusing(self, layer, observation):
        if observation.stamp_ns == 2 * SECOND:
            raise MapError("a beacon at 9 is too far away")
        return integrate(self, layer, observation)

    monkeypatch.setattr(beacons.Beacons, "integrate", refusing)
    _, robots, _ = play((0, "alpha", 1), (2, "alpha", 9), (3, "alpha", 2))
    assert dict(robots["alpha"].reversal.own().counts) == {1: 1, 2: 1}
    (sentence,) = robots["alpha"].left_out.sentences("alpha")
    assert sentence == (
        "alpha: 1 observation did not enter the map; the first, at 2.000 s: a beacon at 9 is too far away"
    )


def test_a_person_is_told_once_per_failure_with_the_number_and_the_first_place(play, monkeypatch):
    broken(monkeypatch, "Slide", "match", IndexError("boom"))
    memory, robots, _ = play(*ALIKE, (2, "alpha", 5), (3, "bravo", 12), (4, "alpha", 2), meet=(1, 2.5, 3.5))
    guard = robots["alpha"].workshop.guard
    assert failure_sentences(memory.events, guard, 0) == [
        "the matcher 'slide' failed: IndexError: boom (3 times, the first at 1.0 s, alpha ← bravo)",
        "the matcher 'slide' failed 3 times (limits.failures) and is not asked again",
    ]
    once_more = dataclasses.replace(memory.events[-1], kind="failed", reason=guard.set_aside["matcher", "slide"])
    assert len(failure_sentences([*memory.events, once_more], guard, 0)) == 2
    assert failure_sentences([event for event in memory.events if event.kind != "failed"], Guard(), 0) == []


def test_a_sink_that_fails_is_not_the_map_types_fault(play, monkeypatch):
    def full(self, snapshot):
        raise OutputError("the disk is full")

    monkeypatch.setattr(MemorySink, "mapped", full)
    with pytest.raises(OutputError, match=r"^the disk is full$"):
        play(*ALIKE, LATER, meet=(1,))


def test_what_a_sink_takes_is_not_the_map_types_time(play, monkeypatch):
    mapped = MemorySink.mapped

    def slow(self, snapshot):
        until = time.monotonic() + 4 * SHORT.plugin_s
        while time.monotonic() < until:
            pass
        mapped(self, snapshot)

    monkeypatch.setattr(MemorySink, "mapped", slow)
    memory, _, _ = play(*ALIKE, LATER, meet=(1,), limits=SHORT)
    assert not failures(memory)
    assert [snapshot.why for snapshot in memory.snapshots if snapshot.robot == "alpha"][-1] == "end"


def _forever() -> None:
    while True:
        pass


def _stubborn() -> None:
    while True:
        try:
            _forever()
        except Exception:  # what a careless plugin does
            continue


@pytest.mark.parametrize("hang", [_forever, _stubborn, lambda: time.sleep(3600), threading.Event().wait])
def test_a_call_that_takes_too_long_is_ended(hang):
    guard = Guard(SHORT)
    with guard.armed():
        sentence = r"the matcher 'slow' took longer than 0.05 s: .*limits.plugin_s"
        with pytest.raises(FailedPluginError, match=sentence), guard.calling("matcher", "slow"):
            hang()
        with guard.calling("matcher", "quick"):
            assert sum(range(10)) == 45


def test_one_that_took_too_long_is_set_aside_at_once_and_the_innermost_is_to_blame():
    guard = Guard(SHORT)
    blamed = pytest.raises(FailedPluginError)
    with guard.armed(), blamed as caught, guard.calling("matcher", "outer"), guard.calling("metric", "inner"):
        _forever()
    assert caught.value.plugin == ("metric", "inner")
    guard.note(caught.value)
    assert "took too long" in guard.set_aside["metric", "inner"]
    assert guard.refused("metric", "inner")
    assert not guard.refused("matcher", "outer")


def test_whoever_asks_others_without_end_is_to_blame_and_not_they():
    guard = Guard(SHORT)
    with guard.armed(), pytest.raises(FailedPluginError) as caught, guard.calling("matcher", "outer"):
        while True:
            with guard.calling("metric", "inner"):
                sum(range(100))
    assert caught.value.plugin == ("matcher", "outer")


def test_without_the_main_thread_there_is_no_limit_but_failures_are_named():
    seen: list[BaseException] = []

    def work() -> None:
        guard = Guard(SHORT)
        try:
            with guard.armed(), guard.calling("matcher", "m"):
                time.sleep(0.1)
                raise ValueError("no")
        except FailedPluginError as error:
            seen.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert str(seen[0]) == "the matcher 'm' failed: ValueError: no"


@pytest.mark.parametrize(
    ("error", "passes"), [(MapError("no"), True), (KeyboardInterrupt(), True), (SystemExit(3), False)]
)
def test_what_passes_and_what_is_a_failure(error, passes):
    with pytest.raises(type(error) if passes else FailedPluginError), Guard().calling("matcher", "m"):
        raise error

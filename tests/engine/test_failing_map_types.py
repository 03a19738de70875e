"""A map type that fails, refuses, hangs or gives nonsense, whatever it is asked for, and whoever asks it."""

from __future__ import annotations

import copy
import time
from dataclasses import replace
from datetime import UTC, datetime

import beacons
import numpy as np
import pytest

from mapgraft.audit import same_map
from mapgraft.config import LimitsConfig
from mapgraft.contracts import (
    MapError,
    MapMetadata,
    OutputMessage,
    PartedType,
    PreviewedType,
    Provenance,
    Reset,
    Transform,
)
from mapgraft.errors import FailedPluginError, MapgraftError, PluginError, SetAsideError
from mapgraft.guard import Guard
from mapgraft.guarded_map_type import OPTIONAL, GuardedMapType
from mapgraft.outputs.provenance import RunProvenance
from mapgraft.outputs.run_folder import RunFolder
from mapgraft.procedures import METHODS
from mapgraft.replay import Network

REVERSALS = ("ledger", "multi_map", "single_map")
LIMITS = LimitsConfig(plugin_s=0.5)
MAP_TYPE = "map type beacons"
SHOWING = ("messages", "files")  # what outputs ask for
ALL = tuple(method for method in METHODS["map type"] if method not in (*SHOWING, "structure", "known_region"))
TRAVELLING = ("parts", "join")  # what beacons have for their way
ASKED = {  # in a replay, by how a robot keeps what it merges
    "ledger": (*(method for method in ALL if method not in ("absorb", "reset", "decode")), *TRAVELLING),
    "multi_map": (*(method for method in ALL if method != "reset"), *TRAVELLING),
    "single_map": (*ALL, *TRAVELLING),
}
# alpha takes bravo in, hears more, takes bravo's newer map in, hears what bravo did not, and takes it out again
TOLD = (
    *((0, "alpha", 0, 2, 5), (0, "bravo", 10, 12, 15), (2, "alpha", 5), (2, "bravo", 12), (4, "alpha", 2)),
    *((5, "alpha", 3), (6, "alpha", 0), (7, "bravo", 15), (8, "alpha", 5)),
)
MEET = (1, 3, 7.5)


def boom(*_args, **_named):
    raise ZeroDivisionError("boom")


def refuse(*_args, **_named):
    raise MapError("refused here")


def nothing(*_args, **_named):
    return None


def hang(*_args, **_named):
    time.sleep(3600)


def from_call(method: str, number: int, wrong, calls: list[str]):
    """Beacons whose method is wrong from one call on; ``calls`` notes each."""
    right = getattr(beacons.Beacons, method)

    def asked(self, *args, **named):
        calls.append(method)
        return (right if len(calls) <= number else wrong)(self, *args, **named)

    return asked


def played(play, monkeypatch, method: str, number: int, wrong, **how):
    """A replay with the method broken, and how often it was asked; a sentence and None where it ended with one."""
    guard, calls = Guard(how.pop("limits", LimitsConfig())), list[str]()
    with monkeypatch.context() as patch:
        patch.setattr(beacons.Beacons, method, from_call(method, number, wrong, calls))
        try:
            memory, robots, _ = play(*TOLD, meet=MEET, guard=guard, **how)
        except MapgraftError as error:
            assert not isinstance(error, SetAsideError)
            return str(error), None, calls
    guard.set_aside.clear()
    return memory, robots, calls


def must_be_sound(robots) -> None:
    """What stands is what was merged, and the fused map is that of the layers."""
    for robot in robots.values():
        standing = {merge.merge_id for merge in robot.merges.values()}
        assert all(merge.state in ("provisional", "confirmed") for merge in robot.merges.values())
        if robot.reversal.name != "single_map" and not robot.left_out.count:
            assert set(robot.reversal.contributions) == standing
            fresh = robot.reversal.recomputed(beacons.Beacons())
            assert same_map(beacons.Beacons(), robot.reversal.fused(), fresh)


@pytest.fixture(scope="module")
def numbers():
    """How often each method is called when nothing is wrong, by reversal; filled by the tests."""
    return {}


@pytest.mark.parametrize(("reversal", "method"), [(name, method) for name in REVERSALS for method in ASKED[name]])
@pytest.mark.parametrize(
    ("wrong", "share"),
    [(hang, 0.0), *((wrong, share) for wrong in (boom, nothing, refuse) for share in (0.0, 0.5, 0.9))],
)
def test_the_run_goes_on_and_the_map_type_is_named(play, monkeypatch, numbers, reversal, method, wrong, share):
    if (reversal, method) not in numbers:
        memory, robots, calls = played(play, monkeypatch, method, 1_000_000, boom, reversal=reversal)
        assert not [event for event in memory.events if event.kind == "failed"]
        must_be_sound(robots)
        numbers[reversal, method] = len(calls), {name: robot.own.encoded_layer() for name, robot in robots.items()}
    total, layers = numbers[reversal, method]
    assert total
    limits = LIMITS if wrong is hang else LimitsConfig()
    memory, robots, calls = played(
        play, monkeypatch, method, int(total * share), wrong, reversal=reversal, limits=limits
    )
    if robots is None:  # not even an empty layer can be had: nothing begins
        assert method in ("new_layer", "region")
        assert wrong is refuse or memory.startswith("the map type 'beacons' ")
        return
    assert len(calls) > int(total * share), "it was asked"
    must_be_sound(robots)
    failed = [event for event in memory.events if event.kind == "failed"]
    if wrong is not refuse:
        assert failed
        assert {event.by for event in failed} == {MAP_TYPE}
        assert len(failed) < 12
    if method != "integrate" and reversal != "single_map":  # which offers what it had before its first merge
        left = {name for name, robot in robots.items() if robot.failed}
        assert all(robots[name].own.encoded_layer() == layers[name] for name in layers if name not in left)


@pytest.mark.parametrize("reversal", REVERSALS)
@pytest.mark.parametrize("wrong", [boom, nothing, refuse])
def test_a_revert_that_the_map_type_fails_at_leaves_the_merge_standing_and_ends_the_robots_part(
    play, monkeypatch, reversal, wrong
):
    """A ledger asks it for nothing; the level that multiple maps drop is the topmost."""
    memory, robots, _ = played(play, monkeypatch, "reset", 0, wrong, reversal=reversal)
    alpha, of_alpha = robots["alpha"], [event for event in memory.events if event.receiver == "alpha"]
    if reversal != "single_map":
        assert "reverted" in [event.kind for event in of_alpha]
        assert not alpha.failed
        return
    (failed,) = [event for event in of_alpha if event.kind == "failed"]
    assert failed.by == MAP_TYPE
    assert failed.reason.endswith("alpha.bravo.1, which was to be reverted (1 beacons disagree, 0 may), stands")
    assert (failed.merge_id, failed.state) == ("alpha.bravo.1", "provisional")
    assert alpha.failed == failed.reason
    assert alpha.merges
    assert alpha.left_out.count == 2, "what alpha heard later"
    assert dict(alpha.reversal.fused().counts)[0] == 2, "the map is as before"


def test_below_the_topmost_level_multiple_maps_are_built_again_or_stand(play, monkeypatch):
    """With charlie merged over bravo, bravo cannot be taken out without the map type."""
    told = [(0, "charlie", 20, 22, 25), *TOLD]
    how = {"meet": (1,), "reversal": "multi_map", "rules": [{"name": "lenient", **LENIENT}]}
    _, robots, _ = play(*told, **how)
    alpha = robots["alpha"]
    assert list(alpha.merges) == ["bravo", "charlie"]
    monkeypatch.setattr(beacons.Beacons, "decode", boom)
    before = dict(alpha.reversal.fused().counts)
    with pytest.raises(FailedPluginError):
        alpha.reversal.revert("alpha.bravo.1")
    assert dict(alpha.reversal.fused().counts) == before
    alpha.reversal.revert("alpha.charlie.1")
    assert set(alpha.reversal.contributions) == {"alpha.bravo.1"}


LENIENT = {
    "match": {"use": "slide"},
    "accept": {"use": "first_one"},
    "fuse": {"use": "sum"},
    "verify": {"use": "at_most", "metrics": ["disagreement"], "every": 1, "limit": 99},
}


@pytest.mark.parametrize("wrong", [boom, nothing, refuse, hang])
@pytest.mark.parametrize("previews", [False, True])
def test_a_layer_that_cannot_be_cut_goes_as_a_whole(play, monkeypatch, wrong, previews):
    how = {"limits": LIMITS, "network": Network(previews=previews)}
    memory, robots, calls = played(play, monkeypatch, "parts", 0, wrong, **how)
    assert calls
    failed = [event for event in memory.events if event.kind == "failed"]
    if wrong is not refuse:
        assert {event.by for event in failed} == {MAP_TYPE}
        assert len([event for event in failed if "again" in event.reason]) <= len(robots)
    assert not any(robot.failed for robot in robots.values())
    kinds = {event.kind for event in memory.events}
    assert {"merged", "updated", "reverted"} <= kinds, "all goes on as without parts"


@pytest.mark.parametrize("wrong", [boom, nothing, refuse, hang])
def test_a_map_that_cannot_be_previewed_is_looked_at_itself(play, monkeypatch, wrong):
    how = {"limits": LIMITS, "network": Network(previews=True)}
    undisturbed, _, seen = played(play, monkeypatch, "preview", 1_000_000, wrong, **how)
    assert seen, "previews are asked for"
    memory, robots, calls = played(play, monkeypatch, "preview", 0, wrong, **how)
    assert calls
    failed = [event for event in memory.events if event.kind == "failed"]
    assert {event.by for event in failed} == (set() if wrong is refuse else {MAP_TYPE})
    assert not any(robot.failed for robot in robots.values())
    merges = [event.merge_id for event in memory.events if event.kind == "merged"]
    assert merges == [event.merge_id for event in undisturbed.events if event.kind == "merged"]


@pytest.mark.parametrize("wrong", [boom, nothing, refuse, hang])
def test_what_came_and_cannot_be_joined_ends_nobodys_part(play, monkeypatch, wrong):
    memory, robots, calls = played(play, monkeypatch, "join", 0, wrong, limits=LIMITS)
    assert calls
    failed = [event for event in memory.events if event.kind == "failed"]
    assert {event.by for event in failed} == (set() if wrong is refuse else {MAP_TYPE})
    assert not any(robot.failed or robot.merges for robot in robots.values())


@pytest.mark.parametrize("method", SHOWING)
@pytest.mark.parametrize("wrong", [boom, nothing, refuse, hang])
def test_what_cannot_be_shown_or_written_is_an_event_and_the_rest_is_there(play, monkeypatch, tmp_path, method, wrong):
    guard = Guard(LIMITS if wrong is hang else LimitsConfig())
    provenance = RunProvenance("0", "", "", [], datetime(2026, 1, 1, tzinfo=UTC), "host", {})
    monkeypatch.setattr(beacons.Beacons, method, wrong)
    with RunFolder(tmp_path / "out", "beacons", "r1", provenance, guard=guard) as folder:
        memory, robots, _ = play(*TOLD, meet=MEET, guard=guard, sinks=[folder])
        with guard.armed():
            folder.write_maps()
        for robot, error in guard.take_untold():
            robots[robot].complain(error, 9)
    failed = [event for event in memory.events if event.kind == "failed"]
    assert {event.by for event in failed} == (set() if wrong is refuse else {MAP_TYPE})
    assert any("the map" in sentence for sentence in folder.unshown)
    assert "merged" in [event.kind for event in memory.events]
    assert (tmp_path / "out" / "beacons.merge.mcap").exists()
    assert not robots["alpha"].failed


LAYER = beacons.Heard()
MAP = beacons.Chart({1: 1})
NOWHERE = beacons.Places(frozenset())
ARGUMENTS = {
    "new_layer": (),
    "integrate": (LAYER, None),
    "view": (LAYER,),
    "place": (LAYER, Transform.identity()),
    "absorb": (LAYER, None),
    "reset": (LAYER, NOWHERE, NOWHERE),
    "region": (LAYER,),
    "known_region": (MAP,),
    "encode": (LAYER,),
    "decode": (b"[]",),
    "metadata": (LAYER,),
    "structure": (MAP,),
    "messages": (MAP,),
    "files": (MAP, "alpha"),
    "parts": (LAYER,),
    "join": ({},),
    "preview": (LAYER,),
}
NONSENSE = [
    *((method, None, "gave ") for method in ARGUMENTS),
    *((method, 5, "gave ") for method in ARGUMENTS),
    ("view", beacons.Chart({}, "cloud"), "where a map of type beacons was wanted"),
    ("place", beacons.Heard(map_type="cloud"), "where a layer of beacons was wanted"),
    ("reset", Reset(None, 0, 0), "where a region was wanted"),
    ("reset", Reset(NOWHERE, -1, 0), "as the number of cells reset"),
    ("reset", Reset(NOWHERE, 0, True), "as the number of cells contaminated"),
    ("metadata", MapMetadata("cloud"), "of a map of type beacons"),
    ("metadata", MapMetadata("beacons", resolution_m=float("nan")), "gave a resolution of nan"),
    ("metadata", MapMetadata("beacons", bounds_m=(0.0, 0.0, 1.0)), "x_min, y_min, x_max and y_max"),
    ("metadata", MapMetadata("beacons", bounds_m=(0.0, 0.0, 1.0, float("inf"))), "gave a bound of inf"),
    ("metadata", MapMetadata("beacons", sensor=None), "gave a sensor of type NoneType"),
    ("structure", np.zeros(3), "where positions"),
    ("structure", np.zeros((3, 4)), "where positions"),
    ("messages", [OutputMessage("map", "std_msgs/msg/String", {}), 5], "gave 5 among its messages"),
    ("files", {"alpha.csv": "text"}, "of type str, bytes were wanted"),
    ("files", {5: b""}, "a file's name of type int"),
    ("parts", {"0": b""}, "gave a part named '0', at most 64 bytes were wanted"),
    ("parts", {bytes(65): b""}, "gave a part named a bytes, at most 64 bytes were wanted"),
    ("parts", {b"0": "text"}, "gave a part of type str, bytes were wanted"),
    ("join", beacons.Heard(map_type="cloud"), "where a layer of beacons was wanted"),
    ("preview", beacons.Heard(map_type="cloud"), "where a layer of beacons was wanted"),
]


def broken(method: str, answer) -> tuple[GuardedMapType, Guard]:
    guard, kind = Guard(LIMITS), beacons.Beacons()
    setattr(kind, method, answer if callable(answer) else lambda *_args, **_named: answer)
    return GuardedMapType(kind, guard), guard


@pytest.mark.parametrize(
    ("extra", "sentence"),
    [
        (
            {"story": "and then " * 2000},
            "bytes about its map, of which others read at most 16,384",
        ),
        ({"places": [1, 2]}, "tells about its map what others do not take: an offer of "),
        ({"places": {1, 2}}, "failed: TypeError: Object of type set is not JSON serializable"),
    ],
)
def test_who_tells_of_its_map_what_nobody_would_read_is_named(play, monkeypatch, extra, sentence):
    """Only alpha does; the others could not even say whose messages they were, and merge each other."""
    right = beacons.Beacons.metadata

    def metadata(self, layer):
        told = right(self, layer)
        return replace(told, extra=extra) if 0 in layer.evidence() else told

    monkeypatch.setattr(beacons.Beacons, "metadata", metadata)
    told = ((0, "alpha", 0, 2, 5), (0, "bravo", 10, 12, 15), (0, "charlie", -20, -18, -15), (2, "alpha", 5))
    memory, robots, exchange = play(*told, meet=(1, 2))
    (failed,) = [event for event in memory.events if event.kind == "failed"]
    assert (failed.receiver, failed.by) == ("alpha", MAP_TYPE)
    assert failed.reason.startswith("the map type 'beacons' ") and sentence in failed.reason
    assert {name: list(robot.merges) for name, robot in robots.items()} == {
        "alpha": [],
        "bravo": ["charlie"],
        "charlie": ["bravo"],
    }
    assert exchange.traffic.unread == {}


def test_every_method_of_the_contract_is_guarded():
    assert set(ARGUMENTS) == set(METHODS["map type"]) | set(OPTIONAL)
    assert set(ARGUMENTS) - set(OPTIONAL) <= set(vars(GuardedMapType))


def test_a_guarded_map_type_has_parts_and_previews_if_it_has_them():
    with_, without = GuardedMapType(beacons.Beacons(), Guard()), GuardedMapType(Plain(), Guard())
    for protocol in (PartedType, PreviewedType):
        assert isinstance(with_, protocol)
        assert not isinstance(without, protocol)
    assert not hasattr(without, "parts")
    assert copy.copy(with_).join(with_.parts(LAYER)) == LAYER


class Plain:
    """What there must be of a map type to be looked at."""

    name = "plain"


@pytest.mark.parametrize(("method", "answer", "sentence"), NONSENSE)
def test_nonsense_is_named(method, answer, sentence):
    kind, _ = broken(method, answer)
    with pytest.raises(FailedPluginError, match=r"^the map type 'beacons' gave ") as caught:
        getattr(kind, method)(*ARGUMENTS[method])
    assert sentence in str(caught.value)
    assert (caught.value.plugin, caught.value.method) == (("map type", "beacons"), method)


@pytest.mark.parametrize("method", ARGUMENTS)
def test_what_hangs_is_ended_and_only_that_is_not_asked_again(method):
    kind, guard = broken(method, hang)
    with guard.armed(), pytest.raises(FailedPluginError, match=r"took longer than 0.5 s") as caught:
        getattr(kind, method)(*ARGUMENTS[method])
    guard.note(caught.value)
    if method == "integrate":  # that ends the robot's part
        assert not guard.set_aside
        return
    sentence = f"the map type 'beacons' took too long and is not asked for its {method} again"
    with pytest.raises(SetAsideError, match=sentence):
        getattr(kind, method)(*ARGUMENTS[method])
    other = "encode" if method != "encode" else "region"
    assert getattr(kind, other)(*ARGUMENTS[other]) is not None


def test_a_tool_that_is_handed_a_map_type_cannot_tell_and_is_not_to_blame():
    kind, guard = broken("place", boom)
    assert isinstance(kind, beacons.Beacons)
    assert kind.spacing_m == 1.0
    with pytest.raises(FailedPluginError) as caught, guard.calling("fuser", "sum"):
        beacons.Sum().fuse(kind, MAP, beacons.Donation(LAYER, Provenance("bravo", 1, 1)), SOUND)
    assert str(caught.value) == "the map type 'beacons' failed: ZeroDivisionError: boom"


SOUND = beacons.Match(Transform.identity(), 3.0, 1.0)


def test_a_map_type_without_a_name_is_none():
    kind = beacons.Beacons()
    kind.name = None
    with pytest.raises(PluginError, match="a text was wanted"):
        GuardedMapType(kind, Guard())

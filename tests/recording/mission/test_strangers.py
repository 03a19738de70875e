"""Plugins that read: those that raise or hang are named, and the rest of the mission goes on."""

from __future__ import annotations

import itertools
import sys
import types

import pytest

from mapgraft.config import parse_config
from mapgraft.contracts import Descriptor, PluginError, RecordingError
from mapgraft.plugins import Offered, Origin, Plugins
from mapgraft.recording.containers.mcap_file import McapSource
from mapgraft.recording.mission import open_mission

TAGS = "geometry_msgs/msg/PoseStamped"


def forever() -> None:
    for n in itertools.count():
        if n < 0:
            break


class Fragile(McapSource):
    """A stranger's source that breaks after some messages when it is read the way a mission is."""

    breaks = staticmethod(lambda: None)
    after = 100

    def messages(self, topics=None, start_ns=None, end_ns=None):
        for n, raw in enumerate(super().messages(topics, start_ns, end_ns)):
            if n >= self.after:
                type(self).breaks()
            yield raw


def raises() -> None:
    raise KeyError("a stranger's fault")


@pytest.fixture
def offering(monkeypatch):
    """``offering(kind, function, **descriptor)``: plugins that offer the function, as an entry point would."""

    def offer(kind, function, **more) -> Plugins:
        module = types.ModuleType("plugin_of_a_stranger")
        module.function = function
        monkeypatch.setitem(sys.modules, module.__name__, module)
        descriptor = Descriptor("odd", f"{module.__name__}:function", "", **more)
        return Plugins({(kind, "odd"): Offered(kind, descriptor, Origin("test", "test", "1"))})

    return offer


def config_of(**limits):
    return parse_config({"limits": limits})


@pytest.mark.parametrize(("breaks", "said"), [(raises, "failed: KeyError"), (forever, "took longer than 0.3 s")])
def test_a_reader_that_fails_on_the_way_ends_its_recording_there(record, offering, monkeypatch, breaks, said):
    path = record("run").drive(8).write().rename(record("run").path.with_suffix(".odd"))
    sound = record("sound").drive(8).write()
    monkeypatch.setattr(Fragile, "breaks", staticmethod(breaks))
    monkeypatch.setattr(Fragile, "after", 1 << 30)  # not while it is looked at
    plugins = offering("reader", Fragile, accepts=(".odd",))
    with open_mission([path, sound], config_of(plugin_s=0.3), plugins=plugins) as mission, mission.guard.armed():
        monkeypatch.setattr(Fragile, "after", 200)
        seen = [observation.robot for observation in mission.observations()]
        assert seen.count("sound") == 40 and 5 < seen.count("run") < 40
        (fault,) = [fault for name, fault in mission.faults if name == path.name]
    assert fault.cause == "reader_failed"
    assert f"the reader 'odd' {said}" in fault.sentence and fault.sentence.endswith("the recording ends there")


@pytest.mark.parametrize(("breaks", "said"), [(raises, "failed: KeyError"), (forever, "took longer than 0.1 s")])
def test_a_reader_that_cannot_open_a_file_is_named(record, offering, breaks, said):
    path = record("run").drive(2).write().rename(record("run").path.with_suffix(".odd"))
    plugins = offering("reader", lambda path: breaks(), accepts=(".odd",))
    with pytest.raises(PluginError, match=rf"run\.odd cannot be read: the reader 'odd' {said}"):
        open_mission([path], config_of(plugin_s=0.1), plugins=plugins)


def test_what_a_reader_says_on_purpose_comes_through(record, offering):
    def refuse(path):
        raise RecordingError("this is not my kind of file")

    path = record("run").drive(2).write().rename(record("run").path.with_suffix(".odd"))
    with pytest.raises(RecordingError, match=r"^this is not my kind of file$"):
        open_mission([path], config_of(), plugins=offering("reader", refuse, accepts=(".odd",)))


def tagged(record):
    file = record("run")
    file.static("base_link", "mast")
    for k in range(41):
        file.tf(k / 20, "odom", "base_link", 0.1 * k)
        file.pose(k / 20, "mast", 0.0, 0.0, 0.0, "/tags")
    return file.write()


def test_a_decoder_that_takes_too_long_is_not_asked_again(record, offering):
    asked: list[object] = []

    def hang(message) -> object:
        asked.append(message)
        if len(asked) > 10:
            forever()
        return len(asked)

    plugins = offering("decoder", hang, accepts=(TAGS,), gives="tag")
    with open_mission([tagged(record)], config_of(plugin_s=0.1), plugins=plugins) as mission, mission.guard.armed():
        assert len(list(mission.observations())) == 10
        (sentence,) = mission.tally.sentences()
    assert len(asked) == 11
    assert "31 of 41 tags on /tags were left out (undecodable)" in sentence and "took longer than 0.1 s" in sentence


def test_a_decoder_that_fails_costs_the_message(record, offering):
    asked: list[object] = []

    def fail(message) -> object:
        asked.append(message)
        return raises() if len(asked) % 2 else len(asked)

    plugins = offering("decoder", fail, accepts=(TAGS,), gives="tag")
    with open_mission([tagged(record)], config_of(), plugins=plugins) as mission:
        assert len(list(mission.observations())) == 20
        assert "the decoder 'odd' failed: KeyError" in mission.tally.sentences()[0]

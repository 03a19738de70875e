"""The layers of others that one robot holds: of each source the newest, in whatever order they come."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from mapgraft.contracts import Provenance
from mapgraft.exchange import SentLayer
from mapgraft.graph.claims import Source
from mapgraft.graph.held import HeldLayers

A = Source("a", 1)
WRITERS = [b"1", b"2"]


def sent(name: str, version: int, writer: bytes) -> SentLayer:
    return SentLayer(Provenance(name, 1, version), "grid", "whole", dict, 0, writer=writer)


SENT = st.lists(st.builds(sent, st.sampled_from("ab"), st.integers(0, 3), st.sampled_from(WRITERS)))


def told(layers: HeldLayers) -> dict[Source, tuple[bytes, int]]:
    held = {source: layers.sent(source) for source in layers}
    return {source: (one.writer, one.provenance.version) for source, one in held.items()}


@given(SENT, st.randoms(use_true_random=False))
def test_the_newest_of_the_one_who_has_the_name_is_held_whatever_came_first(layers, random):
    one, other = HeldLayers(), HeldLayers()
    for layer in layers:
        one.add(layer)
    for layer in random.sample(layers, len(layers)):
        before = other.changes
        assert other.add(layer) == (other.changes > before)
    assert told(one) == told(other)
    for source, found in told(one).items():
        mine = [layer for layer in layers if layer.provenance.source == source.name]
        assert found == max((layer.writer, layer.provenance.version) for layer in mine if layer.writer == found[0])
        assert found[0] == min(layer.writer for layer in mine)


def test_what_is_another_robots_is_forgotten():
    layers = HeldLayers()
    layers.add(sent("a", 7, b"2"))
    before = layers.changes
    layers.belongs(A, b"2")
    assert layers.version(A) == 7 and layers.changes == before
    layers.belongs(A, b"1")
    assert layers.version(A) is None and layers.changes > before
    assert layers.add(sent("a", 3, b"1")) and not layers.add(sent("a", 9, b"2"))

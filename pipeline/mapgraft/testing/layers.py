"""The laws of layers: how observations become evidence, and evidence becomes bytes."""

from __future__ import annotations

import dataclasses

from hypothesis import strategies as st

from mapgraft.contracts import MapError, Provenance
from mapgraft.exchange import MOST_OFFER, Offer
from mapgraft.testing.content import content_of
from mapgraft.testing.laws import BrokenLawError, Drawing, law, require
from mapgraft.testing.supply import Supply, layer_of, require_same_map, scene_of

_NO_LAYERS = (b"", b"\x00" * 64, b"no layer of anybody", bytes(range(256)))


class LayerLaws(Supply):
    """Observing, encoding and telling about one layer."""

    @law("name, Layer.map_type, Map.map_type and MapMetadata.type are one word")
    def test_names_are_one_word(self, drawing: Drawing) -> None:
        map_type, scene = self.make_map_type(), scene_of(self, drawing)
        layer = layer_of(map_type, scene.own)
        told = (layer.map_type, map_type.view(layer).map_type, map_type.metadata(layer).type)
        decoded = map_type.decode(map_type.encode(layer)).map_type
        for what, name in zip(("layer", "map", "metadata", "decoded layer"), (*told, decoded), strict=True):
            require(name == map_type.name, f"the {what} says {name!r}, the map type {map_type.name!r}")

    @law("a new layer knows nothing, and can be looked at, encoded and told about")
    def test_a_new_layer_is_empty(self, drawing: Drawing) -> None:
        map_type = self.make_map_type()
        layer = map_type.new_layer()
        known = (map_type.view(layer).known(), map_type.view(None).known(), len(map_type.region(layer)))
        require(known == (0, 0, 0), f"its view, the view of nothing and its region know {known} units")
        require(map_type.metadata(layer).observations == 0, "its metadata counts observations")
        require(len(map_type.structure(map_type.view(layer))) == 0, "something stands in it")
        again = map_type.decode(map_type.encode(layer))
        require(map_type.encode(again) == map_type.encode(layer), "it changes when it is encoded and decoded")

    @law("integrate writes its layer and nothing else: neither the observation nor another layer")
    def test_observing_writes_only_its_layer(self, drawing: Drawing) -> None:
        map_type, scene = self.make_map_type(), scene_of(self, drawing)
        other = layer_of(map_type, scene.own)
        copy = map_type.decode(map_type.encode(other))
        before, given = map_type.encode(other), content_of(scene.own)
        for observation in scene.own:
            map_type.integrate(copy, observation)
        require(content_of(scene.own) == given, "an observation was written")
        require(map_type.encode(other) == before, "another layer changed, of which this one was a copy")

    @law("integrate returns at least the units that it changes")
    def test_observing_tells_what_it_touched(self, drawing: Drawing) -> None:
        map_type, scene = self.make_map_type(), scene_of(self, drawing)
        layer = map_type.new_layer()
        seen, region = map_type.view(layer), map_type.region(layer)
        for n, observation in enumerate(scene.own, start=1):
            touched = map_type.integrate(layer, observation)
            grown = map_type.region(layer)
            untold = len(grown.minus(region).minus(touched))
            require(not untold, f"{untold} unit(s) that hold evidence since observation {n} were not touched by it")
            seen, region = map_type.view(layer, (), seen, touched), grown
            clause = f"after observation {n}, a view updated where integrate says it touched is not a fresh one"
            require_same_map(self, map_type, seen, map_type.view(layer), clause)

    @law("equal observations make equal layers: no chance, no clock, nothing remembered")
    def test_observing_is_deterministic(self, drawing: Drawing) -> None:
        scene = scene_of(self, drawing)
        one, other = self.make_map_type(), self.make_map_type()
        first = one.encode(layer_of(one, scene.own))
        require(one.encode(layer_of(other, scene.own)) == first, "two instances make different layers")
        layer_of(other, scene.donor)
        aside = self.make_map_type()
        aside.view(layer_of(aside, scene.donor))
        require(aside.encode(layer_of(aside, scene.own)) == first, "a layer differs after another one was made")

    @law("an observation of a kind that it does not map raises MapError and leaves the layer as it was")
    def test_what_cannot_be_mapped_is_refused(self, drawing: Drawing) -> None:
        map_type, scene = self.make_map_type(), scene_of(self, drawing)
        layer = layer_of(map_type, scene.own)
        before = map_type.encode(layer)
        foreign = dataclasses.replace(scene.own[0], kind="nothing_that_exists", payload=object())
        try:
            map_type.integrate(layer, foreign)
        except MapError:
            require(map_type.encode(layer) == before, "the layer changed although the observation was refused")
            return
        require(False, "it was taken without a word")

    @law("decode(encode(x)) equals x, and equal layers have equal bytes")
    def test_decoding_is_the_inverse(self, drawing: Drawing) -> None:
        map_type, scene = self.make_map_type(), scene_of(self, drawing)
        layer = layer_of(map_type, scene.own)
        data = map_type.encode(layer)
        require(isinstance(data, bytes), f"encode gives a {type(data).__name__}, not bytes")
        require(map_type.encode(layer) == data, "encoding twice gives different bytes")
        again = self.make_map_type().decode(data)
        require(map_type.encode(again) == data, "the decoded layer has other bytes")
        clause = "the decoded layer is seen differently"
        require_same_map(self, map_type, map_type.view(again), map_type.view(layer), clause)
        told = map_type.metadata(layer), map_type.metadata(again)
        require(content_of(told[0]) == content_of(told[1]), "the decoded layer tells other metadata")

    @law("a decoded layer is a live one of its own: observing goes on in it as in the original")
    def test_a_decoded_layer_lives_on(self, drawing: Drawing) -> None:
        map_type, scene = self.make_map_type(), scene_of(self, drawing)
        half = (len(scene.own) + 1) // 2
        layer = layer_of(map_type, scene.own[:half])
        before = map_type.encode(layer)
        copy = map_type.decode(before)
        for observation in (*scene.own[half:], scene.own[-1]):
            map_type.integrate(copy, observation)
        require(map_type.encode(layer) == before, "the original changed with its copy")
        for observation in (*scene.own[half:], scene.own[-1]):
            map_type.integrate(layer, observation)
        require(map_type.encode(layer) == map_type.encode(copy), "the original and its copy grew apart")

    @law("bytes that are no layer, or only a part of one, raise MapError")
    def test_damaged_bytes_are_refused(self, drawing: Drawing) -> None:
        map_type, scene = self.make_map_type(), scene_of(self, drawing)
        data = map_type.encode(layer_of(map_type, scene.own))
        cut = data[: drawing.draw(st.integers(0, max(0, len(data) - 1)))]
        for what, damaged in (*(("bytes of nobody", other) for other in _NO_LAYERS), ("the first part of one", cut)):
            try:
                map_type.decode(damaged)
            except MapError:
                continue
            require(False, f"{what} ({len(damaged)} of {len(data)} bytes) became a layer")
        for noise in (drawing.draw(st.binary(max_size=40)), _flipped(drawing, data)):
            try:
                map_type.encode(map_type.decode(noise))
            except MapError:
                continue

    @law("metadata are plain values that can be sent")
    def test_metadata_can_be_sent(self, drawing: Drawing) -> None:
        map_type, scene = self.make_map_type(), scene_of(self, drawing)
        layer = layer_of(map_type, scene.own)
        before = map_type.encode(layer)
        told = map_type.metadata(layer)
        try:
            data = Offer(Provenance("robot", 1, 1), told).encode()
        except TypeError as error:
            raise BrokenLawError(f"they cannot be written as JSON: {error}") from error
        require(len(data) <= MOST_OFFER, f"they take {len(data):,} bytes of JSON, {MOST_OFFER:,} are read")
        arrived = Offer.decode(data).metadata
        require(content_of(arrived) == content_of(told), f"told was {told}, what arrives is {arrived}")
        require(map_type.encode(layer) == before, "telling them changed the layer")
        box = told.bounds_m
        require(box is None or (box[0] <= box[2] and box[1] <= box[3]), f"the bounds {box} are upside down")


def _flipped(drawing: Drawing, data: bytes) -> bytes:
    """The bytes with one of them changed."""
    at = drawing.draw(st.integers(0, len(data) - 1))
    return data[:at] + bytes([data[at] ^ drawing.draw(st.integers(1, 255))]) + data[at + 1 :]

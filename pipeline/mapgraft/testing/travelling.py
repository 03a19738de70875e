"""The laws of layers that travel in parts or are previewed."""

from __future__ import annotations

from collections.abc import Iterator

from hypothesis import strategies as st

from mapgraft.contracts import Layer, MapError, PartedType, PreviewedType
from mapgraft.testing.content import content_of
from mapgraft.testing.laws import Drawing, law, require
from mapgraft.testing.supply import Supply, layer_of, require_moved, require_no_more_looks, same_region, scene_of

_WHOLE = "its layers travel as one part"
_UNSEEN = "it has no previews"
_LONGEST_NAME = 64


class TravellingLaws(Supply):
    """Cutting a layer into parts, joining them, and telling in few bytes what it looks like."""

    @law("joining the parts of a layer gives the layer", vacuous=_WHOLE)
    def test_joining_is_the_inverse_of_cutting(self, drawing: Drawing) -> None:
        map_type, other = self.make_map_type(), self.make_map_type()
        if not isinstance(map_type, PartedType) or not isinstance(other, PartedType):
            return
        for layer in _layers(self, drawing):
            before, parts = map_type.encode(layer), dict(map_type.parts(layer))
            given = dict(parts)
            again = other.join(parts)
            require(map_type.encode(again) == before, f"the layer of {len(parts)} joined parts is another one")
            require(map_type.encode(layer) == before and parts == given, "cutting or joining wrote what it was given")
            require(dict(other.parts(again)) == parts, "the joined layer is cut otherwise")
            told = content_of(map_type.metadata(layer)), content_of(map_type.metadata(again))
            require(told[0] == told[1], "the joined layer tells other metadata")
            long = [name for name in parts if not 0 < len(name) <= _LONGEST_NAME]
            require(not long, f"a part has a name of {len(long[0]) if long else 0} bytes")
        drawing.reached()

    @law("a joined layer is a live one of its own: observing goes on in it as in the original", vacuous=_WHOLE)
    def test_a_joined_layer_lives_on(self, drawing: Drawing) -> None:
        map_type, scene = self.make_map_type(), scene_of(self, drawing)
        if not isinstance(map_type, PartedType):
            return
        half = (len(scene.own) + 1) // 2
        layer = layer_of(map_type, scene.own[:half])
        before = map_type.encode(layer)
        copy = map_type.join(map_type.parts(layer))
        for observation in (*scene.own[half:], scene.own[-1]):
            map_type.integrate(copy, observation)
        require(map_type.encode(layer) == before, "the original changed with its copy")
        for observation in (*scene.own[half:], scene.own[-1]):
            map_type.integrate(layer, observation)
        require(map_type.encode(layer) == map_type.encode(copy), "the original and its copy grew apart")
        drawing.reached()

    @law(
        "parts that are damaged, or of which some are missing, are another layer's parts or raise MapError",
        vacuous=_WHOLE,
    )
    def test_damaged_parts_are_refused(self, drawing: Drawing) -> None:
        map_type = self.make_map_type()
        if not isinstance(map_type, PartedType):
            return
        layer = layer_of(map_type, scene_of(self, drawing).own)
        parts = dict(map_type.parts(layer))
        tried: list[dict[bytes, bytes]] = [{}, parts | {b"nobody's": b"nothing"}]
        if parts:
            name = drawing.draw(st.sampled_from(sorted(parts)), "the part")
            data = parts[name]
            fewer = {other: part for other, part in parts.items() if other != name}
            cut = data[: drawing.draw(st.integers(0, max(0, len(data) - 1)))]
            tried += [fewer, parts | {name: cut}, parts | {name: _flipped(drawing, data)}]
        for damaged in tried:
            try:
                told = dict(map_type.parts(map_type.join(damaged)))
            except MapError:
                continue
            require(told == damaged, f"of {len(damaged)} parts a layer was made that is cut into others")
        drawing.reached()

    @law("a preview shows the same map, and tells no more of it than that", vacuous=_UNSEEN)
    def test_a_preview_shows_the_map(self, drawing: Drawing) -> None:
        map_type = self.make_map_type()
        if not isinstance(map_type, PreviewedType):
            return
        for layer in _layers(self, drawing):
            before = map_type.encode(layer)
            preview = map_type.preview(layer)
            require(map_type.encode(layer) == before, "the layer changed")
            require(map_type.encode(map_type.preview(layer)) == map_type.encode(preview), "the next one is another")
            seen, shown = map_type.view(layer), map_type.view(preview)
            same = same_region(map_type.known_region(seen), map_type.known_region(shown))
            require(same, f"of {seen.known()} known units it shows {shown.known()}, or others")
            stands = map_type.structure(seen), map_type.structure(shown)
            require_moved(*stands, self.tolerance_m(map_type), 1.0, 1.0)
            require_no_more_looks(layer, preview, "in a preview")
        drawing.reached()


def _flipped(drawing: Drawing, data: bytes) -> bytes:
    """The bytes with one of them changed; another one where there is none."""
    if not data:
        return b"x"
    at = drawing.draw(st.integers(0, len(data) - 1))
    return data[:at] + bytes([data[at] ^ drawing.draw(st.integers(1, 255))]) + data[at + 1 :]


def _layers(supply: Supply, drawing: Drawing) -> Iterator[Layer]:
    """A layer that knows nothing, and one that was observed."""
    map_type, scene = supply.make_map_type(), scene_of(supply, drawing)
    yield map_type.new_layer()
    yield layer_of(map_type, scene.own)

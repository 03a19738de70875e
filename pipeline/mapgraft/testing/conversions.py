"""The laws of conversions from one map type to another."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from hypothesis import assume

from mapgraft.contracts import Conversion, EmptyMapError, Layer, MapError, MapType, Transform
from mapgraft.errors import MapgraftError
from mapgraft.testing.laws import BrokenLawError, Drawing, law, require
from mapgraft.testing.scenes import describe
from mapgraft.testing.supply import Supply, layer_of, near, require_moved, require_no_more_looks, scene_of, share_near

_NOT_COUNTED = "the layers of the two types do not both tell how often their units were seen (CountedLayer)"
_SEEN_ONCE = "in none of the scenes something stood that was seen more than once"
_ONE_WAY = "nobody says how else its layers can be read (make_other_source), or nothing reads otherwise so"
_NOTHING_STANDS = "nothing stands in any of the converted maps"


class ConversionLaws(Supply):
    """What a conversion promises; ``make_conversion`` and ``make_target`` must be written beside ``make_map_type``.

    ``make_map_type`` makes the type converted from, ``make_target`` the one converted to, and ``make_other_source``,
    where it is written, the type converted from with other thresholds. A conversion may leave out what the target has
    no word for: ``found_share`` of what stands must be found again.
    """

    examples: ClassVar[int] = 15
    placed_share: ClassVar[float] = 0.8
    found_share: ClassVar[float] = 0.5

    def make_conversion(self) -> Conversion:
        """A new conversion."""
        raise NotImplementedError(f"{type(self).__name__} needs make_conversion()")

    def make_target(self) -> MapType:
        """A new instance of the type converted to."""
        raise NotImplementedError(f"{type(self).__name__} needs make_target()")

    def make_other_source(self) -> MapType | None:
        """A new instance of the type converted from that wants more before something stands in its maps."""
        return None

    @law("converting writes nothing, and equal layers give equal layers")
    def test_converting_is_pure(self, drawing: Drawing) -> None:
        kind, target, scene = self.make_map_type(), self.make_target(), scene_of(self, drawing)
        layer = layer_of(kind, scene.own)
        before = kind.encode(layer)
        conversion = self.make_conversion()
        once = target.encode(self._convert(layer, target, conversion))
        require(kind.encode(layer) == before, "the layer changed when it was converted")
        again = target.encode(self._convert(layer, target, conversion))
        require(again == once, "converted again, it comes out differently")
        other = self.make_target()
        anew = other.encode(self._convert(layer_of(self.make_map_type(), scene.own), other))
        require(anew == once, "another instance converts an equal layer differently")

    @law("the result is a layer of the target: of its type, in its resolution if the scale is known, and usable as one")
    def test_the_result_is_of_the_target(self, drawing: Drawing) -> None:
        kind, target, scene = self.make_map_type(), self.make_target(), scene_of(self, drawing)
        layer = layer_of(kind, scene.own)
        made = self._convert(layer, target)
        require(made.map_type == target.name, f"it is of type {made.map_type!r}, asked was {target.name!r}")
        told, wanted = target.metadata(made), target.metadata(target.new_layer())
        same = told.resolution_m == wanted.resolution_m or not kind.metadata(layer).scale_known
        require(same, f"its resolution is {told.resolution_m} m, the target's {wanted.resolution_m} m")
        data = target.encode(made)
        require(target.encode(target.decode(data)) == data, "it changes when it is encoded and decoded")
        if target.view(made).known():
            target.place(made, Transform.identity())

    @law("what stands in the converted map stands where it stood", vacuous=_NOTHING_STANDS)
    def test_what_stands_stays(self, drawing: Drawing) -> None:
        kind, target, scene = self.make_map_type(), self.make_target(), scene_of(self, drawing)
        layer = layer_of(kind, scene.own)
        here = kind.structure(kind.view(layer))
        there = target.structure(target.view(self._convert(layer, target)))
        if len(here) < 3 or len(there) < 3:
            return
        drawing.reached()
        require_moved(here, there, self._tolerance_m(kind, target), self.placed_share, self.found_share)

    @law("what stood in the converted map stands on when more of the place was seen", vacuous=_SEEN_ONCE)
    def test_what_stood_stands_on(self, drawing: Drawing) -> None:
        kind, target, scene = self.make_map_type(), self.make_target(), scene_of(self, drawing)
        some, all_ = layer_of(kind, scene.own[:1]), layer_of(kind, scene.own)
        near_m = self._tolerance_m(kind, target)
        before = target.structure(target.view(self._convert(some, target)))
        before = before[near(before, kind.structure(kind.view(all_)), near_m)]  # what is gone there may go here
        if len(before) < 3 or len(scene.own) < 2:
            return
        drawing.reached()
        share = share_near(before, target.structure(target.view(self._convert(all_, target))), near_m)
        require(
            share >= self.placed_share,
            f"of what stood in the map of the first observation and stands in the source's still, {share:.0%} stand in "
            f"the map of all, {self.placed_share:.0%} must",
        )

    @law(
        "the source says how its layer is read: what does not stand in its map does not come to stand", vacuous=_ONE_WAY
    )
    def test_the_source_says_how_it_is_read(self, drawing: Drawing) -> None:
        kind, target, scene = self.make_map_type(), self.make_target(), scene_of(self, drawing)
        if (strict := self.make_other_source()) is None:
            return
        layer, near_m = layer_of(kind, scene.own), self._tolerance_m(kind, target)
        here, seen = kind.structure(kind.view(layer)), strict.structure(strict.view(layer))
        if np.count_nonzero(~near(here, seen, near_m)) < 3:
            return
        drawing.reached()
        there = target.structure(target.view(self._convert(layer, target, source=strict)))
        require_moved(seen, there, near_m, self.placed_share, 0.0)

    @law("converting a moved map moves the converted one", vacuous=_NOTHING_STANDS)
    def test_converting_moves_along(self, drawing: Drawing) -> None:
        kind, target, scene = self.make_map_type(), self.make_target(), scene_of(self, drawing)
        T = drawing.draw(self.moves())
        drawing.note(f"moved by {describe(T)}")
        layer = layer_of(kind, scene.own)
        assume(kind.view(layer).known())
        here = target.structure(target.view(self._convert(layer, target)))
        there = target.structure(target.view(self._convert(kind.place(layer, T), target)))
        if len(here) < 3 or len(there) < 3:
            return
        drawing.reached()
        require_moved(T.apply(here), there, self._tolerance_m(kind, target), self.placed_share, self.found_share)

    @law(
        "counts survive, not only classes: evidence seen twice is not evidence seen once", vacuous="no evidence adds up"
    )
    def test_counts_survive(self, drawing: Drawing) -> None:
        kind, target, scene = self.make_map_type(), self.make_target(), scene_of(self, drawing)
        once, twice = layer_of(kind, scene.own), layer_of(kind, (*scene.own, *scene.own))
        if len(kind.region(once)) == 0 or kind.encode(once) == kind.encode(twice):
            return
        made = self._convert(once, target), self._convert(twice, target)
        if len(target.region(made[0])) == 0:
            return
        drawing.reached()
        same = target.encode(made[0]) == target.encode(made[1])
        require(not same, "the same evidence seen twice converts to the same layer as seen once")

    @law("converting makes no looks: no unit was seen more often than one was before", vacuous=_NOT_COUNTED)
    def test_converting_makes_no_looks(self, drawing: Drawing) -> None:
        kind, target, scene = self.make_map_type(), self.make_target(), scene_of(self, drawing)
        layer = layer_of(kind, scene.own)
        if require_no_more_looks(layer, self._convert(layer, target), "converted,"):
            drawing.reached()

    @law("an empty layer converts to an empty one, or raises EmptyMapError")
    def test_nothing_converts_to_nothing(self, drawing: Drawing) -> None:
        kind, target = self.make_map_type(), self.make_target()
        try:
            made = self.make_conversion().convert(kind.new_layer(), kind, target)
        except EmptyMapError:
            return
        known = target.view(made).known()
        require(known == 0, f"out of nothing came a map of {known} known units")

    @law("a target or a layer of another type raises MapError")
    def test_foreign_types_are_refused(self, drawing: Drawing) -> None:
        kind, target, scene = self.make_map_type(), self.make_target(), scene_of(self, drawing)
        layer, conversion = layer_of(kind, scene.own), self.make_conversion()
        for what, given, to in (("target", layer, kind), ("layer", _Foreign(), target)):
            try:
                conversion.convert(given, kind, to)
            except MapgraftError as error:
                require(isinstance(error, MapError), f"a foreign {what} raises {type(error).__name__}: {error}")
                continue
            raise BrokenLawError(f"a foreign {what} was taken without a word")

    def _convert(
        self, layer: Layer, target: MapType, conversion: Conversion | None = None, source: MapType | None = None
    ) -> Layer:
        try:
            return (conversion or self.make_conversion()).convert(layer, source or self.make_map_type(), target)
        except EmptyMapError:
            assume(False)
            raise

    def _tolerance_m(self, kind: MapType, target: MapType) -> float:
        """Both types quantise, one after the other."""
        return self.tolerance_m(kind) + self.tolerance_m(target)


class _Foreign:
    """A layer of a type that nobody knows."""

    map_type = "a_type_that_nobody_knows"

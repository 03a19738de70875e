"""The laws of placing, absorbing and resetting: how a donor's evidence comes into another frame, in and out."""

from __future__ import annotations

import numpy as np
from hypothesis import assume

from mapgraft.contracts import EmptyMapError, MapError, Transform
from mapgraft.testing.laws import BrokenLawError, Drawing, law, require
from mapgraft.testing.scenes import describe
from mapgraft.testing.supply import (
    Supply,
    contributed,
    layer_of,
    require_moved,
    require_no_more_looks,
    require_same_map,
    same_region,
    scene_of,
)

_SCALE = 1.25
_CLOSER = 0.5  # four or eight units come to lie in one
_STEP = np.zeros((4, 4))
_STEP[0, 3] = 2.0**-18  # metres: a quarter of the step of the fixed point


class PlacingLaws(Supply):
    """Placing a layer, baking a contribution in, and discarding it."""

    @law("place writes nothing, and gives the same layer every time and from every instance")
    def test_placing_is_pure(self, drawing: Drawing) -> None:
        map_type, scene, T = self.make_map_type(), scene_of(self, drawing), drawing.draw(self.moves(), "moved by")
        layer = layer_of(map_type, scene.donor)
        before, matrix = map_type.encode(layer), T.matrix.tobytes()
        assume(map_type.view(layer).known())
        once = map_type.encode(map_type.place(layer, T))
        require((map_type.encode(layer), T.matrix.tobytes()) == (before, matrix), "the layer or the transform changed")
        require(map_type.encode(map_type.place(layer, T)) == once, "placing it again gives another layer")
        other = self.make_map_type()
        same = other.encode(other.place(layer_of(other, scene.donor), T)) == once
        require(same, "another instance places an equal layer differently")

    @law("the transform is put into fixed point before anything is placed")
    def test_placing_snaps_first(self, drawing: Drawing) -> None:
        map_type, scene, T = self.make_map_type(), scene_of(self, drawing), drawing.draw(self.moves(), "moved by")
        layer = layer_of(map_type, scene.donor)
        assume(map_type.view(layer).known())
        wanted = map_type.encode(map_type.place(layer, T.snapped()))
        for steps in (-1, 0, 1):
            near = Transform(T.snapped().matrix + steps * _STEP)
            same = map_type.encode(map_type.place(layer, near)) == wanted
            require(same, "two transforms that are one in fixed point place the layer differently")

    @law(
        "what stands in a placed layer stands where the transform puts it", vacuous="nothing stands in any of the maps"
    )
    def test_a_placed_map_is_a_moved_map(self, drawing: Drawing) -> None:
        map_type, scene, T = self.make_map_type(), scene_of(self, drawing), drawing.draw(self.moves())
        drawing.note(f"moved by {describe(T)}")
        layer = layer_of(map_type, scene.donor)
        here = map_type.structure(map_type.view(layer))
        if len(here) < 3:
            return
        drawing.reached()
        there = map_type.structure(map_type.view(map_type.place(layer, T)))
        require_moved(T.apply(here), there, self.tolerance_m(map_type), self.placed_share, self.found_share)

    @law("a scale is honoured, or refused with MapError", vacuous="no map could be placed")
    def test_a_scale_is_honoured_or_refused(self, drawing: Drawing) -> None:
        map_type, scene, T = self.make_map_type(), scene_of(self, drawing), drawing.draw(self.moves())
        drawing.note(f"scaled by {_SCALE} and moved by {describe(T)}")
        layer = layer_of(map_type, scene.donor)
        here = map_type.structure(map_type.view(layer))
        if len(here) < 3:
            return
        drawing.reached()
        try:
            placed = map_type.place(layer, T, _SCALE)
        except MapError:
            return
        there = map_type.structure(map_type.view(placed))
        require_moved(
            T.apply(here * _SCALE), there, _SCALE * self.tolerance_m(map_type), self.placed_share, self.found_share
        )

    @law(
        "placing makes no looks: no unit was seen more often than one was before, also where several fall into one",
        vacuous="its layers do not tell how often their units were seen (CountedLayer)",
    )
    def test_placing_makes_no_looks(self, drawing: Drawing) -> None:
        map_type, scene, T = self.make_map_type(), scene_of(self, drawing), drawing.draw(self.moves())
        layer = layer_of(self.make_donor_map_type(), scene.donor)
        for scale in (1.0, _CLOSER):
            try:
                placed = map_type.place(layer, T, scale)
            except MapError:  # empty, or of a type that cannot be scaled
                continue
            if require_no_more_looks(layer, placed, f"placed at scale {scale:g} and {describe(T)},"):
                drawing.reached()

    @law("an empty layer cannot be placed: EmptyMapError")
    def test_nothing_cannot_be_placed(self, drawing: Drawing) -> None:
        map_type = self.make_map_type()
        try:
            map_type.place(map_type.new_layer(), Transform.identity())
        except EmptyMapError:
            return
        raise BrokenLawError("an empty layer was placed without a word")

    @law("absorbing a contribution shows the same map as viewing it beside the own layer")
    def test_absorbing_is_viewing(self, drawing: Drawing) -> None:
        map_type, scene = self.make_map_type(), scene_of(self, drawing)
        own = layer_of(map_type, scene.own)
        given = contributed(self, map_type, own, scene, drawing.draw(self.moves()))
        before = map_type.encode(given.layer)
        baked = map_type.decode(map_type.encode(own))
        seen, region = map_type.view(baked), map_type.region(baked)
        changed = map_type.absorb(baked, given)
        require(map_type.encode(given.layer) == before, "the contribution was written")
        wanted = map_type.view(own, (given,))
        require_same_map(self, map_type, map_type.view(baked), wanted, "the two maps differ")
        seen = map_type.view(baked, (), seen, changed)
        require_same_map(self, map_type, seen, wanted, "what absorb says it changed is not all that changed")
        untold = len(map_type.region(baked).minus(region).minus(changed))
        require(not untold, f"{untold} unit(s) hold evidence since and were not told")

    @law("reset forgets foreign minus keep, and counts what held evidence and what stays contaminated")
    def test_resetting_counts_what_it_says(self, drawing: Drawing) -> None:
        map_type, scene = self.make_map_type(), scene_of(self, drawing)
        own = layer_of(map_type, scene.own)
        given = contributed(self, map_type, own, scene, drawing.draw(self.moves()))
        keep = map_type.region(own)
        foreign = map_type.absorb(own, given)
        seen, held = map_type.view(own), map_type.region(own)
        gone = foreign.minus(keep)
        said = map_type.reset(own, foreign, keep)
        wanted = (len(gone) - len(gone.minus(held)), len(foreign) - len(gone))
        found = (said.cells_reset, said.cells_contaminated)
        require(found == wanted, f"it says (reset, contaminated) = {found}, it was {wanted}")
        require(same_region(said.touched, gone), f"it touched {len(said.touched)} units, asked were {len(gone)}")
        left = map_type.region(own)
        stays = len(gone) - len(gone.minus(left))
        require(not stays, f"{stays} unit(s) that were reset still hold evidence")
        more = len(held.minus(gone).minus(left))
        require(not more, f"{more} unit(s) lost their evidence that were not asked for")
        seen = map_type.view(own, (), seen, said.touched)
        require_same_map(self, map_type, seen, map_type.view(own), "where it says it touched is not all that changed")

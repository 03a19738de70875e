"""The laws of fusers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from hypothesis import assume

from mapgraft.contracts import (
    Contribution,
    Donation,
    EmptyMapError,
    Fuser,
    Layer,
    MapError,
    MapType,
    Match,
    Observation,
    Provenance,
    Transform,
)
from mapgraft.errors import MapgraftError
from mapgraft.testing.content import content_of
from mapgraft.testing.laws import BrokenLawError, Drawing, NotTriedError, law, require
from mapgraft.testing.supply import Supply, layer_of, require_same_map, scene_of

_PROVENANCE = Provenance("donor", 3, 7)


class FuserLaws(Supply):
    """What a fuser promises about its contributions; ``make_fuser`` must be written beside ``make_map_type``."""

    examples: ClassVar[int] = 15

    @law("fusing writes neither map nor layer, and equal inputs give equal contributions")
    def test_fusing_is_pure(self, drawing: Drawing) -> None:
        scene, T = scene_of(self, drawing), drawing.draw(self.moves(), "moved by")
        told = []
        for _ in range(2):
            kind, own, donor = self._layers(scene.own, scene.donor)
            theirs, target = self.make_donor_map_type(), kind.view(own)
            before = (kind.encode(own), theirs.encode(donor), self.fingerprint(kind, target))
            fuser = self._fuser()
            told += [self._told(kind, own, self._fuse(kind, own, donor, T, fuser)) for _ in range(2)]
            after = (kind.encode(own), theirs.encode(donor), self.fingerprint(kind, target))
            require(after == before, "a layer or a map changed when it was fused")
        require(all(other == told[0] for other in told), "equal inputs give different contributions")

    @law("a contribution keeps its provenance, its scale and the transform in fixed point")
    def test_a_contribution_says_what_was_done(self, drawing: Drawing) -> None:
        scene, T = scene_of(self, drawing), drawing.draw(self.moves(), "moved by")
        kind, own, donor = self._layers(scene.own, scene.donor)
        made = self._fuse(kind, own, donor, T)
        require(made.provenance == _PROVENANCE, f"its provenance is {made.provenance}, given was {_PROVENANCE}")
        require(made.T_receiver_donor == T.snapped(), "its transform is not the match's in fixed point")
        require(made.scale == 1.0, f"its scale is {made.scale}, given was 1")
        require(made.role in ("observation", "prior"), f"its role is {made.role!r}")
        require(made.layer.map_type == kind.name, f"its layer is of type {made.layer.map_type!r}, not the receiver's")
        require(bool(made.resampler), "it does not say how the layer was placed (resampler)")
        wrong = [name for name, value in made.summary.items() if not isinstance(value, float | int)]
        require(not wrong, f"{wrong} of its summary are no numbers")

    @law("the contributed layer is the donor's evidence unweighted, whatever the receiver knows")
    def test_the_layer_is_unweighted(self, drawing: Drawing) -> None:
        scene, T = scene_of(self, drawing), drawing.draw(self.moves(), "moved by")
        kind, own, donor = self._layers(scene.own, scene.donor)
        one = kind.encode(self._fuse(kind, own, donor, T).layer)
        for observation in (*scene.own, *scene.own):
            kind.integrate(own, observation)
        other = kind.encode(self._fuse(kind, own, donor, T).layer)
        require(one == other, "when the receiver knows more, the donor's layer in the contribution is another one")

    @law("region holds every unit that the contribution changes in the fused map")
    def test_the_region_is_where_the_map_changes(self, drawing: Drawing) -> None:
        scene, T = scene_of(self, drawing), drawing.draw(self.moves(), "moved by")
        kind, own, donor = self._layers(scene.own, scene.donor)
        made = self._fuse(kind, own, donor, T)
        alone, fused = kind.view(own), kind.view(own, (made,))
        there = kind.view(own, (made,), alone, made.region)
        require_same_map(self, kind, there, fused, "updated in its region only, the fused map is not the fresh one")
        back = kind.view(own, (), fused, made.region)
        require_same_map(self, kind, back, alone, "taken out in its region only, it leaves a trace")
        untold = len(kind.known_region(fused).minus(kind.known_region(alone)).minus(made.region))
        require(not untold, f"{untold} unit(s) came to be known outside its region")

    @law("nothing cannot be contributed: an empty donor raises EmptyMapError")
    def test_an_empty_donor_is_refused(self, drawing: Drawing) -> None:
        scene = scene_of(self, drawing)
        kind, own, donor = self._layers(scene.own, ())
        try:
            self._contribution(kind, own, donor, Transform.identity())
        except EmptyMapError:
            return
        raise BrokenLawError("an empty layer was contributed without a word")

    @law("with a receiver that knows nothing it makes a contribution, or raises EmptyMapError")
    def test_an_empty_receiver_is_refused_or_filled(self, drawing: Drawing) -> None:
        scene = scene_of(self, drawing)
        kind, own, donor = self._layers((), scene.donor)
        assume(self.make_donor_map_type().view(donor).known())
        try:
            made = self._contribution(kind, own, donor, Transform.identity())
        except EmptyMapError:
            return
        fused = kind.view(own, (made,))
        require(fused.known() > 0, "a contribution to an empty map leaves it empty")

    @law("a layer of another type raises MapError")
    def test_foreign_layers_are_refused(self, drawing: Drawing) -> None:
        scene = scene_of(self, drawing)
        kind, own, _ = self._layers(scene.own, ())
        try:
            self._contribution(kind, own, _Foreign(), Transform.identity())
        except MapgraftError as error:
            require(isinstance(error, MapError), f"it raises {type(error).__name__}: {error}")
            return
        raise BrokenLawError("a layer of a type that nobody knows was contributed without a word")

    def _layers(self, own: Sequence[Observation], donor: Sequence[Observation]) -> tuple[MapType, Layer, Layer]:
        kind = self.make_map_type()
        return kind, layer_of(kind, own), layer_of(self.make_donor_map_type(), donor)

    def _fuse(self, kind: MapType, own: Layer, donor: Layer, T: Transform, fuser: Fuser | None = None) -> Contribution:
        try:
            return self._contribution(kind, own, donor, T, fuser)
        except EmptyMapError:
            assume(False)
            raise

    def _contribution(
        self, kind: MapType, own: Layer, donor: Layer, T: Transform, fuser: Fuser | None = None
    ) -> Contribution:
        fuser = fuser or self._fuser()
        return fuser.fuse(kind, kind.view(own), Donation(donor, _PROVENANCE), Match(T, score=1.0, margin=1.0))

    def _fuser(self) -> Fuser:
        if (fuser := self.make_fuser()) is None:
            raise NotTriedError(f"{type(self).__name__} needs make_fuser()")
        return fuser

    def _told(self, kind: MapType, own: Layer, made: Contribution) -> object:
        """All that a contribution does and says."""
        fused = self.fingerprint(kind, kind.view(own, (made,)))
        return (kind.encode(made.layer), len(made.region), content_of(dict(made.summary)), made.resampler, fused)


class _Foreign:
    """A layer of a type that nobody knows."""

    map_type = "a_type_that_nobody_knows"

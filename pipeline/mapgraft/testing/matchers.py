"""The laws of matchers."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from hypothesis import strategies as st

from mapgraft.contracts import EmptyMapError, Map, MapError, Match, Matcher, Points, Prior, Transform
from mapgraft.errors import MapgraftError
from mapgraft.testing.content import content_of
from mapgraft.testing.laws import BrokenLawError, Drawing, law, require
from mapgraft.testing.scenes import Scene, describe, moved, ready_scenes, scenes_from
from mapgraft.testing.supply import Supply, layer_of

_NO_MATCH = "the matcher found no hypothesis in any of the scenes"
_RIGID = 1e-6


class MatcherLaws(Supply):
    """What a matcher promises about its hypotheses.

    ``make_matcher`` must be written beside ``make_map_type``, and ``make_donor_map_type`` where the donor's map is of
    another type. ``same_place_m`` and ``same_turn_rad``: how far apart two hypotheses may lie that are one.
    ``decisive_margin``: what a best hypothesis must lead by (as a share of its score) to be found again when a map is
    moved. ``scale_open`` says that the scale is unknown. ``uses_prior`` and ``needs_prior`` say whether it takes a
    prior, and whether it does nothing without one; ``any_type`` that it takes maps of every type.
    """

    examples: ClassVar[int] = 8
    shrinks: ClassVar[bool] = False
    same_place_m: ClassVar[float] = 0.3
    same_turn_rad: ClassVar[float] = 0.1
    decisive_margin: ClassVar[float] = 0.1
    scale_open: ClassVar[bool] = False
    uses_prior: ClassVar[bool] = False
    needs_prior: ClassVar[bool] = False
    any_type: ClassVar[bool] = False

    def make_matcher(self) -> Matcher:
        """A new matcher with the parameters to try."""
        raise NotImplementedError(f"{type(self).__name__} needs make_matcher()")

    def scenes(self) -> st.SearchStrategy[Scene]:
        """What two robots have seen of one place: enough of it to be matched."""
        single = self.observations()
        return ready_scenes(self.kind, 6, 9, self.donor_kind) if single is None else scenes_from(single, 9)

    def maps(self, scene: Scene) -> tuple[Map, Map]:
        """The receiver's and the donor's map."""
        own, donor = self.make_map_type(), self.make_donor_map_type()
        return own.view(layer_of(own, scene.own)), donor.view(layer_of(donor, scene.donor))

    def prior(self, scene: Scene) -> Prior | None:
        """What somebody knows beforehand: the truth, within half a metre and ten degrees; None without a truth."""
        if scene.T_receiver_donor is None:
            return None
        covariance = np.diag([0.25, 0.25, 0.0, 0.0, 0.0, math.radians(10.0) ** 2])
        return Prior(scene.T_receiver_donor, covariance, "the conformance kit")

    @law("equal maps give equal hypotheses, whoever is asked and whatever was matched before")
    def test_matching_is_deterministic(self, drawing: Drawing) -> None:
        scene = drawing.draw(self.scenes(), "scene")
        matcher, maps = self.make_matcher(), self.maps(scene)
        first = content_of(self._match(matcher, scene, maps))
        require(content_of(self._match(matcher, scene, maps)) == first, "asked again, the matcher says something else")
        if maps[0].map_type == maps[1].map_type:
            self._match(matcher, scene, (maps[1], maps[0]))
        require(content_of(self._match(matcher, scene, maps)) == first, "after another match it says something else")
        again = content_of(self._match(self.make_matcher(), scene, self.maps(scene)))
        require(again == first, "another instance with equal maps says something else")

    @law("the maps are not written")
    def test_the_maps_are_not_written(self, drawing: Drawing) -> None:
        scene = drawing.draw(self.scenes(), "scene")
        types, maps = (self.make_map_type(), self.make_donor_map_type()), self.maps(scene)
        before = [self.fingerprint(kind, map_) for kind, map_ in zip(types, maps, strict=True)]
        self._match(self.make_matcher(), scene, maps)
        after = [self.fingerprint(kind, map_) for kind, map_ in zip(types, maps, strict=True)]
        require(after == before, "a map changed when it was matched")

    @law("a map without content raises EmptyMapError, on either side")
    def test_empty_maps_are_refused(self, drawing: Drawing) -> None:
        scene = drawing.draw(self.scenes(), "scene")
        own, donor = self.make_map_type(), self.make_donor_map_type()
        full, none = self.maps(scene), (own.view(own.new_layer()), donor.view(donor.new_layer()))
        for side, maps in (("receiver's", (none[0], full[1])), ("donor's", (full[0], none[1])), ("two", none)):
            try:
                found = self._match(self.make_matcher(), scene, maps)
            except EmptyMapError:
                continue
            except MapgraftError as error:
                raise BrokenLawError(f"an empty {side} map raises {type(error).__name__}: {error}") from error
            raise BrokenLawError(f"an empty {side} map gives {len(found)} hypotheses instead of EmptyMapError")

    @law("a map of another type raises MapError", vacuous="it takes maps of every type")
    def test_foreign_maps_are_refused(self, drawing: Drawing) -> None:
        if self.any_type:
            return
        scene = drawing.draw(self.scenes(), "scene")
        drawing.reached()
        maps = self.maps(scene)
        for foreign in ((maps[0], _Foreign()), (_Foreign(), maps[1])):
            try:
                self._match(self.make_matcher(), scene, foreign)
            except MapError:
                continue
            raise BrokenLawError("a map of a type that it does not know was matched without a word")

    @law("every hypothesis is a rigid transform, of scale 1 unless the scale is unknown", vacuous=_NO_MATCH)
    def test_hypotheses_are_rigid(self, drawing: Drawing) -> None:
        for match in self._found(drawing):
            matrix = match.T_receiver_donor.matrix
            rotation = matrix[:3, :3]
            require(bool(np.isfinite(matrix).all()), "a transform is not finite")
            off = max(float(abs(rotation @ rotation.T - np.eye(3)).max()), abs(float(np.linalg.det(rotation)) - 1.0))
            require(off < _RIGID and matrix[3].tolist() == [0, 0, 0, 1], f"a transform is not rigid (off by {off:.2g})")
            scale = match.scale
            require(scale == 1.0 or self.scale_open, f"the scale is {scale}, nobody said that it is unknown")
            require(math.isfinite(scale) and scale > 0.0, f"the scale is {scale}")

    @law("hypotheses come best first, and the margin of the best one is no more than its lead", vacuous=_NO_MATCH)
    def test_the_best_comes_first(self, drawing: Drawing) -> None:
        found = self._found(drawing)
        scores = [match.score for match in found]
        require(all(map(math.isfinite, scores)), f"the scores {scores} are not all finite")
        require(scores == sorted(scores, reverse=True), f"the scores {scores} do not fall")
        if found:
            margin = found[0].margin
            require(not math.isnan(margin) and margin >= 0.0, f"the best hypothesis has the margin {margin}")
        if len(found) > 1:
            lead = scores[0] - scores[1]
            tolerance = 1e-9 * max(1.0, abs(scores[0]))
            require(margin <= lead + tolerance, f"the margin {margin:g} is more than the lead over the next, {lead:g}")

    @law("covariances are None or symmetric (6, 6) without negative variance, and evidence is named numbers")
    def test_hypotheses_say_how_sure_they_are(self, drawing: Drawing) -> None:
        for match in self._found(drawing):
            wrong = [name for name, value in match.evidence.items() if not isinstance(value, float | int)]
            require(not wrong, f"the evidence {wrong} is no number")
            if match.covariance is None:
                continue
            c = np.asarray(match.covariance)
            require(
                c.shape == (6, 6) and bool(np.isfinite(c).all()), f"a covariance of shape {c.shape}, not all finite"
            )
            largest = max(float(abs(c).max()), 1e-12)
            require(float(abs(c - c.T).max()) <= 1e-9 * largest, "a covariance is not symmetric")
            least = float(np.linalg.eigvalsh((c + c.T) / 2.0)[0])
            require(least >= -1e-9 * largest, f"a covariance has the variance {least:.2g}")

    @law(
        "when a map is moved, the best hypothesis moves with it", vacuous="no best hypothesis led clearly in any scene"
    )
    def test_matching_is_equivariant(self, drawing: Drawing) -> None:
        scene = drawing.draw(self.scenes(), "scene")
        best = self._decisive(scene)
        if best is None:
            return
        drawing.reached()
        A, B = drawing.draw(self.moves()), drawing.draw(self.moves())
        drawing.note(f"receiver moved by {describe(A)}, donor by {describe(B)}")
        for T_own, T_donor in ((A, None), (None, B)):
            own = scene.own if T_own is None else tuple(moved(o, T_own) for o in scene.own)
            donor = scene.donor if T_donor is None else tuple(moved(o, T_donor) for o in scene.donor)
            wanted, truth = best.T_receiver_donor, scene.T_receiver_donor
            if T_own is not None:
                wanted, truth = T_own @ wanted, None if truth is None else T_own @ truth
            if T_donor is not None:
                back = T_donor.inverse()
                wanted, truth = wanted @ back, None if truth is None else truth @ back
            other = dataclasses.replace(scene, own=own, donor=donor, T_receiver_donor=truth)
            found = self._match(self.make_matcher(), other, self.maps(other))
            # what is measured is how far the middle of the donor's map is displaced, wherever its origin lies
            middle = np.mean([o.T_map_base.matrix[:3, 3] for o in donor], axis=0)[None]
            off_m, off_rad = _apart(found[0].T_receiver_donor, wanted, middle) if found else (math.inf, math.inf)
            which = "receiver's" if T_own is not None else "donor's"
            require(
                off_m <= self.same_place_m and off_rad <= self.same_turn_rad,
                f"with the {which} map moved, the best hypothesis is not the old one moved with it: "
                + (f"it lies {off_m:.2f} m and {math.degrees(off_rad):.1f}° away" if found else "there is none"),
            )

    @law("a matcher that searches around a prior tells what the prior itself scores", vacuous="it uses no prior")
    def test_the_prior_is_scored(self, drawing: Drawing) -> None:
        if not self.uses_prior:
            return
        scene = drawing.draw(self.scenes(), "scene")
        if (prior := self.prior(scene)) is None:
            return
        for match in self.make_matcher().match(*self.maps(scene), prior):
            drawing.reached()
            score = match.evidence.get("prior_score")
            require(
                score is not None, f"the evidence has no 'prior_score', it has {', '.join(match.evidence) or 'none'}"
            )

    def _decisive(self, scene: Scene) -> Match | None:
        """The best hypothesis, if it leads clearly."""
        found = self._match(self.make_matcher(), scene, self.maps(scene))
        if not found or found[0].margin < self.decisive_margin * abs(found[0].score):
            return None
        return found[0]

    def _found(self, drawing: Drawing) -> Sequence[Match]:
        scene = drawing.draw(self.scenes(), "scene")
        found = self._match(self.make_matcher(), scene, self.maps(scene))
        if found:
            drawing.reached()
        return found

    def _match(self, matcher: Matcher, scene: Scene, maps: tuple[Map, Map]) -> Sequence[Match]:
        return matcher.match(*maps, self.prior(scene) if self.needs_prior else None)


class _Foreign:
    """A map of a type that nobody knows."""

    map_type = "a_type_that_nobody_knows"

    def known(self) -> int:
        return 1


def _apart(a: Transform, b: Transform, at: Points) -> tuple[float, float]:
    """How far two transforms displace a point (1, 3) from each other, in metres, and how far they turn, in radians."""
    return float(np.linalg.norm(a.apply(at) - b.apply(at))), a.difference(b)[1]

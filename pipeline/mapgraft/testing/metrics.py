"""The laws of metrics and their trackers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce
from typing import ClassVar

from hypothesis import assume
from hypothesis import strategies as st

from mapgraft.comparison import Compared, Sight
from mapgraft.contracts import (
    EmptyMapError,
    LocalTracker,
    MapType,
    Match,
    Measurement,
    Metric,
    Observation,
    Region,
    Step,
    Transform,
)
from mapgraft.reversal import Reversal, new_reversal
from mapgraft.testing.content import content_of
from mapgraft.testing.laws import Drawing, law, require
from mapgraft.testing.scenes import Scene, moved, ready_scenes, scenes_from
from mapgraft.testing.supply import Supply, layer_of

_NOTHING_HEARD = "in none of the scenes an observation made any difference to what it measures"
_FAR = Transform.planar(60.0, 0.0, 0.0)


@dataclass(slots=True)
class Merged:
    """A receiver that maps on, a donor placed in its frame, and what metrics see of the two."""

    map_type: MapType
    reversal: Reversal
    sight: Sight
    comparison: Compared

    def observe(self, observation: Observation) -> Region:
        touched = self.reversal.observe(observation)
        self.sight.changed()
        return touched


class MetricLaws(Supply):
    """What a metric promises; ``make_metric`` must be written beside ``make_map_type``.

    ``stream`` says that the metric counts what the observations since the registration say, and hence equals a replay
    of these observations, not a fresh look at the two maps. ``metric_name`` is what its measurements are called.
    """

    examples: ClassVar[int] = 15
    stream: ClassVar[bool] = False
    metric_name: ClassVar[str | None] = None

    def make_metric(self) -> Metric:
        """A new metric with the parameters to try."""
        raise NotImplementedError(f"{type(self).__name__} needs make_metric()")

    def scenes(self) -> st.SearchStrategy[Scene]:
        single = self.observations()
        return ready_scenes(self.kind, 3, 6, self.donor_kind) if single is None else scenes_from(single, 6)

    @law("a measurement is what it says: a number with its support and its direction, NaN without any support")
    def test_measurements_are_well_formed(self, drawing: Drawing) -> None:
        scene = drawing.draw(self.scenes(), "scene")
        found = self.make_metric().track(self._merged(drawing, scene).comparison).update(Step())
        name = self.metric_name
        require(name is None or found.name == name, f"it is called {found.name!r}, not {name!r}")
        require(isinstance(found.value, float), f"its value is a {type(found.value).__name__}")
        require(isinstance(found.support, int) and found.support >= 0, f"its support is {found.support!r}")
        require(found.better in ("higher", "lower"), f"better is {found.better!r}")
        require(found.support > 0 or math.isnan(found.value), f"without any support its value is {found.value:g}")
        wrong = [name for name, value in found.details.items() if not isinstance(value, float)]
        require(not wrong, f"its details {wrong} are no floats")
        ends = [at for single in found.findings for at in (single.start_m, single.end_m)]
        placed = all(len(at) == 3 and all(map(math.isfinite, at)) for at in ends)
        require(placed, "what it found lies at no place: start_m and end_m must be three finite numbers")

    @law("measuring writes neither layers nor maps, and equal maps give equal measurements")
    def test_measuring_is_pure(self, drawing: Drawing) -> None:
        scene, T = drawing.draw(self.scenes(), "scene"), self._move(drawing)
        metric, told = self.make_metric(), []
        for n in range(3):
            merged = self._merged(drawing, scene, T)
            kind, seen = merged.map_type, merged.comparison
            before = (kind.encode(seen.target_layer), kind.encode(seen.donor_layer))
            prints = (self.fingerprint(kind, seen.target), self.fingerprint(kind, seen.donor))
            tracker = (metric if n < 2 else self.make_metric()).track(seen)
            told.append(content_of(tracker.update(Step())))
            require((kind.encode(seen.target_layer), kind.encode(seen.donor_layer)) == before, "a layer was written")
            after = (self.fingerprint(kind, seen.target), self.fingerprint(kind, seen.donor))
            require(after == prints, "a map was written")
        require(told[1] == told[0], "measured again, it comes out differently")
        require(told[2] == told[0], "another instance measures something else")

    @law(
        "an updated tracker equals a fresh measurement, or, of a stream, the replay of all observations",
        vacuous=_NOTHING_HEARD,
    )
    def test_an_updated_tracker_equals_a_fresh_one(self, drawing: Drawing) -> None:
        scene = drawing.draw(self.scenes(), "scene")
        merged, metric = self._merged(drawing, scene), self.make_metric()
        tracker, replayed = metric.track(merged.comparison), metric.track(merged.comparison)
        first = latest = tracker.update(Step())
        regions, seen = [], (*scene.own[1:], scene.own[0])
        for n, observation in enumerate(seen, start=1):
            regions.append(merged.observe(observation))
            latest = tracker.update(Step(regions[-1], (observation,)))
            if not self.stream:
                drawing.reached()
                self._require_fresh(latest, metric, merged, f"after {n} observation(s)")
        if self.stream:
            told = replayed.update(Step(reduce(lambda a, b: a.union(b), regions), seen))
            self._require_heard(drawing, first, latest, told, "told one by one", "told at once")

    @law(
        "when the donor has changed, the tracker measures the new one, of a stream from then on", vacuous=_NOTHING_HEARD
    )
    def test_a_changed_donor_is_measured(self, drawing: Drawing) -> None:
        scene = drawing.draw(self.scenes(), "scene")
        merged, metric = self._merged(drawing, scene), self.make_metric()
        tracker = metric.track(merged.comparison)
        tracker.update(Step())
        self._register_anew(drawing, scene, merged)
        latest = tracker.update(Step(donor_changed=True))
        if not self.stream:
            drawing.reached()
            self._require_fresh(latest, metric, merged, "after the donor has changed")
            return
        begun = metric.track(merged.comparison)
        first = told = begun.update(Step())
        for observation in (*scene.own[1:], scene.own[0]):
            step = Step(merged.observe(observation), (observation,))
            latest, told = tracker.update(step), begun.update(step)
        self._require_heard(drawing, first, latest, told, "registered anew", "begun then")

    @law("what a local tracker is not concerned with makes no difference to it", vacuous="its trackers are not local")
    def test_concerns_are_honest(self, drawing: Drawing) -> None:
        scene = drawing.draw(self.scenes(), "scene")
        merged, metric = self._merged(drawing, scene), self.make_metric()
        asked, spared = metric.track(merged.comparison), metric.track(merged.comparison)
        if not isinstance(spared, LocalTracker):
            return
        latest, kept = asked.update(Step()), spared.update(Step())
        offs = [drawing.draw(st.booleans()) for _ in scene.own]
        for seen, far in zip(scene.own, offs, strict=True):
            observation = moved(seen, _FAR) if far else seen
            touched = merged.observe(observation)
            step = Step(touched, (observation,))
            latest, concerns = asked.update(step), spared.concerns
            if concerns is None or len(touched.minus(concerns)) < len(touched):
                kept = spared.update(step)
            else:
                drawing.reached()
            require(
                content_of(kept) == content_of(latest),
                f"asked at every observation it measures {_said(latest)}, only where concerned {_said(kept)}",
            )

    @law("two maps with nothing in common can be measured: NaN where that tells nothing")
    def test_nothing_in_common_can_be_measured(self, drawing: Drawing) -> None:
        scene = drawing.draw(self.scenes(), "scene")
        found = self.make_metric().track(self._merged(drawing, scene, _FAR).comparison).update(Step())
        require(isinstance(found, Measurement), f"it gives a {type(found).__name__}")

    def _register_anew(self, drawing: Drawing, scene: Scene, merged: Merged) -> None:
        """Another donor's layer, at another place."""
        T = self._move(drawing).snapped()
        assume(merged.comparison.T_receiver_donor != T)
        donor = layer_of(self.make_map_type(), scene.donor[:-1] or scene.donor)
        try:
            placed = merged.map_type.place(donor, T)
        except EmptyMapError:
            assume(False)
            raise
        merged.comparison.put_donor(placed, T, Match(T, score=2.0, margin=0.5))

    def _require_heard(
        self, drawing: Drawing, first: Measurement, latest: Measurement, told: Measurement, one: str, other: str
    ) -> None:
        """Two ways of hearing the same come to the same; it is no news where nothing was heard either way."""
        same = content_of(latest) == content_of(told)
        require(same, f"{one} it measures {_said(latest)}, {other} {_said(told)}")
        if content_of(told) != content_of(first):
            drawing.reached()

    def _move(self, drawing: Drawing) -> Transform:
        return drawing.draw(self.moves())

    def _merged(self, drawing: Drawing, scene: Scene, T: Transform | None = None) -> Merged:
        """The receiver has seen one observation, the donor lies where it really does, or anywhere."""
        if T is None:
            T = (
                scene.T_receiver_donor
                if scene.T_receiver_donor and drawing.draw(st.booleans())
                else self._move(drawing)
            )
        kind, T = self.make_map_type(), T.snapped()
        reversal = new_reversal("ledger", kind)
        reversal.observe(scene.own[0])
        try:
            placed = kind.place(layer_of(self.make_map_type(), scene.donor), T)
        except EmptyMapError:
            assume(False)
            raise
        assume(reversal.own().known())
        sight = Sight(reversal, kind)
        match = Match(T, score=1.0, margin=1.0)
        return Merged(kind, reversal, sight, Compared(kind, "own", T, match, placed, sight))

    def _require_fresh(self, latest: Measurement, metric: Metric, merged: Merged, when: str) -> None:
        fresh = metric.track(merged.comparison).update(Step())
        same = content_of(latest) == content_of(fresh)
        require(same, f"{when} it measures {_said(latest)}, a fresh tracker {_said(fresh)}")


def _said(measurement: Measurement) -> str:
    return f"{measurement.value:.6g} (support {measurement.support})"

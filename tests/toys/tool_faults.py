"""One fault of the other things that ``beacons`` offers for every law of theirs."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from dataclasses import dataclass, field

import beacon_laws as laws
import beacons
import echoes
from beacons import Chart, Disagreement, Heard, Places, Sum
from fault_book import breaks

from mapgraft.contracts import Decision, Measurement, Step, Verdict


@breaks(laws.SlideLaws, "matching_is_deterministic", "the_best_comes_first")
class SlideRemembers(beacons.Slide):
    asked = 0

    def match(self, target, source, prior=None):
        SlideRemembers.asked += 1
        return [dataclasses.replace(m, score=m.score + SlideRemembers.asked) for m in super().match(target, source)]


@breaks(laws.SlideLaws, "the_maps_are_not_written", "matching_is_deterministic", "matching_is_equivariant")
class SlideWrites(beacons.Slide):
    def match(self, target, source, prior=None):
        found = super().match(target, source)
        target.counts.pop(min(target.counts))
        return found


@breaks(laws.SlideLaws, "empty_maps_are_refused")
class SlideTakesEmpty(beacons.Slide):
    def match(self, target, source, prior=None):
        if not (target.known() and source.known()):
            return []
        return super().match(target, source)


@breaks(laws.SlideLaws, "foreign_maps_are_refused")
class SlideTakesAny(beacons.Slide):
    def match(self, target, source, prior=None):
        both = isinstance(target, Chart) and isinstance(source, Chart)
        return super().match(target, source) if both else []


@breaks(laws.SlideLaws, "hypotheses_are_rigid")
class SlideScales(beacons.Slide):
    def match(self, target, source, prior=None):
        return [dataclasses.replace(m, scale=1.01) for m in super().match(target, source)]


@breaks(laws.SlideLaws, "the_best_comes_first", "matching_is_equivariant")
class SlideWorstFirst(beacons.Slide):
    def match(self, target, source, prior=None):
        return super().match(target, source)[::-1]


@breaks(laws.SlideLaws, "hypotheses_say_how_sure_they_are")
class SlidePlanar(beacons.Slide):
    def match(self, target, source, prior=None):
        return [dataclasses.replace(m, covariance=[[1.0]]) for m in super().match(target, source)]


@breaks(laws.SlideLaws, "matching_is_equivariant")
class SlideBackwards(beacons.Slide):
    def match(self, target, source, prior=None):
        found = super().match(target, source)
        return [dataclasses.replace(m, T_receiver_donor=m.T_receiver_donor.inverse()) for m in found]


@breaks(laws.SlideNearLaws, "the_prior_is_scored")
class SlideUntold(beacons.SlideNear):
    def __init__(self):
        super().__init__(tells=False)


@breaks(laws.SumLaws, "fusing_is_pure", "the_layer_is_unweighted", "the_region_is_where_the_map_changes")
class SumGrows(Sum):
    times = 0

    def fuse(self, map_type, target, source, match):
        SumGrows.times += 1
        made = super().fuse(map_type, target, source, match)
        made.layer.counts[99] += SumGrows.times
        return dataclasses.replace(made, region=map_type.region(made.layer))


@breaks(laws.SumLaws, "a_contribution_says_what_was_done")
class SumAnonymous(Sum):
    def fuse(self, map_type, target, source, match):
        made = super().fuse(map_type, target, source, match)
        return dataclasses.replace(made, provenance=made.provenance._replace(version=0))


@breaks(laws.SumLaws, "the_layer_is_unweighted", "an_empty_receiver_is_refused_or_filled")
class SumWeighs(Sum):
    def fuse(self, map_type, target, source, match):
        made = super().fuse(map_type, target, source, match)
        for at in made.layer.counts:
            made.layer.counts[at] *= abs(target.counts.get(at, 1))
        return made


@breaks(laws.SumLaws, "the_region_is_where_the_map_changes")
class SumTellsLess(Sum):
    def fuse(self, map_type, target, source, match):
        made = super().fuse(map_type, target, source, match)
        return dataclasses.replace(made, region=Places(frozenset()))


@breaks(laws.SumLaws, "an_empty_donor_is_refused")
class SumOfNothing(Sum):
    def fuse(self, map_type, target, source, match):
        layer = (
            source.layer if not isinstance(source.layer, Heard) or source.layer.evidence() else Heard(Counter({0: 1}))
        )
        return super().fuse(map_type, target, source._replace(layer=layer), match)


@breaks(laws.SumLaws, "an_empty_receiver_is_refused_or_filled")
class SumFails(Sum):
    def fuse(self, map_type, target, source, match):
        made = super().fuse(map_type, target, source, match)
        return made if target.known() else dataclasses.replace(made, layer=Heard())


@breaks(laws.SumLaws, "foreign_layers_are_refused")
class SumTrusts(Sum):
    def fuse(self, map_type, target, source, match):
        if not isinstance(source.layer, Heard):
            raise AttributeError("a foreign layer has no counts")
        return super().fuse(map_type, target, source, match)


@dataclass
class _Tracker:
    """The tracker of the metric, with a fault."""

    inner: object
    comparison: object
    updates: int = 0
    first: Measurement | None = None
    fault: object = field(default=None)

    def update(self, step):
        self.updates += 1
        return self.fault(self, step, self.inner.update(step))


def measures(fault, local=None):
    """The metric with a fault in its trackers; ``local`` says what concerns them."""

    class Faulty(Disagreement):
        def track(self, comparison):
            tracker = _Tracker(super().track(comparison), comparison, fault=fault)
            if local is not None:
                tracker.concerns = local
            return tracker

    return Faulty


def _stale(tracker, step, measured):
    tracker.first = tracker.first or measured
    return measured if step.donor_changed else tracker.first


def _deaf(tracker, step, measured):
    tracker.first = measured if tracker.first is None or not step.donor_changed else tracker.first
    return tracker.first


def _writes(tracker, step, measured):
    tracker.comparison.target.counts[77] = 1
    return measured


def _fails_apart(tracker, step, measured):
    if measured.support == 0 and tracker.comparison.T_receiver_donor.x_m > 50:
        raise ZeroDivisionError("nothing in common")
    return measured


breaks(laws.DisagreementLaws, "measurements_are_well_formed")(
    measures(lambda tracker, step, m: dataclasses.replace(m, value=0.0) if math.isnan(m.value) else m)
)
breaks(
    laws.DisagreementLaws, "measuring_is_pure", "an_updated_tracker_equals_a_fresh_one", "a_changed_donor_is_measured"
)(measures(_writes))
breaks(laws.DisagreementLaws, "an_updated_tracker_equals_a_fresh_one")(measures(_stale))
breaks(laws.DisagreementLaws, "a_changed_donor_is_measured")(measures(_deaf))
breaks(laws.DisagreementLaws, "concerns_are_honest")(measures(lambda tracker, step, m: m, Places(frozenset())))
breaks(laws.DisagreementLaws, "nothing_in_common_can_be_measured")(measures(_fails_apart))


class _HearsTheLatest(echoes.EchoTracker):
    def update(self, step):
        return super().update(Step(step.touched, step.observations[-1:], step.donor_changed))


class _KeepsTheFirstDonor(echoes.EchoTracker):
    def __init__(self, comparison):
        super().__init__(comparison)
        self.first = super().known()

    def known(self):
        return self.first


def hears(tracker):
    """The stream metric with other trackers."""

    class Faulty(echoes.Echoes):
        def track(self, comparison):
            return tracker(comparison)

    return Faulty


breaks(laws.EchoesLaws, "an_updated_tracker_equals_a_fresh_one")(hears(_HearsTheLatest))
breaks(laws.EchoesLaws, "a_changed_donor_is_measured")(hears(_KeepsTheFirstDonor))


@breaks(laws.FirstOneLaws, "nothing_is_unmatched", "decisions_are_well_formed")
class TakesNothing(beacons.FirstOne):
    def accept(self, candidates):
        return super().accept(candidates) if candidates else Decision("ambiguous", None, "who knows")


@breaks(laws.FirstOneLaws, "decisions_are_well_formed", "nothing_is_unmatched")
class ChoosesAlways(beacons.FirstOne):
    def accept(self, candidates):
        return dataclasses.replace(super().accept(candidates), chosen=0)


@breaks(laws.FirstOneLaws, "accepting_is_pure")
class Tires(beacons.FirstOne):
    asked = 0

    def accept(self, candidates):
        Tires.asked += 1
        said = super().accept(candidates)
        return dataclasses.replace(said, reason=f"{said.reason} ({Tires.asked})")


@breaks(laws.AtMostLaws, "verdicts_are_well_formed")
class Mute(beacons.AtMost):
    def verify(self, history, reversal):
        return dataclasses.replace(super().verify(history, reversal), reason="")


@breaks(laws.AtMostLaws, "verifying_is_pure")
class Counts(beacons.AtMost):
    asked = 0

    def verify(self, history, reversal):
        Counts.asked += 1
        return dataclasses.replace(super().verify(history, reversal), reason=f"asked {Counts.asked} times")


@breaks(laws.AtMostLaws, "the_merge_itself_confirms_nothing")
class Hasty(beacons.AtMost):
    def verify(self, history, reversal):
        said = super().verify(history, reversal)
        measured = not math.isnan(history[-1].measurements["disagreement"].value)
        return Verdict("confirm", said.reason) if said.action == "keep" and measured else said


@breaks(laws.AtMostLaws, "what_cannot_be_measured_tells_nothing", "the_merge_itself_confirms_nothing")
class Credulous(beacons.AtMost):
    def verify(self, history, reversal):
        if math.isnan(history[-1].measurements["disagreement"].value):
            return Verdict("confirm", "nothing was measured, so nothing disagrees")
        return super().verify(history, reversal)


def converts(law, *along):
    """Note a fault that what the conversion gives is put through."""

    def note(fault):
        class Faulty(laws.ToMarks):
            def convert(self, layer, source, target):
                return fault(layer, super().convert(layer, source, target))

        return breaks(laws.ToMarksLaws, law, *along)(Faulty)

    return note


@converts("converting_is_pure", "converting_moves_along")
def _converts_away(layer, made):
    layer.counts.clear()
    return made


@converts("the_result_is_of_the_target")
def _gives_beacons(layer, made):
    made.map_type = "beacons"
    return made


@converts("what_stands_stays")
def _aside(layer, made):
    made.counts = Counter({at + 3: n for at, n in made.counts.items()})
    return made


@converts("converting_moves_along", "what_stands_stays")
def _mirrored(layer, made):
    made.counts = Counter({-at: n for at, n in made.counts.items()})
    return made


@converts("counts_survive")
def _classes_only(layer, made):
    made.counts = Counter({at: 1 if n > 0 else -1 for at, n in made.counts.items() if n})
    return made


@converts("what_stood_stands_on", "what_stands_stays")
def _only_near_the_farthest(layer, made):
    farthest = max(made.counts, default=0)
    made.counts = Counter({at: n for at, n in made.counts.items() if at > farthest - 6})
    return made


@breaks(laws.ToMarksLaws, "the_source_says_how_it_is_read")
class ReadsAllAlike(laws.ToMarks):
    def convert(self, layer, source, target):
        return super().convert(layer, beacons.Beacons() if isinstance(source, beacons.Beacons) else source, target)


@converts("converting_makes_no_looks")
def _doubled(layer, made):
    made.counts = Counter({at: 2 * n for at, n in made.counts.items()})
    return made


@converts("nothing_converts_to_nothing", "the_result_is_of_the_target", "converting_makes_no_looks")
def _something_always(layer, made):
    made.counts[0] += 1 if not made.evidence() else 0
    return made


@breaks(laws.ToMarksLaws, "foreign_types_are_refused", "nothing_converts_to_nothing")
class TakesAnyLayer(laws.ToMarks):
    def convert(self, layer, source, target):
        known = isinstance(layer, Heard) and target.name == "marks"
        return super().convert(layer, source, target) if known else target.new_layer()


@breaks(laws.RegularLaws, "meetings_fall_into_their_time")
class MeetsTwice(laws.Regular):
    def due(self, situation):
        return [met for met in super().due(situation) for _ in range(2)][:3]

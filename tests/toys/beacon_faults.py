"""One fault for every law: the plugin ``beacons`` with the smallest change that breaks it.

``FAULTS`` maps the class of laws and the law to what makes the faulty thing, and to the laws that break along with it.
"""

from __future__ import annotations

import dataclasses
import math
import random
from collections import Counter
from dataclasses import dataclass, field

import beacon_laws as laws
import beacons
from beacons import Beacons, Chart, Disagreement, Heard, Places, Sum

from mapgraft.contracts import Decision, MapError, Measurement, OutputMessage, Reset, Transform, Verdict

FAULTS: dict[tuple[type, str], tuple[type, tuple[str, ...]]] = {}
MAKERS = {
    laws.BeaconLaws: "make_map_type",
    laws.SlideLaws: "make_matcher",
    laws.SlideNearLaws: "make_matcher",
    laws.SumLaws: "make_fuser",
    laws.DisagreementLaws: "make_metric",
    laws.FirstOneLaws: "make_acceptor",
    laws.AtMostLaws: "make_verifier",
    laws.ToMarksLaws: "make_conversion",
    laws.RegularLaws: "make_policy",
}
EXACT = ("the_ledger_is_exact", "multi_map_is_exact", "a_reverted_map_is_one_that_never_merged")
UPDATED = ("an_updated_view_equals_a_fresh_one", "observing_tells_what_it_touched", *EXACT)
BAKED = ("absorbing_is_viewing", "multi_map_is_exact", "a_single_map_says_what_it_lost")


def breaks(kind, law, *along):
    """Note that a class breaks a law, and which other ones it may break."""

    def note(faulty):
        FAULTS[kind, law] = (faulty, along)
        return faulty

    return note


@breaks(laws.BeaconLaws, "names_are_one_word")
class OtherWord(Beacons):
    def metadata(self, layer):
        return dataclasses.replace(super().metadata(layer), type="beacon")


@breaks(laws.BeaconLaws, "a_new_layer_is_empty", *UPDATED, "observing_is_deterministic", "decoding_is_the_inverse",
        "a_decoded_layer_lives_on", "damaged_bytes_are_refused", "nothing_cannot_be_placed", *BAKED,
        "the_order_of_merges_changes_nothing", "structure_lies_in_the_map", "a_moved_robot_makes_a_moved_map",
        "a_placed_map_is_a_moved_map", "regions_are_sets", "regions_meet_where_they_have_a_unit_in_common",
        "regions_are_not_written", "resetting_counts_what_it_says")  # fmt: skip
class NeverEmpty(Beacons):
    def new_layer(self):
        return Heard(Counter({0: 1}))


@breaks(laws.BeaconLaws, "observing_writes_only_its_layer", *UPDATED, *BAKED, "a_decoded_layer_lives_on",
        "observing_is_deterministic", "the_order_of_merges_changes_nothing", "resetting_counts_what_it_says",
        "decoding_is_the_inverse", "damaged_bytes_are_refused")  # fmt: skip
class Sharing(Beacons):
    """Decoded layers share their counts with whatever was encoded to the same bytes."""

    def __init__(self):
        super().__init__()
        self.kept = {}

    def encode(self, layer):
        data = super().encode(layer)
        self.kept[data] = layer.counts
        return data

    def decode(self, data):
        layer = super().decode(data)
        return Heard(self.kept[data]) if data in self.kept else layer


@breaks(laws.BeaconLaws, "observing_tells_what_it_touched", *UPDATED, "a_single_map_says_what_it_lost",
        "regions_are_sets")  # fmt: skip
class TouchesLess(Beacons):
    def integrate(self, layer, observation):
        touched = super().integrate(layer, observation)
        return Places(frozenset(sorted(touched.at)[:1]))


@breaks(laws.BeaconLaws, "observing_is_deterministic", *UPDATED, *BAKED, "a_decoded_layer_lives_on",
        "placing_is_pure", "views_are_deterministic", "a_moved_robot_makes_a_moved_map")  # fmt: skip
class Remembers(Beacons):
    seen = 0

    def integrate(self, layer, observation):
        Remembers.seen += 1
        touched = super().integrate(layer, observation)
        layer.counts.update(dict.fromkeys(touched.at, Remembers.seen % 7))
        return touched


@breaks(laws.BeaconLaws, "what_cannot_be_mapped_is_refused")
class TakesAnything(Beacons):
    def integrate(self, layer, observation):
        if not isinstance(observation.payload, tuple | dict):
            return Places(frozenset())
        return super().integrate(layer, observation)


@breaks(laws.BeaconLaws, "decoding_is_the_inverse", "a_decoded_layer_lives_on", *BAKED,
        "the_order_of_merges_changes_nothing", "observing_writes_only_its_layer", "names_are_one_word")  # fmt: skip
class LosesSigns(Beacons):
    def decode(self, data):
        return Heard(Counter({at: abs(n) for at, n in super().decode(data).counts.items()}))


@breaks(laws.BeaconLaws, "a_decoded_layer_lives_on", "observing_writes_only_its_layer", *BAKED, *EXACT)
class Frozen(Beacons):
    """A decoded layer is only to look at."""

    def decode(self, data):
        layer = super().decode(data)
        layer.frozen = True
        return layer

    def integrate(self, layer, observation):
        if getattr(layer, "frozen", False):
            raise MapError("this layer came from elsewhere")
        return super().integrate(layer, observation)


@breaks(laws.BeaconLaws, "damaged_bytes_are_refused")
class Trusting(Beacons):
    def decode(self, data):
        try:
            return super().decode(data)
        except MapError:
            return Heard()


@breaks(laws.BeaconLaws, "metadata_can_be_sent")
class Unsendable(Beacons):
    def metadata(self, layer):
        return dataclasses.replace(super().metadata(layer), extra={"heard": frozenset(layer.evidence())})


@breaks(laws.BeaconLaws, "looking_writes_nothing", *UPDATED, "views_are_deterministic", *BAKED,
        "the_map_knows_what_it_says", "the_order_of_merges_changes_nothing")  # fmt: skip
class Tidies(Beacons):
    """Looking at a contribution forgets what was heard least."""

    def view(self, own, contributions=(), previous=None, touched=None):
        seen = super().view(own, contributions, previous, touched)
        for given in contributions:
            given.layer.counts.pop(max(given.layer.counts, default=None), None)
        return seen


@breaks(laws.BeaconLaws, "views_are_deterministic", *UPDATED, *BAKED, "the_map_knows_what_it_says",
        "the_order_of_merges_changes_nothing", "looking_writes_nothing", "decoding_is_the_inverse",
        "resetting_counts_what_it_says", "files_start_with_their_stem", "placing_is_pure")  # fmt: skip
class Chancy(Beacons):
    def __init__(self):
        super().__init__()
        self.offset = random.SystemRandom().randrange(10**6)

    def files(self, map_, stem):
        return {**super().files(map_, stem), f"{stem}.seed": str(self.offset).encode()}


@breaks(laws.BeaconLaws, "an_updated_view_equals_a_fresh_one", *UPDATED, "absorbing_is_viewing",
        "resetting_counts_what_it_says", "a_single_map_says_what_it_lost")  # fmt: skip
class OnlyGrows(Beacons):
    """A view that is updated never forgets a beacon."""

    def view(self, own, contributions=(), previous=None, touched=None):
        fresh = super().view(own, contributions)
        return fresh if previous is None else Chart({**previous.counts, **fresh.counts})


@breaks(laws.BeaconLaws, "the_map_knows_what_it_says")
class KnowsHeardOnly(Beacons):
    def known_region(self, map_):
        return Places(frozenset(at for at, n in map_.counts.items() if n > 0))


@breaks(laws.BeaconLaws, "structure_lies_in_the_map")
class IgnoresWithin(Beacons):
    def structure(self, map_, within=None):
        return super().structure(map_)


@breaks(laws.BeaconLaws, "a_moved_robot_makes_a_moved_map")
class InTheSensorFrame(Beacons):
    def integrate(self, layer, observation):
        return super().integrate(layer, dataclasses.replace(observation, T_map_sensor=Transform.identity()))


@breaks(laws.BeaconLaws, "messages_encode")
class WrongField(Beacons):
    def messages(self, map_):
        return [OutputMessage("map", "std_msgs/msg/String", {"text": "beacons"})]


@breaks(laws.BeaconLaws, "files_start_with_their_stem")
class OneFile(Beacons):
    def files(self, map_, stem):
        return {"beacons.csv": b""}


@breaks(laws.BeaconLaws, "placing_is_pure", "looking_writes_nothing", "placing_snaps_first", *EXACT)
class Moves(Beacons):
    """What is placed is gone where it was."""

    def place(self, layer, T_receiver_donor, scale=1.0):
        placed = super().place(layer, T_receiver_donor, scale)
        layer.counts.clear()
        return placed


@breaks(laws.BeaconLaws, "placing_snaps_first")
class RawTransform(Beacons):
    def place(self, layer, T_receiver_donor, scale=1.0):
        placed = super().place(layer, T_receiver_donor, scale)
        placed.counts[0] += int(T_receiver_donor.x_m != T_receiver_donor.snapped().x_m)
        return placed


@breaks(laws.BeaconLaws, "a_placed_map_is_a_moved_map")
class PlacesBackwards(Beacons):
    def place(self, layer, T_receiver_donor, scale=1.0):
        return super().place(layer, T_receiver_donor.inverse(), scale)


@breaks(laws.BeaconLaws, "a_scale_is_honoured_or_refused")
class IgnoresScale(Beacons):
    def place(self, layer, T_receiver_donor, scale=1.0):
        return super().place(layer, T_receiver_donor)


@breaks(laws.BeaconLaws, "nothing_cannot_be_placed")
class PlacesNothing(Beacons):
    def place(self, layer, T_receiver_donor, scale=1.0):
        return super().place(layer, T_receiver_donor, scale) if layer.evidence() else Heard()


@breaks(laws.BeaconLaws, "absorbing_is_viewing", *BAKED, "multi_map_is_exact", "a_single_map_says_what_it_lost",
        "resetting_counts_what_it_says")  # fmt: skip
class AbsorbsTwice(Beacons):
    def absorb(self, layer, contribution):
        super().absorb(layer, contribution)
        return super().absorb(layer, contribution)


@breaks(laws.BeaconLaws, "resetting_counts_what_it_says", "a_single_map_says_what_it_lost")
class CountsAll(Beacons):
    def reset(self, layer, foreign, keep):
        said = super().reset(layer, foreign, keep)
        return Reset(said.touched, len(foreign), said.cells_contaminated)


class _BadUnion(Places):
    def union(self, other):
        return type(self)(self.at ^ other.at)

    def minus(self, other):
        return type(self)(self.at - other.at)


class _Writing(Places):
    def union(self, other):
        object.__setattr__(self, "at", self.at | other.at)
        return self

    def minus(self, other):
        return type(self)(self.at - other.at)


class _Meets(Places):
    def union(self, other):
        return type(self)(self.at | other.at)

    def minus(self, other):
        return type(self)(self.at - other.at)

    def meets(self, other):
        return bool(self.at) and bool(other.at)


def regions_are(kind):
    """The map type with another class of regions."""

    class Faulty(Beacons):
        def integrate(self, layer, observation):
            return kind(super().integrate(layer, observation).at)

        def region(self, layer):
            return kind(super().region(layer).at)

        def absorb(self, layer, contribution):
            return kind(super().absorb(layer, contribution).at)

        def known_region(self, map_):
            return kind(super().known_region(map_).at)

    return Faulty


breaks(laws.BeaconLaws, "regions_are_sets", *UPDATED, *BAKED, "resetting_counts_what_it_says",
       "regions_are_not_written", "regions_meet_where_they_have_a_unit_in_common")(regions_are(_BadUnion))  # fmt: skip
breaks(laws.BeaconLaws, "regions_are_not_written", "regions_are_sets", *UPDATED, *BAKED,
       "resetting_counts_what_it_says")(regions_are(_Writing))  # fmt: skip
breaks(laws.BeaconLaws, "regions_meet_where_they_have_a_unit_in_common")(regions_are(_Meets))


@breaks(laws.BeaconLaws, "the_ledger_is_exact", *EXACT, "an_updated_view_equals_a_fresh_one", "absorbing_is_viewing",
        "the_order_of_merges_changes_nothing", "looking_writes_nothing", "the_map_knows_what_it_says",
        "a_single_map_says_what_it_lost")  # fmt: skip
class Sticky(Beacons):
    """What a merge has contributed is remembered by its donor, and never looked at again."""

    def __init__(self):
        super().__init__()
        self.kept = {}

    def view(self, own, contributions=(), previous=None, touched=None):
        kept = tuple(self.kept.setdefault(given.provenance.source, given) for given in contributions)
        return super().view(own, kept)


@breaks(laws.BeaconLaws, "multi_map_is_exact", *BAKED, "decoding_is_the_inverse", "the_order_of_merges_changes_nothing")
class ForgetsMerges(Beacons):
    """What was absorbed does not survive encoding."""

    def absorb(self, layer, contribution):
        layer.absorbed = [*getattr(layer, "absorbed", []), contribution]
        return Places(frozenset(contribution.layer.evidence()))

    def view(self, own, contributions=(), previous=None, touched=None):
        return super().view(own, (*getattr(own, "absorbed", ()), *contributions), previous, touched)


@breaks(laws.BeaconLaws, "the_order_of_merges_changes_nothing", *EXACT, "absorbing_is_viewing",
        "an_updated_view_equals_a_fresh_one")  # fmt: skip
class FirstCountsDouble(Beacons):
    def view(self, own, contributions=(), previous=None, touched=None):
        return super().view(own, (*contributions[:1], *contributions))


@breaks(laws.BeaconLaws, "a_reverted_map_is_one_that_never_merged", *EXACT, *UPDATED, "looking_writes_nothing",
        "views_are_deterministic", "absorbing_is_viewing", "the_order_of_merges_changes_nothing",
        "the_map_knows_what_it_says", "a_single_map_says_what_it_lost", "resetting_counts_what_it_says")  # fmt: skip
class WritesThrough(Beacons):
    """The fused map is written into the own layer."""

    def view(self, own, contributions=(), previous=None, touched=None):
        seen = super().view(own, contributions)
        if own is not None and contributions:
            own.counts.clear()
            own.counts.update(seen.counts)
        return seen


@breaks(laws.BeaconLaws, "a_single_map_says_what_it_lost", "absorbing_is_viewing", "resetting_counts_what_it_says")
class TellsLess(Beacons):
    """What it absorbs on beacons that the layer has already, it does not tell."""

    def absorb(self, layer, contribution):
        known = frozenset(layer.evidence())
        return Places(super().absorb(layer, contribution).at - known)

    def reset(self, layer, foreign, keep):
        return dataclasses.replace(super().reset(layer, foreign, keep), cells_contaminated=0)


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
            def convert(self, layer, target):
                return fault(layer, super().convert(layer, target))

        return breaks(laws.ToMarksLaws, law, *along)(Faulty)

    return note


@converts("converting_is_pure", "converting_moves_along", "regions_are_converted")
def _converts_away(layer, made):
    layer.counts.clear()
    return made


@converts("the_result_is_of_the_target")
def _gives_beacons(layer, made):
    made.map_type = "beacons"
    return made


@converts("what_stands_stays", "regions_are_converted")
def _aside(layer, made):
    made.counts = Counter({at + 3: n for at, n in made.counts.items()})
    return made


@converts("converting_moves_along", "what_stands_stays", "regions_are_converted")
def _mirrored(layer, made):
    made.counts = Counter({-at: n for at, n in made.counts.items()})
    return made


@converts("counts_survive", "regions_are_converted")
def _classes_only(layer, made):
    made.counts = Counter({at: 1 if n > 0 else -1 for at, n in made.counts.items() if n})
    return made


@converts("nothing_converts_to_nothing", "regions_are_converted", "the_result_is_of_the_target")
def _something_always(layer, made):
    made.counts[0] += 1 if not made.evidence() else 0
    return made


@breaks(laws.ToMarksLaws, "regions_are_converted")
class NamesNothing(laws.ToMarks):
    def region(self, region, target):
        return Places(frozenset())


@breaks(laws.ToMarksLaws, "foreign_types_are_refused", "nothing_converts_to_nothing")
class TakesAnyLayer(laws.ToMarks):
    def convert(self, layer, target):
        known = isinstance(layer, Heard) and target.name == "marks"
        return super().convert(layer, target) if known else target.new_layer()


@breaks(laws.RegularLaws, "meetings_fall_into_their_time")
class MeetsTwice(laws.Regular):
    def due(self, situation):
        return [met for met in super().due(situation) for _ in range(2)][:3]


def faulty_laws(kind, law, examples):
    """The class of laws with the faulty thing in the good one's place."""
    faulty, _ = FAULTS[kind, law]
    given = {"limit": 0.5, "confirm_after": 3} if issubclass(faulty, beacons.AtMost) else {}
    return type(
        kind.__name__, (kind,), {MAKERS[kind]: lambda self: faulty(**given), "examples": examples, "shrinks": False}
    )()

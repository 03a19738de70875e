"""One fault of the map type ``beacons`` for every law of map types: the smallest change that breaks it."""

from __future__ import annotations

import dataclasses
import random
from collections import Counter

import beacon_laws as laws
from beacons import Beacons, Chart, Heard, Places
from fault_book import breaks

from mapgraft.contracts import MapError, OutputMessage, Reset, Transform

EXACT = ("the_ledger_is_exact", "multi_map_is_exact", "a_reverted_map_is_one_that_never_merged")
UPDATED = ("an_updated_view_equals_a_fresh_one", "observing_tells_what_it_touched", *EXACT)
BAKED = ("absorbing_is_viewing", "multi_map_is_exact", "a_single_map_says_what_it_lost")


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


@breaks(laws.BeaconLaws, "joining_is_the_inverse_of_cutting", "a_joined_layer_lives_on", "damaged_parts_are_refused")
class CutsShort(Beacons):
    def parts(self, layer):
        return dict(list(super().parts(layer).items())[:1])


@breaks(laws.BeaconLaws, "a_joined_layer_lives_on", *EXACT, "multi_map_is_exact")
class FrozenTogether(Frozen):
    """A joined layer is only to look at; a decoded one is not."""

    def decode(self, data):
        return Beacons.decode(self, data)

    def join(self, parts):
        layer = super().join(parts)
        layer.frozen = True
        return layer


@breaks(laws.BeaconLaws, "damaged_parts_are_refused")
class JoinsAnything(Beacons):
    def join(self, parts):
        try:
            return super().join(parts)
        except MapError:
            return Heard()


@breaks(laws.BeaconLaws, "a_preview_shows_the_map")
class ShowsHeardOnly(Beacons):
    def preview(self, layer):
        return Heard(Counter({at: n for at, n in super().preview(layer).counts.items() if n > 0}))


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


@breaks(laws.BeaconLaws, "placing_makes_no_looks")
class PlacesTwice(Beacons):
    """Whatever is placed counts double."""

    def place(self, layer, T_receiver_donor, scale=1.0):
        placed = super().place(layer, T_receiver_donor, scale)
        return Heard(Counter({at: 2 * n for at, n in placed.counts.items()}))


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

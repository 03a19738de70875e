"""Every law catches the plugin that breaks it, and only what has to do with it breaks along."""

from __future__ import annotations

from dataclasses import replace

import beacon_faults as faults
import beacon_laws
import beacons
import echoes
import pytest

from mapgraft.contracts import MapMetadata, Metric, Observation
from mapgraft.testing import examine, laws_of

EXAMPLES = 80
TWICE = {beacon_laws.SlideNearLaws: beacon_laws.SlideLaws, beacon_laws.EchoesLaws: beacon_laws.DisagreementLaws}
ALL = [(kind, law.name) for kind in beacon_laws.ALL for law in laws_of(kind)]
DEAR = ("the_ledger_is_exact", "multi_map_is_exact", "a_single_map_says_what_it_lost", "damaged_bytes_are_refused")


def name_of(value: object) -> str:
    return value.__name__.removesuffix("Laws") if isinstance(value, type) else str(value)


def test_every_law_has_its_fault() -> None:
    """Of two things of one kind each law is broken by one at least."""
    tried = {(TWICE.get(kind, kind), law) for kind, law in faults.FAULTS}
    assert {(TWICE.get(kind, kind), law) for kind, law in ALL} == tried
    assert set(faults.FAULTS) <= set(ALL)


@pytest.mark.parametrize(("kind", "law"), faults.FAULTS, ids=name_of)
def test_the_right_law_breaks_and_only_what_has_to_do_with_it(kind: type, law: str) -> None:
    (meant,) = [one for one in laws_of(kind) if one.name == law]
    outcome = examine(faults.faulty_laws(kind, law, EXAMPLES), meant)
    assert outcome.status == "broken", outcome
    assert outcome.sentence and "\n" not in outcome.sentence
    once, (_, along) = faults.faulty_laws(kind, law, examples=1), faults.FAULTS[kind, law]
    others = [one for one in laws_of(kind) if one.name not in (law, *along, *DEAR)]
    assert {one.name: outcome.sentence for one in others if (outcome := examine(once, one)).status == "broken"} == {}


def test_a_stream_that_hears_nothing_is_not_called_kept() -> None:
    class Deaf(echoes.EchoTracker):
        def places(self, observation: Observation) -> frozenset[int]:
            return frozenset()

    class Laws(beacon_laws.EchoesLaws):
        examples = 10

        def make_metric(self) -> Metric:
            made = echoes.Echoes()
            made.track = Deaf
            return made

    told = {one.name: examine(Laws(), one) for one in laws_of(Laws) if one.vacuous}
    for law in ("an_updated_tracker_equals_a_fresh_one", "a_changed_donor_is_measured"):
        assert told[law].status == "not tried"
        assert "in none of the scenes an observation made any difference" in told[law].sentence


@pytest.mark.parametrize("extra", [{"story": "and then " * 2000}, {"places": [1, 2]}])
def test_metadata_that_no_other_robot_reads_are_not_called_sendable(extra: dict[str, object]) -> None:
    class TellsTooMuch(beacons.Beacons):
        def metadata(self, layer: beacons.Heard) -> MapMetadata:
            return replace(super().metadata(layer), extra=extra)

    class Laws(beacon_laws.BeaconLaws):
        examples = 3

        def make_map_type(self) -> beacons.Beacons:
            return TellsTooMuch()

    (law,) = [one for one in laws_of(Laws) if one.name == "metadata_can_be_sent"]
    assert examine(Laws(), law).status == "broken"

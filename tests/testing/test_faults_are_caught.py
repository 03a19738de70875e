"""Every law catches the plugin that breaks it, and only what has to do with it breaks along."""

from __future__ import annotations

import beacon_faults as faults
import beacon_laws
import pytest

from mapgraft.testing import examine, laws_of

BYSTANDERS = 2  # examples of the laws that are not meant
ALL = [(kind, law.name) for kind in beacon_laws.ALL for law in laws_of(kind)]
NEAR = [  # the laws of matchers are tried on one of the two matchers
    (beacon_laws.SlideNearLaws, law.name) for law in laws_of(beacon_laws.SlideLaws) if law.name != "the_prior_is_scored"
]


def name_of(value: object) -> str:
    return value.__name__.removesuffix("Laws") if isinstance(value, type) else str(value)


def test_every_law_has_its_fault() -> None:
    untested = set(ALL) - set(faults.FAULTS) - set(NEAR) - {(beacon_laws.SlideLaws, "the_prior_is_scored")}
    assert untested == set()
    assert set(faults.FAULTS) <= set(ALL)


@pytest.mark.parametrize(("kind", "law"), faults.FAULTS, ids=name_of)
def test_the_right_law_breaks(kind: type, law: str) -> None:
    (meant,) = [one for one in laws_of(kind) if one.name == law]
    outcome = examine(faults.faulty_laws(kind, law, examples=80), meant)
    assert outcome.status == "broken", outcome
    assert outcome.sentence and "\n" not in outcome.sentence


@pytest.mark.parametrize(("kind", "law"), faults.FAULTS, ids=name_of)
def test_only_what_has_to_do_with_it_breaks_along(kind: type, law: str) -> None:
    subject, (_, along) = faults.faulty_laws(kind, law, BYSTANDERS), faults.FAULTS[kind, law]
    others = [one for one in laws_of(kind) if one.name != law and one.name not in along]
    assert {one.name: outcome.sentence for one in others if (outcome := examine(subject, one)).status == "broken"} == {}

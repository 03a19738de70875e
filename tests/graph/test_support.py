"""How sure a robot is of a merge, in one number."""

from __future__ import annotations

import math

import pytest

from mapgraft.contracts import Measurement, Sample, Verdict
from mapgraft.graph.claims import MOST_SUPPORT
from mapgraft.graph.support import ACCEPTED, CONFIRMED, MOST_JUDGED, as_believed, support_of


def sample(log_odds: float = 3.0, value: float = 0.95) -> Sample:
    probable = Measurement("any name", value, "1", 10, "higher", {"log_odds": log_odds, "walls": 2.0})
    other = Measurement("similarity", 0.5, "1", 10, "higher", {"cells": 4.0})
    return Sample(0, 0, {"any name": probable, "similarity": other})


def verdict(wrong: float) -> Verdict:
    return Verdict("keep", "so far", {"log_odds_wrong": wrong})


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (([], None, False, True), MOST_SUPPORT),
        (([], None, False, False), ACCEPTED),
        (([], None, True, False), CONFIRMED),
        (([sample()], None, False, False), 3.0),
        (([sample(20.0)], None, False, False), MOST_JUDGED),
        (([sample(-2.0)], None, False, False), -2.0),
        (([sample()], None, True, False), CONFIRMED),
        (([sample()], verdict(-5.0), False, False), 5.0),
        (([sample()], verdict(-50.0), True, False), MOST_JUDGED),
        (([sample()], verdict(50.0), True, False), -MOST_SUPPORT),
        (([sample()], verdict(4.0), True, False), -4.0),
        (([sample()], verdict(math.nan), False, False), 3.0),
        (([sample(math.nan)], None, False, False), ACCEPTED),
        (([sample(value=math.nan)], None, False, False), ACCEPTED),
        (([sample()], Verdict("keep", "tells nothing"), False, False), 3.0),
    ],
)
def test_support(given, expected) -> None:
    assert support_of(*given) == expected


def test_of_what_is_attached_the_chain_tells_the_probability_and_nothing_else_changes() -> None:
    (told,) = as_believed([sample(-8.0, 0.0003)], 2.0)
    assert told.measurements["any name"].value == pytest.approx(1.0 / (1.0 + math.exp(-2.0)))
    assert told.measurements["any name"].details == {"log_odds": 2.0, "walls": 2.0}
    assert told.measurements["similarity"] == sample().measurements["similarity"]


def test_what_could_not_be_measured_stays_unmeasured() -> None:
    (told,) = as_believed([sample(value=math.nan)], 2.0)
    assert math.isnan(told.measurements["any name"].value)

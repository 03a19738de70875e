"""What is known of an example in the end: what most say, and the place that goes with it."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.contracts import Transform
from mapgraft.examples import ExampleKey, Word, transform_of
from mapgraft.examples.judged import judged

JUDGED = Transform.planar(7.0, 3.0, 0.0)
MOVED = Transform.planar(1.0, 2.0, 0.3)
REFINED = Transform.planar(7.1, 3.0, 0.01)
PLACES = {"none": None, "judged": JUDGED, "moved": MOVED, "refined": REFINED}


def example(T: Transform | None = JUDGED, **told: Any) -> dict[str, Any]:
    """One of which nobody knows the truth; what both maps know is a square of 20 m about the receiver's origin."""
    window = {"window_px_w": 40, "window_px_h": 40, "window_px_m": 0.5, "window_x_m": -10.0, "window_y_m": -10.0}
    known = {"example_id": "a.b.1", "truth": None, "truth_by": None, "truth_T": None}
    return {**known, **window, "T_receiver_donor": None if T is None else T.matrix.ravel(), **told}


def words(*said: tuple[str, str]) -> list[Word]:
    """One word per (label, place), each of another person."""
    return [
        Word(ExampleKey("r1", "a.b.1"), label, f"p{n}", JUDGED, PLACES[place], "", n, None)
        for n, (label, place) in enumerate(said)
    ]


def known(*said: tuple[str, str], **told: Any) -> tuple[str | None, Transform | None]:
    row = judged(example(**told), words(*said))
    return row["label"], transform_of(row["T_label"] if row["T_label"] is None else row["T_label"].ravel())


@pytest.mark.parametrize(
    ("said", "label", "place"),
    [
        ([("wrong", "none"), ("wrong", "none"), ("right", "judged")], "wrong", None),
        ([("wrong", "none"), ("wrong", "moved"), ("right", "judged")], "wrong", MOVED),
        ([("right", "judged"), ("right", "judged"), ("right", "refined"), ("wrong", "moved")], "right", JUDGED),
        ([("right", "judged"), ("wrong", "none")], "unsure", None),
        ([("right", "judged"), ("unsure", "moved")], "right", JUDGED),
        ([("unsure", "moved"), ("unsure", "moved")], "unsure", None),
        ([("wrong", "judged")], "wrong", None),  # the label was changed in a table, the pose beside it was not
        ([("right", "moved")], "right", None),
        ([], None, None),
    ],
)
def test_the_place_is_that_of_those_who_say_what_counts(said, label, place):
    told, T = known(*said)
    assert told == label and (T is None) == (place is None)
    assert T is None or T.difference(place)[0] < 1e-9


@given(st.lists(st.tuples(st.sampled_from(["right", "wrong", "unsure"]), st.sampled_from([*PLACES])), max_size=6))
def test_no_place_contradicts_the_label(said: list[tuple[str, str]]):
    label, T = known(*said)
    if T is not None:
        shift_m, turn_rad = JUDGED.difference(T)
        near = shift_m <= 0.5 and turn_rad <= math.radians(5.0)
        assert near == (label == "right") and label in ("right", "wrong")


def test_places_are_compared_where_the_maps_lie_and_not_at_an_origin_far_off():
    """Half a degree about the middle of the maps moves an origin that is 200 m off by almost two metres."""
    far = Transform.planar(200.0, 0.0, 0.0)
    turned = Transform.planar(0.0, 0.0, math.radians(0.5)) @ far
    one = Word(ExampleKey("r1", "a.b.1"), "right", "p", far, turned, "", 0, None)
    T = transform_of(judged(example(far), [one])["T_label"].ravel())
    assert T is not None and T.difference(turned)[0] < 1e-9
    assert judged(example(far, window_px_m=None), [one])["T_label"] is None  # nothing tells where they lie


def test_where_nothing_was_proposed_the_place_is_that_of_who_says_right():
    assert known(("right", "moved"), T=None)[1].difference(MOVED)[0] < 1e-9
    assert known(("wrong", "none"), ("wrong", "none"), ("right", "moved"), T=None) == ("wrong", None)


def test_the_truth_goes_before_persons():
    label, T = known(("wrong", "moved"), truth="right", truth_by="given", truth_T=REFINED.matrix.ravel())
    assert label == "right" and T is not None and T.difference(REFINED)[0] < 1e-9

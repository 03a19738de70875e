"""What enters a map: so many times, or as a prior that a few looks override however it was drawn."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mapgraft.contracts import Contribution, Donation, MapError, Match, Provenance, Transform
from mapgraft_lines.layer import LOOKS, LineLayer, W
from mapgraft_lines.map_type import LineSegments
from mapgraft_lines.segments import from_segments
from mapgraft_lines.union import LineUnion
from mapgraft_lines.weights import Bounds, as_prior, bounded

KIND = LineSegments()
TURN_RAD = math.radians(20.0)
THROUGH = 6  # looks: one in five must have seen a wall that stands, and the prior is one


def along(xs: NDArray[np.float64], y: float | NDArray[np.float64]) -> NDArray[np.float64]:
    """Segments from place to place at a height, turned a little, so that no wall runs as the cells do."""
    points = np.column_stack((xs, np.broadcast_to(y, xs.shape)))
    c, s = math.cos(TURN_RAD), math.sin(TURN_RAD)
    points = points @ np.array([[c, s], [-s, c]])
    return np.stack((points[:-1], points[1:]), axis=1)


CENTIMETRES = np.linspace(0.0, 4.0, 401)
JAGGED = np.where(np.arange(401) % 2, 0.0015, 0.0)  # directions change by 17° from piece to piece
DRAWN = {
    "one line": along(np.array([0.0, 4.0]), 0.0),
    "two faces": np.concatenate((along(np.array([0.0, 4.0]), -0.06), along(np.array([0.0, 4.0]), 0.06))),
    "ten times": np.repeat(along(np.array([0.0, 4.0]), 0.0), 10, axis=0),
    "pieces of 1 cm": along(CENTIMETRES, 0.0),
    "outlines of an image": along(CENTIMETRES, JAGGED),
}


def told(segments: NDArray[np.float64], **more: object) -> Contribution:
    layer = from_segments(KIND, segments, 0.1)
    donation = Donation(layer, Provenance("plan", 1, 1))
    match = Match(Transform.identity(), 1.0, 1.0)
    return dataclasses.replace(LineUnion().fuse(KIND, KIND.view(None), donation, match), **more)


def through(looks: int) -> LineLayer:
    """A map that was looked through everywhere so many times."""
    at = np.stack(np.meshgrid(np.arange(-8, 24), np.arange(-8, 24)), axis=-1).reshape(-1, 2) * 0.25 + 0.1
    return from_segments(KIND, np.empty((0, 2, 2)), free_m=at, free_looks=looks)


@pytest.mark.parametrize("drawn", DRAWN)
def test_a_prior_is_one_look_however_it_was_drawn(drawn: str) -> None:
    entered = KIND.view(None, [as_prior(told(DRAWN[drawn]))])
    assert set(entered.total.pieces.counts[:, LOOKS].tolist()) == {1}
    longest = entered.walls.lengths_m[0]
    assert longest == pytest.approx(4.0, abs=0.1)
    assert entered.walls.looks[0] == pytest.approx(1.0)
    # of its information no slot has more than a line across the cell: 1.1 is the rounding of weights about 10
    line = 256 * (0.02 / 0.1) ** 2
    assert entered.total.pieces.counts[:, W].max() <= math.ceil(1.1 * line / math.cos(TURN_RAD))


@pytest.mark.parametrize("drawn", DRAWN)
def test_a_few_looks_through_it_override_a_prior_however_it_was_drawn(drawn: str) -> None:
    prior = as_prior(told(DRAWN[drawn]))
    assert KIND.view(through(THROUGH - 1), [prior]).walls.lengths_m.sum() > 3.9
    assert len(KIND.view(through(THROUGH), [prior]).walls) == 0


@pytest.mark.parametrize("drawn", DRAWN)
def test_a_prior_hardly_moves_a_wall_that_was_seen(drawn: str) -> None:
    beside = np.array([-math.sin(TURN_RAD), math.cos(TURN_RAD)]) * 0.05
    seen = from_segments(KIND, DRAWN["one line"] + beside, 0.02, looks=4)
    walls = KIND.view(seen, [as_prior(told(DRAWN[drawn]))]).walls
    off = (walls.ends_m[0] - DRAWN["one line"][0, 0]) @ beside / 0.05
    np.testing.assert_allclose(off, 0.05, atol=0.006)


def test_baked_in_it_says_no_more() -> None:
    layer = through(THROUGH)
    KIND.absorb(layer, as_prior(told(DRAWN["pieces of 1 cm"])))
    assert len(KIND.view(layer).walls) == 0
    assert layer.absorbed.equals(KIND.view(None, [as_prior(told(DRAWN["pieces of 1 cm"]))]).received)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.booleans())
def test_no_two_pieces_of_a_prior_add_up(seed: int, count: int, faced: bool) -> None:
    random = np.random.default_rng(seed)
    start = random.uniform(-1.0, 1.0, (count, 1, 2))
    segments = np.concatenate((start, start + random.uniform(-0.4, 0.4, (count, 1, 2))), axis=1)
    layer = from_segments(KIND, segments, 0.05, faced=faced, looks=3, free_m=start[:, 0], free_looks=9)
    found = bounded(layer, Bounds(0.05))
    slots = found.pieces.keys & 31
    for a, b in np.argwhere((found.pieces.keys[:, None] ^ found.pieces.keys) < 32).tolist():
        bins = 16 if slots[a] < 17 else 8
        assert a == b or (slots[a] < 17) != (slots[b] < 17) or 1 < abs(int(slots[a] - slots[b])) < bins - 1
    assert set(found.pieces.counts[:, LOOKS].tolist()) == {1} and set(found.space.counts[:, 0].tolist()) == {1}
    assert (found.pieces.counts[:, W] >= 1).all()
    assert len(KIND.view(None, [as_prior(told(segments))]).walls) >= 0  # rows that a wall can be grown of


def test_a_prior_is_bounded_or_refused() -> None:
    loud = told(DRAWN["one line"], role="prior", weights=1)
    for enter in (lambda: KIND.view(None, [loud]), lambda: KIND.absorb(KIND.new_layer(), loud)):
        with pytest.raises(MapError, match="weighted by its Bounds"):
            enter()
    for weights in (0, 4, True, 1.0, None, Bounds()):
        with pytest.raises(MapError, match="whole number from 1 to 3"):
            KIND.view(None, [told(DRAWN["one line"], weights=weights)])
    with pytest.raises(MapError, match="m unsure, found 20"):
        Bounds(20.0)


def test_what_was_received_is_added_up_once() -> None:
    """A look of one's own costs nothing where nothing else has changed, however much was received."""
    contribution = told(DRAWN["pieces of 1 cm"])
    layer = through(1)
    before = KIND.view(layer, [contribution])
    layer.own = layer.own.plus(through(1).own)
    after = KIND.view(layer, [contribution], before, KIND.region(layer))
    assert after.received is before.received
    assert KIND.view(layer, [], after, contribution.region).received.is_empty
    assert not KIND.view(layer, [told(DRAWN["one line"])], after, contribution.region).received.equals(after.received)

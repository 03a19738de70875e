"""Ray casting: the fast way equals brute force bit for bit, and brute force equals geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft_recordings.simulator import cast_fan, cast_rays, distance_to_walls, unit_vectors

SQUARE = np.array([[-2.0, -1.0, 3.0, -1.0], [3.0, -1.0, 3.0, 4.0], [3.0, 4.0, -2.0, 4.0], [-2.0, 4.0, -2.0, -1.0]])

metres = st.one_of(st.floats(-12.0, 12.0), st.integers(-24, 24).map(lambda half: half / 2))
segments = st.lists(st.tuples(metres, metres, metres, metres), min_size=1, max_size=12).map(np.array)
bearings = st.one_of(st.floats(-20.0, 20.0), st.integers(-8, 8).map(lambda eighth: eighth * math.pi / 4))


def brute_force(x: float, y: float, directions: np.ndarray, walls: np.ndarray, max_m: float) -> np.ndarray:
    return cast_rays(np.tile((x, y), (len(directions), 1)), directions, walls, max_m)


@settings(max_examples=300, deadline=None)
@given(
    x=metres,
    y=metres,
    first=bearings,
    beams=st.integers(2, 90),
    field=st.one_of(st.floats(0.01, 2 * math.pi), st.just(2 * math.pi)),
    clockwise=st.booleans(),
    walls=segments,
    max_m=st.floats(0.5, 30.0),
)
def test_fan_equals_brute_force_bit_for_bit(
    x: float, y: float, first: float, beams: int, field: float, clockwise: bool, walls: np.ndarray, max_m: float
) -> None:
    increment = field / beams * (-1.0 if clockwise else 1.0)
    directions = unit_vectors(first + increment * np.arange(beams))
    fan = cast_fan(x, y, first, increment, directions, walls, max_m)
    assert np.array_equal(fan, brute_force(x, y, directions, walls, max_m))


def test_fan_from_a_point_on_a_wall() -> None:
    first, increment = 0.3, math.radians(1.0)
    directions = unit_vectors(first + increment * np.arange(360))
    for x, y in ((3.0, 1.0), (3.0, -1.0), (2.9999999, 1.0)):
        fan = cast_fan(x, y, first, increment, directions, SQUARE, 20.0)
        assert np.array_equal(fan, brute_force(x, y, directions, SQUARE, 20.0))


def test_ranges_inside_a_box_are_the_distances_to_its_sides() -> None:
    directions = unit_vectors(np.radians([0.0, 90.0, 180.0, 270.0, 45.0]))
    assert brute_force(0.0, 0.0, directions, SQUARE, 20.0) == pytest.approx([3.0, 4.0, 2.0, 1.0, 3.0 * math.sqrt(2)])


def test_no_beam_leaks_out_of_a_closed_box() -> None:
    bearings_rad = np.linspace(-math.pi, math.pi, 20_001)
    corners = np.arctan2(SQUARE[:, 1], SQUARE[:, 0])
    directions = unit_vectors(np.concatenate((bearings_rad, corners)))
    assert np.isfinite(brute_force(0.0, 0.0, directions, SQUARE, 20.0)).all()


def test_nothing_beyond_the_limit() -> None:
    directions = unit_vectors(np.array([0.0, math.pi]))
    assert brute_force(0.0, 0.0, directions, SQUARE, 2.5).tolist() == [math.inf, 2.0]


def test_ray_ends_lie_on_walls() -> None:
    directions = unit_vectors(np.linspace(0, 6.0, 500))
    ranges = brute_force(0.4, 0.7, directions, SQUARE, 20.0)
    assert distance_to_walls((0.4, 0.7) + directions * ranges[:, None], SQUARE).max() < 1e-9

"""Regions against Python sets."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import MapError
from mapgraft_grid.parameters import Lattice
from mapgraft_grid.region import GridRegion

LATTICE = Lattice(0.05)
OTHER = Lattice(0.05, (0.02, 0.0))

Cells = set[tuple[int, int]]
CELL = st.tuples(st.integers(-130, 130), st.integers(-70, 200))
CELLS = st.sets(CELL | st.tuples(st.integers(-(2**30), 2**30 - 1), st.integers(-(2**30), 2**30 - 1)), max_size=40)


def _region(cells: Cells) -> GridRegion:
    """Cell by cell, so that union is tested on the way."""
    out = GridRegion.empty(LATTICE)
    for cell in sorted(cells):
        out = out.union(GridRegion.from_mask(LATTICE, cell, np.ones((1, 1), np.bool_)))
    return out


def _cells(region: GridRegion) -> Cells:
    bits = np.unpackbits(region.rows.view(np.uint8), axis=1, bitorder="little").reshape(-1, 64, 64)
    tile_x, tile_y = (region.keys & ((1 << 26) - 1)) - (1 << 25), (region.keys >> 26) - (1 << 25)
    return {(int(64 * tile_x[t] + c), int(64 * tile_y[t] + r)) for t, r, c in np.argwhere(bits)}


@settings(max_examples=80, deadline=None)
@given(a=CELLS, b=CELLS)
def test_the_algebra_is_that_of_sets(a: Cells, b: Cells) -> None:
    one, two = _region(a), _region(b)
    assert _cells(one) == a
    assert (len(one), len(two)) == (len(a), len(b))
    for ours, theirs in ((one.union(two), a | b), (one.minus(two), a - b), (one.intersection(two), a & b)):
        assert _cells(ours) == theirs
        assert len(ours) == len(theirs)
        assert ours == _region(theirs), "equal sets have equal arrays"
        assert hash(ours) == hash(_region(theirs))
        assert (np.diff(ours.keys) > 0).all()
        assert ours.rows.any(axis=1).all(), "no empty tiles"


@settings(max_examples=60, deadline=None)
@given(
    origin=st.tuples(st.integers(-200, 200), st.integers(-200, 200)),
    shape=st.tuples(st.integers(0, 150), st.integers(0, 150)),
    seed=st.integers(0, 2**32 - 1),
    shift=st.tuples(st.integers(-100, 100), st.integers(-100, 100)),
)
def test_masks_come_back(origin: tuple[int, int], shape: tuple[int, int], seed: int, shift: tuple[int, int]) -> None:
    mask = np.random.default_rng(seed).random(shape) < 0.1
    region = GridRegion.from_mask(LATTICE, origin, mask)
    assert len(region) == mask.sum()
    assert (region.mask(origin, shape) == mask).all()
    window = (origin[0] + shift[0], origin[1] + shift[1])
    inside = {(x, y) for x, y in _cells(region) if 0 <= x - window[0] < 90 and 0 <= y - window[1] < 50}
    assert {(int(x + window[0]), int(y + window[1])) for y, x in np.argwhere(region.mask(window, (50, 90)))} == inside


def test_lattices_do_not_mix() -> None:
    one = GridRegion.from_mask(LATTICE, (0, 0), np.ones((2, 2), np.bool_))
    two = GridRegion.from_mask(OTHER, (0, 0), np.ones((2, 2), np.bool_))
    for operation in (one.union, one.minus, one.intersection):
        with pytest.raises(MapError, match="one lattice"):
            operation(two)
    nothing = GridRegion.empty(OTHER)
    assert one.union(nothing) == nothing.union(one) == one.minus(nothing) == one
    assert len(nothing.minus(one)) == 0
    assert one != two


def test_a_region_cannot_be_written() -> None:
    region = GridRegion.from_mask(LATTICE, (0, 0), np.ones((2, 2), np.bool_))
    with pytest.raises(ValueError, match="read-only"):
        region.rows[0, 0] = 0
    with pytest.raises(ValueError, match="read-only"):
        region.keys[0] = 0

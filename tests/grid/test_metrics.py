"""Similarity and distance against brute force, against their limits, and incremental against fresh."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_cdt

from mapgraft.contracts import (
    ConfigError,
    Layer,
    Map,
    MapError,
    MapType,
    Match,
    Measurement,
    Observation,
    Step,
    Transform,
)
from mapgraft_grid.distance import Distance, distance_maps
from mapgraft_grid.grid_map import FREE, OCCUPIED, GridMap
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.similarity import Similarity

GRIDS = OccupancyGrid(resolution_m=0.1)
Classes = NDArray[np.uint8]
MakeMap = Callable[..., GridMap]
Placed = tuple[Classes, tuple[int, int]]  # classes and the cell of element [0, 0]


@dataclass(slots=True)
class Pair:
    """Two maps as a comparison."""

    target: Map
    donor: Map
    subject: Literal["own", "merged"] = "own"
    map_type: MapType = GRIDS
    target_layer: Layer = dataclasses.field(default_factory=GRIDS.new_layer)
    donor_layer: Layer = dataclasses.field(default_factory=GRIDS.new_layer)
    T_receiver_donor: Transform = dataclasses.field(default_factory=Transform.identity)
    match: Match = dataclasses.field(default_factory=lambda: Match(Transform.identity(), 1.0, 1.0))


@dataclass(frozen=True, slots=True)
class Strange:
    """A map that is no grid."""

    map_type: str = "cairns"

    def known(self) -> int:
        return 1


def measured(metric: Similarity | Distance, pair: Pair) -> Measurement:
    return metric.track(pair).update(Step())


def cells_of(placed: Placed) -> dict[tuple[int, int], int]:
    classes, (x, y) = placed
    return {(x + c, y + r): int(classes[r, c]) for r, c in np.ndindex(*classes.shape) if classes[r, c]}


def brute_distance(a: Placed, b: Placed, trim: float = math.inf) -> dict[str, float]:
    """The definition, cell by cell."""
    one, other = cells_of(a), cells_of(b)
    joint = one.keys() & other.keys()
    parts: dict[str, list[float]] = {"sum": [], "mean": [], "pooled": []}
    for wanted in (FREE, OCCUPIED):
        ways = []
        for here, there in ((one, other), (other, one)):
            targets = [cell for cell, c in there.items() if c == wanted]
            steps = [
                min(trim, min((abs(x - u) + abs(y - v) for u, v in targets), default=math.nan))
                for x, y in joint
                if here[x, y] == wanted
            ]
            ways.append(steps)
        means = [sum(steps) / len(steps) if steps else math.nan for steps in ways]
        parts["sum"].append(sum(means))
        parts["mean"].append(sum(means) / 2)
        parts["pooled"].append(sum(ways[0] + ways[1]) / max(1, len(ways[0] + ways[1])))
    enough = not math.isnan(sum(parts["sum"]))
    return {name: sum(values) if enough else math.nan for name, values in parts.items()}


@st.composite
def neighbours(draw: st.DrawFn) -> tuple[Placed, Placed]:
    """Two maps with some overlap, mostly free, somewhere across the border of a tile."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    x, y = rng.integers(-70, 70), rng.integers(-5, 5)
    walls = draw(st.sampled_from((0.05, 0.15, 0.5)))
    unknown = draw(st.sampled_from((0.0, 0.3, 0.7)))
    out = []
    for dx, dy in ((0, 0), rng.integers(-6, 7, 2)):
        shape = rng.integers(1, 13, 2)
        cells = np.where(rng.random(shape) < walls, 2, 1) * (rng.random(shape) >= unknown)
        out.append((cells.astype(np.uint8), (int(x + dx), int(y + dy))))
    return out[0], out[1]


@settings(deadline=None, max_examples=200)
@given(neighbours())
def test_similarity_is_the_share_of_equal_cells(grid_map_of: MakeMap, pair: tuple[Placed, Placed]) -> None:
    a, b = (grid_map_of(placed[0], 0.1, placed[1]) for placed in pair)
    one, other = (cells_of(placed) for placed in pair)
    joint = one.keys() & other.keys()
    similar = sum(one[cell] == other[cell] for cell in joint)
    found = measured(Similarity(overlap_min_m2=0.0), Pair(a, b))
    assert found.support == len(joint)
    assert found.details["similar"] == similar and found.details["dissimilar"] == len(joint) - similar
    assert found.value == pytest.approx(similar / len(joint) if joint else math.nan, nan_ok=True)
    if joint:
        chance = sum(
            sum(one[c] == k for c in joint) * sum(other[c] == k for c in joint) / len(joint) ** 2 for k in (1, 2)
        )
        kappa = (similar / len(joint) - chance) / (1 - chance) if chance < 1 else math.nan
        assert found.details["kappa"] == pytest.approx(kappa, nan_ok=True)


@settings(deadline=None, max_examples=200)
@given(neighbours())
def test_distance_is_what_the_definition_says(grid_map_of: MakeMap, pair: tuple[Placed, Placed]) -> None:
    a, b = (grid_map_of(placed[0], 0.1, placed[1]) for placed in pair)
    want, trimmed = brute_distance(*pair), brute_distance(*pair, trim=2)
    for variant in ("sum", "mean", "pooled"):
        metric = Distance(variant=variant, overlap_min_m2=0.0, trim_m=0.2)
        found = measured(metric, Pair(a, b))
        assert found.value == pytest.approx(want[variant], nan_ok=True)
        assert found.details["metres"] == pytest.approx(0.1 * want[variant], nan_ok=True)
        assert found.details["trimmed"] == pytest.approx(trimmed[variant], nan_ok=True)
        assert found.details["occupied"] + found.details["free"] == pytest.approx(want[variant], nan_ok=True)
        assert {v: found.details[v] for v in want} == pytest.approx(want, nan_ok=True)


def test_a_nearest_cell_outside_the_overlap_counts(grid_map_of: MakeMap) -> None:
    """The overlap is one column wide; the target's occupied cell that is nearest lies two columns outside it."""
    target = grid_map_of([[2, 1, 1], [0, 0, 1], [0, 0, 1], [0, 0, 1], [0, 0, 2]])
    donor = grid_map_of([[2], [1], [1], [1], [2]], 0.1, (2, 0))
    found = measured(Distance(overlap_min_m2=0.0), Pair(target, donor))
    assert found.details["occupied"] == pytest.approx(0.0 + (2 + 0) / 2)


def test_a_nearest_cell_far_outside_the_overlap_counts(grid_map_of: MakeMap) -> None:
    """The overlap is a column of 400 cells; the nearest wall lies 150 cells to its left, the next one at its top."""
    target = np.zeros((400, 900), np.uint8)
    target[:, 750] = 1
    target[399, 750] = target[0, 600] = target[200, 0] = target[200, 899] = 2
    donor = np.ones((400, 1), np.uint8)
    donor[0] = 2
    found = measured(Distance(), Pair(grid_map_of(target), grid_map_of(donor, 0.1, (750, 0))))
    assert found.details["occupied"] == pytest.approx(150 + 399)
    assert found.details["trimmed"] - found.details["free"] <= 2 * 10


@settings(deadline=None, max_examples=100)
@given(st.integers(0, 2**32 - 1), st.sampled_from((0.0, 0.02, 0.3)), st.sampled_from((FREE, OCCUPIED)))
def test_distance_maps_agree_with_another_implementation(seed: int, share: float, wanted: int) -> None:
    rng = np.random.default_rng(seed)
    shape = rng.integers(1, 40, 2)
    grid = np.where(rng.random(shape) < share, wanted, 3 - wanted).astype(np.uint8)
    found = distance_maps(grid)[wanted - 1]
    if (grid == wanted).any():
        assert np.array_equal(found, distance_transform_cdt(grid != wanted, metric="taxicab"))
    else:
        assert (found >= sum(grid.shape)).all()


def test_limits_follow_the_resolution_and_what_is_compared(grid_map_of: MakeMap) -> None:
    for resolution_m, own, merged in ((0.07, 4.9, 2.1), (0.10, 4.1, 1.7)):
        grid = grid_map_of([[1, 2], [2, 1]], resolution_m)
        limits = [measured(Distance(), Pair(grid, grid, subject)).details["limit"] for subject in ("own", "merged")]
        assert limits == pytest.approx([own, merged], abs=0.05)
    limits = [measured(Similarity(), Pair(grid, grid, subject)).details["limit"] for subject in ("own", "merged")]
    assert limits == [0.9, 0.95]


def test_too_little_in_common_is_no_measurement(grid_map_of: MakeMap) -> None:
    grid = grid_map_of(np.tile([[1, 2], [2, 1]], (2, 2)), 0.1)
    apart = grid_map_of([[1, 2]], 0.1, (500, 0))
    for metric in (Similarity(), Distance()):
        for pair in (Pair(grid, grid), Pair(grid, apart), Pair(grid, GRIDS.view(None)), Pair(GRIDS.view(None), grid)):
            found = measured(metric, pair)
            assert not found.sufficient and found.support < 100
    one_class = grid_map_of(np.ones((20, 20), int), 0.1)
    assert not measured(Distance(), Pair(one_class, one_class)).sufficient
    assert measured(Similarity(), Pair(one_class, one_class)).value == 1.0


def test_identical_maps_agree_and_a_shift_is_seen_in_metres(grid_map_of: MakeMap) -> None:
    room = np.ones((60, 80), int)
    room[[0, -1]] = room[:, [0, -1]] = 2
    here, there = grid_map_of(room, 0.1), grid_map_of(room, 0.1, (10, 0))
    assert measured(Similarity(), Pair(here, here)).value == 1.0
    assert measured(Distance(), Pair(here, here)).value == 0.0
    moved = measured(Distance(), Pair(here, there))
    assert moved.unit == "cells" and moved.better == "lower"
    assert 0.2 < moved.details["metres"] == pytest.approx(0.1 * moved.value)


def test_updates_equal_fresh_measurements(intel: list[Observation]) -> None:
    """Own mapping goes on, then the donor changes, then both at once."""
    own, donor = GRIDS.new_layer(), GRIDS.new_layer()
    for observation in intel[100:130]:
        GRIDS.integrate(donor, observation)
    for observation in intel[:90]:
        GRIDS.integrate(own, observation)
    pair = Pair(GRIDS.view(own), GRIDS.view(donor))
    trackers = [(metric, metric.track(pair)) for metric in (Similarity(), Distance())]
    sufficient = 0
    for number, observation in enumerate(intel[90:130]):
        touched = GRIDS.integrate(own, observation)
        pair.target = GRIDS.view(own, (), pair.target, touched)
        if donor_changed := number % 13 == 12:
            GRIDS.integrate(donor, intel[130 + number])
            pair.donor = GRIDS.view(donor)
        for metric, tracker in trackers:
            found = tracker.update(Step(touched, (observation,), donor_changed))
            fresh = measured(metric, Pair(GRIDS.view(own), GRIDS.view(donor)))
            sufficient += found.sufficient
            assert repr(found) == repr(fresh)
    assert sufficient > 40


def test_a_tile_that_a_map_loses_is_no_longer_counted(grid_map_of: MakeMap) -> None:
    wide = grid_map_of(np.tile([[1, 2]], (20, 100)))
    pair = Pair(wide, wide)
    tracker = Similarity().track(pair)
    assert tracker.update(Step()).support == 4000
    pair.donor = grid_map_of(np.tile([[1, 2]], (20, 20)))
    assert tracker.update(Step(donor_changed=True)).support == 800


def test_what_cannot_be_compared_is_refused(grid_map_of: MakeMap) -> None:
    here, finer = grid_map_of([[1, 2]], 0.1), grid_map_of([[1, 2]], 0.05)
    for metric in (Similarity(), Distance()):
        for target, donor in itertools.permutations((here, finer)):
            with pytest.raises(MapError, match="one lattice"):
                measured(metric, Pair(target, donor))
        with pytest.raises(MapError, match="'cairns'"):
            measured(metric, Pair(here, Strange()))


@pytest.mark.parametrize(
    "make",
    [
        lambda: Similarity(overlap_min_m2=-1),
        lambda: Distance(overlap_min_m2=math.nan),
        lambda: Distance(trim_m=0),
        lambda: Distance(variant="median"),
    ],
)
def test_impossible_parameters_are_refused(make: Callable[[], object]) -> None:
    with pytest.raises(ConfigError, match="found"):
        make()

"""New evidence since a merge: what votes, what does not, and that nothing is counted twice."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mapgraft.contracts import Layer, Map, MapType, Match, Measurement, Observation, Step, Transform
from mapgraft_grid.evidence.news import News, NewsTracker
from mapgraft_grid.grid_map import FREE, OCCUPIED, GridMap
from mapgraft_grid.layer import GridLayer
from mapgraft_grid.map_type import OccupancyGrid

GRIDS = OccupancyGrid(resolution_m=0.1)
MakeMap = Callable[..., GridMap]
MakeScan = Callable[..., Observation]
HALF = (6.0, 4.0)  # m from the middle of the room to its walls


@dataclasses.dataclass(slots=True)
class Pair:
    """A merge as a comparison: what the receiver knows, and the donor where it was placed."""

    target: Map
    donor: Map
    target_layer: Layer
    donor_layer: Layer
    subject: Literal["own", "merged"] = "own"
    map_type: MapType = GRIDS
    T_receiver_donor: Transform = dataclasses.field(default_factory=Transform.identity)
    match: Match = dataclasses.field(default_factory=lambda: Match(Transform.identity(), 1.0, 1.0))


@pytest.fixture(scope="module")
def scan_in_room(scan_of: MakeScan) -> MakeScan:
    """Makes a scan of the room of ± HALF from (x, y) towards ``yaw``, ``wide`` rad to both sides."""

    def make(x: float, y: float, yaw: float, wide: float = 0.6, wall_x: float | None = None) -> Observation:
        angles = np.linspace(-wide, wide, 180) + yaw
        with np.errstate(divide="ignore"):
            to_x = np.where(np.cos(angles) > 0, HALF[0] - x, HALF[0] + x) / np.abs(np.cos(angles))
            to_y = np.where(np.sin(angles) > 0, HALF[1] - y, HALF[1] + y) / np.abs(np.sin(angles))
        ranges = np.minimum(to_x, to_y)
        if wall_x is not None:
            ranges = np.where(np.cos(angles) > 0, np.minimum(ranges, (wall_x - x) / np.cos(angles)), ranges)
        return scan_of(angles, ranges, True, (x, y, 0.0))

    return make


def room(wall_x: int | None = None) -> NDArray[np.uint8]:
    """Classes of the donor's map of the room, from x = -6.1 m and y = -4.1 m on; ``wall_x`` a column of walls."""
    classes = np.full((82, 122), FREE, np.uint8)
    classes[[0, -1]] = classes[:, [0, -1]] = OCCUPIED
    if wall_x is not None:
        classes[:, wall_x] = OCCUPIED
    return classes


def merged(scan_in_room: MakeScan, donor: GridMap, donor_layer: Layer | None = None) -> tuple[Pair, GridLayer]:
    """A receiver that has seen the left of the room, and the donor's map of all of it."""
    own = GRIDS.new_layer()
    for y in (-1.0, 0.0, 1.0):
        GRIDS.integrate(own, scan_in_room(-3.0, y, math.pi))
    return Pair(GRIDS.view(own), donor, own, donor_layer or GRIDS.new_layer()), own


def go_on(tracker: NewsTracker, pair: Pair, own: GridLayer, *scans: Observation) -> Measurement:
    """Map on and tell the tracker, scan by scan."""
    measurement = tracker.update(Step())
    for scan in scans:
        touched = GRIDS.integrate(own, scan)
        pair.target = GRIDS.view(own)
        measurement = tracker.update(Step(touched, (scan,)))
    return measurement


def test_nothing_new_says_nothing(scan_in_room: MakeScan, grid_map_of: MakeMap) -> None:
    pair, own = merged(scan_in_room, grid_map_of(room(), origin_cell=(-61, -41)))
    again = [scan_in_room(-3.0, y, math.pi, 0.5) for y in (-0.5, 0.0, 0.5)]
    measurement = go_on(News().track(pair), pair, own, *again)
    assert measurement.support == 0
    assert math.isnan(measurement.value)


def test_new_walls_where_the_donor_has_them_agree(scan_in_room: MakeScan, grid_map_of: MakeMap) -> None:
    pair, own = merged(scan_in_room, grid_map_of(room(), origin_cell=(-61, -41)))
    measurement = go_on(News().track(pair), pair, own, scan_in_room(0.0, 0.0, 0.0), scan_in_room(2.0, 1.0, 0.0))
    assert measurement.value == 0.0
    assert measurement.details["agreed_m"] >= 4.0  # of the 8 m on the right


def test_new_walls_in_the_donors_free_space_are_against_it(scan_in_room: MakeScan, grid_map_of: MakeMap) -> None:
    pair, own = merged(scan_in_room, grid_map_of(room(), origin_cell=(-61, -41)))
    scans = [scan_in_room(0.0, y, 0.0, wall_x=3.0) for y in (-1.0, 0.0, 1.0)]
    measurement = go_on(News().track(pair), pair, own, *scans)
    assert measurement.value > 0.9
    assert measurement.details["places"] >= 2.0


def test_beams_through_the_donors_walls_are_against_it(scan_in_room: MakeScan, grid_map_of: MakeMap) -> None:
    pair, own = merged(scan_in_room, grid_map_of(room(wall_x=91), origin_cell=(-61, -41)))  # at x = 3 m
    measurement = go_on(News().track(pair), pair, own, scan_in_room(0.0, 0.0, 0.0), scan_in_room(0.0, 0.5, 0.0))
    assert measurement.details["against"] >= 5.0


def test_what_refined_a_transform_does_not_test_it(scan_in_room: MakeScan, grid_map_of: MakeMap) -> None:
    """After the merge was registered anew, what the receiver knew by then votes no more; earlier votes stay."""
    pair, own = merged(scan_in_room, grid_map_of(room(), origin_cell=(-61, -41)))
    tracker = News().track(pair)
    right_side = [scan_in_room(0.0, y, 0.0) for y in (-1.0, 0.0, 1.0)]
    before = go_on(tracker, pair, own, right_side[0])
    GRIDS.integrate(own, right_side[1])  # seen, and told with the step before the new registration
    pair.target = GRIDS.view(own)
    pair.T_receiver_donor = Transform.planar(0.05, 0.0, 0.0)
    moved = tracker.update(Step(None, (), donor_changed=True))
    assert moved.details == before.details
    assert go_on(tracker, pair, own, right_side[1]).details == before.details


def test_what_the_donor_newly_maps_is_new_evidence(scan_in_room: MakeScan, grid_map_of: MakeMap) -> None:
    left_half, whole = room(), room(wall_x=20)
    left_half[:, 61:] = 0
    pair, own = merged(scan_in_room, grid_map_of(left_half, origin_cell=(-61, -41)))
    for y in (-1.0, 0.0, 1.0):
        GRIDS.integrate(own, scan_in_room(0.0, y, 0.0))
    pair.target = GRIDS.view(own)
    tracker = News().track(pair)
    pair.donor = grid_map_of(room(), origin_cell=(-61, -41))
    found = tracker.update(Step(None, (), donor_changed=True))
    assert found.value == 0.0
    assert found.details["agreed_m"] >= 2.0
    pair.donor = grid_map_of(whole, origin_cell=(-61, -41))  # nothing that was unknown before
    assert tracker.update(Step(None, (), donor_changed=True)).details == found.details


@pytest.mark.parametrize(("subject", "support"), [("own", True), ("merged", False)])
def test_a_ready_made_map_votes_but_not_with_the_donors_own_cells(
    grid_map_of: MakeMap, message_of: MakeScan, subject: Literal["own", "merged"], support: bool
) -> None:
    """The receiver gets its map anew, now of the whole room; a merged map held the donor's cells all along."""
    donor = grid_map_of(room(), origin_cell=(-61, -41))
    half = room()
    half[:, 61:] = 0
    own, whole = grid_map_of(half, origin_cell=(-61, -41)), grid_map_of(room(), origin_cell=(-61, -41))
    pair = Pair(own if subject == "own" else whole, donor, GRIDS.new_layer(), GRIDS.new_layer(), subject)
    tracker = News().track(pair)
    pair.target = whole
    message = message_of(np.array([-1, 0, 100], np.int8)[room()], 0.1, (-6.1, -4.1, 0.0))
    measured = tracker.update(Step(None, (message,)))
    assert (measured.support > 0) == support
    assert not measured.details["against"]


def test_blocks_of_coarse_grids_are_larger(scan_in_room: MakeScan) -> None:
    """Three cells at least, so that one beam decides nothing."""
    coarse = OccupancyGrid(resolution_m=0.4)
    own, donor = coarse.new_layer(), coarse.new_layer()
    coarse.integrate(own, scan_in_room(-3.0, 0.0, math.pi))
    for x in (-2.0, 0.0, 2.0):
        coarse.integrate(donor, scan_in_room(x, 0.0, 0.0, 3.0))
    pair = Pair(coarse.view(own), coarse.view(donor), own, donor, map_type=coarse)
    measured = News().track(pair).update(Step(None, (scan_in_room(0.0, 0.0, 0.0),)))
    assert measured.support >= 2
    assert measured.details["agreed_m"] == pytest.approx(1.2 * measured.details["agreed"])


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_telling_scans_one_by_one_or_together_is_the_same(
    walked: Callable[..., GridLayer], scan_of: MakeScan, seed: int
) -> None:
    random = np.random.default_rng(seed)
    own, donor = walked(GRIDS, seed, scans=2), walked(GRIDS, seed + 1)
    pair = Pair(GRIDS.view(own), GRIDS.view(donor), own, donor)
    one_by_one, together = News().track(pair), News().track(pair)
    scans = [
        scan_of(np.linspace(-2, 2, 90), random.uniform(0.5, 5.0, 90), True, tuple(random.uniform(-2, 2, 3)))
        for _ in range(4)
    ]
    for scan in scans:
        last = one_by_one.update(Step(None, (scan,)))
    assert str(together.update(Step(None, tuple(scans)))) == str(last)


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_what_does_not_concern_it_changes_nothing(
    walked: Callable[..., GridLayer], scan_of: MakeScan, seed: int
) -> None:
    """A scan that touches no cell of ``concerns`` may be left out."""
    random = np.random.default_rng(seed)
    own, donor = walked(GRIDS, seed, scans=2), walked(GRIDS, seed + 1)
    pair = Pair(GRIDS.view(own), GRIDS.view(donor), own, donor)
    tracker = News().track(pair)
    for _ in range(4):
        pose = (*random.uniform(-12, 12, 2), random.uniform(-3, 3))
        scan = scan_of(np.linspace(-2, 2, 90), random.uniform(0.5, 5.0, 90), True, tuple(pose))
        touched = GRIDS.integrate(own, scan)
        before = str(tracker.update(Step()))
        concerned = len(touched) + len(tracker.concerns) > len(touched.union(tracker.concerns))
        after = str(tracker.update(Step(touched, (scan,))))
        assert concerned or before == after

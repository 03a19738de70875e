"""Swapping the transform of a standing merge on grids: byte for byte a merge made there, and reversible."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import (
    SCAN,
    Contribution,
    Donation,
    Match,
    Observation,
    Provenance,
    Region,
    Scan,
    Transform,
)
from mapgraft.plugins import load_plugins
from mapgraft.registration import Site, find_move
from mapgraft.reversal import Ledger, MultiMap, new_reversal
from mapgraft_grid.bayes import log_bayes_factor
from mapgraft_grid.correlation import Correlation
from mapgraft_grid.log_odds import LogOdds
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.prepared import prepare
from mapgraft_grid.region import GridRegion

EXACT = ("ledger", "multi_map")
BEAMS = np.linspace(-math.pi, math.pi, 90, endpoint=False)
FAN = np.stack((np.cos(BEAMS), np.sin(BEAMS)), axis=1)
WALLS = ((-1.5, 6.5), (-2.0, 3.0))  # x and y of a room's walls in the world (m)
Kept = Ledger | MultiMap


def scan(x_m: float, y_m: float, yaw_rad: float = 0.0, T_map_world: Transform | None = None) -> Observation:
    """What a lidar sees of the room from there, in a map frame that lies in the world as ``T_map_world`` says."""
    a = BEAMS + yaw_rad
    with np.errstate(divide="ignore", over="ignore"):
        to_x = np.where(np.cos(a) > 0, WALLS[0][1] - x_m, WALLS[0][0] - x_m) / np.cos(a)
        to_y = np.where(np.sin(a) > 0, WALLS[1][1] - y_m, WALLS[1][0] - y_m) / np.sin(a)
    ranges = np.minimum(to_x, to_y).astype(np.float32)
    T = (T_map_world or Transform.identity()) @ Transform.planar(x_m, y_m, yaw_rad)
    return Observation("a", 0, 0, "laser", SCAN, Scan(FAN, ranges, np.ones(90, bool)), T, T)


PLACE = st.tuples(st.floats(-1.0, 6.0), st.floats(-1.5, 2.5), st.floats(-3.0, 3.0))
POSE = st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))


def mapped(kept: Kept, places) -> None:
    for place in places:
        kept.observe(scan(*place))


def contribution(kept: Kept, kind: OccupancyGrid, donated, pose) -> Contribution:
    match = Match(Transform.planar(*pose), 1.0, 1.0)
    return LogOdds().fuse(kind, kept.own(), Donation(donated, Provenance("b", 1, 2)), match)


def bytes_of(kind: OccupancyGrid, kept: Kept) -> tuple[object, ...]:
    """All that can be seen of a robot's maps: views, files and layers."""
    out: list[object] = [kind.encode(kept.offered_layer())]
    for map_ in (kept.own(), kept.fused()):
        dense = map_.dense()
        out += [dense.origin_cell, dense.log_odds.tobytes(), dense.classes.tobytes(), map_.known()]
        out += sorted(kind.files(map_, "map").items())
    return tuple(out)


def same(a: Contribution, b: Contribution, encode: Callable[..., bytes]) -> bool:
    return (
        encode(a.layer) == encode(b.layer)
        and a.T_receiver_donor == b.T_receiver_donor
        and (a.region, a.fill, a.summary) == (b.region, b.fill, b.summary)
        and repr(a.weights) == repr(b.weights)
    )


@pytest.mark.parametrize("name", EXACT)
@settings(max_examples=12, deadline=None)
@given(
    before=st.lists(PLACE, min_size=1, max_size=2),
    after=st.lists(PLACE, max_size=2),
    theirs=st.lists(PLACE, min_size=1, max_size=2),
    poses=st.tuples(POSE, POSE),
    later=st.lists(PLACE, max_size=1),
)
def test_a_swap_equals_a_fresh_merge_and_is_reverted_exactly(name, before, after, theirs, poses, later):
    kind, coarse = OccupancyGrid(resolution_m=0.1), OccupancyGrid(resolution_m=0.13)
    donated = coarse.new_layer()
    for place in theirs:
        coarse.integrate(donated, scan(*place))
    swapped, fresh, alone = (new_reversal(name, kind) for _ in range(3))
    mapped(swapped, before)
    swapped.merge("a.b.1", contribution(swapped, kind, donated, poses[0]))
    swapped.fused()
    mapped(swapped, after)
    new = contribution(swapped, kind, donated, poses[1])
    swapped.replace("a.b.1", new)
    for kept in (fresh, alone):
        mapped(kept, [*before, *after])
    made = contribution(fresh, kind, donated, poses[1])
    fresh.merge("a.b.1", made)
    assert same(new, made, kind.encode)
    for kept in (swapped, fresh, alone):
        mapped(kept, later)
    assert bytes_of(kind, swapped) == bytes_of(kind, fresh)
    assert swapped.revert("a.b.1").exact
    assert bytes_of(kind, swapped) == bytes_of(kind, alone)


@pytest.mark.parametrize("off", ((0.0, 0.0, 0.0), (0.12, -0.1, 0.01), (-0.2, 0.15, -0.02)))
def test_the_correlation_matcher_moves_a_merge_to_the_truth_and_then_leaves_it(off):
    kind = OccupancyGrid(resolution_m=0.05)
    T_donor_world = Transform.planar(4.0, -1.0, 2.0)
    own, other = kind.new_layer(), kind.new_layer()
    for n in range(8):
        kind.integrate(own, scan(-0.5 + 0.6 * n, 0.3 * n - 1.0, 0.2 * n))
        kind.integrate(other, scan(5.5 - 0.5 * n, 1.5 - 0.3 * n, 0.1 * n, T_donor_world))
    truth = T_donor_world.inverse()
    site = Site.of(kind.metadata(own), kind.metadata(other))
    standing = Match(Transform.planar(*off) @ truth, 100.0, 5.0)
    maps = kind.view(own), kind.view(other)
    move = find_move(Correlation(), *maps, standing, standing.T_receiver_donor, site)
    if off == (0.0, 0.0, 0.0):
        assert move is None or move.shift_m < 0.05
        return
    assert move is not None
    error_m, error_rad = move.match.T_receiver_donor.difference(truth)
    assert error_m < 0.06 and error_rad < math.radians(0.6)
    assert move.match.margin == 5.0
    unit_m = move.match.evidence["resolution_m"]
    sides = (prepare(map_, unit_m) for map_ in maps)
    assert move.score_before == log_bayes_factor(*sides, standing.T_receiver_donor) < move.match.score
    assert find_move(Correlation(), *maps, move.match, standing.T_receiver_donor, site) is None
    aside = Transform.planar(0.6, 0.0, 0.0) @ move.match.T_receiver_donor
    assert find_move(Correlation(), *maps, standing, aside, site) is None  # accepted elsewhere


REGION = st.lists(st.tuples(st.integers(-70, 140), st.integers(-70, 70)), max_size=6)


@given(a=REGION, b=REGION)
def test_regions_meet_where_they_have_a_cell_in_common(a, b):
    lattice = OccupancyGrid(resolution_m=0.1).new_layer().lattice

    def region(cells) -> GridRegion:
        out = GridRegion.empty(lattice)
        for cell in cells:
            out = out.union(GridRegion.from_mask(lattice, cell, np.ones((1, 1), bool)))
        return out

    one, other = region(a), region(b)
    both: Region = one.minus(other)
    assert one.meets(other) is other.meets(one) is (len(both) < len(one)) is bool(set(a) & set(b))


def test_only_matchers_that_search_around_a_prior_refine():
    plugins = load_plugins()
    told = {
        name: plugins.find("matcher", name).descriptor.uses_prior for name in ("correlation", "carpin", "known_pose")
    }
    assert told == {"correlation": True, "carpin": False, "known_pose": False}

"""What walls, beams and paths say of a placement: on rooms drawn by hand, and against brute force."""

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

from mapgraft.contracts import Layer, Map, MapType, Match, Metric, Observation, Step, Transform
from mapgraft_grid.evidence.bayes_factor import BayesFactor
from mapgraft_grid.evidence.features import IN_NATS, features_of
from mapgraft_grid.evidence.joint import TOLERANCE_M, joint_of, standing_of
from mapgraft_grid.evidence.margin import Margin
from mapgraft_grid.evidence.posterior import Posterior
from mapgraft_grid.evidence.traces import Paths, Rays
from mapgraft_grid.evidence.walls import Contradiction, Kappa, Recall
from mapgraft_grid.grid_map import FREE, OCCUPIED, GridMap
from mapgraft_grid.layer import GridLayer
from mapgraft_grid.map_type import OccupancyGrid

GRIDS = OccupancyGrid(resolution_m=0.1)
MakeMap = Callable[..., GridMap]
HERE = Match(Transform.identity(), 100.0, 50.0, evidence={IN_NATS: 100.0})
METRICS = (BayesFactor(), Kappa(), Margin(), Contradiction(), Recall(), Rays(), Paths(), Posterior())


@dataclasses.dataclass(slots=True)
class Pair:
    """Two maps as a comparison."""

    target: Map
    donor: Map
    target_layer: Layer = dataclasses.field(default_factory=GRIDS.new_layer)
    donor_layer: Layer = dataclasses.field(default_factory=GRIDS.new_layer)
    subject: Literal["own", "merged"] = "own"
    map_type: MapType = GRIDS
    T_receiver_donor: Transform = dataclasses.field(default_factory=Transform.identity)
    match: Match = HERE


def room(width: int = 60, height: int = 40, gap: slice | None = None) -> NDArray[np.uint8]:
    """Classes (h, w) of one room with four walls; ``gap`` opens the wall on the right."""
    classes = np.full((height, width), FREE, np.uint8)
    classes[[0, -1]] = classes[:, [0, -1]] = OCCUPIED
    if gap is not None:
        classes[gap, -1] = FREE
    return classes


def value(metric: Metric, pair: Pair) -> float:
    return metric.track(pair).update(Step()).value


@pytest.fixture(scope="module")
def seen_from(scan_of: Callable[..., Observation]) -> Callable[..., GridLayer]:
    """Makes the layer of a robot that looked around in an empty room of ± (x, y) m from places on a line."""

    def make(half: tuple[float, float], places: tuple[tuple[float, float], ...]) -> GridLayer:
        angles = np.linspace(-math.pi, math.pi, 720, endpoint=False)
        layer = GRIDS.new_layer()
        for x, y in places:
            with np.errstate(divide="ignore"):
                to_x = np.where(np.cos(angles) > 0, half[0] - x, half[0] + x) / np.abs(np.cos(angles))
                to_y = np.where(np.sin(angles) > 0, half[1] - y, half[1] + y) / np.abs(np.sin(angles))
            GRIDS.integrate(layer, scan_of(angles, np.minimum(to_x, to_y), True, (x, y, 0.0)))
        return layer

    return make


def test_equal_maps_agree_in_everything(grid_map_of: MakeMap) -> None:
    pair = Pair(grid_map_of(room()), grid_map_of(room()))
    assert value(Contradiction(), pair) == 0.0
    assert value(Recall(), pair) == 1.0
    assert value(BayesFactor(), pair) > 100.0
    found = standing_of(pair, "test")
    assert found.walls_m == found.near_m
    assert found.walls_m[0] == pytest.approx(20.0, abs=1.5)  # 2 · (6 + 4) m, in blocks
    assert found.bad == 0 < found.good


def test_kappa_and_margin_are_told_as_metrics(grid_map_of: MakeMap) -> None:
    pair = Pair(grid_map_of(room()), grid_map_of(room()))
    assert value(Kappa(), pair) == 1.0
    assert value(Margin(), pair) == 50.0
    alone = Margin().track(dataclasses.replace(pair, match=dataclasses.replace(HERE, margin=math.inf))).update(Step())
    assert math.isnan(alone.value) and alone.support == 0


def test_maps_that_share_nothing_say_nothing(grid_map_of: MakeMap) -> None:
    pair = Pair(grid_map_of(room()), grid_map_of(room(), origin_cell=(500, 500)))
    for metric in (Contradiction(), Recall(), Rays(), Paths(), Posterior()):
        measurement = metric.track(pair).update(Step())
        assert math.isnan(measurement.value)
        assert measurement.support == 0


def test_walls_in_free_space_contradict(grid_map_of: MakeMap) -> None:
    """A wall of the donor across the room: 4 m that the receiver saw free."""
    divided = room()
    divided[1:-1, 30] = OCCUPIED
    measurement = Contradiction().track(Pair(grid_map_of(room()), grid_map_of(divided))).update(Step())
    assert measurement.details["own_m"] == 0.0
    assert measurement.details["donor_m"] == pytest.approx(4.0, abs=0.8)
    assert measurement.details["bad_patches"] >= 1.0


@given(st.integers(-2, 2), st.integers(-2, 2))
def test_what_is_off_by_less_than_the_tolerance_is_no_contradiction(grid_map_of: MakeMap, x: int, y: int) -> None:
    if math.hypot(x, y) * 0.1 <= TOLERANCE_M:
        pair = Pair(grid_map_of(room()), grid_map_of(room(), origin_cell=(x, y)))
        assert value(Contradiction(), pair) == 0.0
        assert value(Recall(), pair) == 1.0


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_walls_are_counted_as_defined(grid_map_of: MakeMap, seed: int) -> None:
    random = np.random.default_rng(seed)
    maps = [random.choice(3, (25, 30), p=(0.4, 0.4, 0.2)).astype(np.uint8) for _ in range(2)]
    pair = Pair(grid_map_of(maps[0]), grid_map_of(maps[1]))
    joint, found = joint_of(pair, "test"), standing_of(pair, "test")
    for side, (mine, other) in enumerate(((joint.own, joint.donor), (joint.donor, joint.own))):
        walls = np.argwhere(other == OCCUPIED)
        blocks: dict[str, set[tuple[int, int]]] = {"all": set(), "near": set(), "against": set()}
        for y, x in np.argwhere((mine == OCCUPIED) & (other > 0)).tolist():
            near = len(walls) > 0 and np.hypot(*(walls - (y, x)).T).min() * 0.1 <= TOLERANCE_M
            kinds = ("all", "near" if near else "against" if other[y, x] == FREE else "all")
            for kind in kinds:
                blocks[kind].add((y // 2, x // 2))  # 0.25 m are two and a half cells, rounded
        lengths = (found.walls_m[side], found.near_m[side], found.against_m[side])
        assert lengths == pytest.approx([0.2 * len(b) for b in blocks.values()])
    known = [(int(a), int(b)) for a, b in zip(joint.own.ravel(), joint.donor.ravel(), strict=True) if a and b]
    assert found.table.tolist() == [[known.count((a, b)) for b in (1, 2)] for a in (1, 2)]


def test_beams_do_not_go_through_walls(seen_from: Callable[..., GridLayer], grid_map_of: MakeMap) -> None:
    looked = seen_from((3.0, 2.0), ((0.0, 0.0), (1.0, 0.5)))
    own = GRIDS.view(looked)
    same = Rays().track(Pair(own, own, looked, looked)).update(Step())
    assert same.value == 0.0
    assert same.details["stood"] == same.support > 100

    divided = np.full((44, 64), FREE, np.uint8)
    divided[:, 40] = OCCUPIED  # x = 0.8 … 0.9 m
    other = grid_map_of(divided, origin_cell=(-32, -22))
    crossed = Rays().track(Pair(own, other, looked)).update(Step())
    assert crossed.details["through"] >= 10.0
    assert crossed.value > 0.5


def test_a_path_through_a_wall_is_counted(seen_from: Callable[..., GridLayer], grid_map_of: MakeMap) -> None:
    driven = seen_from((3.0, 2.0), tuple((x, 0.0) for x in np.arange(-2.0, 2.01, 0.5)))
    divided = np.full((44, 64), FREE, np.uint8)
    divided[:, 40:42] = OCCUPIED
    pair = Pair(GRIDS.view(driven), grid_map_of(divided, origin_cell=(-32, -22)), driven)
    measurement = Paths().track(pair).update(Step())
    assert measurement.value == 2.0
    assert measurement.support >= 38
    divided[20:26, 40:42] = FREE  # a door
    assert value(Paths(), Pair(GRIDS.view(driven), grid_map_of(divided, origin_cell=(-32, -22)), driven)) == 0.0


def test_no_traces_are_no_agreement(grid_map_of: MakeMap) -> None:
    """Ready-made maps have none: the probability rests on the cells alone, and only there."""
    pair = Pair(grid_map_of(room()), grid_map_of(room()))
    assert math.isnan(value(Rays(), pair))
    assert not {"beams", "steps"} & set(features_of(pair))


def test_the_probability_follows_the_evidence(seen_from: Callable[..., GridLayer], grid_map_of: MakeMap) -> None:
    looked = seen_from((6.0, 4.0), tuple((x, 0.0) for x in np.arange(-4.0, 4.1, 0.5)))
    own = GRIDS.view(looked)
    right = value(Posterior(), Pair(own, own, looked, looked))
    rival = dataclasses.replace(HERE, margin=-1e6)
    assert right > 0.9
    assert value(Posterior(), Pair(own, own, looked, looked, match=rival)) < right
    moved = grid_map_of(
        own.dense().classes, origin_cell=(own.dense().origin_cell[0] + 17, own.dense().origin_cell[1] + 9)
    )
    assert value(Posterior(), Pair(own, moved, looked, GRIDS.new_layer())) < 0.5


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_measuring_again_as_the_map_grows_equals_measuring_anew(
    walked: Callable[..., GridLayer], scan_of: Callable[..., Observation], seed: int
) -> None:
    random = np.random.default_rng(seed)
    own, donor = walked(GRIDS, seed), walked(GRIDS, seed + 1)
    pair = Pair(GRIDS.view(own), GRIDS.view(donor), own, donor)
    trackers = [metric.track(pair) for metric in METRICS]
    for _ in range(3):
        observation = scan_of(
            np.linspace(-2, 2, 30), random.uniform(0.5, 4.0, 30), True, tuple(random.uniform(-2, 2, 3))
        )
        touched = GRIDS.integrate(own, observation)
        pair.target = GRIDS.view(own)
        for metric, tracker in zip(METRICS, trackers, strict=True):
            seen, anew = tracker.update(Step(touched, (observation,))), metric.track(pair).update(Step())
            assert str(seen) == str(anew)

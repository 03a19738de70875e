"""Matcher, fuser and metric: finding the right pose, saying how sure, uniting, and judging."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import pytest
from mapgraft_landmarks.agreement import LandmarkAgreement
from mapgraft_landmarks.constellation import Constellation
from mapgraft_landmarks.hypotheses import fitted, moved, mutual_pairs
from mapgraft_landmarks.landmarks import LandmarkMap, Landmarks
from mapgraft_landmarks.layer import LandmarkLayer
from mapgraft_landmarks.map_type import PointLandmarks
from mapgraft_landmarks.union import LandmarkUnion

from mapgraft.contracts import (
    ConfigError,
    Donation,
    EmptyMapError,
    MapError,
    Match,
    Observation,
    Prior,
    Provenance,
    Step,
    Transform,
)

TwoWalks = tuple[list[Observation], list[Observation], Transform]
Walk = Callable[..., list[Observation]]
TYPE = PointLandmarks()
HERE = Transform.identity()


def mapped(observations: list[Observation]) -> LandmarkLayer:
    layer = TYPE.new_layer()
    for observation in observations:
        TYPE.integrate(layer, observation)
    return layer


@pytest.fixture(scope="module")
def layers(two_walks: TwoWalks) -> tuple[LandmarkLayer, LandmarkLayer]:
    return mapped(two_walks[0]), mapped(two_walks[1])


@pytest.fixture(scope="module")
def maps(layers: tuple[LandmarkLayer, LandmarkLayer]) -> tuple[LandmarkMap, LandmarkMap]:
    return TYPE.view(layers[0]), TYPE.view(layers[1])


def test_the_right_pose_comes_first_by_far(maps: tuple[LandmarkMap, LandmarkMap], two_walks: TwoWalks) -> None:
    matches = Constellation().match(*maps)
    shift_m, turn_rad = matches[0].T_receiver_donor.difference(two_walks[2])
    assert shift_m < 0.15
    assert turn_rad < math.radians(1.0)
    assert matches[0].margin == pytest.approx(matches[0].score - matches[1].score)
    assert matches[1].margin == pytest.approx(matches[1].score - matches[0].score)
    assert matches[0].margin > 20.0
    assert [m.score for m in matches] == sorted((m.score for m in matches), reverse=True)
    assert len(matches) >= 2


def test_the_covariance_covers_the_error(maps: tuple[LandmarkMap, LandmarkMap], two_walks: TwoWalks) -> None:
    best = Constellation().match(*maps)[0]
    assert best.covariance is not None
    T, truth = best.T_receiver_donor, two_walks[2]
    off = np.array([T.x_m - truth.x_m, T.y_m - truth.y_m, math.remainder(T.yaw_rad - truth.yaw_rad, math.tau)])
    planar = best.covariance[np.ix_([0, 1, 5], [0, 1, 5])]
    assert off @ np.linalg.solve(planar, off) < 16.3
    assert np.sqrt(planar[2, 2]) < math.radians(1.0)
    assert (best.covariance == best.covariance.T).all()
    assert not best.covariance[[2, 3, 4]].any()


def test_there_and_back_is_the_identity(maps: tuple[LandmarkMap, LandmarkMap]) -> None:
    there, back = Constellation().match(*maps)[0], Constellation().match(*maps[::-1])[0]
    shift_m, turn_rad = (there.T_receiver_donor @ back.T_receiver_donor).difference(Transform.identity())
    assert shift_m < 0.05
    assert turn_rad < 0.005
    assert there.score == pytest.approx(back.score)


def test_equal_inputs_give_equal_matches(maps: tuple[LandmarkMap, LandmarkMap]) -> None:
    once, again = Constellation().match(*maps), Constellation().match(*maps)
    assert [(m.T_receiver_donor, m.score, m.evidence) for m in once] == [
        (m.T_receiver_donor, m.score, m.evidence) for m in again
    ]


def test_a_prior_turns_away_what_lies_elsewhere(maps: tuple[LandmarkMap, LandmarkMap], two_walks: TwoWalks) -> None:
    covariance = np.diag([0.5**2, 0.5**2, 0.0, 0.0, 0.0, 0.1**2])
    right = Constellation().match(*maps, Prior(two_walks[2], covariance, "a person"))
    assert [m.T_receiver_donor for m in right] == [Constellation().match(*maps)[0].T_receiver_donor]
    assert right[0].margin == math.inf
    wrong = Prior(two_walks[2] @ Transform.planar(30.0, -80.0, 1.0), covariance, "a person")
    assert Constellation().match(*maps, wrong) == []


def test_a_regular_orchard_is_ambiguous(walk: Walk) -> None:
    trunks = np.array([[3.0 * i, 3.0 * j, 0.1] for i in range(8) for j in range(8)])
    path = [(4.5 + 12.0 * s, 10.5, 6.0 * s) for s in np.linspace(0.0, 1.0, 50)]
    first, second = (TYPE.view(mapped(walk(trunks, [], path, Transform.identity(), seed))) for seed in (1, 2))
    matches = Constellation().match(first, second)
    assert len(matches) >= 2
    assert abs(matches[0].margin) < 8.0  # a right match in the orchard above lies 40 nats ahead


def test_maps_with_too_little_give_no_hypothesis() -> None:
    bare = LandmarkMap(0.25, mapped([]).cells, Landmarks(np.empty((0, 2)), np.empty(0, int), np.empty(0, int)))
    with pytest.raises(EmptyMapError, match="receiver's landmark map is empty"):
        Constellation().match(bare, bare)


def test_two_landmarks_are_no_constellation(walk: Walk) -> None:
    pair = np.array([[2.0, 0.0, 0.1], [0.0, 3.0, 0.1]])
    map_ = TYPE.view(mapped(walk(pair, [], [(0.0, 0.0, 0.1 * k) for k in range(10)], Transform.identity(), 1)))
    assert len(map_.landmarks) == 2
    assert Constellation().match(map_, map_) == []


def test_foreign_maps_are_refused(maps: tuple[LandmarkMap, LandmarkMap]) -> None:
    class Foreign:
        map_type = "occupancy_grid"

        def known(self) -> int:
            return 1

    with pytest.raises(MapError, match="found one of occupancy_grid"):
        Constellation().match(maps[0], Foreign())


@pytest.mark.parametrize("seed", range(5))
def test_least_squares_finds_the_pose(seed: int) -> None:
    dice = np.random.default_rng(seed)
    source, pose = dice.uniform(-9, 9, (6, 2)), np.array([*dice.uniform(-9, 9, 2), dice.uniform(-3, 3)])
    assert fitted(moved(source, pose), source) == pytest.approx(pose)


def test_mutual_pairs_use_every_point_once() -> None:
    a, b = np.array([[0.0, 0.0], [1.0, 0.0], [9.0, 9.0]]), np.array([[0.9, 0.0], [0.8, 0.0], [5.0, 5.0]])
    rows, columns, distances = mutual_pairs(a, b, 1.0)
    assert (rows.tolist(), columns.tolist()) == ([1], [0])
    assert distances == pytest.approx([0.1])


def test_union_makes_a_contribution_that_can_be_taken_out(
    layers: tuple[LandmarkLayer, LandmarkLayer], two_walks: TwoWalks
) -> None:
    own, donor = layers
    before, sent = TYPE.encode(own), TYPE.encode(donor)
    match = Constellation().match(TYPE.view(own), TYPE.view(donor))[0]
    provenance = Provenance("second", 1, 80)
    made = LandmarkUnion(weight=2).fuse(TYPE, TYPE.view(own), Donation(donor, provenance), match)
    assert made.provenance == provenance
    assert made.T_receiver_donor == match.T_receiver_donor.snapped()
    assert len(made.region) == len(TYPE.region(made.layer))
    fused = TYPE.view(own, (made,))
    assert len(fused.landmarks) > len(TYPE.view(own).landmarks)
    assert (TYPE.encode(own), TYPE.encode(donor)) == (before, sent)
    with pytest.raises(EmptyMapError, match="nothing to unite"):
        LandmarkUnion().fuse(TYPE, TYPE.view(TYPE.new_layer()), Donation(donor, provenance), match)


@dataclass
class Pair:
    """The comparison of two layers, as the engine hands it out."""

    target_layer: LandmarkLayer
    donor_layer: LandmarkLayer
    map_type: PointLandmarks = TYPE
    T_receiver_donor: Transform = HERE
    match: Match = field(default_factory=lambda: Match(HERE, 1.0, 1.0))
    subject: Literal["own", "merged"] = "own"

    @property
    def target(self) -> LandmarkMap:
        return self.map_type.view(self.target_layer)

    @property
    def donor(self) -> LandmarkMap:
        return self.map_type.view(self.donor_layer)


def test_agreement_tells_right_from_wrong(layers: tuple[LandmarkLayer, LandmarkLayer], two_walks: TwoWalks) -> None:
    metric = LandmarkAgreement()
    right = metric.track(Pair(layers[0], TYPE.place(layers[1], two_walks[2]))).update(Step())
    wrong = metric.track(Pair(layers[0], TYPE.place(layers[1], two_walks[2] @ Transform.planar(1.5, 1.0, 0.1)))).update(
        Step()
    )
    assert right.value > 0.85
    assert wrong.value < 0.4
    assert right.support >= 15
    assert right.details["confirmed"] + right.details["denied_target"] + right.details["denied_donor"] == right.support


def test_agreement_is_symmetric(layers: tuple[LandmarkLayer, LandmarkLayer], two_walks: TwoWalks) -> None:
    placed = TYPE.place(layers[1], two_walks[2])
    one, other = (
        LandmarkAgreement().measure(*(TYPE.view(x) for x in (layers[0], placed))),
        LandmarkAgreement().measure(*(TYPE.view(x) for x in (placed, layers[0]))),
    )
    assert (one.value, one.support) == (other.value, other.support)


def test_an_incremental_measurement_equals_a_fresh_one(two_walks: TwoWalks) -> None:
    own, donor = mapped(two_walks[0][:30]), TYPE.place(mapped(two_walks[1]), two_walks[2])
    pair = Pair(own, donor)
    tracker = LandmarkAgreement().track(pair)
    supports = {tracker.update(Step()).support}
    for observation in two_walks[0][30:60]:
        touched = TYPE.integrate(own, observation)
        measured = tracker.update(Step(touched, (observation,)))
        fresh = LandmarkAgreement().track(pair).update(Step())
        assert (measured.value, measured.support, measured.details) == (fresh.value, fresh.support, fresh.details)
        supports.add(measured.support)
    assert len(supports) > 1
    pair.donor_layer = TYPE.place(mapped(two_walks[1][:50]), two_walks[2])
    nothing_touched = TYPE.region(TYPE.new_layer())
    changed = tracker.update(Step(nothing_touched, (), donor_changed=True))
    fresh = LandmarkAgreement().track(pair).update(Step())
    assert changed.sufficient
    assert (changed.value, changed.support, changed.details) == (fresh.value, fresh.support, fresh.details)
    assert changed.support != measured.support


def test_too_little_in_common_is_not_measured(layers: tuple[LandmarkLayer, LandmarkLayer]) -> None:
    far = TYPE.place(layers[1], Transform.planar(500.0, 0.0, 0.0))
    measured = LandmarkAgreement().track(Pair(layers[0], far)).update(Step())
    assert math.isnan(measured.value)
    assert not measured.sufficient
    assert measured.support == 0


@pytest.mark.parametrize(
    "make",
    [
        lambda: Constellation(pairs_min=1),
        lambda: Constellation(seen_again=0.4),
        lambda: Constellation(tolerance_m=0.0),
        lambda: LandmarkUnion(weight=0),
        lambda: LandmarkAgreement(support_min=0),
    ],
)
def test_nonsense_parameters_are_refused(make: Callable[[], object]) -> None:
    with pytest.raises(ConfigError, match=r"found|positive"):
        make()

"""The laws of the map type: additive, exact, canonical, and equal however it is computed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mapgraft_landmarks.cells import LOOKS, POSITION_STEP_M, SIGHTINGS, SUM_X, CellRegion, Cells
from mapgraft_landmarks.landmarks import LandmarkMap
from mapgraft_landmarks.layer import LandmarkLayer
from mapgraft_landmarks.map_type import PointLandmarks

from mapgraft.contracts import (
    ConfigError,
    Contribution,
    EmptyMapError,
    MapError,
    Observation,
    Provenance,
    Transform,
)

TwoWalks = tuple[list[Observation], list[Observation], Transform]
TYPE = PointLandmarks()

evidence = st.dictionaries(
    st.tuples(st.integers(-30, 30), st.integers(-30, 30)), st.tuples(st.integers(1, 9), st.integers(0, 9)), max_size=12
)
poses = st.builds(Transform.planar, st.floats(-50, 50), st.floats(-50, 50), st.floats(-np.pi, np.pi, exclude_min=True))


def layer_of(given: dict[tuple[int, int], tuple[int, int]], cell_m: float = 0.25) -> LandmarkLayer:
    """Sightings in the middle of their cells."""
    ordered = sorted(given)
    counts = np.zeros((len(ordered), 4), np.int64)
    for row, (ix, iy) in enumerate(ordered):
        looks, sightings = given[ix, iy]
        middle = np.round(np.array([ix + 0.5, iy + 0.5]) * cell_m / POSITION_STEP_M).astype(np.int64)
        counts[row] = looks, sightings, *(sightings * middle)
    keys = np.array([ix * 2**32 + iy for ix, iy in ordered], np.int64)
    return LandmarkLayer(cell_m, Cells(keys, counts), observations=7)


def contribution(layer: LandmarkLayer, weight: object = 1) -> Contribution:
    return Contribution(
        Provenance("donor", 1, 1), layer, Transform.identity(), 1.0, "none", weight, None, TYPE.region(layer)
    )


def same(a: LandmarkMap, b: LandmarkMap) -> bool:
    return (
        a.cell_m == b.cell_m
        and (a.cells.keys == b.cells.keys).all()
        and (a.cells.counts == b.cells.counts).all()
        and (a.landmarks.positions_m == b.landmarks.positions_m).all()
        and (a.landmarks.sightings == b.landmarks.sightings).all()
        and (a.landmarks.looks == b.landmarks.looks).all()
    )


def mapped(observations: list[Observation]) -> LandmarkLayer:
    layer = TYPE.new_layer()
    for observation in observations:
        TYPE.integrate(layer, observation)
    return layer


def test_landmarks_stand_where_the_trunks_are(two_walks: TwoWalks, orchard: tuple[np.ndarray, object]) -> None:
    map_ = TYPE.view(mapped(two_walks[0]))
    in_world = Transform.planar(3.0, -2.0, 1.1).inverse().apply(map_.landmarks.positions_m)
    trunks = orchard[0][:, :2]
    off_m = np.hypot(*(in_world[:, None] - trunks[None]).transpose(2, 0, 1)).min(axis=1)
    assert len(map_.landmarks) >= 15
    assert off_m.max() < 0.1


def test_the_order_of_observations_does_not_matter(two_walks: TwoWalks) -> None:
    there, back = mapped(two_walks[0]), mapped(two_walks[0][::-1])
    assert TYPE.encode(there) == TYPE.encode(back)


def test_integrate_tells_what_it_touched(two_walks: TwoWalks) -> None:
    layer = mapped(two_walks[0][:10])
    before = layer.cells
    touched = TYPE.integrate(layer, two_walks[0][10])
    assert not (layer.cells.at(touched.keys) == before.at(touched.keys)).all(axis=1).any()
    rest = TYPE.region(layer).minus(touched)
    assert (layer.cells.at(rest.keys) == before.at(rest.keys)).all()


def test_an_incremental_view_equals_a_fresh_one(two_walks: TwoWalks) -> None:
    own, donor = mapped(two_walks[0][:20]), mapped(two_walks[1])
    given = (contribution(TYPE.place(donor, two_walks[2]), 2),)
    alone, fused = TYPE.view(own), TYPE.view(own, given)
    for observation in two_walks[0][20:40]:
        touched = TYPE.integrate(own, observation)
        alone, fused = TYPE.view(own, (), alone, touched), TYPE.view(own, given, fused, touched)
        assert same(alone, TYPE.view(own))
        assert same(fused, TYPE.view(own, given))


def test_a_view_stays_what_it_was_when_mapping_goes_on(two_walks: TwoWalks) -> None:
    layer = mapped(two_walks[0][:10])
    view = TYPE.view(layer)
    counts = view.cells.counts.copy()
    TYPE.integrate(layer, two_walks[0][10])
    assert (view.cells.counts == counts).all()


@given(evidence, evidence, evidence, st.integers(1, 3))
def test_taking_a_contribution_away_leaves_no_trace(a: dict, b: dict, c: dict, weight: int) -> None:
    own, one, two = layer_of(a), contribution(layer_of(b), weight), contribution(layer_of(c))
    both = TYPE.view(own, (one, two))
    assert same(both, TYPE.view(own, (two, one)))
    touched = CellRegion(0.25, both.cells.keys)
    assert same(TYPE.view(own, (two,), both, touched), TYPE.view(own, (two,)))
    assert same(TYPE.view(own, (), both, touched), TYPE.view(own))


@given(evidence, evidence, st.integers(1, 3))
def test_absorbing_equals_viewing_together(a: dict, b: dict, weight: int) -> None:
    own, given = layer_of(a), contribution(layer_of(b), weight)
    together = TYPE.view(own, (given,))
    changed = TYPE.absorb(own, given)
    assert same(TYPE.view(own), together)
    assert set(changed.keys.tolist()) == set(given.layer.cells.keys.tolist())


@given(evidence, evidence)
def test_reset_forgets_what_is_only_foreign(a: dict, b: dict) -> None:
    own, donor = layer_of(a), layer_of(b)
    keep, expected = TYPE.region(own), own.cells.without(donor.cells.keys)
    TYPE.absorb(own, contribution(donor))
    reset = TYPE.reset(own, TYPE.region(donor), keep)
    assert reset.cells_reset == len(b.keys() - a.keys()) == len(reset.touched)
    assert reset.cells_contaminated == len(b.keys() & a.keys())
    assert set(own.cells.keys.tolist()) == set(keep.keys.tolist())
    assert (own.cells.at(expected.keys) == expected.counts).all()


@given(evidence)
def test_decode_is_the_inverse_of_encode(a: dict) -> None:
    data = TYPE.encode(layer_of(a))
    back = TYPE.decode(data)
    assert TYPE.encode(back) == data
    assert back.observations == 7
    assert same(TYPE.view(back), TYPE.view(layer_of(a)))


def test_a_decoded_layer_goes_on_being_written(two_walks: TwoWalks) -> None:
    layer = mapped(two_walks[0][:10])
    copy = TYPE.decode(TYPE.encode(layer))
    for observation in two_walks[0][10:20]:
        TYPE.integrate(layer, observation)
        TYPE.integrate(copy, observation)
    assert TYPE.encode(copy) == TYPE.encode(layer)


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: b"",
        lambda data: data[:-1],
        lambda data: data + b"\0",
        lambda data: b"{}" + data[data.index(b"\n") :],
        lambda data: data.replace(b"landmarks 1", b"landmarks 9"),
        lambda data: data[: data.index(b"\n") + 1] + b"\x7f" * (len(data) - data.index(b"\n") - 1),
        lambda data: data[: data.index(b"\n") + 1] + b"\0" * (len(data) - data.index(b"\n") - 1),
        lambda data: b"\x93" + data,
    ],
)
def test_damaged_bytes_are_refused(damage: object) -> None:
    assert callable(damage)
    data = TYPE.encode(layer_of({(1, 2): (3, 2), (4, 5): (6, 1)}))
    with pytest.raises(MapError, match="landmark map"):
        TYPE.decode(damage(data))


@given(evidence.filter(bool), poses)
def test_placing_keeps_every_sighting(a: dict, T: Transform) -> None:
    donor = layer_of(a)
    placed = TYPE.place(donor, T)
    assert placed.cells.counts[:, SIGHTINGS].sum() == donor.cells.counts[:, SIGHTINGS].sum()
    sums = donor.cells.counts[:, SUM_X:].sum(axis=0) * POSITION_STEP_M
    n = donor.cells.counts[:, SIGHTINGS].sum()
    expected = T.matrix[:2, :2] @ sums + n * T.matrix[:2, 3]
    slack = (n + len(donor.cells)) * POSITION_STEP_M
    assert placed.cells.counts[:, SUM_X:].sum(axis=0) * POSITION_STEP_M == pytest.approx(expected, abs=slack)


@given(evidence.filter(bool))
def test_placing_by_whole_cells_changes_nothing_else(a: dict) -> None:
    placed = TYPE.place(layer_of(a), Transform.planar(0.5, -0.75, 0.0))
    moved = layer_of({(ix + 2, iy - 3): row for (ix, iy), row in a.items()})
    assert TYPE.encode(placed) == TYPE.encode(moved)


def test_turning_leaves_no_holes(two_walks: TwoWalks) -> None:
    donor = layer_of({(ix, iy): (5, 0) for ix in range(-20, 20) for iy in range(-20, 20)})
    placed = TYPE.place(donor, Transform.planar(0.1, 0.2, 0.7))
    inside = np.mgrid[-3:3:0.25, -3:3:0.25].reshape(2, -1).T
    assert (TYPE.view(placed).looks_at(inside) == 5).all()
    assert len(placed.cells) == pytest.approx(1600, rel=0.02)


@pytest.mark.parametrize(("donor_cell_m", "scale"), [(0.5, 1.0), (0.1, 1.0), (0.25, 2.0), (0.25, 0.4)])
def test_other_cells_and_scales_cover_the_same_place(donor_cell_m: float, scale: float) -> None:
    side = round(8.0 / donor_cell_m)
    donor = layer_of({(ix, iy): (5, 0) for ix in range(side) for iy in range(side)}, donor_cell_m)
    placed = TYPE.place(donor, Transform.planar(1.0, 1.0, 0.3), scale)
    assert (placed.cells.counts[:, LOOKS] == 5).all()
    assert len(placed.cells) * 0.25**2 == pytest.approx((8.0 * scale) ** 2, rel=0.05)


def test_placing_refuses_what_it_cannot_do() -> None:
    donor = layer_of({(0, 0): (1, 1)})
    with pytest.raises(EmptyMapError, match="nothing to place"):
        TYPE.place(TYPE.new_layer(), Transform.identity())
    with pytest.raises(MapError, match="tilted"):
        TYPE.place(donor, Transform.from_quaternion((0, 0, 0), (0.1, 0, 0, 1)))
    with pytest.raises(MapError, match="positive"):
        TYPE.place(donor, Transform.identity(), scale=0.0)
    with pytest.raises(MapError, match="too large"):
        TYPE.place(layer_of({(2**29, 0): (1, 2**20)}), Transform.identity())


def test_metadata_tells_extent_and_landmarks(two_walks: TwoWalks) -> None:
    layer = mapped(two_walks[0])
    told = TYPE.metadata(layer)
    assert told.type == TYPE.name == layer.map_type == TYPE.view(layer).map_type
    assert told.extra["landmarks"] == len(TYPE.view(layer).landmarks)
    assert told.observations == len(two_walks[0])
    assert told.bounds_m is not None
    x0, y0, x1, y1 = told.bounds_m
    assert told.known_area_m2 <= (x1 - x0) * (y1 - y0)
    assert told.quality is not None
    assert 0.5 < told.quality <= 1.0
    empty = TYPE.metadata(TYPE.new_layer())
    assert (empty.bounds_m, empty.quality, empty.known_area_m2) == (None, None, 0.0)


def test_a_landmark_on_a_cell_corner_is_one_landmark() -> None:
    layer = layer_of({(0, 0): (20, 6), (0, 1): (20, 4), (1, 0): (20, 5), (1, 1): (20, 4), (9, 9): (20, 9)})
    landmarks = TYPE.view(layer).landmarks
    assert landmarks.sightings.tolist() == [19, 9]
    assert landmarks.looks.tolist() == [20, 20]


def test_seldom_sighted_things_do_not_stand() -> None:
    layer = layer_of({(0, 0): (100, 20), (9, 0): (9, 2), (18, 0): (9, 3)})
    assert TYPE.view(layer).landmarks.sightings.tolist() == [3]
    assert PointLandmarks(share_min=0.2).view(layer).landmarks.sightings.tolist() == [20, 3]
    assert PointLandmarks(sightings_min=2, share_min=0.0).view(layer).landmarks.sightings.tolist() == [20, 2, 3]


def test_nonsense_parameters_are_all_named() -> None:
    with pytest.raises(ConfigError, match=r"cell_m=-1.*beams_min=1.*share_min=2"):
        PointLandmarks(cell_m=-1, beams_min=1, share_min=2)


def test_what_does_not_fit_is_refused(two_walks: TwoWalks) -> None:
    layer = layer_of({(0, 0): (1, 1)})
    ready = two_walks[0][0].__class__("r", 0, 0, "m", "grid_message", None, Transform.identity(), Transform.identity())
    with pytest.raises(MapError, match="maps scans, found a grid_message"):
        TYPE.integrate(layer, ready)
    with pytest.raises(MapError, match=r"0\.5 m cells does not fit"):
        TYPE.view(layer, (contribution(layer_of({(0, 0): (1, 1)}, 0.5)),))
    for weight in (None, 0, 1.5):
        with pytest.raises(MapError, match="whole number from 1"):
            TYPE.view(layer, (contribution(layer_of({(0, 0): (1, 1)}), weight),))


def test_what_is_shown_and_written(two_walks: TwoWalks) -> None:
    map_ = TYPE.view(mapped(two_walks[0]))
    (message,) = TYPE.messages(map_)
    assert message.message_type == "sensor_msgs/msg/PointCloud2"
    points = np.frombuffer(message.fields["data"], "<f4").reshape(-1, 5)
    assert points[:, :2] == pytest.approx(map_.landmarks.positions_m, abs=1e-4)
    assert points[:, 3].tolist() == map_.landmarks.sightings.tolist()
    ((name, content),) = TYPE.files(map_, "robot").items()
    assert name == "robot.landmarks.csv"
    lines = content.decode().splitlines()
    assert lines[0] == "x_m,y_m,sightings,looks"
    assert len(lines) == 1 + len(map_.landmarks)
    x, y, sightings, _ = (float(cell) for cell in lines[1].split(","))
    assert (x, y) == pytest.approx(tuple(map_.landmarks.positions_m[0]), abs=1e-3)
    assert sightings == map_.landmarks.sightings[0]

"""Does quality mean something: on recorded logs that took no part in fitting it, and on drawn walls."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Iterable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import spearmanr

from mapgraft.contracts import Donation, EmptyMapError, MapError, Match, Observation, Provenance, Transform
from mapgraft_grid import quality as quality_module
from mapgraft_grid.degradation import Degradation, degrade
from mapgraft_grid.grid_map import OCCUPIED, DenseGrid, GridMap
from mapgraft_grid.layer import GridLayer
from mapgraft_grid.log_odds import LogOdds
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.quality import MODEL_FILE, QualityModel, WindowLayout, shipped_model, window_quality
from mapgraft_grid.quality_features import FEATURES, feature_shares
from mapgraft_grid.wall_error import mean_wall_error_m, wall_error_m

MakeMap = Callable[..., GridMap]
Carmen = Callable[[str], list[Observation]]

LOGS = ("intel", "aces", "belgioioso", "freiburg-101")
POSE = tuple(Degradation(pose_sigma_m=s, pose_sigma_rad=10 * math.radians(s)) for s in (0.03, 0.07, 0.15))
RANGE = tuple(Degradation(range_sigma_m=s) for s in (0.04, 0.1, 0.2))
DROPPED = tuple(Degradation(dropped=s) for s in (0.3, 0.6, 0.9))
RESOLUTIONS_M = {"intel": 0.05, "aces": 0.07, "belgioioso": 0.1, "freiburg-101": 0.05}


def mapped(observations: Iterable[Observation], resolution_m: float) -> tuple[OccupancyGrid, GridLayer, GridMap]:
    grids = OccupancyGrid(resolution_m=resolution_m)
    layer = grids.new_layer()
    for observation in observations:
        grids.integrate(layer, observation)
    return grids, layer, grids.view(layer)


def dense_of(observations: Iterable[Observation], resolution_m: float) -> DenseGrid:
    return mapped(observations, resolution_m)[2].dense()


def test_quality_ranks_maps_and_windows_by_their_true_wall_error(carmen: Carmen) -> None:
    """Four logs, a third of each, degraded in nine ways; rank correlation of at least 0.6 for windows and for maps."""
    qualities, errors, map_qualities, map_errors = [], [], [], []
    for name in LOGS:
        scans = carmen(name)
        scans, resolution_m = scans[: len(scans) // 3], RESOLUTIONS_M[name]
        truth = dense_of(scans, resolution_m)
        for seed, degradation in enumerate((Degradation(), *POSE, *RANGE, *DROPPED)):
            grid = dense_of(degrade(scans, degradation, seed), resolution_m)
            found = window_quality(grid)
            cells = np.maximum(found.layout.sums(grid.classes == OCCUPIED), 1)
            judged = ~np.isnan(found.quality)
            qualities.append(found.quality[judged])
            errors.append((found.layout.sums(wall_error_m(grid, truth)) / cells)[judged])
            map_qualities.append(found.mean())
            map_errors.append(mean_wall_error_m(grid, truth))
    windows = spearmanr(np.concatenate(qualities), -np.concatenate(errors)).statistic
    maps = spearmanr(map_qualities, [-error for error in map_errors]).statistic
    assert windows >= 0.6 and maps >= 0.6, (windows, maps)


@pytest.mark.parametrize("degradation", [POSE[1], RANGE[1]], ids=["pose noise", "range noise"])
@pytest.mark.parametrize("name", LOGS)
def test_fusing_by_quality_beats_plain_bayes_when_the_donor_is_worse(
    carmen: Carmen, name: str, degradation: Degradation
) -> None:
    plain, weighted = plain_and_weighted(carmen(name), RESOLUTIONS_M[name], degradation)
    assert weighted < plain


@pytest.mark.parametrize("name", LOGS)
def test_a_donor_that_lost_beams_is_fused_as_by_plain_bayes(carmen: Carmen, name: str) -> None:
    """What it did see is in its place."""
    plain, weighted = plain_and_weighted(carmen(name), RESOLUTIONS_M[name], DROPPED[1])
    assert weighted < 1.05 * plain


def plain_and_weighted(scans: list[Observation], resolution_m: float, degradation: Degradation) -> tuple[float, float]:
    """Wall errors of fused maps. Two robots share a floor: alternate blocks of ten scans; the donor's are degraded."""
    scans = scans[: len(scans) // 2]
    own, donor = ([s for n, s in enumerate(scans) if n // 10 % 2 == side] for side in (0, 1))
    truth = dense_of(scans, resolution_m)
    grids, layer, view = mapped(own, resolution_m)
    donation = Donation(mapped(degrade(donor, degradation, 7), resolution_m)[1], Provenance("donor", 1, len(donor)))
    here = Match(Transform.identity(), 1.0, math.inf)
    plain, weighted = (
        mean_wall_error_m(grids.view(layer, [LogOdds(quality=q).fuse(grids, view, donation, here)]).dense(), truth)
        for q in ("none", "windowed")
    )
    return plain, weighted


def test_more_pose_noise_is_less_quality(intel: list[Observation]) -> None:
    sigmas_m = (0.0, 0.03, 0.06, 0.12, 0.24)
    worse = [degrade(intel[:150], Degradation(pose_sigma_m=s, pose_sigma_rad=s / 6), 0) for s in sigmas_m]
    quality = [window_quality(dense_of(scans, 0.05)).mean() for scans in worse]
    assert quality == sorted(quality, reverse=True)
    assert quality[0] - quality[-1] > 0.3


def test_a_coarser_map_of_the_same_scans_is_worse(intel: list[Observation]) -> None:
    quality = [window_quality(dense_of(intel[:150], resolution_m)).mean() for resolution_m in (0.05, 0.1, 0.2)]
    assert quality == sorted(quality, reverse=True)


def test_evidence_that_was_gathered_coarsely_stays_worse_on_finer_cells(intel: list[Observation]) -> None:
    grid = dense_of(intel[:100], 0.05)
    assert window_quality(grid, measured_m=0.15).mean() < window_quality(grid).mean() - 0.1
    assert window_quality(grid, measured_m=0.01).mean() == window_quality(grid).mean()


def test_the_shipped_model_is_fitted_data_with_its_origin() -> None:
    given = json.loads(MODEL_FILE.read_text())
    assert given["provenance"].keys() >= {"script", "seed", "worlds", "windows", "target"}
    model = shipped_model()
    assert model == QualityModel.load() and set(model.weights) == set(FEATURES)
    assert all(weight <= 0 for name, weight in model.weights.items() if name != "certainty")
    assert model.weights["certainty"] >= 0


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1))
def test_quality_lies_between_0_and_1_where_there_is_wall(grid_map_of: MakeMap, seed: int) -> None:
    rng = np.random.default_rng(seed)
    classes = rng.choice(3, rng.integers(5, 80, 2), p=rng.dirichlet((1, 1, 1)))
    classes[0, 0] = OCCUPIED
    found = window_quality(grid_map_of(classes, 0.1).dense())
    judged = ~np.isnan(found.quality)
    assert np.array_equal(judged, found.wall_m >= 1.0)
    assert ((found.quality[judged] >= 0) & (found.quality[judged] <= 1)).all()
    assert math.isnan(found.mean()) == (not judged.any())


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1), st.integers(-50, 50), st.integers(-50, 50))
def test_windows_lie_on_the_lattice_and_not_on_the_array(grid_map_of: MakeMap, seed: int, x: int, y: int) -> None:
    rng = np.random.default_rng(seed)
    classes = rng.integers(1, 3, rng.integers(1, 50, 2))
    grid = grid_map_of(classes, 0.1, (x, y)).dense()
    layout = WindowLayout.of(grid)
    sums = layout.sums(grid.classes == OCCUPIED)
    for row, column in np.ndindex(*sums.shape):
        left, low = ((layout.first_block[0] + column) * 10, (layout.first_block[1] + row) * 10)
        rows = slice(max(0, low - y), max(0, low + 20 - y))
        columns = slice(max(0, left - x), max(0, left + 20 - x))
        assert sums[row, column] == np.count_nonzero(classes[rows, columns] == OCCUPIED)
    assert sums.sum() == 4 * np.count_nonzero(classes == OCCUPIED)  # every cell lies in four windows


def feature(map_: GridMap, name: str) -> float:
    over, under = feature_shares(map_.dense())[name]
    return float(over.sum() / under.sum())


def with_wall(rows: slice) -> NDArray[np.int64]:
    classes = np.ones((60, 60), int)
    classes[rows] = OCCUPIED
    return classes


def test_features_tell_thin_walls_from_thick_double_and_crumbled_ones(grid_map_of: MakeMap) -> None:
    thin, thick = grid_map_of(with_wall(slice(30, 31)), 0.05), grid_map_of(with_wall(slice(28, 33)), 0.05)
    double = with_wall(slice(28, 29))
    double[32] = OCCUPIED
    crumbs = np.ones((60, 60), int)
    crumbs[::6, ::6] = OCCUPIED
    assert feature(thin, "spread_m") == pytest.approx(0.0, abs=1e-4)
    assert feature(thick, "spread_m") == pytest.approx(0.05 * math.sqrt(2), rel=1e-3)  # five cells: variance 2
    assert feature(grid_map_of(double, 0.05), "spread_m") == pytest.approx(0.1, rel=1e-3)
    assert feature(thin, "interior") == 0.0
    assert feature(thick, "interior") == pytest.approx(0.6)
    assert feature(thin, "speckle") == 0.0
    assert feature(grid_map_of(crumbs, 0.05), "speckle") == 1.0


def test_contradicting_evidence_near_walls_is_undecided(scan_of: Callable[..., Observation]) -> None:
    """Two hits and four misses say nothing; they lie 0.2 m before a wall."""
    grids = OccupancyGrid(resolution_m=0.1)
    layer = grids.new_layer()
    for ahead in (2.05, 2.05, 2.25, 2.25, 2.25, 2.25):
        grids.integrate(layer, scan_of(np.linspace(-0.2, 0.2, 40), ahead))
    assert feature(grids.view(layer), "undecided") > 0.05
    steady = grids.new_layer()
    for _ in range(6):
        grids.integrate(steady, scan_of(np.linspace(-0.2, 0.2, 40), 3.05))
    assert feature(grids.view(steady), "undecided") == 0.0


def test_wall_error_is_the_distance_to_the_nearest_true_wall(grid_map_of: MakeMap) -> None:
    truth = grid_map_of(with_wall(slice(10, 11)), 0.1).dense()
    for shift, want_m in ((0, 0.0), (3, 0.3), (9, 0.9), (20, 1.0)):
        grid = grid_map_of(with_wall(slice(10 + shift, 11 + shift)), 0.1).dense()
        assert mean_wall_error_m(grid, truth) == pytest.approx(want_m)
        error = wall_error_m(grid, truth)
        assert error.shape == grid.classes.shape and (error[grid.classes != OCCUPIED] == 0).all()
    finer = grid_map_of(with_wall(slice(24, 26)), 0.05).dense()  # 1.2 to 1.3 m; the true wall is from 1.0 to 1.1 m
    assert mean_wall_error_m(finer, truth) == pytest.approx(0.2)
    free = grid_map_of(np.ones((3, 3), int), 0.1).dense()
    for pair in itertools.permutations((free, truth)):
        with pytest.raises(EmptyMapError, match="no occupied cell"):
            mean_wall_error_m(*pair)


def test_degrading_is_seeded_and_does_what_it_says(intel: list[Observation]) -> None:
    d = Degradation(pose_sigma_m=0.1, pose_sigma_rad=0.05, range_sigma_m=0.2, dropped=0.25)
    once, again = list(degrade(intel[:60], d, 5)), list(degrade(intel[:60], d, 5))
    assert all(a.T_map_sensor == b.T_map_sensor for a, b in zip(once, again, strict=True))
    assert all(np.array_equal(a.payload.ranges_m, b.payload.ranges_m, True) for a, b in zip(once, again, strict=True))
    errors = [a.T_map_sensor.difference(b.T_map_sensor) for a, b in zip(once, intel, strict=False)]
    assert math.sqrt(np.mean([m * m for m, _ in errors])) == pytest.approx(0.1 * math.sqrt(2), rel=0.3)
    assert math.sqrt(np.mean([rad * rad for _, rad in errors])) == pytest.approx(0.05, rel=0.4)
    ranges, noisy = (np.concatenate([o.payload.ranges_m for o in scans]) for scans in (intel[:60], once))
    hits = np.concatenate([o.payload.hits for o in intel[:60]])
    assert np.isnan(noisy).mean() == pytest.approx(0.25, abs=0.02)
    seen = hits & ~np.isnan(noisy)
    assert (noisy - ranges)[seen].std() == pytest.approx(0.2, rel=0.1)
    assert np.array_equal(noisy[~hits & ~np.isnan(noisy)], ranges[~hits & ~np.isnan(noisy)])


def test_only_scans_can_be_degraded(message_of: Callable[..., Observation]) -> None:
    with pytest.raises(MapError, match="only scans"):
        list(degrade([message_of([[0, 100]])], Degradation(), 0))


@pytest.mark.parametrize(
    ("height", "width", "resolution_m"),
    [(300, 500, 0.05), (57, 911, 0.1), (1, 2000, 0.05), (333, 2, 0.3), (70, 60, 1.7), (5, 700, 0.01)],
)
def test_large_grids_are_judged_piece_by_piece_as_if_whole(
    height: int, width: int, resolution_m: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The memory that it takes does not grow with the grid."""
    chance = np.random.default_rng(height)
    classes = np.where(chance.random((height, width)) < 0.05, OCCUPIED, chance.integers(0, 2, (height, width)))
    log_odds = (classes.astype(np.int32) - 1) * 700 + chance.integers(-400, 400, (height, width), np.int32)
    grid = DenseGrid(classes.astype(np.uint8), log_odds, (-13, 7), (0.0, 0.0), resolution_m)
    whole = window_quality(grid)
    monkeypatch.setattr(quality_module, "PIECE_CELLS", 100)
    monkeypatch.setattr(quality_module, "SIDE_CELLS", 64)
    pieces = window_quality(grid)
    assert np.array_equal(pieces.wall_m, whole.wall_m)
    assert np.allclose(pieces.quality, whole.quality, rtol=1e-6, equal_nan=True)
    assert whole.wall_m.sum() > 0


def test_a_grid_of_too_many_windows_is_not_judged() -> None:
    cells = np.broadcast_to(np.uint8(1), (3000, 3000))
    grid = DenseGrid(cells, np.broadcast_to(np.int32(-900), cells.shape), (0, 0), (0.0, 0.0), 1.0)
    with pytest.raises(MapError, match="too wide to be judged"):
        window_quality(grid)

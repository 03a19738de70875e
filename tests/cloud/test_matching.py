"""The matchers on real and simulated clouds: right, repeatable, honest about how sure they are."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mapgraft.contracts import (
    CLOUD_MAP,
    Cloud,
    ConfigError,
    EmptyMapError,
    MapError,
    Match,
    Observation,
    Prior,
    Transform,
)
from mapgraft_cloud import wall_columns
from mapgraft_cloud.agreement import agreement
from mapgraft_cloud.cloud_file import read
from mapgraft_cloud.cloud_map import CloudMap
from mapgraft_cloud.layer import CloudLayer
from mapgraft_cloud.map_type import PointCloud
from mapgraft_cloud.surface import surface_of

gicp = pytest.importorskip("mapgraft_cloud.gicp")
pytest.importorskip("small_gicp", reason="needs the extra cloud")
pytest.importorskip("kiss_matcher", reason="needs the extra cloud")
kiss = pytest.importorskip("mapgraft_cloud.kiss")

Observe = Callable[..., Observation]
FAR = Transform.planar(7.0, -12.0, math.radians(137.0))


@pytest.fixture(scope="module")
def real(shared_data: Path) -> tuple[Cloud, Cloud, Transform]:
    """Two lidar scans of one street, target and source, and the transform between them."""
    folder = shared_data / "clouds" / "small_gicp"
    matrix = np.loadtxt(folder / "T_target_source.txt")
    u, _, vt = np.linalg.svd(matrix[:3, :3])  # the file has six digits
    matrix[:3, :3] = u @ vt
    return read(folder / "target.ply"), read(folder / "source.ply"), Transform.from_matrix(matrix)


def map_of(cloud: Cloud, T: Transform | None = None, every: int = 1, voxel_m: float = 0.1) -> CloudMap:
    kind, pose = PointCloud(resolution_m=voxel_m), T or Transform.identity()
    layer = kind.new_layer()
    thin = Cloud(cloud.points_m[::every], origin_m=None)
    kind.integrate(layer, Observation("r", 0, 0, "file", CLOUD_MAP, thin, pose, pose))
    return kind.view(layer)


def errors(match: Match, truth: Transform) -> tuple[float, float]:
    apart_m, turned = match.T_receiver_donor.difference(truth)
    return apart_m, math.degrees(turned)


def prior(T: Transform, sigma_m: float = 0.3) -> Prior:
    covariance = np.diag([sigma_m**2, sigma_m**2, 0.0, 0.0, 0.0, 0.1**2])
    return Prior(T, covariance, "a person")


@pytest.mark.parametrize(
    ("moved", "aligned"),
    [(Transform.identity(), True), (FAR, True), (FAR, False)],
    ids=["as recorded", "turned by 137 degrees", "turned, not aligned"],
)
def test_real_scans_are_matched_from_no_prior(
    real: tuple[Cloud, Cloud, Transform], moved: Transform, aligned: bool
) -> None:
    target, source, truth = real
    found = kiss.Kiss(aligned=aligned).match(map_of(target), map_of(source, moved))
    apart_m, apart_deg = errors(found[0], truth @ moved.inverse())
    assert apart_m < 0.05
    assert apart_deg < 0.5
    assert len(found) >= 2
    assert found[0].margin > 0.5 * found[0].score
    assert found[0].evidence["overlap"] > 0.6


def test_sparse_against_dense(real: tuple[Cloud, Cloud, Transform]) -> None:
    target, source, truth = real
    found = kiss.Kiss().match(map_of(target), map_of(source, FAR, 20))
    apart_m, apart_deg = errors(found[0], truth @ FAR.inverse())
    assert apart_m < 0.15
    assert apart_deg < 1.0


def test_maps_of_large_voxels(real: tuple[Cloud, Cloud, Transform], capfd: pytest.CaptureFixture[str]) -> None:
    target, source, truth = real
    found = kiss.Kiss().match(map_of(target, voxel_m=0.8), map_of(source, FAR, voxel_m=0.2))
    apart_m, apart_deg = errors(found[0], truth @ FAR.inverse())
    assert apart_m < 0.2
    assert apart_deg < 1.0
    assert capfd.readouterr().out == ""  # nor does the library write anything


def test_huge_maps_are_thinned_until_they_are_not(
    real: tuple[Cloud, Cloud, Transform], monkeypatch: pytest.MonkeyPatch
) -> None:
    target, source, truth = real
    thinned, sizes = kiss.thinned, list[int]()

    def counting(points: np.ndarray, voxel_m: float) -> np.ndarray:
        sizes.append(len(thinned(points, voxel_m)))
        return thinned(points, voxel_m)

    monkeypatch.setattr(kiss, "MOST_POINTS", 2000)
    monkeypatch.setattr(kiss, "thinned", counting)
    guesses = kiss.kiss_guesses(target.points_m, source.points_m, 0.3, True)
    assert max(sizes[-2:]) <= 2000 < max(sizes)
    assert min(guess.difference(truth)[0] for guess in guesses) < 1.0


def test_a_tilted_scan_needs_all_six_degrees_of_freedom(real: tuple[Cloud, Cloud, Transform]) -> None:
    target, source, truth = real
    tilted = Transform.from_quaternion((2.0, 1.0, 0.5), (0.05, -0.08, 0.4, 0.9))
    found = kiss.Kiss(aligned=False).match(map_of(target), map_of(source, tilted))
    apart_m, apart_deg = errors(found[0], truth @ tilted.inverse())
    assert apart_m < 0.1
    assert apart_deg < 0.5


def test_gicp_alone_needs_a_prior_and_betters_it(real: tuple[Cloud, Cloud, Transform]) -> None:
    target, source, truth = real
    maps = map_of(target), map_of(source)
    with pytest.raises(MapError, match="nobody knows one for this pair"):
        gicp.Gicp().match(*maps)
    start = Transform.planar(0.4, -0.3, math.radians(4.0)) @ truth
    best = gicp.Gicp().match(*maps, prior(start))[0]
    apart_m, apart_deg = errors(best, truth)
    assert apart_m < 0.05
    assert apart_deg < 0.5
    assert best.score > best.evidence["prior_score"]
    assert kiss.Kiss().match(*maps, prior(start))[0].T_receiver_donor == best.T_receiver_donor


def test_simulated_drives_are_matched_and_their_covariance_is_honest(
    maps: tuple[CloudMap, CloudMap], drives: tuple[CloudLayer, CloudLayer]
) -> None:
    kind, T = PointCloud(), Transform.planar(12.0, -7.0, 2.0).snapped()
    donor = kind.view(kind.place(drives[1], T))
    found = kiss.Kiss().match(maps[0], donor)
    best, middle = found[0], donor.points_m.mean(axis=0)[None]
    assert np.linalg.norm(best.T_receiver_donor.apply(middle) - T.inverse().apply(middle)) < 0.15
    assert best.margin > 20
    covariance = best.covariance
    assert covariance is not None
    assert np.array_equal(covariance, covariance.T)
    assert not covariance[3:5].any()
    assert (np.linalg.eigvalsh(covariance[np.ix_([0, 1, 2, 5], [0, 1, 2, 5])]) > 0).all()
    wrong = [agreement(maps[0], donor, match.T_receiver_donor, walls_only=True) for match in found[1:]]
    right = agreement(maps[0], donor, best.T_receiver_donor, walls_only=True)
    assert right.through_m2 < 0.05 * right.shared_m2
    assert all(one.through_m2 > 0.1 * one.shared_m2 for one in wrong)


def test_a_corridor_is_said_to_be_unsure_along_it(observe: Observe) -> None:
    y, z = np.meshgrid(np.arange(-8, 8, 0.05), np.arange(0, 2.4, 0.1))
    walls = [np.stack((np.full(y.size, x), y.ravel(), z.ravel()), axis=1) for x in (-1.0, 1.0)]
    kind = PointCloud()
    layer = kind.new_layer()
    kind.integrate(layer, observe(np.concatenate(walls), None, None, True))
    seen = kind.view(layer)
    best = gicp.Gicp().match(seen, seen, prior(Transform.identity(), 0.1))[0]
    assert best.covariance is not None
    assert best.covariance[1, 1] > 20 * best.covariance[0, 0]


def test_equal_maps_give_equal_matches(real: tuple[Cloud, Cloud, Transform]) -> None:
    told = []
    for _ in range(2):
        found = kiss.Kiss().match(map_of(real[0]), map_of(real[1], FAR))
        told.append([(match.T_receiver_donor.matrix.tobytes(), match.score) for match in found])
    assert told[0] == told[1]


def test_maps_with_hardly_anything_are_refused(observe: Observe, maps: tuple[CloudMap, CloudMap]) -> None:
    kind = PointCloud()
    layer = kind.new_layer()
    kind.integrate(layer, observe([[1, 0, 0], [2, 0, 0]]))
    with pytest.raises(EmptyMapError, match="the donor's point cloud map has 2 places on surfaces, 30 are needed"):
        kiss.Kiss().match(maps[0], kind.view(layer))


def test_wall_columns_find_the_turn_and_the_shift(
    maps: tuple[CloudMap, CloudMap], drives: tuple[CloudLayer, CloudLayer]
) -> None:
    kind, T = PointCloud(), Transform.from_quaternion((3.0, 4.0, 0.7), (0.0, 0.0, 0.6, 0.8)).snapped()
    donor = kind.view(kind.place(drives[1], T))
    guesses = wall_columns.guesses(maps[0].surface, donor.surface, 3)
    middle = donor.points_m.mean(axis=0)[None]
    apart = [float(np.linalg.norm(guess.apply(middle) - T.inverse().apply(middle))) for guess in guesses]
    assert min(apart) < 0.8
    assert wall_columns.guesses(maps[0].surface, surface_of(np.zeros((3, 3))), 3) == []


@pytest.mark.parametrize("wrong", [{"voxel_m": 0.0}, {"hypotheses": 0}, {"aligned": "yes"}])
def test_impossible_parameters_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        kiss.Kiss(**wrong)

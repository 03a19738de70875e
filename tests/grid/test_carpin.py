"""Carpin's matcher on real map pairs, under turned maps, across resolutions, and on what cannot be matched."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mapgraft.contracts import ConfigError, EmptyMapError, MapError, Match, Observation, Transform
from mapgraft_grid.carpin import OTHER_SHIFT_M, OTHER_YAW_RAD, Carpin
from mapgraft_grid.grid_map import OCCUPIED, GridMap
from mapgraft_grid.kernels.agreement import coincidences, meet
from mapgraft_grid.kernels.coarsen import coarsen
from mapgraft_grid.kernels.hough import axis_spectra, hough_spectrum
from mapgraft_grid.map_type import OccupancyGrid

MakeMap = Callable[..., GridMap]


@dataclass(frozen=True, slots=True)
class Strange:
    map_type: str = "cairns"

    def known(self) -> int:
        return 1


def view_of(observations: list[Observation], resolution_m: float, T: Transform | None = None) -> GridMap:
    """The map of these scans, seen from a frame of its own: T is ``T_map_world``."""
    grids = OccupancyGrid(resolution_m=resolution_m)
    layer = grids.new_layer()
    for o in observations:
        pose = o.T_map_sensor if T is None else T @ o.T_map_sensor
        grids.integrate(layer, Observation(o.robot, o.stamp_ns, o.recorded_ns, o.sensor, o.kind, o.payload, pose, pose))
    return grids.view(layer)


def off_by(found: Transform, truth: Transform, spots: NDArray[np.float64]) -> tuple[float, float]:
    """Mean displacement of the spots in metres, and the turn between both in degrees."""
    turn = math.remainder(found.yaw_rad - truth.yaw_rad, 2 * math.pi)
    return float(np.hypot(*(found.apply(spots) - truth.apply(spots)).T).mean()), abs(math.degrees(turn))


def walls_of(map_: GridMap) -> NDArray[np.float64]:
    dense = map_.dense()
    rows, columns = np.nonzero(dense.classes == OCCUPIED)
    return np.stack((columns + 0.5, rows + 0.5), axis=1) * dense.resolution_m + np.array(dense.origin_m)


def inside_ellipse(match: Match, truth: Transform) -> bool:
    """Whether the truth lies in the ellipsoid of x, y and yaw that should hold it in 95 % of all cases."""
    assert match.covariance is not None
    found = match.T_receiver_donor
    turn = math.remainder(found.yaw_rad - truth.yaw_rad, 2 * math.pi)
    error = np.array([found.x_m - truth.x_m, found.y_m - truth.y_m, turn])
    covariance = match.covariance[np.ix_([0, 1, 5], [0, 1, 5])]
    return bool(error @ np.linalg.solve(covariance, error) <= 7.81)


def flat_with_rooms(seed: int) -> NDArray[np.uint8]:
    """A floor of rooms that no turn maps on itself, as classes."""
    rng = np.random.default_rng(seed)
    classes = np.ones((120, 180), np.uint8)
    classes[:2] = classes[-2:] = classes[:, :2] = classes[:, -2:] = OCCUPIED
    classes[50:52, :100] = classes[50:52, 112:] = OCCUPIED
    for x in (40, 75, 130):
        classes[52:, x : x + 2] = OCCUPIED
    classes[:50, 60:62] = OCCUPIED
    for _ in range(8):
        y, x = rng.integers(5, 110), rng.integers(5, 170)
        classes[y : y + rng.integers(2, 9), x : x + rng.integers(2, 9)] = OCCUPIED
    classes[:30, 150:] = 0
    return classes


def test_real_pairs_are_matched_as_by_the_best_of_its_kind(shared_data: Path, grid_map_of: MakeMap) -> None:
    """Right is within 0.5 m and 5 degrees; the original method finds 85 % of such pairs of equal resolution."""
    folder = shared_data / "maps" / "grid_pairs"

    def load(name: str, resolution_m: float) -> GridMap:
        image = cv2.imread(str(folder / name), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        return grid_map_of(np.where(image == 0, 2, np.where(image == 254, 1, 0)), resolution_m)

    verdicts: dict[str, bool] = {}
    for pair in json.loads((folder / "pairs.json").read_text()):
        a, b = load(pair["a"], pair["res_a"]), load(pair["b"], pair["res_b"])
        matches = Carpin().match(a, b)
        verdicts[pair["id"]] = pair_is_right(matches[0], pair, walls_of(b))
        assert matches[0].margin > 0.02, pair["id"]
    assert len(verdicts) == 29 and all(verdicts.values()), [name for name, right in verdicts.items() if not right]
    for pair in json.loads((folder / "unrelated.json").read_text()):
        matches = Carpin().match(load(pair["a"], 0.05), load(pair["b"], 0.05))
        assert len(matches) >= 2 and matches[0].margin < 0.02


def pair_is_right(match: Match, pair: dict[str, Any], walls: NDArray[np.float64]) -> bool:
    """The truth maps pixel indices to pixel indices, x to the right and y down, as the maps were loaded."""
    a, b, c, d, e, f = pair["T_px_b2a"]
    pixels = walls / pair["res_b"] - 0.5
    truth = (pixels @ np.array([[a, d], [b, e]]) + (c, f) + 0.5) * pair["res_a"]
    displaced = np.hypot(*(match.T_receiver_donor.apply(walls) - truth).T).mean()
    turn = math.remainder(match.T_receiver_donor.yaw_rad - math.atan2(d, a), 2 * math.pi)
    return bool(displaced <= 0.5 and abs(turn) <= math.radians(5.0))


@pytest.mark.parametrize(("target_m", "source_m"), [(0.05, 0.05), (0.07, 0.1), (0.1, 0.07), (0.05, 0.2)])
def test_two_missions_meet_at_any_two_resolutions(intel: list[Observation], target_m: float, source_m: float) -> None:
    """Two rounds of one robot through the same floor, the second in a frame of its own."""
    T_world_map = Transform.planar(4.0, -7.0, 2.0)
    target, source = view_of(intel[:190], target_m), view_of(intel[420:640], source_m, T_world_map.inverse())
    best, second = Carpin().match(target, source)[:2]
    shift_m, turn_deg = off_by(best.T_receiver_donor, T_world_map, walls_of(source))
    assert shift_m < 0.25 and turn_deg < 1.5
    assert best.score > 0.93 and best.margin > 0.02
    assert inside_ellipse(best, T_world_map)
    assert best.evidence["sigma_max_m"] < 0.5 * max(target_m, source_m)  # nor is it told to be anywhere
    assert best.evidence["resolution_m"] == max(target_m, source_m)
    assert best.score - second.score == pytest.approx(-second.margin)


@settings(deadline=None, max_examples=12)
@given(st.integers(0, 3), st.integers(0, 3), st.integers(0, 50))
def test_turning_a_map_by_quarters_turns_the_answer(grid_map_of: MakeMap, a: int, b: int, seed: int) -> None:
    """A quarter turn keeps the cells, so that nothing but rounding may change."""
    classes = flat_with_rooms(seed)
    part = classes[20:, 10:150]
    best = Carpin().match(grid_map_of(np.rot90(classes, a)), grid_map_of(np.rot90(part, b)))[0]
    want = quarter(a, classes.shape) @ Transform.planar(1.0, 2.0, 0.0) @ quarter(b, part.shape).inverse()
    shift_m, turn_deg = off_by(best.T_receiver_donor, want, walls_of(grid_map_of(np.rot90(part, b))))
    assert shift_m < 0.1 and turn_deg < 0.5
    assert best.score > 0.99


def quarter(turns: int, shape: tuple[int, int]) -> Transform:
    """What ``np.rot90`` does to a grid with row 0 at the bottom and 0.1 m cells: a turn clockwise, then a shift."""
    T = Transform.identity()
    height, width = shape
    for _ in range(turns):
        T = Transform.planar(0.0, 0.1 * width, -math.pi / 2) @ T
        height, width = width, height
    return T


def test_equal_inputs_give_equal_bits_and_stay_as_they_are(grid_map_of: MakeMap) -> None:
    classes = flat_with_rooms(3)
    maps = grid_map_of(classes), grid_map_of(np.rot90(classes[:, 30:]))
    before = [(m.dense().classes.copy(), m.dense().log_odds.copy()) for m in maps]
    first, again = Carpin().match(*maps), Carpin().match(grid_map_of(classes), grid_map_of(np.rot90(classes[:, 30:])))
    assert [repr(m) for m in first] == [repr(m) for m in again]
    assert first[0].covariance is not None and again[0].covariance is not None
    assert first[0].covariance.tobytes() == again[0].covariance.tobytes()
    assert [m.T_receiver_donor.matrix.tobytes() for m in first] == [m.T_receiver_donor.matrix.tobytes() for m in again]
    for map_, (kept_classes, kept_log_odds) in zip(maps, before, strict=True):
        assert not map_.dense().classes.flags.writeable
        assert np.array_equal(map_.dense().classes, kept_classes)
        assert np.array_equal(map_.dense().log_odds, kept_log_odds)


def test_hypotheses_are_rigid_different_places_best_first(grid_map_of: MakeMap) -> None:
    classes = flat_with_rooms(5)
    matches = Carpin(returned=6, hypotheses=8).match(grid_map_of(classes), grid_map_of(classes[:, :100]))
    assert 2 <= len(matches) <= 6
    middle = np.array([[5.0, 6.0]])
    for number, match in enumerate(matches):
        assert np.linalg.det(match.T_receiver_donor.matrix[:3, :3]) == pytest.approx(1.0)  # never a reflection
        assert match.scale == 1.0
        e = match.evidence
        assert e["agreement"] + e["disagreement"] == e["overlap_cells"]
        assert match.score == pytest.approx(e["agreement"] / e["overlap_cells"])
        for other in matches[:number]:
            shift_m, turn_deg = off_by(match.T_receiver_donor, other.T_receiver_donor, middle)
            assert shift_m > OTHER_SHIFT_M / 2 or turn_deg > math.degrees(OTHER_YAW_RAD)
    share = [m.evidence["occupied_agreement"] >= 0.5 * matches[0].evidence["occupied_agreement"] for m in matches]
    assert share == sorted(share, reverse=True)  # rivals before weaker ones
    rivals = [m.score for m, rival in zip(matches, share, strict=True) if rival]
    assert rivals == sorted(rivals, reverse=True)


def test_a_symmetric_room_has_two_equally_good_hypotheses(grid_map_of: MakeMap) -> None:
    room = np.ones((60, 90), np.uint8)
    room[[0, -1]] = room[:, [0, -1]] = OCCUPIED
    first, second = Carpin().match(grid_map_of(room), grid_map_of(room))[:2]
    assert first.margin == pytest.approx(0.0, abs=0.02)
    turn = math.remainder(first.T_receiver_donor.yaw_rad - second.T_receiver_donor.yaw_rad, 2 * math.pi)
    assert abs(turn) == pytest.approx(math.pi, abs=0.02)


def test_a_corridor_tells_nothing_of_where_along_it(grid_map_of: MakeMap) -> None:
    rng = np.random.default_rng(7)

    def corridor(columns: int) -> NDArray[np.uint8]:
        classes = np.ones((24, columns), np.uint8)
        classes[[0, 1, -2, -1]] = rng.integers(1, 3, (4, columns))  # ragged, each time anew
        classes[[0, -1]] = OCCUPIED
        return classes

    best = Carpin(overlap_min=0.9).match(grid_map_of(corridor(160)), grid_map_of(np.rot90(corridor(110))))[0]
    assert best.covariance is not None
    assert best.evidence["sigma_max_m"] > 8.0
    assert abs(math.sin(best.evidence["degenerate_dir_rad"])) < 0.03
    assert best.covariance[1, 1] - best.covariance[1, 5] ** 2 / best.covariance[5, 5] < 0.1**2  # across it is clear
    assert best.covariance[5, 5] < math.radians(2.0) ** 2


def test_too_little_wall_tells_no_covariance(grid_map_of: MakeMap) -> None:
    stub = np.ones((40, 40), np.uint8)
    stub[20, 12:26] = OCCUPIED
    best = Carpin().match(grid_map_of(stub), grid_map_of(stub))[0]
    assert best.covariance is None
    assert "sigma_max_m" not in best.evidence and "degenerate_dir_rad" not in best.evidence


def test_poses_with_hardly_any_overlap_are_left_out(grid_map_of: MakeMap) -> None:
    classes = flat_with_rooms(1)
    maps = grid_map_of(classes), grid_map_of(classes[:, 60:])
    smaller = np.count_nonzero(classes[:, 60:])
    for match in Carpin(overlap_min=0.6).match(*maps):
        assert match.evidence["overlap_cells"] >= 0.55 * smaller  # the search estimates the overlap from a sample


def test_maps_without_walls_and_other_types_are_refused(grid_map_of: MakeMap) -> None:
    room, free = grid_map_of(flat_with_rooms(0)), grid_map_of(np.ones((5, 5), int))
    for target, source, side in ((free, room, "target"), (room, free, "source")):
        with pytest.raises(EmptyMapError, match=f"the {side} map has no occupied cell"):
            Carpin().match(target, source)
    nothing = OccupancyGrid().view(None)
    with pytest.raises(EmptyMapError):
        Carpin().match(room, nothing)
    with pytest.raises(MapError, match="'cairns'"):
        Carpin().match(room, Strange())


@pytest.mark.parametrize("options", [{"hypotheses": 0}, {"peaks": 0}, {"returned": 1}, {"overlap_min": 1.5}])
def test_impossible_parameters_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="found"):
        Carpin(**options)


def _points(seed: int) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    return rng.uniform(-12, 12, (rng.integers(1, 200), 2))


def _classes(seed: int) -> NDArray[np.uint8]:
    rng = np.random.default_rng(seed)
    return rng.integers(0, 3, rng.integers(1, 13, 2)).astype(np.uint8)


seeds = st.integers(0, 2**32 - 1)
points, grids = seeds.map(_points), seeds.map(_classes)


@settings(deadline=None, max_examples=100)
@given(points, st.floats(0, 2 * math.pi))
def test_spectra_count_votes(p: NDArray[np.float64], angle: float) -> None:
    rho = np.floor(p[:, 0] * math.cos(angle) + p[:, 1] * math.sin(angle) + 0.5)
    votes = np.unique(rho, return_counts=True)[1]
    assert hough_spectrum(p, np.array([angle]), 18)[0] == pytest.approx((votes**2).sum(), abs=2.1 * len(p))
    spectra = axis_spectra(p, math.cos(angle), math.sin(angle), 18)
    turned = p @ np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    assert spectra.sum(axis=1) == pytest.approx([len(p)] * 2)
    assert spectra @ (np.arange(spectra.shape[1]) - 19) == pytest.approx(turned.sum(axis=0), abs=1e-6)


@settings(deadline=None, max_examples=100)
@given(grids, points, seeds)
def test_meeting_counts_pairs_of_classes(target: NDArray[np.uint8], p: NDArray[np.float64], seed: int) -> None:
    rng = np.random.default_rng(seed)
    classes = rng.integers(0, 3, len(p)).astype(np.uint8)
    yaw, x, y = rng.uniform(-3, 3, 3)
    c, s = math.cos(yaw), math.sin(yaw)
    want = np.zeros((3, 3), int)
    for (px, py), k in zip(p, classes, strict=True):
        u, v = math.floor(c * px - s * py + x), math.floor(s * px + c * py + y)
        inside = 0 <= v < target.shape[0] and 0 <= u < target.shape[1]
        want[target[v, u] if inside else 0, k] += 1
    assert np.array_equal(meet(target, p, classes, c, s, x, y), want)
    turned = np.stack((c * p[:, 0] - s * p[:, 1], s * p[:, 0] + c * p[:, 1]), axis=1)
    assert coincidences(target, OCCUPIED, turned, np.array([[x, y]]))[0] == want[OCCUPIED].sum()


@settings(deadline=None, max_examples=100)
@given(grids, st.sampled_from((1.0, 1.37, 2.0, 10 / 7, 3.5)))
def test_coarse_cells_say_what_their_fine_cells_say(fine: NDArray[np.uint8], ratio: float) -> None:
    coarse = coarsen(fine, ratio)
    assert coarse.shape == tuple(math.ceil(side / ratio) for side in fine.shape)
    row_of, column_of = (((np.arange(side) + 0.5) / ratio).astype(int) for side in fine.shape)
    for row, column in np.ndindex(*coarse.shape):
        cells = fine[np.ix_(row_of == row, column_of == column)]
        free = bool(cells.size) and (cells == 1).mean() >= 0.5
        assert coarse[row, column] == (OCCUPIED if (cells == OCCUPIED).any() else int(free))

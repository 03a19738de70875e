"""The correlation matcher: on floors with a known transform, under moved maps, within priors, on what is no map."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mapgraft.contracts import ConfigError, EmptyMapError, MapError, Match, Prior, Transform
from mapgraft_grid.bayes import log_bayes_factor
from mapgraft_grid.correlation import OTHER_SHIFT_M, OTHER_YAW_RAD, Correlation
from mapgraft_grid.grid_map import OCCUPIED, GridMap
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.prepared import canonical_m, prepare

MakeMap = Callable[..., GridMap]
Boxes = NDArray[np.float64]  # (n, 4) x, y of the lower-left corner, width, height in metres
Part = tuple[float, float, float, float]  # x, y of the lower-left and the upper-right corner in metres
WHOLE: Part = (-1.0, -1.0, 19.0, 13.0)
angles = st.floats(-math.pi, math.pi)


@dataclass(frozen=True, slots=True)
class Strange:
    map_type: str = "cairns"

    def known(self) -> int:
        return 1


def floor_plan(seed: int) -> Boxes:
    """The walls and the furniture of a floor of 18 m by 12 m that no turn maps on itself."""
    random = np.random.default_rng(seed)
    walls = [(0, 0, 18, 0.2), (0, 11.8, 18, 0.2), (0, 0, 0.2, 12), (17.8, 0, 0.2, 12), (0, 5, 10, 0.2)]
    walls += [(11.2, 5, 6.8, 0.2), (4, 5, 0.2, 5.5), (7.5, 6.5, 0.2, 5.5), (13, 5, 0.2, 5.8), (6, 0, 0.2, 3.8)]
    places = random.uniform((0.5, 0.5, 0.3, 0.3), (16.5, 10.5, 0.9, 0.9), (10, 4))
    return np.vstack((np.array(walls, np.float64), places))


def drawn(make: MakeMap, boxes: Boxes, part: Part, T_map_world: Transform, resolution_m: float) -> GridMap:
    """The map, in a frame of its own, of what lies in one part of a floor; cells say what is at their centres."""
    x0, y0, x1, y1 = part
    corners = T_map_world.apply(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]))
    low = np.floor(corners.min(axis=0) / resolution_m).astype(int)
    columns, rows = (np.ceil(corners.max(axis=0) / resolution_m) - low).astype(int)
    x, y = np.meshgrid(np.arange(columns) + low[0] + 0.5, np.arange(rows) + low[1] + 0.5)
    world = T_map_world.inverse().apply(np.stack((x.ravel(), y.ravel()), axis=1) * resolution_m)
    known = ((world >= (max(x0, 0.0), max(y0, 0.0))) & (world <= (min(x1, 18.0), min(y1, 12.0)))).all(axis=1)
    low_m, high_m = boxes[:, None, :2], boxes[:, None, :2] + boxes[:, None, 2:]
    inside = ((world >= low_m) & (world <= high_m)).all(axis=2).any(axis=0)
    classes = (known * (1 + inside)).reshape(rows, columns)
    return make(classes, resolution_m, (int(low[0]), int(low[1])))


def walls_of(map_: GridMap) -> NDArray[np.float64]:
    dense = map_.dense()
    rows, columns = np.nonzero(dense.classes == OCCUPIED)
    return np.stack((columns + 0.5, rows + 0.5), axis=1) * dense.resolution_m + np.array(dense.origin_m)


def off_by(found: Transform, truth: Transform, spots: NDArray[np.float64]) -> tuple[float, float]:
    """Mean displacement of the spots in metres, and the turn between both in degrees."""
    turn = math.remainder(found.yaw_rad - truth.yaw_rad, 2 * math.pi)
    return float(np.hypot(*(found.apply(spots) - truth.apply(spots)).T).mean()), abs(math.degrees(turn))


def sure_within(metres: float, degrees: float) -> NDArray[np.float64]:
    """A covariance of x, y and yaw."""
    return np.diag([metres**2, metres**2, 0.0, 0.0, 0.0, math.radians(degrees) ** 2])


@settings(deadline=None, max_examples=15)
@given(
    st.integers(0, 20),
    angles,
    angles,
    st.sampled_from([(0.05, 0.05), (0.07, 0.1), (0.1, 0.07), (0.1, 0.1), (0.02, 0.1), (0.05, 0.2)]),
)
def test_a_known_transform_is_found_below_a_cell(
    grid_map_of: MakeMap, seed: int, a: float, b: float, resolutions_m: tuple[float, float]
) -> None:
    """Two rooms' worth of overlap, every rotation, any two resolutions."""
    boxes = floor_plan(seed)
    T_a, T_b = Transform.planar(3.0, -2.0, a), Transform.planar(-5.0, 8.0, b)
    target = drawn(grid_map_of, boxes, (-1.0, -1.0, 13.6, 13.0), T_a, resolutions_m[0])
    source = drawn(grid_map_of, boxes, (3.5, -1.0, 19.0, 13.0), T_b, resolutions_m[1])
    truth = T_a @ T_b.inverse()
    best = Correlation().match(target, source)[0]
    shift_m, turn_deg = off_by(best.T_receiver_donor, truth, walls_of(source))
    assert shift_m < 0.6 * max(resolutions_m) and turn_deg < 0.3
    assert best.margin > 0.3 * best.score
    assert best.evidence["resolution_m"] == canonical_m(*resolutions_m)


@settings(deadline=None, max_examples=8)
@given(angles, st.floats(-50, 50), st.floats(-50, 50))
def test_moving_a_map_moves_the_answer(grid_map_of: MakeMap, yaw: float, x: float, y: float) -> None:
    """Whichever of the two is seen from another frame, the answer is the same seen from there."""
    boxes, T = floor_plan(4), Transform.planar(x, y, yaw)
    one = drawn(grid_map_of, boxes, WHOLE, Transform.identity(), 0.1)
    part = drawn(grid_map_of, boxes, (2.0, -1.0, 19.0, 9.0), Transform.planar(1.0, 1.0, 0.5), 0.1)
    moved_one = drawn(grid_map_of, boxes, WHOLE, T, 0.1)
    moved_part = drawn(grid_map_of, boxes, (2.0, -1.0, 19.0, 9.0), T @ Transform.planar(1.0, 1.0, 0.5), 0.1)
    still = Correlation().match(one, part)[0].T_receiver_donor
    for target, source, want in ((moved_one, part, T @ still), (one, moved_part, still @ T.inverse())):
        found = Correlation().match(target, source)[0].T_receiver_donor
        shift_m, turn_deg = off_by(found, want, walls_of(source))
        assert shift_m < 0.06 and turn_deg < 0.3


def test_equal_inputs_give_equal_bits_and_stay_as_they_are(grid_map_of: MakeMap) -> None:
    def maps() -> tuple[GridMap, GridMap]:
        boxes = floor_plan(3)
        target = drawn(grid_map_of, boxes, WHOLE, Transform.identity(), 0.07)
        return target, drawn(grid_map_of, boxes, (2.0, 0.0, 15.0, 12.0), Transform.planar(0, 0, 2.0), 0.1)

    def bits(matches: list[Match]) -> list[tuple[str, bytes, bytes]]:
        out = []
        for match in matches:
            covariance = b"" if match.covariance is None else match.covariance.tobytes()
            out.append((repr(match.evidence), match.T_receiver_donor.matrix.tobytes(), covariance))
        return out

    one, other = maps()
    before = [m.dense().classes.copy() for m in (one, other)]
    first = bits(list(Correlation().match(one, other)))
    assert first == bits(list(Correlation().match(one, other)))  # from what is kept
    assert first == bits(list(Correlation().match(*maps())))  # and anew
    for map_, classes in zip((one, other), before, strict=True):
        assert np.array_equal(map_.dense().classes, classes)


def test_hypotheses_are_rigid_different_places_best_first(grid_map_of: MakeMap) -> None:
    boxes = floor_plan(5)
    target = drawn(grid_map_of, boxes, WHOLE, Transform.identity(), 0.1)
    source = drawn(grid_map_of, boxes, (3.0, 0.0, 14.0, 12.0), Transform.planar(0, 0, -1.0), 0.07)
    matches = Correlation(returned=6).match(target, source)
    assert 2 <= len(matches) <= 6
    assert [m.score for m in matches] == sorted((m.score for m in matches), reverse=True)
    assert matches[0].margin == matches[0].score - matches[1].score
    assert all(m.margin == m.score - matches[0].score for m in matches[1:])
    for number, match in enumerate(matches):
        T = match.T_receiver_donor
        assert np.linalg.det(T.matrix[:3, :3]) == pytest.approx(1.0)  # never a reflection
        assert match.evidence["agreement"] + match.evidence["disagreement"] == match.evidence["overlap_cells"]
        assert match.score == log_bayes_factor(prepare(target, 0.1), prepare(source, 0.1), T)
        for other in matches[:number]:
            shift_m, turn_deg = off_by(T, other.T_receiver_donor, walls_of(source))
            assert shift_m > 0.9 * OTHER_SHIFT_M or turn_deg > math.degrees(OTHER_YAW_RAD)


def test_a_symmetric_room_has_two_equally_good_hypotheses(grid_map_of: MakeMap) -> None:
    room = np.ones((60, 90), np.uint8)
    room[[0, -1]] = room[:, [0, -1]] = OCCUPIED
    first, second = Correlation().match(grid_map_of(room), grid_map_of(room))[:2]
    assert first.margin < 0.1 * first.score
    assert first.evidence["rivals"] >= 1.0
    turn = math.remainder(first.T_receiver_donor.yaw_rad - second.T_receiver_donor.yaw_rad, 2 * math.pi)
    assert abs(turn) == pytest.approx(math.pi, abs=0.02)


def test_a_corridor_tells_nothing_of_where_along_it(grid_map_of: MakeMap) -> None:
    def corridor(columns: int) -> NDArray[np.uint8]:
        classes = np.ones((24, columns), np.uint8)
        classes[[0, 1, -2, -1]] = OCCUPIED
        return classes

    best = Correlation().match(grid_map_of(corridor(160)), grid_map_of(np.rot90(corridor(110))))[0]
    assert best.covariance is not None
    assert best.evidence["sigma_max_m"] > 5.0
    assert abs(math.sin(best.evidence["degenerate_dir_rad"])) < 0.03
    assert best.covariance[5, 5] < math.radians(2.0) ** 2


@pytest.mark.parametrize("wrong", [(0.4, 0.2, 3.0), (3.0, -2.0, 20.0)])
def test_a_prior_restricts_the_search(grid_map_of: MakeMap, wrong: tuple[float, float, float]) -> None:
    """A rough guess leads to the right place, and nothing outside comes back."""
    boxes, T = floor_plan(8), Transform.planar(-4.0, 2.0, 1.0)
    target = drawn(grid_map_of, boxes, WHOLE, Transform.identity(), 0.1)
    source = drawn(grid_map_of, boxes, (3.0, 0.0, 14.0, 12.0), T, 0.07)
    spots = walls_of(source)
    middle = spots.mean(axis=0)
    beside = Transform.planar(float(middle[0]), float(middle[1]), 0.0)
    x, y, degrees = wrong
    guess = T.inverse() @ beside @ Transform.planar(x, y, math.radians(degrees)) @ beside.inverse()
    about = abs(x) / 2, degrees / 2
    matches = Correlation().match(target, source, Prior(guess, moved_to(middle, guess, *about), "a person"))
    shift_m, turn_deg = off_by(matches[0].T_receiver_donor, T.inverse(), spots)
    assert shift_m < 0.06 and turn_deg < 0.3
    for match in matches:
        shift_m, turn_deg = off_by(match.T_receiver_donor, guess, middle[None])
        assert shift_m <= math.hypot(3.5 * about[0], 0.3) + 0.5 and turn_deg <= 3.5 * about[1] + 1.5
    elsewhere = Prior(guess @ Transform.planar(0.0, 0.0, math.pi), sure_within(0.01, 0.01), "wrong")
    for match in Correlation().match(target, source, elsewhere):
        assert off_by(match.T_receiver_donor, T.inverse(), spots)[1] > 90.0


def moved_to(place: NDArray[np.float64], T: Transform, metres: float, degrees: float) -> NDArray[np.float64]:
    """The covariance of a transform that is sure within so much at that place of the source."""
    arm = T.apply(place[None])[0] - (T.x_m, T.y_m)
    moves = np.eye(6)
    moves[0, 5], moves[1, 5] = arm[1], -arm[0]
    out: NDArray[np.float64] = moves @ sure_within(metres, degrees) @ moves.T
    return out


def test_a_weak_place_within_a_wide_prior_is_found_among_stronger_ones_outside(grid_map_of: MakeMap) -> None:
    """Walls of which the target holds 35 whole copies, and a ruin where the prior says."""
    random = np.random.default_rng(2)
    room = np.zeros((50, 60), np.uint8)
    room[[0, -1]] = room[:, [0, -1]] = OCCUPIED
    for row, column, height, width in random.integers((2, 2, 2, 2), (40, 50, 9, 9), (9, 4)):
        room[row : row + height, column : column + width] = OCCUPIED
    ruin = room.copy()
    ruin[:, 24:] = 0
    target = np.zeros((6 * 64, 6 * 74), np.uint8)
    for row, column in np.ndindex(6, 6):
        y, x = 64 * row + 7, 74 * column + 7
        target[y : y + 50, x : x + 60] = ruin if (row, column) == (2, 1) else room
    T = Transform.planar(7.4 + 0.7, 2 * 6.4 + 0.7, 0.0)  # where the ruin's lower-left corner is
    middle = np.array([3.0, 2.5])
    prior = Prior(T, moved_to(middle, T, 0.8, 40.0), "a person")
    best = Correlation().match(grid_map_of(target), grid_map_of(room), prior)[0]
    shift_m, turn_deg = off_by(best.T_receiver_donor, T, middle[None])
    assert shift_m < 0.1 and turn_deg < 0.5


def test_rotations_outside_a_wide_prior_do_not_come_back(grid_map_of: MakeMap) -> None:
    """The right place is half a turn off: what comes back is worse, and within the prior."""
    classes = drawn(grid_map_of, floor_plan(6), WHOLE, Transform.identity(), 0.1).dense().classes
    floor = grid_map_of(np.where(classes == OCCUPIED, OCCUPIED, 0))
    middle = walls_of(floor).mean(axis=0)
    beside = Transform.planar(float(middle[0]), float(middle[1]), 0.0)
    guess = beside @ Transform.planar(0.0, 0.0, math.pi) @ beside.inverse()
    found = Correlation().match(floor, floor, Prior(guess, moved_to(middle, guess, 1.5, 12.0), "a person"))
    assert found
    for match in found:
        shift_m, turn_deg = off_by(match.T_receiver_donor, guess, middle[None])
        assert turn_deg <= 3.5 * 12.0 + 1.5 and shift_m <= math.hypot(3.5 * 1.5, 0.3) + 0.5
        assert match.score < 0.7 * Correlation().match(floor, floor)[0].score


def test_a_match_is_a_prior_that_finds_itself(grid_map_of: MakeMap) -> None:
    boxes = floor_plan(9)
    target = drawn(grid_map_of, boxes, WHOLE, Transform.identity(), 0.07)
    source = drawn(grid_map_of, boxes, (3.0, 0.0, 14.0, 12.0), Transform.planar(7.0, 2.0, 1.0), 0.1)
    best = Correlation().match(target, source)[0]
    assert best.covariance is not None
    again = Correlation().match(target, source, Prior(best.T_receiver_donor, best.covariance, "the match"))[0]
    shift_m, turn_deg = off_by(again.T_receiver_donor, best.T_receiver_donor, walls_of(source))
    assert shift_m < 0.02 and turn_deg < 0.1
    assert again.score == pytest.approx(best.score, rel=0.02)


def test_priors_that_are_none_are_refused(grid_map_of: MakeMap) -> None:
    room = drawn(grid_map_of, floor_plan(0), WHOLE, Transform.identity(), 0.1)
    for covariance in (np.eye(3), np.full((6, 6), np.nan), -np.eye(6)):
        with pytest.raises(MapError, match="finite \\(6, 6\\) covariance"):
            Correlation().match(room, room, Prior(Transform.identity(), covariance, "nobody"))


def test_maps_without_walls_and_other_types_are_refused(grid_map_of: MakeMap) -> None:
    room, free = grid_map_of(np.full((20, 30), 2)), grid_map_of(np.ones((5, 5), int))
    for target, source, side in ((free, room, "target"), (room, free, "source")):
        with pytest.raises(EmptyMapError, match=f"the {side} map has no occupied cell"):
            Correlation().match(target, source)
    with pytest.raises(EmptyMapError):
        Correlation().match(room, OccupancyGrid().view(None))
    with pytest.raises(MapError, match="'cairns'"):
        Correlation().match(room, Strange())
    with pytest.raises(ConfigError, match="found 1"):
        Correlation(returned=1)


def test_walls_alone_and_single_cells_give_hypotheses(grid_map_of: MakeMap) -> None:
    """No free cell, or one wall cell: weak evidence is for the acceptor to judge."""
    walls = np.zeros((40, 60), np.uint8)
    walls[0], walls[:, 0] = OCCUPIED, OCCUPIED
    assert len(Correlation().match(grid_map_of(walls), grid_map_of(walls))) >= 2
    dot = np.ones((5, 5), np.uint8)
    dot[2, 2] = OCCUPIED
    assert Correlation().match(grid_map_of(walls), grid_map_of(dot))
    assert Correlation().match(grid_map_of(dot), grid_map_of(walls))

"""What counts as a landmark in a scan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from mapgraft_landmarks.cells import keys_at
from mapgraft_landmarks.extraction import Extraction, cells_looked_at, landmarks_in

from mapgraft.contracts import Scan, Transform

Look = Callable[..., Scan]

AS_SHIPPED = Extraction(width_m=0.6, clear_m=0.5, range_m=8.0, beams_min=2)
NO_WALLS: list[tuple[float, float, float, float]] = []
ROOM = [(-6.0, -6.0, 6.0, -6.0), (6.0, -6.0, 6.0, 6.0), (6.0, 6.0, -6.0, 6.0), (-6.0, 6.0, -6.0, -6.0)]
HERE = Transform.identity()


def trunk(x: float, y: float, radius: float = 0.15) -> np.ndarray:
    return np.array([[x, y, radius]])


@pytest.mark.parametrize("bearing", np.linspace(-np.pi, np.pi, 9))
def test_a_trunk_is_found_where_it_stands(look: Look, bearing: float) -> None:
    x, y = 3.0 * np.cos(bearing), 3.0 * np.sin(bearing)  # ± pi: across the seam of the scan
    found = landmarks_in(look(trunk(x, y), ROOM, (0.0, 0.0, 0.0)), HERE, AS_SHIPPED)
    assert found == pytest.approx(np.array([[x, y]]), abs=0.05)


def test_walls_and_corners_are_no_landmarks(look: Look) -> None:
    assert landmarks_in(look(np.empty((0, 3)), ROOM, (1.0, 2.0, 0.3)), HERE, AS_SHIPPED).shape == (0, 2)


def test_a_trunk_before_a_wall_is_no_landmark(look: Look) -> None:
    assert len(landmarks_in(look(trunk(5.7, 0.0), ROOM, (0.0, 0.0, 0.0)), HERE, AS_SHIPPED)) == 0


def test_something_wide_is_no_landmark(look: Look) -> None:
    assert len(landmarks_in(look(trunk(3.0, 0.0, radius=0.5), ROOM, (0.0, 0.0, 0.0)), HERE, AS_SHIPPED)) == 0


def test_an_empty_horizon_is_behind_a_trunk(look: Look) -> None:
    found = landmarks_in(look(trunk(2.0, 1.0), NO_WALLS, (0.0, 0.0, 0.0)), HERE, AS_SHIPPED)
    assert found == pytest.approx(np.array([[2.0, 1.0]]), abs=0.03)


def test_a_lost_beam_beside_a_trunk_leaves_it_undecided(look: Look) -> None:
    scan = look(trunk(3.0, 0.0), ROOM, (0.0, 0.0, 0.0))
    on_trunk = np.flatnonzero(scan.ranges_m < 3.5)
    ranges = scan.ranges_m.copy()
    ranges[on_trunk[-1] + 1] = np.nan
    assert len(landmarks_in(replace(scan, ranges_m=ranges), HERE, AS_SHIPPED)) == 0


def test_a_trunk_at_the_rim_of_an_open_scan_is_undecided(look: Look) -> None:
    scan = look(trunk(3.0, 0.0), ROOM, (0.0, 0.0, 0.0))
    first = int(np.flatnonzero(scan.ranges_m < 3.5)[0])
    cut = Scan(scan.directions[first:], scan.ranges_m[first:], scan.hits[first:])
    assert len(landmarks_in(cut, HERE, AS_SHIPPED)) == 0
    cut = Scan(scan.directions[first - 1 :], scan.ranges_m[first - 1 :], scan.hits[first - 1 :])
    assert len(landmarks_in(cut, HERE, AS_SHIPPED)) == 1


def test_the_order_of_the_beams_does_not_matter(look: Look) -> None:
    scan = look(np.array([[3.0, 1.0, 0.1], [-2.0, 2.0, 0.2]]), ROOM, (0.2, 0.0, 0.0))
    order = np.random.default_rng(3).permutation(len(scan.ranges_m))
    shuffled = Scan(scan.directions[order], scan.ranges_m[order], scan.hits[order])
    assert (landmarks_in(shuffled, HERE, AS_SHIPPED) == landmarks_in(scan, HERE, AS_SHIPPED)).all()


def test_an_upside_down_lidar_sees_the_same(look: Look) -> None:
    scan = look(np.array([[3.0, 1.0, 0.1]]), ROOM, (0.0, 0.0, 0.0))
    mirrored = Scan(scan.directions * [1.0, -1.0], scan.ranges_m, scan.hits)
    hanging = Transform.from_matrix(np.diag([1.0, -1.0, -1.0, 1.0]))
    assert landmarks_in(mirrored, hanging, AS_SHIPPED) == pytest.approx(landmarks_in(scan, HERE, AS_SHIPPED))


def test_landmarks_come_in_the_map_frame(look: Look) -> None:
    T_map_sensor = Transform.planar(10.0, -4.0, 2.0)
    scan = look(trunk(2.0, 1.0), ROOM, (0.0, 0.0, 0.0))
    expected = T_map_sensor.apply(landmarks_in(scan, HERE, AS_SHIPPED))
    assert landmarks_in(scan, T_map_sensor, AS_SHIPPED) == pytest.approx(expected)


def test_a_look_ends_before_what_it_sees(look: Look) -> None:
    looked = cells_looked_at(look(trunk(3.0, 0.0, radius=0.5), ROOM, (0.0, 0.0, 0.0)), HERE, AS_SHIPPED, 0.25)
    inside = keys_at(np.array([[1.9, 0.1], [-5.1, 0.1], [3.1, 2.1]]), 0.25)
    beyond = keys_at(np.array([[2.3, 0.1], [5.1, 0.1], [-5.9, 0.1], [7.0, 0.0]]), 0.25)
    assert np.isin(inside, looked).all()
    assert not np.isin(beyond, looked).any()
    assert (np.diff(looked) > 0).all()

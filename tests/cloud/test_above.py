"""A cloud as people see it: from above, walls apart from floors and ceilings."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
import pytest

from mapgraft.contracts import Observation, OutputMessage
from mapgraft_cloud import above
from mapgraft_cloud.cloud_map import CloudMap
from mapgraft_cloud.map_type import PointCloud

Observe = Callable[..., Observation]


def room() -> np.ndarray:
    """Floor and ceiling of 10 × 8 m, 2.5 m apart, and one wall across at x = 5 m."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(0.05, 10, 0.1), np.arange(0.05, 8, 0.1)))
    level = [np.stack((x, y, np.full(x.shape, z)), axis=1) for z in (0.02, 2.52)]
    y, z = (axis.ravel() for axis in np.meshgrid(np.arange(1.05, 7.0, 0.05), np.arange(0.35, 2.4, 0.05)))
    return np.vstack((*level, np.stack((np.full(y.shape, 5.05), y, z), axis=1)))


def seen(observe: Observe, points: np.ndarray, **how: Any) -> CloudMap:
    kind = PointCloud()
    layer = kind.new_layer()
    kind.integrate(layer, observe(points, **how))
    return kind.view(layer)


def cells_of(message: OutputMessage) -> tuple[np.ndarray, float, tuple[float, float]]:
    info = cast("dict[str, Any]", message.fields["info"])
    cells = np.asarray(message.fields["data"]).reshape(info["height"], info["width"])
    position = info["origin"]["position"]
    return cells, info["resolution"], (position["x"], position["y"])


def test_of_a_storey_walls_show_and_floor_and_ceiling_do_not(observe: Observe) -> None:
    map_ = seen(observe, room(), ready=True, seen_from=None)
    cells, cell_m, (x_m, y_m) = cells_of(above.seen_from_above(map_))
    assert (cell_m, x_m, y_m) == (pytest.approx(0.1), pytest.approx(0.0), pytest.approx(0.0))
    assert cells.shape == (80, 100)
    rows, columns = np.nonzero(cells == above.WALL)
    assert set(columns.tolist()) <= {49, 50, 51}
    assert (rows.min(), rows.max()) == (pytest.approx(10, abs=2), pytest.approx(69, abs=2))
    assert not (cells == above.FREE).any()  # a ready-made cloud tells of nothing free


def test_what_was_looked_through_is_free_where_no_wall_stands(observe: Observe) -> None:
    map_ = seen(observe, room() - (2.0, 4.0, 1.0), seen_from=(0.0, 0.0, 0.0))
    cells, cell_m, (x_m, _) = cells_of(above.seen_from_above(map_))
    assert (cells == above.FREE).sum() * cell_m**2 > 30.0
    rows, columns = np.nonzero(cells == above.WALL)
    assert len(rows) > 50
    assert np.abs(x_m + (columns + 0.5) * cell_m - 3.05).max() < 0.2


@pytest.mark.parametrize("most", [40, 400, 8_000])
def test_large_maps_are_shown_in_larger_cells_that_lose_no_wall(
    observe: Observe, monkeypatch: pytest.MonkeyPatch, most: int
) -> None:
    map_ = seen(observe, room() - 3.0, ready=True, seen_from=None)
    fine, fine_m, fine_at = cells_of(above.seen_from_above(map_))
    monkeypatch.setattr(above, "MOST_CELLS", most)
    cells, cell_m, at = cells_of(above.seen_from_above(map_))
    assert cells.size <= most
    assert cell_m / fine_m == pytest.approx(round(cell_m / fine_m))
    for row, column in np.argwhere(fine == above.WALL).tolist():
        x_m, y_m = fine_at[0] + (column + 0.5) * fine_m, fine_at[1] + (row + 0.5) * fine_m
        assert cells[int((y_m - at[1]) // cell_m), int((x_m - at[0]) // cell_m)] == above.WALL


def test_viewers_get_the_points_and_the_view_from_above(observe: Observe) -> None:
    kind = PointCloud()
    layer = kind.new_layer()
    assert list(kind.messages(kind.view(layer))) == []
    kind.integrate(layer, observe([(1.0, 2.0, 0.5), (1.0, 2.0, 1.0)]))
    told = {message.suffix: message.message_type for message in kind.messages(kind.view(layer))}
    assert told == {"cloud": "sensor_msgs/msg/PointCloud2", "cloud_above": "nav_msgs/msg/OccupancyGrid"}

"""Maps as a viewer sees them: messages as cells seen from above."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Cells = NDArray[np.uint8]  # (h, w) of UNKNOWN, FREE, OCCUPIED; row 0 at the smallest y

UNKNOWN, FREE, OCCUPIED = range(3)
FREE_TO, OCCUPIED_FROM = 35, 65  # percent: what lies between says nothing
_POINTS_ACROSS: Final = 400  # cells along the longer side of what has no cells of its own
_DATATYPES: Final = {7: "f4", 8: "f8"}  # of sensor_msgs/PointField
_ADD, _DELETE, _DELETE_ALL = 0, 2, 3  # actions of visualization_msgs/Marker
_LINE_STRIP, _LINE_LIST, _CUBE_LIST = 4, 5, 6  # types of visualization_msgs/Marker
_FREE_SPACE: Final = "free"  # the namespace of markers that show what is free, as the contract has it
_MOST_POINTS: Final = 4_000_000  # of one list of cubes
_CELLS_AT_ONCE: Final = 1_000_000
_LARGEST: Final = 6000  # cells along a side that are looked at one by one


@dataclass(frozen=True, slots=True, eq=False)
class Raster:
    """Cells of ``cell_m`` whose lower-left corner is (``x_m``, ``y_m``) in the map's frame."""

    cells: Cells
    x_m: float
    y_m: float
    cell_m: float

    @property
    def bounds_m(self) -> tuple[float, float, float, float]:
        """x_min, y_min, x_max, y_max."""
        h, w = self.cells.shape
        return self.x_m, self.y_m, self.x_m + w * self.cell_m, self.y_m + h * self.cell_m

    def trimmed(self) -> Raster | None:
        """Without the unknown around; None when nothing is known."""
        rows, columns = (np.flatnonzero(self.cells.any(axis=axis)) for axis in (1, 0))
        if not len(rows):
            return None
        (r0, r1), (c0, c1) = (rows[0], rows[-1] + 1), (columns[0], columns[-1] + 1)
        x_m, y_m = self.x_m + c0 * self.cell_m, self.y_m + r0 * self.cell_m
        return Raster(self.cells[r0:r1, c0:c1], float(x_m), float(y_m), self.cell_m)


@dataclass(frozen=True, slots=True)
class Canvas:
    """A rectangle of square cells in one frame, on which several maps are drawn."""

    x_m: float
    y_m: float
    cell_m: float
    rows: int
    columns: int

    @classmethod
    def around(cls, *rasters: Raster | None, edge: float = 0.03) -> Canvas | None:
        """Around all that are there, in the cells of the first one and on its lattice, with a share of ``edge``."""
        given = [raster for raster in rasters if raster is not None]
        if not given:
            return None
        x0, y0, x1, y1 = (np.array([raster.bounds_m for raster in given])[:, side] for side in range(4))
        low, high = np.array([x0.min(), y0.min()]), np.array([x1.max(), y1.max()])
        first, cell_m = given[0], given[0].cell_m
        extent = float((high - low).max())
        cell_m *= max(1, math.ceil(extent / cell_m / _LARGEST))
        corner = np.array([first.x_m, first.y_m])
        before = np.ceil((corner - low + edge * extent) / cell_m - 1e-6)
        after = np.ceil((high - corner + edge * extent) / cell_m - 1e-6)
        x_m, y_m = (corner - before * cell_m).tolist()
        columns, rows = (before + after).astype(int).tolist()
        return cls(x_m, y_m, cell_m, rows, columns)

    def cells_of(self, raster: Raster | None) -> Cells:
        """What a map says in every cell of the canvas: where several of its cells fall into one, the wall shows."""
        out = np.zeros((self.rows, self.columns), np.uint8)
        if raster is None:
            return out
        if raster.cell_m >= self.cell_m * (1.0 - 1e-6):
            rows, inside_y = _looked_up(self.y_m, self.cell_m, self.rows, raster.y_m, raster.cell_m, len(raster.cells))
            columns, inside_x = _looked_up(
                self.x_m, self.cell_m, self.columns, raster.x_m, raster.cell_m, raster.cells.shape[1]
            )
            if len(rows) and len(columns):
                whole = (slice(inside_y[0], inside_y[-1] + 1), slice(inside_x[0], inside_x[-1] + 1))
                out[whole] = raster.cells[rows][:, columns]
            return out
        step = max(1, _CELLS_AT_ONCE // raster.cells.shape[1])
        for top in range(0, len(raster.cells), step):  # where each cell goes takes a hundred times its memory
            self._add(out, raster, top, raster.cells[top : top + step])
        return out

    def _add(self, out: Cells, raster: Raster, top: int, cells: Cells) -> None:
        """Draw some rows of a map, those from ``top`` on, whose cells are smaller than the canvas'."""
        at_row, at_column = np.nonzero(cells)
        rows = np.floor((raster.y_m + (top + at_row + 0.5) * raster.cell_m - self.y_m) / self.cell_m).astype(np.intp)
        columns = np.floor((raster.x_m + (at_column + 0.5) * raster.cell_m - self.x_m) / self.cell_m).astype(np.intp)
        inside = (rows >= 0) & (rows < self.rows) & (columns >= 0) & (columns < self.columns)
        np.maximum.at(out, (rows[inside], columns[inside]), cells[at_row[inside], at_column[inside]])


def raster_of(message_type: str, message: Any) -> Raster | None:
    """A decoded message from above; None when there is nothing to see, or no picture of such a message."""
    make = _MAKERS.get(message_type)
    return make(message) if make else None


def drawable_of(message_types: Iterable[str]) -> str | None:
    """Of the types of the messages that show one map, that which says most of how it looks from above; None where
    there is a picture of none."""
    given = set(message_types)
    return next((message_type for message_type in _MAKERS if message_type in given), None)


def _looked_up(
    from_m: float, cell_m: float, n: int, raster_m: float, raster_cell_m: float, raster_n: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Along one axis: the raster's index for each of the canvas' cells that it covers, and these cells' indices."""
    centres = from_m + (np.arange(n) + 0.5) * cell_m
    index = np.floor((centres - raster_m) / raster_cell_m).astype(np.intp)
    inside = np.flatnonzero((index >= 0) & (index < raster_n))
    return index[inside], inside


def _grid(message: Any) -> Raster | None:
    info, origin = message.info, message.info.origin
    data = np.asarray(message.data, np.int8)
    if not data.size or data.size != info.width * info.height or not info.resolution > 0.0:
        return None
    values = data.reshape(info.height, info.width)
    cells = np.zeros(values.shape, np.uint8)
    cells[(values >= 0) & (values <= FREE_TO)] = FREE
    cells[values >= OCCUPIED_FROM] = OCCUPIED
    cell_m = float(f"{info.resolution:.6g}")  # float32 0.05 is 0.0500000007
    raster = Raster(cells, origin.position.x, origin.position.y, cell_m)
    q = origin.orientation
    yaw_rad = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    upright = raster if abs(yaw_rad) < 1e-9 else _turned(raster, yaw_rad)
    return upright.trimmed()


def _turned(raster: Raster, yaw_rad: float) -> Raster:
    """A grid that lies askew about its corner, on upright cells of the same size."""
    h, w = raster.cells.shape
    c, s, cell_m = math.cos(yaw_rad), math.sin(yaw_rad), raster.cell_m
    R = np.array([[c, -s], [s, c]])
    corners = np.array([[0, 0], [w, 0], [0, h], [w, h]]) * cell_m @ R.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    columns, rows = np.ceil((high - low) / cell_m).astype(int).tolist()
    y, x = np.mgrid[0:rows, 0:columns]
    points = np.stack((x.ravel() + 0.5, y.ravel() + 0.5), axis=1) * cell_m + low
    at = np.floor(points @ R / cell_m).astype(np.intp)  # R turns back from the right
    inside = (at >= 0).all(axis=1) & (at[:, 0] < w) & (at[:, 1] < h)
    out = np.zeros(rows * columns, np.uint8)
    out[inside] = raster.cells[at[inside, 1], at[inside, 0]]
    return Raster(out.reshape(rows, columns), raster.x_m + float(low[0]), raster.y_m + float(low[1]), cell_m)


def _cloud(message: Any) -> Raster | None:
    fields = {field.name: (field.offset, field.datatype) for field in message.fields}
    if not all(axis in fields and fields[axis][1] in _DATATYPES for axis in "xy"):
        return None
    count = int(message.width) * int(message.height)
    data = np.asarray(message.data, np.uint8)
    if not count or len(data) < count * message.point_step:
        return None
    order = ">" if message.is_bigendian else "<"
    points = data[: count * message.point_step].reshape(count, message.point_step)
    axes = []
    for axis in "xy":
        offset, datatype = fields[axis]
        kind = np.dtype(order + _DATATYPES[datatype])
        if offset + kind.itemsize > message.point_step:
            return None
        raw = np.ascontiguousarray(points[:, offset : offset + kind.itemsize])
        axes.append(raw.view(kind).ravel().astype(np.float64))
    where = np.stack(axes, axis=1)
    where = where[np.isfinite(where).all(axis=1)]
    return _painted([(where, OCCUPIED)])


def _markers(message: Any) -> Raster | None:
    """Lines as they run, cubes as large as they are: walls, except in the namespace of free space."""
    shown: dict[tuple[str, int], Any] = {}
    for marker in message.markers:
        if marker.action == _DELETE_ALL:
            shown.clear()
        elif marker.action == _DELETE:
            shown.pop((marker.ns, marker.id), None)
        elif marker.action == _ADD:
            shown[marker.ns, marker.id] = marker
    coarse = _painted([(_placed(marker, _own(marker)), OCCUPIED) for marker in shown.values()])
    return None if coarse is None else _painted([_drawn(marker, coarse.cell_m) for marker in shown.values()])


def _drawn(marker: Any, cell_m: float) -> tuple[NDArray[np.float64], int]:
    """Points (n, 2) of one marker in the map's frame, so close that no cell is missed, and what they are."""
    own, kind = _own(marker), FREE if marker.ns == _FREE_SPACE else OCCUPIED
    if marker.type == _LINE_STRIP:
        own = np.stack((own[:-1], own[1:]), axis=1).reshape(-1, 2)
    if marker.type in (_LINE_STRIP, _LINE_LIST):
        return _placed(marker, _along(own, cell_m)), kind
    if marker.type != _CUBE_LIST:
        return _placed(marker, own), kind
    return _placed(marker, _filled(own, (marker.scale.x, marker.scale.y), cell_m)), kind


def _own(marker: Any) -> NDArray[np.float64]:
    """The points (n, 2) of a marker in its own frame; a marker without points is one."""
    return np.array([(point.x, point.y) for point in marker.points] or [(0.0, 0.0)], np.float64)


def _placed(marker: Any, own_m: NDArray[np.float64]) -> NDArray[np.float64]:
    at, q = marker.pose.position, marker.pose.orientation
    yaw_rad = math.atan2(2.0 * (q.w * q.z + q.x * q.y), q.w * q.w + q.x * q.x - q.y * q.y - q.z * q.z)
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    placed: NDArray[np.float64] = own_m @ np.array([[c, s], [-s, c]]) + (at.x, at.y)
    return placed


def _along(ends_m: NDArray[np.float64], cell_m: float) -> NDArray[np.float64]:
    """Points (n, 2) along lines, given by their ends two by two, so close that no cell is missed."""
    lines = ends_m[: len(ends_m) // 2 * 2].reshape(-1, 2, 2)
    lines = lines[np.isfinite(lines).all(axis=(1, 2))]
    way = lines[:, 1] - lines[:, 0]
    counts = np.ceil(np.abs(way).max(axis=1, initial=0.0) / cell_m * 2.0).astype(np.intp) + 1
    which = np.repeat(np.arange(len(lines)), counts)
    step = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = step / np.maximum(counts - 1, 1)[which]
    out: NDArray[np.float64] = lines[which, 0] + way[which] * share[:, None]
    return out


def _filled(middles_m: NDArray[np.float64], size_m: tuple[float, float], cell_m: float) -> NDArray[np.float64]:
    """Points (n, 2) all over boxes of one size, so close that no cell is missed, unless there were millions."""
    most = math.isqrt(_MOST_POINTS // max(1, len(middles_m)))
    counts = [max(1, min(most, math.ceil(side / cell_m * 2.0))) for side in size_m]
    x, y = ((np.arange(n) + 0.5) / n * side - side / 2 for n, side in zip(counts, size_m, strict=True))
    inside = np.stack(np.meshgrid(x, y), axis=-1).reshape(1, -1, 2)
    return (middles_m[:, None] + inside).reshape(-1, 2)


def _painted(parts: Sequence[tuple[NDArray[np.float64], int]]) -> Raster | None:
    """Points (n, 2) as cells of what they are; where several fall into one cell, a wall shows."""
    points_m = np.concatenate([points for points, _ in parts]) if parts else np.empty((0, 2))
    kinds = np.repeat(np.array([kind for _, kind in parts], np.uint8), [len(points) for points, _ in parts])
    finite = np.isfinite(points_m).all(axis=1)
    points_m, kinds = points_m[finite], kinds[finite]
    if not len(points_m):
        return None
    low, high = points_m.min(axis=0), points_m.max(axis=0)
    cell_m = max(float((high - low).max()), 1.0) / _POINTS_ACROSS
    at = np.floor((points_m - low) / cell_m).astype(np.intp)
    cells = np.zeros((int(at[:, 1].max()) + 1, int(at[:, 0].max()) + 1), np.uint8)
    np.maximum.at(cells, (at[:, 1], at[:, 0]), kinds)
    return Raster(cells, float(low[0]), float(low[1]), cell_m)


_MAKERS: Final[Mapping[str, Callable[[Any], Raster | None]]] = {  # that which says most first
    "nav_msgs/msg/OccupancyGrid": _grid,
    "visualization_msgs/msg/MarkerArray": _markers,
    "sensor_msgs/msg/PointCloud2": _cloud,
}

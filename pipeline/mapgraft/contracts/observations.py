"""What a robot observes: one scan, cloud or ready-made map, with its stamp and pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts.geometry import Points, Transform

SCAN = "scan"
GRID_MESSAGE = "grid_message"
CLOUD = "cloud"
CLOUD_MAP = "cloud_map"


class Rays(NamedTuple):
    """The beams of one scan in the map's plane, invalid beams left out.

    ``origins_m`` is (1, 2) when all beams start at one place, else (n, 2); ``ends_m`` (n, 2); both float64 in the map
    frame. ``hits`` (n,) bool: True where the beam ended on something, False where it is free up to its end.
    """

    origins_m: Points
    ends_m: Points
    hits: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One planar sweep in the sensor frame, its beams in the order in which the message has them (a circle may close).

    ``directions`` (n, 2) float64 unit vectors, shared between scans of one geometry; ``ranges_m`` (n,) float32, NaN
    where the beam says nothing (too close, NaN, filtered); ``hits`` (n,) bool, False where the beam saw nothing up to
    its range (no return). ``T_sensor_beam`` (n, 3) float64 x, y, yaw of the sensor when the beam was fired, seen from
    the sensor at the scan's stamp; None when the sensor stood still or the beams have no times of their own.
    """

    directions: NDArray[np.float64]
    ranges_m: NDArray[np.float32]
    hits: NDArray[np.bool_]
    T_sensor_beam: NDArray[np.float64] | None = None

    def rays(self, T_map_sensor: Transform) -> Rays:
        """The valid beams as seen in the map's plane (z dropped), so that tilted and upside-down sensors are right."""
        valid = ~np.isnan(self.ranges_m)
        ends = self.directions[valid] * self.ranges_m[valid, None].astype(np.float64)
        matrix = T_map_sensor.matrix
        if self.T_sensor_beam is None:
            return Rays(matrix[None, :2, 3], ends @ matrix[:2, :2].T + matrix[:2, 3], self.hits[valid])
        x, y, yaw = self.T_sensor_beam[valid].T
        c, s = np.cos(yaw), np.sin(yaw)
        turned = np.stack((c * ends[:, 0] - s * ends[:, 1] + x, s * ends[:, 0] + c * ends[:, 1] + y), axis=1)
        starts = np.stack((x, y), axis=1)
        T = matrix[:2, :2].T
        return Rays(starts @ T + matrix[:2, 3], turned @ T + matrix[:2, 3], self.hits[valid])


@runtime_checkable
class Pictured(Protocol):
    """A payload that was read from an image, or could be: where its pixels lie in the map frame.

    ``shape_px`` is height and width, None where there is no image after all; ``resolution_m`` the side of a pixel;
    ``T_map_origin`` the pose of the outer corner of the lower-left pixel.
    """

    @property
    def shape_px(self) -> tuple[int, int] | None: ...
    @property
    def resolution_m(self) -> float: ...
    @property
    def T_map_origin(self) -> Transform: ...


@dataclass(frozen=True, slots=True, eq=False)
class GridMessage:
    """A ready-made occupancy grid, as ``nav_msgs/OccupancyGrid`` defines it.

    ``cells`` (height, width) int8, row 0 at the bottom (smallest y): -1 unknown, 0 free … 100 occupied.
    ``T_map_origin`` is the pose of the outer corner of cell (0, 0) in the map frame.
    """

    cells: NDArray[np.int8]
    resolution_m: float
    T_map_origin: Transform

    @property
    def shape_px(self) -> tuple[int, int]:
        height, width = self.cells.shape
        return height, width


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """Points in three dimensions in the sensor frame: one sweep of a lidar or camera, or a ready-made map of points.

    ``points_m`` (n, 3) float32, finite. ``origin_m`` is where the sweep was seen from, so that what lies between it and
    a point is free; None where nobody knows. ``dropped`` counts points that were left out because they are no returns.
    """

    points_m: NDArray[np.float32]
    origin_m: tuple[float, float, float] | None = (0.0, 0.0, 0.0)
    dropped: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """One payload of one robot, placed in the robot's own map frame.

    ``stamp_ns`` is the time on the mission's timeline, ``recorded_ns`` the stamp as recorded; they differ when robots
    recorded one after another are shifted to a common start. ``kind`` names the payload: ``scan`` (Scan),
    ``grid_message`` (GridMessage), ``cloud`` (Cloud, one sweep), ``cloud_map`` (Cloud, a ready-made map of
    points), or whatever a plugin's decoder gives. ``T_map_sensor`` places the payload;
    ``T_map_base`` is where the robot's body was, for its path.
    """

    robot: str
    stamp_ns: int
    recorded_ns: int
    sensor: str
    kind: str
    payload: object
    T_map_sensor: Transform
    T_map_base: Transform

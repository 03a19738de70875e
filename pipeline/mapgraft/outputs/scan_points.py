"""A scan as points for viewers: where its beams ended on something."""

from __future__ import annotations

import numpy as np

from mapgraft.contracts import Observation, Scan

POINTS_TYPE = "sensor_msgs/msg/PointCloud2"
_FLOAT32 = 7
_FIELDS = [{"name": axis, "offset": 4 * i, "datatype": _FLOAT32, "count": 1} for i, axis in enumerate("xyz")]


def scan_points(observation: Observation) -> dict[str, object] | None:
    """The fields of a PointCloud2 in the robot's map frame (x, y in metres, z = 0); None when it is no planar scan."""
    if not isinstance(observation.payload, Scan):
        return None
    rays = observation.payload.rays(observation.T_map_sensor)
    points = np.zeros((int(rays.hits.sum()), 3), dtype="<f4")
    points[:, :2] = rays.ends_m[rays.hits]
    return {
        "height": 1,
        "width": len(points),
        "fields": _FIELDS,
        "is_bigendian": False,
        "point_step": 12,
        "row_step": 12 * len(points),
        "data": points.view(np.uint8).reshape(-1),
        "is_dense": True,
    }

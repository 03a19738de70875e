"""Drives with a spinning lidar as ROS 2 messages: ``PointCloud2`` as drivers write it, tf and static tf."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mapgraft.contracts import Transform
from mapgraft_recordings.buildings.spatial import SpatialDrive, Sweep
from mapgraft_recordings.simulator.messages import Message

_FLOAT32, _UINT16 = 7, 4  # sensor_msgs/PointField
_POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("padding", "<u2")])
_OFFSETS = {"x": 0, "y": 4, "z": 8, "intensity": 12, "ring": 16}
_FIELDS = [
    {"name": name, "offset": offset, "datatype": _UINT16 if name == "ring" else _FLOAT32, "count": 1}
    for name, offset in _OFFSETS.items()
]


def cloud_messages(made: SpatialDrive, robot: str, T_map_building: Transform | None = None) -> Iterator[Message]:
    """The drive of one robot: ``/tf_static``, then for every sweep a ``/tf`` (map → base_link) and its points.

    Points come organised, rows being rings, with NaN where nothing came back. Frames have the robot's name before them;
    the robot's map lies in the building by ``T_map_building``.
    """
    to_map = T_map_building or Transform.identity()
    first_ns = made.sweeps[0].stamp_ns
    mount = _transform(first_ns, f"{robot}/base_link", f"{robot}/lidar", made.lidar.T_base_sensor)
    yield Message("/tf_static", "tf2_msgs/msg/TFMessage", first_ns, {"transforms": [mount]})
    for sweep, pose in zip(made.sweeps, made.believed.tolist(), strict=True):
        T_map_base = to_map @ Transform.planar(*pose)
        moved = _transform(sweep.stamp_ns, f"{robot}/map", f"{robot}/base_link", T_map_base)
        yield Message("/tf", "tf2_msgs/msg/TFMessage", sweep.stamp_ns, {"transforms": [moved]})
        yield _points(robot, sweep)


def first_place(made: SpatialDrive) -> Transform:
    """``T_map_building`` of a map that begins where the drive does, as SLAM's does."""
    x, y, yaw = made.believed[0].tolist()
    return Transform.planar(x, y, yaw).inverse()


def _points(robot: str, sweep: Sweep) -> Message:
    rings, columns = sweep.points_m.shape[:2]
    table = np.zeros((rings, columns), _POINT)
    for axis, name in enumerate("xyz"):
        table[name] = sweep.points_m[:, :, axis]
    away = np.linalg.norm(sweep.points_m, axis=2)
    table["intensity"] = np.nan_to_num(np.round(100.0 / (1.0 + away), 1))
    table["ring"] = np.arange(rings)[:, None]
    fields = {
        "header": {"stamp": _time(sweep.stamp_ns), "frame_id": f"{robot}/lidar"},
        "height": rings,
        "width": columns,
        "fields": _FIELDS,
        "is_bigendian": False,
        "point_step": _POINT.itemsize,
        "row_step": _POINT.itemsize * columns,
        "data": table.reshape(-1).view(np.uint8),
        "is_dense": False,
    }
    return Message(f"/{robot}/points", "sensor_msgs/msg/PointCloud2", sweep.stamp_ns, fields)


def _time(stamp_ns: int) -> dict[str, int]:
    return {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}


def _transform(stamp_ns: int, frame: str, child: str, T: Transform) -> dict[str, object]:
    x, y, z, w = T.quaternion_xyzw()
    return {
        "header": {"stamp": _time(stamp_ns), "frame_id": frame},
        "child_frame_id": child,
        "transform": {
            "translation": {"x": T.x_m, "y": T.y_m, "z": T.z_m},
            "rotation": {"x": x, "y": y, "z": z, "w": w},
        },
    }

"""How landmark maps are shown and written to files."""

from __future__ import annotations

import numpy as np

from mapgraft.contracts import OutputMessage
from mapgraft_landmarks.landmarks import LandmarkMap

_FLOAT32 = 7  # sensor_msgs/PointField.FLOAT32
_CHANNELS = ("x", "y", "z", "sightings", "looks")


def point_cloud(map_: LandmarkMap) -> OutputMessage:
    """The landmarks as ``sensor_msgs/PointCloud2`` with their sightings and looks, at height 0."""
    landmarks = map_.landmarks
    table = np.zeros((len(landmarks), len(_CHANNELS)), "<f4")
    table[:, :2] = landmarks.positions_m
    table[:, 3], table[:, 4] = landmarks.sightings, landmarks.looks
    fields = [
        {"name": name, "offset": 4 * place, "datatype": _FLOAT32, "count": 1} for place, name in enumerate(_CHANNELS)
    ]
    return OutputMessage(
        "landmarks",
        "sensor_msgs/msg/PointCloud2",
        {
            "height": 1,
            "width": len(landmarks),
            "fields": fields,
            "is_bigendian": False,
            "point_step": 4 * len(_CHANNELS),
            "row_step": table.nbytes,
            "data": np.frombuffer(table.tobytes(), np.uint8),
            "is_dense": True,
        },
    )


def csv_file(map_: LandmarkMap) -> bytes:
    """One line per landmark: x and y in metres, sightings, looks."""
    landmarks = map_.landmarks
    lines = ["x_m,y_m,sightings,looks"]
    for (x, y), sightings, looks in zip(landmarks.positions_m, landmarks.sightings, landmarks.looks, strict=True):
        lines.append(f"{x:.3f},{y:.3f},{sightings},{looks}")
    return ("\n".join(lines) + "\n").encode()

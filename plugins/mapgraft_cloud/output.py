"""How point-cloud maps are shown to viewers and written to files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import OutputMessage
from mapgraft_cloud.cloud_map import CloudMap
from mapgraft_cloud.parameters import LOG_ODDS_PER_NAT
from mapgraft_cloud.pcd import Encoding, pcd_bytes
from mapgraft_cloud.ply import ply_bytes

FORMS: Final[Mapping[str, tuple[str, Encoding]]] = {
    "pcd": ("pcd", "binary"),
    "pcd_ascii": ("pcd", "ascii"),
    "ply": ("ply", "binary"),
    "ply_ascii": ("ply", "ascii"),
}
_FLOAT32 = 7  # sensor_msgs/PointField.FLOAT32
_COLUMNS = ("x", "y", "z", "intensity")


def point_cloud(map_: CloudMap) -> OutputMessage:
    """The occupied voxels as ``sensor_msgs/PointCloud2``: their mean points, and the probability as intensity."""
    table = np.column_stack((map_.points_m, probabilities(map_))).astype("<f4")
    fields = [{"name": name, "offset": 4 * i, "datatype": _FLOAT32, "count": 1} for i, name in enumerate(_COLUMNS)]
    return OutputMessage(
        "cloud",
        "sensor_msgs/msg/PointCloud2",
        {
            "height": 1,
            "width": len(table),
            "fields": fields,
            "is_bigendian": False,
            "point_step": 4 * len(_COLUMNS),
            "row_step": table.nbytes,
            "data": np.frombuffer(table.tobytes(), np.uint8),
            "is_dense": True,
        },
    )


def probabilities(map_: CloudMap) -> NDArray[np.float64]:
    """The probability (n,) that an occupied voxel is occupied, in the order of ``points_m``."""
    odds: NDArray[np.float64] = 1.0 / (1.0 + np.exp(-map_.occupied_log_odds() / LOG_ODDS_PER_NAT))
    return odds


def files(map_: CloudMap, stem: str, form: str) -> Mapping[str, bytes]:
    """The mean points of the occupied voxels with their probability as intensity, in one of ``FORMS``."""
    suffix, encoding = FORMS[form]
    write = pcd_bytes if suffix == "pcd" else ply_bytes
    return {f"{stem}.{suffix}": write(map_.points_m, probabilities(map_).astype(np.float32), encoding)}

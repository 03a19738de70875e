"""Clouds in messages: ``sensor_msgs/PointCloud2`` of ROS 1 and 2, ``foxglove.PointCloud`` as protobuf or JSON."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Cloud, RecordingError
from mapgraft_cloud.columns import cloud_of

_ROS: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}  # PointField.datatype
_FOXGLOVE: Final = {1: "u1", 2: "i1", 3: "u2", 4: "i2", 5: "u4", 6: "i4", 7: "f4", 8: "f8"}  # PackedElementField.type
_FOXGLOVE_NAMES: Final = ("UINT8", "INT8", "UINT16", "INT16", "UINT32", "INT32", "FLOAT32", "FLOAT64")
MOST_POINTS: Final = 1 << 28


class _Field(NamedTuple):
    name: str
    offset: int
    kind: str  # of numpy, without the order of bytes
    numbers: int


def point_cloud2(message: Any) -> Cloud:
    """The cloud in a ``PointCloud2`` object: any fields in any order and type, either order of bytes, organised or not.

    Rows may be padded. Points with a coordinate that is not finite, and those exactly in the sensor, are no returns:
    they are left out and counted. Raises RecordingError when
    there is no x, y and z of a known type, or the bytes do not fit the layout.
    """
    order = ">" if message.is_bigendian else "<"
    fields = [_Field(str(f.name), int(f.offset), _kind(_ROS, f.datatype), max(1, int(f.count))) for f in message.fields]
    data = _numbers(message.data)
    layout = _Layout(int(message.point_step), int(message.height), int(message.width), int(message.row_step))
    return _cloud(data, fields, layout, order)


def foxglove_point_cloud(message: Any) -> Cloud:
    """The cloud in a ``foxglove.PointCloud`` object, little-endian; raises RecordingError as ``point_cloud2``."""
    data = _numbers(message.data)
    step = int(message.point_stride)
    fields = [_Field(str(f.name), int(f.offset), _kind(_FOXGLOVE, _foxglove(f.type)), 1) for f in message.fields]
    width = len(data) // step if step > 0 else 0
    return _cloud(data, fields, _Layout(step, 1, width, width * step), "<")


class _Layout(NamedTuple):
    """How many bytes a point and a row take, and how many of them there are."""

    point_step: int
    height: int
    width: int
    row_step: int


def _cloud(data: NDArray[np.uint8], fields: Sequence[_Field], layout: _Layout, order: str) -> Cloud:
    _check(data, fields, layout)
    used = [field for field in fields if field.name in ("x", "y", "z")]
    record = np.dtype(
        {
            "names": [field.name for field in used],
            "formats": [order + field.kind for field in used],
            "offsets": [field.offset for field in used],
            "itemsize": layout.point_step,
        }
    )
    if not layout.height * layout.width:
        points = np.zeros(0, record)
    else:
        rows = np.ndarray((layout.height, layout.width), record, data, strides=(layout.row_step, layout.point_step))
        points = rows.reshape(-1)
    cloud = cloud_of({name: points[name] for name in record.names or ()}, (0.0, 0.0, 0.0))
    _require_metres(cloud, order)
    return cloud


def _check(data: NDArray[np.uint8], fields: Sequence[_Field], layout: _Layout) -> None:
    by_name = {field.name: field for field in fields}
    missing = [axis for axis in "xyz" if axis not in by_name]
    if missing:
        known = ", ".join(by_name) or "none"
        raise RecordingError(f"a cloud needs the fields x, y and z, found no {' and no '.join(missing)} among {known}")
    wrong = [axis for axis in "xyz" if not by_name[axis].kind]
    if wrong:
        raise RecordingError(f"the field {wrong[0]} of a cloud has a type of number that nobody knows")
    if len(by_name) < len(fields):
        raise RecordingError(f"a cloud has two fields of one name among {', '.join(f.name for f in fields)}")
    if layout.height * layout.width > MOST_POINTS:
        raise RecordingError(f"a cloud of {layout.height} × {layout.width} points is not believable: it is broken")
    ends = [f.offset + np.dtype(f.kind).itemsize for f in fields if f.kind]
    if layout.point_step < max(ends) or min(f.offset for f in fields) < 0:
        raise RecordingError(f"a cloud's fields end at byte {max(ends)} of points of {layout.point_step} bytes")
    if layout.height > 1 and layout.row_step < layout.width * layout.point_step:
        raise RecordingError(
            f"a cloud's rows of {layout.width} points of {layout.point_step} bytes do not fit {layout.row_step} bytes"
        )
    needed = (layout.height - 1) * layout.row_step + layout.width * layout.point_step if layout.width else 0
    if layout.height > 0 and len(data) < needed:
        raise RecordingError(
            f"a cloud of {layout.height} × {layout.width} points needs {needed} bytes, has {len(data)}"
        )


def _require_metres(cloud: Cloud, order: str) -> None:
    """Raises RecordingError where most coordinates are what numbers read in the wrong order of bytes look like."""
    if len(cloud.points_m) < _FEW:
        return
    size = np.abs(cloud.points_m).max(axis=1)
    odd = float(np.mean((size > _FARTHEST_M) | ((size > 0) & (size < _NEAREST_M))))
    if odd > 0.5:
        said = "big-endian" if order == ">" else "little-endian"
        raise RecordingError(
            f"{100 * odd:.0f} % of a cloud's points lie nearer than {_NEAREST_M:g} or farther than {_FARTHEST_M:g} m: "
            f"its numbers are probably not {said}, as it says"
        )


_FEW: Final = 8  # points: fewer tell nothing
_NEAREST_M, _FARTHEST_M = 1e-6, 1e7


def _kind(kinds: Mapping[int, str], code: object) -> str:
    """The type of a field; empty for one that nobody knows, which only matters where it is needed."""
    return kinds.get(int(str(code)), "")


def _foxglove(kind: object) -> int:
    """The number of a type that protobuf gives as a number and JSON maybe by its name."""
    if isinstance(kind, str) and kind in _FOXGLOVE_NAMES:
        return _FOXGLOVE_NAMES.index(kind) + 1
    return int(str(kind))


def _numbers(data: Any) -> NDArray[np.uint8]:
    """The bytes of a message's data: an array, bytes, or base64 in JSON."""
    if isinstance(data, np.ndarray):
        return np.ascontiguousarray(data).view(np.uint8)
    return np.frombuffer(base64.b64decode(data, validate=True) if isinstance(data, str) else bytes(data), np.uint8)

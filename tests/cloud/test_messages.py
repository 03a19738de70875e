"""Clouds in messages: any layout of fields, either order of bytes, organised, padded, broken."""

from __future__ import annotations

import base64
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import RecordingError
from mapgraft_cloud.messages import foxglove_point_cloud, point_cloud2

_CODES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}


def cloud2(record: np.dtype[Any], table: np.ndarray, *, big: bool = False, row_padding: int = 0) -> SimpleNamespace:
    """A PointCloud2 object of a (height, width) table whose records are laid out as said."""
    height, width = table.shape
    data = np.zeros((height, width * record.itemsize + row_padding), np.uint8)
    data[:, : width * record.itemsize] = np.ascontiguousarray(table).view(np.uint8).reshape(height, -1)
    fields = [
        SimpleNamespace(name=name, offset=record.fields[name][1], datatype=_CODES[record[name].str[1:]], count=1)
        for name in record.names or ()
    ]
    return SimpleNamespace(
        height=height,
        width=width,
        fields=fields,
        is_bigendian=big,
        point_step=record.itemsize,
        row_step=data.shape[1],
        data=data.reshape(-1),
        is_dense=False,
    )


def table_of(record: np.dtype[Any], points: np.ndarray, height: int = 1) -> np.ndarray:
    table = np.zeros(len(points), record)
    for axis, name in enumerate("xyz"):
        table[name] = points[:, axis]
    return table.reshape(height, -1)


@settings(max_examples=40, deadline=None)
@given(
    kind=st.sampled_from(["f4", "f8", "i2", "i4"]),
    big=st.booleans(),
    order=st.permutations(["x", "y", "z", "other"]),
    gap=st.integers(0, 7),
    padding=st.integers(0, 9),
    height=st.sampled_from([1, 2, 3]),
    seed=st.integers(0, 1000),
)
def test_any_layout_gives_the_same_points(
    kind: str, big: bool, order: list[str], gap: int, padding: int, height: int, seed: int
) -> None:
    points = np.random.default_rng(seed).integers(-900, 900, (height * 4, 3)).astype(float)
    sign, offset, offsets, formats = (">" if big else "<"), gap, [], []
    for name in order:
        formats.append(sign + ("u2" if name == "other" else kind))
        offsets.append(offset)
        offset += np.dtype(formats[-1]).itemsize + gap % 3
    record = np.dtype({"names": order, "formats": formats, "offsets": offsets, "itemsize": offset + gap})
    cloud = point_cloud2(cloud2(record, table_of(record, points, height), big=big, row_padding=padding))
    assert np.array_equal(cloud.points_m, points.astype(np.float32))
    assert cloud.origin_m == (0.0, 0.0, 0.0)


def test_points_that_are_not_finite_are_left_out_and_counted() -> None:
    record = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")])
    table = table_of(record, np.array([[1, 2, 3], [np.nan, 0, 0], [4, 5, np.inf], [7, 8, 9]], float), 2)
    cloud = point_cloud2(cloud2(record, table))
    assert cloud.points_m.tolist() == [[1, 2, 3], [7, 8, 9]]
    assert cloud.dropped == 2


def test_a_cloud_without_points_is_a_cloud() -> None:
    record = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
    assert point_cloud2(cloud2(record, np.zeros((1, 0), record))).points_m.shape == (0, 3)


def test_fields_that_nobody_knows_do_no_harm() -> None:
    record = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("label", "<u2"), ("weird", "<u4")])
    message = cloud2(record, table_of(record, np.ones((3, 3))))
    message.fields[-1].datatype = 77
    assert len(point_cloud2(message).points_m) == 3


def _broken(change: str) -> SimpleNamespace:
    record = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
    message = cloud2(record, table_of(record, np.random.default_rng(0).uniform(1, 9, (12, 3)), 3))
    if change == "no z":
        message.fields[2].name = "height"
    elif change == "type":
        message.fields[0].datatype = 9
    elif change == "short":
        message.data = message.data[:-5]
    elif change == "step":
        message.point_step = 8
    elif change == "rows":
        message.row_step = 20
    elif change == "huge":
        message.width = 1 << 30
    elif change == "twice":
        message.fields[1].name = "x"
    elif change == "order":
        message.is_bigendian = True
    return message


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("no z", "found no z among x, y, height"),
        ("type", "field x of a cloud has a type of number that nobody knows"),
        ("short", "needs 144 bytes, has 139"),
        ("step", "fields end at byte 12 of points of 8 bytes"),
        ("rows", "do not fit 20 bytes"),
        ("huge", "not believable"),
        ("twice", "no y"),
        ("order", "probably not big-endian, as it says"),
    ],
)
def test_broken_clouds_say_what_is_wrong(change: str, said: str) -> None:
    with pytest.raises(RecordingError, match=said):
        point_cloud2(_broken(change))


@pytest.mark.parametrize("as_json", [False, True])
def test_foxglove_clouds_as_protobuf_and_json_have_them(as_json: bool) -> None:
    table = np.zeros(5, [("x", "<f4"), ("y", "<f4"), ("z", "<f8"), ("red", "u1"), ("green", "u1"), ("blue", "u1")])
    table["x"], table["z"], table["green"] = np.arange(5), 2.5, 7
    kinds = ("FLOAT32", "FLOAT32", "FLOAT64", "UINT8", "UINT8", "UINT8") if as_json else (7, 7, 8, 1, 1, 1)
    assert table.dtype.fields is not None
    fields = [
        SimpleNamespace(name=name, offset=table.dtype.fields[name][1], type=kind)
        for name, kind in zip(table.dtype.names or (), kinds, strict=True)
    ]
    data = table.tobytes()
    message = SimpleNamespace(
        point_stride=table.itemsize, fields=fields, data=base64.b64encode(data).decode() if as_json else data
    )
    cloud = foxglove_point_cloud(message)
    assert cloud.points_m.tolist() == [[k, 0, 2.5] for k in range(5)]

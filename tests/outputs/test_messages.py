"""Messages from plain values: defaults, headers, definitions, and what does not fit."""

from __future__ import annotations

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from mapgraft.errors import OutputError, PluginError
from mapgraft.outputs.messages import MERGE_EVENT, MessageEncoder

GRID = "nav_msgs/msg/OccupancyGrid"
MARKERS = "visualization_msgs/msg/MarkerArray"
STAMP_NS = 12_000_000_034


@pytest.fixture(scope="module")
def encoder() -> MessageEncoder:
    return MessageEncoder()


def test_headers_times_and_defaults_are_filled_in(encoder: MessageEncoder) -> None:
    data = encoder.encode(GRID, {"data": [-1, 0, 100], "info": {"resolution": 0.25, "width": 3}}, STAMP_NS, "a/map")
    grid = encoder.decode(GRID, data)
    assert (grid.header.frame_id, grid.header.stamp.sec, grid.header.stamp.nanosec) == ("a/map", 12, 34)
    assert (grid.info.map_load_time.sec, grid.info.width, grid.info.height, grid.info.resolution) == (12, 3, 0, 0.25)
    assert grid.info.origin.orientation.w == 1.0
    assert grid.data.tolist() == [-1, 0, 100]


def test_nested_lists_get_headers_too(encoder: MessageEncoder) -> None:
    fields = {"markers": [{"ns": "one", "points": [{"x": 1.0}, {"y": 2.0}]}, {"header": {"frame_id": "other"}}]}
    markers = encoder.decode(MARKERS, encoder.encode(MARKERS, fields, STAMP_NS, "world")).markers
    assert [m.header.frame_id for m in markers] == ["world", "other"]
    assert markers[1].header.stamp.nanosec == 34
    assert [(p.x, p.y) for p in markers[0].points] == [(1.0, 0.0), (0.0, 2.0)]


def test_arrays_of_any_shape_are_written_row_major(encoder: MessageEncoder) -> None:
    cells = np.array([[1, 2], [3, 4]], dtype=np.int8)
    for data in (cells, np.asfortranarray(cells), cells.tolist(), cells.astype(np.int64)):
        assert encoder.decode(GRID, encoder.encode(GRID, {"data": data}, 0, "")).data.tolist() == [1, 2, 3, 4]


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"dada": []}, "has no field dada"),
        ({"info": {"resolution_m": 0.1}}, "has no field resolution_m"),
        ({"info": 3}, "needs a mapping of its fields, found a int"),
        ({"data": [0.5]}, "float64 does not fit int8"),
        ({"info": {"width": "wide"}}, "does not fit its field"),
        ({"info": {"width": -1}}, "does not fit its field"),
    ],
)
def test_what_does_not_fit_is_said(encoder: MessageEncoder, fields: dict[str, object], sentence: str) -> None:
    with pytest.raises(PluginError, match=sentence):
        encoder.encode(GRID, fields, 0, "map")


def test_unknown_types_and_impossible_stamps_are_said(encoder: MessageEncoder) -> None:
    with pytest.raises(PluginError, match="no message type 'my/msg/Own'"):
        encoder.encode("my/msg/Own", {}, 0, "map")
    for stamp_ns in (-1, 2**31 * 10**9):
        with pytest.raises(OutputError, match="does not fit a ROS message"):
            encoder.encode(GRID, {}, stamp_ns, "map")


@pytest.mark.parametrize("name", [MERGE_EVENT, GRID, MARKERS])
def test_definitions_stand_alone(encoder: MessageEncoder, name: str) -> None:
    text = encoder.definition(name)
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, name))
    fields = {"reason": "why"} if name == MERGE_EVENT else {}
    assert store.deserialize_cdr(encoder.encode(name, fields, 5, "map"), name) is not None


def test_our_definition_carries_its_comments(encoder: MessageEncoder) -> None:
    assert "# p_receiver = T_receiver_donor p_donor" in encoder.definition(MERGE_EVENT)
    assert "# NaN when there is too little to measure" in encoder.definition(MERGE_EVENT)

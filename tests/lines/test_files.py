"""Line maps in files and messages: what is written reads back, and what is wrong says so."""

from __future__ import annotations

import json
import math
import xml.etree.ElementTree as ET

import numpy as np
import pytest
import zstandard

from mapgraft.contracts import ConfigError, Contribution, MapError, Observation, Provenance, Transform
from mapgraft.outputs.messages import MessageEncoder
from mapgraft_lines.geojson_file import read
from mapgraft_lines.map_type import SEGMENTS, LineSegments

KIND = LineSegments()
NOWHERE = Transform.identity()


def mapped(observations):
    layer = KIND.new_layer()
    for observation in observations:
        KIND.integrate(layer, observation)
    return layer


def merged(office):
    own, donor = mapped(office[:40]), KIND.place(mapped(office[25:80]), Transform.planar(0.1, 0.05, 0.01))
    given = Contribution(Provenance("bob", 1, 1), donor, NOWHERE, 1.0, "test", 1, None, KIND.region(donor))
    return KIND.view(own, [given])


def test_what_is_written_reads_back(office, tmp_path):
    seen = KIND.view(mapped(office[:60]))
    path = tmp_path / "office.lines.geojson"
    path.write_bytes(KIND.files(seen, "office")[path.name])
    layer = KIND.new_layer()
    KIND.integrate(layer, Observation("file", 0, 0, path.name, SEGMENTS, read(path), NOWHERE, NOWHERE))
    again = KIND.view(layer)
    assert again.walls.lengths_m.sum() == pytest.approx(seen.walls.lengths_m.sum(), rel=0.01)
    assert len(again.walls) == pytest.approx(len(seen.walls), rel=0.1)
    assert again.walls.sigma_m[:10].mean() == pytest.approx(seen.walls.sigma_m[:10].mean(), rel=0.3)
    assert abs(again.known() - seen.known()) < 0.05 * seen.known()


def test_a_newer_map_takes_the_place_of_the_older(tmp_path):
    layer = KIND.new_layer()
    for length in (3.0, 5.0):
        path = tmp_path / "a.geojson"
        path.write_text(json.dumps(lines([[[0.0, 0.0], [length, 0.0]]])))
        KIND.integrate(layer, Observation("a", 0, 0, "a", SEGMENTS, read(path), NOWHERE, NOWHERE))
    assert layer.observations == 2 and layer.mapper == "ready map"
    assert KIND.view(layer).walls.lengths_m.tolist() == pytest.approx([5.0], abs=0.01)


def test_a_merged_map_links_the_segments_of_both_sides(office):
    fused = merged(office)
    document = json.loads(KIND.files(fused, "m")["m.lines.geojson"])
    by_kind = {}
    for feature in document["features"]:
        by_kind.setdefault(feature["properties"]["kind"], []).append(feature)
    walls = {feature["id"] for feature in by_kind["wall"]}
    assert len(by_kind["own"]) == len(fused.side("own")) and len(by_kind["received"]) == len(fused.side("received"))
    linked = [feature["properties"]["walls"] for side in ("own", "received") for feature in by_kind[side]]
    assert all(set(on) <= walls for on in linked) and np.mean([bool(on) for on in linked]) > 0.9
    shared = [f for f in by_kind["wall"] if 0.0 < f["properties"]["own_share"] < 1.0]
    assert len(shared) > 5  # both sides lie on them


def test_messages_can_be_written_to_a_recording(office):
    encoder = MessageEncoder()
    for seen, names in ((KIND.view(mapped(office[:20])), ["walls", "free"]), (merged(office), None)):
        (message,) = KIND.messages(seen)
        data = encoder.encode(message.message_type, message.fields, 5, "map")
        markers = encoder.decode(message.message_type, data).markers
        assert [marker.ns for marker in markers] == (names or ["walls", "own", "received", "free"])
        assert len(markers[0].points) == 2 * len(seen.walls)
        assert {marker.header.frame_id for marker in markers} == {"map"}
    assert not list(KIND.messages(KIND.view(None)))


def test_the_drawing_is_valid_and_y_goes_up(office):
    root = ET.fromstring(KIND.files(merged(office), "m")["m.lines.svg"])
    assert root.tag.endswith("svg")
    width, height = map(float, root.attrib["viewBox"].split()[2:])
    assert min(width, height) > 5.0
    assert root.find("{*}g").attrib["transform"] == "scale(1 -1)"


def lines(coordinates, **more):
    features = [{"type": "Feature", "geometry": {"type": "LineString", "coordinates": c}} for c in coordinates]
    return {"type": "FeatureCollection", "features": features} | more


def test_walls_that_others_have_drawn_are_read(tmp_path):
    path = tmp_path / "plan.geojson"
    square = [[0, 0, 1.5], [4, 0, 1.5], [4, 3, 1.5], [0, 3, 1.5], [0, 0, 1.5]]
    shapes = [
        {"type": "Polygon", "coordinates": [square]},
        {"type": "MultiLineString", "coordinates": [[[1, 1], [2, 1]], [[1, 2], [2, 2]]]},
        {"type": "Point", "coordinates": [0, 0]},
        None,
    ]
    features = [{"type": "Feature", "properties": None, "geometry": shape} for shape in shapes]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    found = read(path, sigma_m=0.05)
    assert found.points_m.shape == (6, 2, 2)
    assert set(found.sigma_m.tolist()) == {0.05} and not found.faced.any() and not len(found.free_m)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("no json", "is no GeoJSON"),
        ("[]", "no GeoJSON FeatureCollection"),
        (json.dumps(lines([])), "holds no line"),
        (json.dumps(lines([[[0.0, 0.0]]])), "a line has two"),
        (json.dumps(lines([[[0.0, 0.0], ["a", 1.0]]])), "no list of x, y"),
        (json.dumps(lines([[[0.0, 0.0], [math.inf, 1.0]]])), "a line has two"),
        (json.dumps(lines([[[24.10512, 56.94965], [24.10523, 56.94967]]])), "in degrees probably"),
        (json.dumps(lines([[[0.0, 0.0], [5.0, 1.0]]], crs="EPSG:4326")), "in degrees probably"),
        (json.dumps({"type": "FeatureCollection", "features": [3]}), "without geometry"),
    ],
)
def test_files_that_are_wrong_say_so(tmp_path, content, said):
    path = tmp_path / "x.geojson"
    path.write_text(content)
    with pytest.raises(MapError, match=said):
        read(path)


def test_free_space_without_bounds_is_refused(tmp_path):
    path = tmp_path / "x.geojson"
    ring = [[0, 0], [1e9, 0], [1e9, 1e9], [0, 1e9], [0, 0]]
    geometry = {"type": "MultiPolygon", "coordinates": [[ring]]}
    free = {"type": "Feature", "properties": {"kind": "free", "cell_m": 0.25}, "geometry": geometry}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [free]}))
    with pytest.raises(MapError, match="cells of free space"):
        read(path)
    with pytest.raises(MapError, match="cannot be read"):
        read(tmp_path / "missing.geojson")
    with pytest.raises(ConfigError, match="sigma_m"):
        read(path, sigma_m=3.0)


@pytest.mark.parametrize("cut", [0, 5, 9, 40, -1])
def test_damaged_bytes_are_refused(office, cut):
    data = KIND.encode(mapped(office[:10]))
    assert KIND.encode(KIND.decode(data)) == data
    with pytest.raises(MapError):
        KIND.decode(data[:cut])
    with pytest.raises(MapError):
        KIND.decode(data + b"x")
    with pytest.raises(MapError):
        KIND.decode(b"MGLINES\x02\x00" + data[9:])


@pytest.mark.parametrize(
    "told", [{"rows": [math.inf, 0, 0, 0]}, {"cell_m": 1e-300}, {"cell_m": 0.3}, {"observations": math.inf}]
)
def test_a_head_that_nobody_would_write_is_refused(told):
    head = {"cell_m": 0.25, "mapper": "", "observations": 0, "rows": [0, 0, 0, 0], "sensors": []}
    packed = [
        zstandard.ZstdCompressor(level=3, write_checksum=True).compress(json.dumps(h).encode() + b"\n")
        for h in (head, head | told)
    ]
    assert KIND.decode(b"MGLINES\x01\x00" + packed[0]).observations == 0
    with pytest.raises(MapError, match="is damaged"):
        KIND.decode(b"MGLINES\x01\x00" + packed[1])

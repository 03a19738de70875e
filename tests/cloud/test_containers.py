"""Clouds in files of all kinds: ROS 1 bags, and Foxglove's messages as JSON and protobuf in MCAP."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer
from rosbags.rosbag1 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

from mapgraft.config import parse_config
from mapgraft.contracts import CLOUD, Cloud
from mapgraft.plugins import load_plugins
from mapgraft.recording.mission import open_mission

POINTS = np.array([[1.0, 2.0, 0.5], [3.0, -1.0, 0.25], [0.5, 0.5, 1.0]], np.float32)
FRAMES = [("map", "base_link", (4.0, 5.0, 0.0)), ("base_link", "lidar", (0.0, 0.0, 0.6))]
S = 10**9


def clouds_in(path: Path) -> list[tuple[Cloud, Any]]:
    """The clouds of a recording with where they were seen from."""
    with open_mission([path], parse_config({}), plugins=load_plugins()) as mission:
        found = []
        for seen in mission.observations():
            assert seen.kind == CLOUD
            assert isinstance(seen.payload, Cloud)
            found.append((seen.payload, seen.T_map_sensor))
        return found


def test_ros1_bags(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    types: dict[str, Any] = dict(store.types)
    path = tmp_path / "ada.bag"

    def header(stamp_ns: int, frame: str) -> Any:
        time = types["builtin_interfaces/msg/Time"](sec=stamp_ns // S, nanosec=stamp_ns % S)
        return types["std_msgs/msg/Header"](seq=0, stamp=time, frame_id=frame)

    def transform(stamp_ns: int, frame: str, child: str, xyz: tuple[float, float, float]) -> Any:
        move = types["geometry_msgs/msg/Transform"](
            translation=types["geometry_msgs/msg/Vector3"](*xyz),
            rotation=types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
        )
        return types["geometry_msgs/msg/TransformStamped"](header(stamp_ns, frame), child, move)

    with BagWriter(path) as bag:
        tf = bag.add_connection("/tf", "geometry_msgs/msg/TransformStamped", typestore=store)
        points = bag.add_connection("/points", "sensor_msgs/msg/PointCloud2", typestore=store)
        field = types["sensor_msgs/msg/PointField"]
        fields = [field(name=name, offset=4 * k, datatype=7, count=1) for k, name in enumerate("xyz")]
        for k in range(4):
            stamp_ns = (100 + k) * S
            for frame in FRAMES:
                data = store.serialize_ros1(transform(stamp_ns, *frame), "geometry_msgs/msg/TransformStamped")
                bag.write(tf, stamp_ns, data)
            cloud = types["sensor_msgs/msg/PointCloud2"](
                header=header(stamp_ns, "lidar"),
                height=1,
                width=3,
                fields=fields,
                is_bigendian=True,
                point_step=12,
                row_step=36,
                data=np.frombuffer(POINTS.astype(">f4").tobytes(), np.uint8),
                is_dense=True,
            )
            bag.write(points, stamp_ns, store.serialize_ros1(cloud, "sensor_msgs/msg/PointCloud2"))
    found = clouds_in(path)
    assert len(found) == 4
    for cloud, T_map_sensor in found:
        assert np.array_equal(cloud.points_m, POINTS)
        assert T_map_sensor.matrix[:3, 3].tolist() == [4.0, 5.0, 0.6]


def foxglove_messages() -> list[tuple[str, str, int, dict[str, Any]]]:
    """Topic, type, stamp and fields; the cloud lies a little above its frame."""
    messages: list[tuple[str, str, int, dict[str, Any]]] = []
    for k in range(3):
        stamp = {"sec": 100 + k, "nsec": 0}
        for frame, child, (x, y, z) in FRAMES:
            fields = {
                "timestamp": stamp,
                "parent_frame_id": frame,
                "child_frame_id": child,
                "translation": {"x": x, "y": y, "z": z},
                "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
            }
            messages.append(("/tf", "foxglove.FrameTransform", (100 + k) * S, fields))
        pose = {"position": {"x": 0.0, "y": 0.0, "z": 0.1}, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
        cloud = {
            "timestamp": stamp,
            "frame_id": "lidar",
            "pose": pose,
            "point_stride": 12,
            "fields": [{"name": name, "offset": 4 * n, "type": 7} for n, name in enumerate("xyz")],
            "data": base64.b64encode(POINTS.tobytes()).decode(),
        }
        messages.append(("/points", "foxglove.PointCloud", (100 + k) * S, cloud))
    return messages


def test_foxglove_json(tmp_path: Path) -> None:
    path = tmp_path / "ada.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channels: dict[str, int] = {}
        for topic, kind, stamp_ns, fields in foxglove_messages():
            if topic not in channels:
                schema = writer.register_schema(kind, "jsonschema", b"{}")
                channels[topic] = writer.register_channel(topic, "json", schema)
            writer.add_message(channels[topic], stamp_ns, json.dumps(fields).encode(), stamp_ns)
        writer.finish()
    _check(clouds_in(path))


def test_foxglove_protobuf(tmp_path: Path) -> None:
    pytest.importorskip("mcap_protobuf", reason="needs the extra foxglove")
    from google.protobuf import descriptor_pb2, descriptor_pool, json_format, message_factory

    pool, file = descriptor_pool.DescriptorPool(), descriptor_pb2.FileDescriptorProto()
    _describe(file)
    pool.Add(file)
    data = descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString()
    path = tmp_path / "ada.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channels: dict[str, int] = {}
        for topic, kind, stamp_ns, fields in foxglove_messages():
            if topic not in channels:
                schema = writer.register_schema(kind, "protobuf", data)
                channels[topic] = writer.register_channel(topic, "protobuf", schema)
            made = message_factory.GetMessageClass(pool.FindMessageTypeByName(kind))()
            json_format.ParseDict(_times_as_numbers(fields), made)
            writer.add_message(channels[topic], stamp_ns, made.SerializeToString(), stamp_ns)
        writer.finish()
    _check(clouds_in(path))


def _times_as_numbers(fields: dict[str, Any]) -> dict[str, Any]:
    stamp = fields["timestamp"]
    return {**fields, "timestamp": {"seconds": stamp["sec"], "nanos": stamp["nsec"]}}


def _describe(file: Any) -> None:
    """The parts of Foxglove's schemas that the messages use, in one file."""
    file.name, file.package, file.syntax = "clouds.proto", "foxglove", "proto3"
    kinds = {"double": 1, "uint32": 13, "int64": 3, "int32": 5, "string": 9, "bytes": 12}

    def message(called: str, **fields: str) -> None:
        made = file.message_type.add(name=called)
        for number, (field, kind) in enumerate(fields.items(), start=1):
            repeated = kind.startswith("*")
            added = made.field.add(name=field, number=number, label=3 if repeated else 1)
            if (bare := kind.removeprefix("*")) in kinds:
                added.type = kinds[bare]
            else:
                added.type, added.type_name = 11, f".foxglove.{bare}"

    message("Stamp", seconds="int64", nanos="int32")
    message("Vector3", x="double", y="double", z="double")
    message("Quaternion", x="double", y="double", z="double", w="double")
    message("Pose", position="Vector3", orientation="Quaternion")
    message("PackedElementField", name="string", offset="uint32", type="int32")
    message(
        "FrameTransform",
        timestamp="Stamp",
        parent_frame_id="string",
        child_frame_id="string",
        translation="Vector3",
        rotation="Quaternion",
    )
    message(
        "PointCloud",
        timestamp="Stamp",
        frame_id="string",
        pose="Pose",
        point_stride="uint32",
        fields="*PackedElementField",
        data="bytes",
    )


def _check(found: list[tuple[Cloud, Any]]) -> None:
    assert len(found) == 3
    for cloud, T_map_sensor in found:
        assert np.array_equal(cloud.points_m, POINTS)
        assert np.allclose(T_map_sensor.matrix[:3, 3], [4.0, 5.0, 0.7])

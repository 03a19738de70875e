"""What MCAP files may hold: both ROS, IDL, JSON, protobuf, and several versions of one message."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from mapgraft.errors import RecordingError, UsageError
from mapgraft.recording.containers.mcap_file import McapSource

IDL = """\
================================================================================
IDL: lab_msgs/msg/Beacon
#include "builtin_interfaces/msg/Time.idl"
module lab_msgs { module msg {
  struct Beacon { builtin_interfaces::msg::Time stamp; double range_m; sequence<float> levels; };
}; };
================================================================================
IDL: builtin_interfaces/msg/Time
module builtin_interfaces { module msg {
  struct Time { int32 sec; uint32 nanosec; };
}; };
"""


def test_both_ros_and_json_in_one_file_that_others_refuse(write_mcap: Any, ros2_scans: Any, ros1_scans: Any) -> None:
    def sample(encoding: str, schema: Any, log_ns: int, data: bytes) -> Any:
        return ros2_scans.sample(0)._replace(
            topic=f"/{encoding}", encoding=encoding, schema=schema, log_ns=log_ns, data=data
        )

    chunk = [
        ros2_scans.sample(1, "/two"),
        ros1_scans.sample(2, "/one"),
        sample("json", ("status", "jsonschema", b"{}"), 3, b'{"battery": {"volts": [12.5, 12.4]}}'),
        sample("flatbuffer", ("x.Y", "flatbuffer", b"?"), 4, b"?"),
        sample("cdr", None, 5, b"?"),
        sample("ros1", ("a/B", "ros2msg", b"int32 x"), 6, b"?"),
    ]
    path = write_mcap([chunk], profile="")
    with pytest.raises(Exception, match=r"(?i)profile"):
        Reader(path).open()
    source = McapSource(path)
    reasons = {channel.topic: channel.why_not for channel in source.channels}
    assert reasons == {
        "/two": "",
        "/one": "",
        "/json": "",
        "/flatbuffer": "the encoding 'flatbuffer' is unknown here",
        "/cdr": "its cdr messages have no schema",
        "/ros1": "a schema of kind 'ros2msg' does not go with ros1 messages",
    }
    messages = {message.channel.topic: message for message in source.messages()}
    assert sorted(messages) == ["/json", "/one", "/two"]
    status: Any = source.decode(messages["/json"])
    assert status.battery.volts == [12.5, 12.4]
    for topic, store in (("/two", ros2_scans), ("/one", ros1_scans)):
        scan, message = source.decode_scan(messages[topic]), source.decode(messages[topic])
        assert type(message).__name__ == type(store.message(0, [])).__name__
        assert scan.frame_id == "laser"
        assert len(scan.ranges_m) == 40


def test_idl_definitions(write_mcap: Any, ros2_scans: Any) -> None:
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_idl("\n".join(IDL.splitlines()[3:6])))
    kind = "lab_msgs/msg/Beacon"
    stamp = store.types["builtin_interfaces/msg/Time"](sec=3, nanosec=4)
    beacon = store.types[kind](stamp=stamp, range_m=2.5, levels=np.array([1, 2], np.float32))
    sample = ros2_scans.sample(9)._replace(
        schema=(kind, "ros2idl", IDL.encode()), data=bytes(store.serialize_cdr(beacon, kind)), topic="/beacon"
    )
    source = McapSource(write_mcap([[sample]]))
    (message,) = source.messages()
    decoded: Any = source.decode(message)
    assert (decoded.stamp.sec, decoded.range_m, decoded.levels.tolist()) == (3, 2.5, [1.0, 2.0])


def test_two_versions_of_one_message(write_mcap: Any, ros2_scans: Any) -> None:
    def beacon(topic: str, text: bytes, data: bytes, log_ns: int) -> Any:
        return ros2_scans.sample(log_ns)._replace(
            topic=topic, schema=("lab_msgs/msg/Beacon", "ros2msg", text), data=data
        )

    head = b"\x00\x01\x00\x00"
    chunk = [
        beacon("/old", b"int32 id\n", head + (7).to_bytes(4, "little"), 1),
        beacon("/new", b"int32 id\nint32 level\n", head + (8).to_bytes(4, "little") + (9).to_bytes(4, "little"), 2),
    ]
    source = McapSource(write_mcap([chunk]))
    decoded: list[Any] = [source.decode(message) for message in source.messages()]
    assert (decoded[0].id, decoded[1].id, decoded[1].level) == (7, 8, 9)
    assert not hasattr(decoded[0], "level")


def test_scans_with_an_unusual_definition_take_the_general_way(write_mcap: Any, ros2_scans: Any) -> None:
    name, encoding, text = ros2_scans.schema
    wider = text.replace(b"float32 range_max\n", b"float32 range_max\nfloat32 tilt\n", 1)
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(wider.decode(), name))
    plain = ros2_scans.message(5, [1.0, 2.0])
    fields = {field: getattr(plain, field) for field in plain.__dataclass_fields__ if field != "__msgtype__"}
    data = bytes(store.serialize_cdr(store.types[name](**fields, tilt=0.25), name))
    sample = ros2_scans.sample(5)._replace(schema=(name, encoding, wider), data=data)
    source = McapSource(write_mcap([[sample]]))
    (recorded,) = source.scans()
    assert recorded.scan.ranges_m.tolist() == [1.0, 2.0]
    assert recorded.scan.range_max_m == 30.0


def test_a_definition_that_cannot_be_parsed(write_mcap: Any, ros2_scans: Any) -> None:
    broken = ros2_scans.sample(1)._replace(schema=("sensor_msgs/msg/LaserScan", "ros2msg", b"float32 [[[ oops"))
    source = McapSource(write_mcap([[broken]]))
    (message,) = source.messages()
    with pytest.raises(RecordingError, match=r"definition of sensor_msgs/msg/LaserScan .* cannot be parsed"):
        source.decode(message)
    assert list(source.scans()) == []
    assert source.faults.count("scan_undecodable") == 1


def test_a_definition_cannot_run_code(write_mcap: Any, ros2_scans: Any, tmp_path: Any) -> None:
    """Type names become Python code inside the decoder, so what is no name is refused."""
    trap = tmp_path / "sprung"
    name = f"a/msg/B:\n  open({str(trap)!r}, 'w')\nclass C"
    source = McapSource(write_mcap([[ros2_scans.sample(1)._replace(schema=(name, "ros2msg", b"int32 x"))]]))
    (message,) = source.messages()
    with pytest.raises(RecordingError, match="cannot be the name of a message type"):
        source.decode(message)
    assert not trap.exists()


def test_types_that_are_only_named_come_from_the_typestore(write_mcap: Any, ros2_scans: Any) -> None:
    named = ros2_scans.sample(1)._replace(schema=("sensor_msgs/msg/LaserScan", "ros2msg", b""))
    strange = ros2_scans.sample(2, "/strange")._replace(schema=("lab_msgs/msg/Beacon", "ros2msg", b""))
    path = write_mcap([[named, strange]])
    source = McapSource(path)
    assert len(list(source.scans())) == 1
    (undecodable,) = (channel for channel in source.channels if not channel.decodable)
    assert undecodable.why_not == "its definition is neither in the recording nor in the typestore 'ros2_humble'"
    with pytest.raises(UsageError, match="no typestore 'ros2_bumble': choose one of"):
        McapSource(path, typestore="ros2_bumble")


def foxglove_scan_json(**fields: Any) -> bytes:
    scan = {
        "timestamp": {"sec": 3, "nsec": 5},
        "frame_id": "lidar",
        "pose": {"position": {"x": 0, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}},
        "start_angle": -1.0,
        "end_angle": 1.0,
        "ranges": [1.0, 2.5, None],
        "intensities": [],
    }
    return json.dumps(scan | fields).encode()


def test_foxglove_scans_in_json(write_mcap: Any, ros2_scans: Any) -> None:
    turned = {"position": {"x": 1, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 1, "w": 1}}
    datas = [foxglove_scan_json(), foxglove_scan_json(pose=turned), foxglove_scan_json(ranges="?"), b"{"]
    schema = ("foxglove.LaserScan", "jsonschema", b"{}")
    base = ros2_scans.sample(0)._replace(encoding="json", schema=schema)
    source = McapSource(write_mcap([[base._replace(log_ns=n, data=data) for n, data in enumerate(datas)]]))
    first, second = (recorded.scan for recorded in source.scans())
    assert source.channels[0].message_type == "foxglove/msg/LaserScan"
    assert (first.stamp_ns, first.frame_id, first.angle_min_rad, first.angle_increment_rad) == (
        3 * 10**9 + 5,
        "lidar",
        -1,
        1,
    )
    assert first.ranges_m[:2].tolist() == [1.0, 2.5]
    assert math.isnan(first.ranges_m[2])
    assert first.T_frame_sensor is None
    assert second.T_frame_sensor is not None
    assert second.T_frame_sensor.yaw_rad == pytest.approx(math.pi / 2)
    assert source.faults.count("scan_undecodable") == 2


def test_foxglove_scans_in_protobuf(write_mcap: Any, ros2_scans: Any) -> None:
    pytest.importorskip("mcap_protobuf", reason="needs mcap-protobuf-support (the extra 'foxglove')")
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    file = descriptor_pb2.FileDescriptorProto(name="scan.proto", package="foxglove", syntax="proto3")
    numbers = descriptor_pb2.FieldDescriptorProto

    def message(name: str, **fields: Any) -> None:
        added = file.message_type.add(name=name)
        for n, (field, kind) in enumerate(fields.items(), 1):
            label = numbers.LABEL_REPEATED if field == "ranges" else numbers.LABEL_OPTIONAL
            if isinstance(kind, str):
                added.field.add(name=field, number=n, type=numbers.TYPE_MESSAGE, label=label, type_name=kind)
            else:
                added.field.add(name=field, number=n, type=kind, label=label)

    double = numbers.TYPE_DOUBLE
    message("Time", seconds=numbers.TYPE_INT64, nanos=numbers.TYPE_INT32)
    message("Vector3", x=double, y=double, z=double)
    message("Quaternion", x=double, y=double, z=double, w=double)
    message("Pose", position=".foxglove.Vector3", orientation=".foxglove.Quaternion")
    message(
        "LaserScan",
        timestamp=".foxglove.Time",
        frame_id=numbers.TYPE_STRING,
        pose=".foxglove.Pose",
        start_angle=double,
        end_angle=double,
        ranges=double,
    )
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    scan_class = message_factory.GetMessageClass(pool.FindMessageTypeByName("foxglove.LaserScan"))
    scan = scan_class(frame_id="lidar", start_angle=0.0, end_angle=1.0, ranges=[1.0, math.inf, 3.0])
    scan.timestamp.seconds, scan.timestamp.nanos = 4, 6
    schema = ("foxglove.LaserScan", "protobuf", descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString())
    sample = ros2_scans.sample(1)._replace(encoding="protobuf", schema=schema, data=scan.SerializeToString())
    source = McapSource(write_mcap([[sample, sample._replace(data=b"\xff\xff", log_ns=2)]]))
    (recorded,) = source.scans()
    assert recorded.scan.stamp_ns == 4 * 10**9 + 6
    assert recorded.scan.ranges_m.tolist() == [1.0, math.inf, 3.0]
    assert recorded.scan.angle_increment_rad == 0.5
    assert recorded.scan.T_frame_sensor is None
    assert source.faults.count("scan_undecodable") == 1
